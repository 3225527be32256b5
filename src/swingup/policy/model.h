/*
 * Angles, and the model of the plant: the estimator's, which an identifier may change, and the guard's.
 */
#ifndef SWINGUP_MODEL_H
#define SWINGUP_MODEL_H

#include "numbers.h"

#if SWINGUP_HAS_ESTIMATOR || SWINGUP_HAS_REGULATOR || SWINGUP_HAS_GUARD || SWINGUP_HAS_FEEDBACK
/* An angle's distance (rad) without whole turns. */
static inline double swingup_turned(double angle)
{
    return angle - 2.0 * SWINGUP_PI * swingup_rint(angle / (2.0 * SWINGUP_PI));
}
#endif

#if SWINGUP_HAS_ESTIMATOR || SWINGUP_HAS_GUARD
typedef struct {
    double m11, m12, m22, coupling, gravity1, gravity2; /* of the mass matrix (kg m^2) and of gravity (N m) */
    const double *damping, *coulomb;                    /* friction of both joints (N m s/rad, N m) */
    const double *load;                                 /* constant torques against them, then springs; 0 for none */
} swingup_plant;

/* The plant with these base parameters, and friction: damping of both joints, then Coulomb friction. */
static inline void swingup_believe(swingup_plant *p, const double base[9], const double friction[4])
{
    const double geared = SWINGUP_GEAR * base[8], reflected = SWINGUP_GEAR * geared;
    p->m11 = base[0] + reflected + base[8];
    p->m12 = base[1] - geared;
    p->m22 = base[1] + reflected;
    p->coupling = SWINGUP_L1 * base[2];
    p->gravity1 = SWINGUP_GRAVITY * base[3];
    p->gravity2 = SWINGUP_GRAVITY * base[2];
    p->damping = friction;
    p->coulomb = friction + 2;
    p->load = 0;
}

/*
 * Accelerations (rad/s^2) under torques (N m). Friction is linear about the rates of x and acts on
 * those at the end of a step of h (s) that starts with the rates first[2].
 */
static inline void swingup_acceleration(
    const swingup_plant *p, const double x[4], const double u[2], const double *first, double h, double a[2])
{
    const double cosine = p->coupling * cos(x[1]), sine = p->coupling * sin(x[1]);
    const double weight = p->gravity2 * sin(x[0] + x[1]), m12 = p->m12 + cosine;
    double m[2], f[2], determinant;
    int i;
    m[0] = p->m11 + 2.0 * cosine;
    m[1] = p->m22;
    f[0] = u[0] - p->gravity1 * sin(x[0]) - weight + sine * x[3] * (2.0 * x[2] + x[3]);
    f[1] = u[1] - weight - sine * x[2] * x[2];
    for (i = 0; i < 2; i++) {
        const double steep = SWINGUP_STEEPNESS * x[i + 2];
        const double slope = p->damping[i] + SWINGUP_STEEPNESS * p->coulomb[i] / (1.0 + steep * steep);
        f[i] -= p->damping[i] * x[i + 2] + p->coulomb[i] * atan(steep) - slope * (x[i + 2] - first[i]);
        m[i] += h * slope;
    }
    determinant = m[0] * m[1] - m12 * m12;
    a[0] = (m[1] * f[0] - m12 * f[1]) / determinant;
    a[1] = (m[0] * f[1] - m12 * f[0]) / determinant;
}

/* One step over h (s), in place, of the midpoint rule with implicit friction; without friction it is explicit. */
static inline void swingup_step(const swingup_plant *p, double x[4], double torque, double h)
{
    double a[2], middle[4], u[2] = {0.0, 0.0};
    int i;
    for (i = 0; i < 2 && p->load; i++) {
        u[i] = -p->load[i] - p->load[i + 2] * x[i];
    }
    u[SWINGUP_DRIVEN] += torque;
    swingup_acceleration(p, x, u, x + 2, 0.5 * h, a);
    middle[0] = x[0] + 0.5 * h * x[2];
    middle[1] = x[1] + 0.5 * h * x[3];
    middle[2] = x[2] + 0.5 * h * a[0];
    middle[3] = x[3] + 0.5 * h * a[1];
    swingup_acceleration(p, middle, u, x + 2, h, a);
    x[0] += h * middle[2];
    x[1] += h * middle[3];
    x[2] += h * a[0];
    x[3] += h * a[1];
}

/* What one N m on the driven joint adds to the accelerations (rad/s^2) at the angles of x. */
static inline void swingup_response(const swingup_plant *p, const double x[4], double response[2])
{
    const double cosine = p->coupling * cos(x[1]);
    const double m11 = p->m11 + 2.0 * cosine, m12 = p->m12 + cosine, determinant = m11 * p->m22 - m12 * m12;
    response[SWINGUP_DRIVEN] = (SWINGUP_DRIVEN == 0 ? p->m22 : m11) / determinant;
    response[1 - SWINGUP_DRIVEN] = -m12 / determinant;
}
#endif

#endif
