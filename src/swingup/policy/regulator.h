/*
 * The regulator near the top; regulator.py has its equations.
 */
#ifndef SWINGUP_REGULATOR_H
#define SWINGUP_REGULATOR_H

#include "model.h"

#if SWINGUP_HAS_REGULATOR
typedef struct {
    int begun;               /* 0 before the first call */
    int acting;              /* whether the regulator acts */
    int is_far;              /* whether the state is far from the top: which of two designs counts */
    double cost_to_go[4][4]; /* P of the errors */
    double friction[4];      /* its column of the friction f */
} swingup_regulator;

/* M11, M12 and M22 (kg m^2) of base parameters theta at an angle of the elbow, by its cosine. */
static inline void swingup_mass(const double theta[9], double cosine, double mass[3])
{
    const double geared = SWINGUP_GEAR * theta[8], reflected = SWINGUP_GEAR * geared;
    const double coupling = SWINGUP_L1 * theta[2] * cosine;

    mass[0] = theta[0] + 2.0 * coupling + reflected + theta[8];
    mass[1] = theta[1] + coupling - geared;
    mass[2] = theta[1] + reflected;
}

/* How friction counts far from the top or near it: the damping of both joints (N m s/rad), and the torque
 * -friction[0] atan(friction[1] rate). Whether there are two designs. */
static inline int swingup_dry_friction(const double theta[9], int is_far, double damping[2], double friction[2])
{
    const int undriven = 1 - SWINGUP_DRIVEN;
    const double second = SWINGUP_GRAVITY * theta[2], first = undriven ? 0.0 : SWINGUP_GRAVITY * theta[3];
    const double dry = theta[6 + undriven];
    double mass[3], slack, lost;
    int j, two;

    for (j = 0; j < 2; j++) {
        const double coulomb = theta[6 + j], more = coulomb > 0.0 ? coulomb / SWINGUP_COULOMB_DAMPING : 0.0;
        damping[j] = theta[4 + j] + coulomb + coulomb * more;
    }
    friction[0] = SWINGUP_WEAK_SHARE * dry;
    friction[1] = SWINGUP_WEAK_KNEE;
    /* The damping at which the torque does not move the growing motion, less the joint's own. */
    swingup_mass(theta, 1.0, mass);
    slack = (first + second) * mass[1] - mass[2 * undriven] * second;
    lost = slack / sqrt(fmax(second * mass[1], SWINGUP_TINY)) - theta[4 + undriven];
    if (!(lost > 0.0 && dry > SWINGUP_STRONG * lost)) {
        return 0;
    }
    two = dry < lost;
    is_far = is_far && two;
    damping[undriven] = theta[4 + undriven] + lost * (is_far ? SWINGUP_FAR_DAMPING : SWINGUP_NEAR_DAMPING);
    friction[0] = (is_far ? SWINGUP_FAR_SHARE : SWINGUP_NEAR_SHARE) * dry;
    friction[1] = is_far ? SWINGUP_FAR_KNEE : SWINGUP_NEAR_KNEE;
    return two;
}

/* [A b d] of one step of the recursion, for base parameters theta and the damping of both joints. */
static inline void swingup_upright(const double theta[9], const double damping[2], double step[4][6])
{
    const double h = SWINGUP_RICCATI_STEP, half = 0.5 * h * h;
    const double gravity2 = SWINGUP_GRAVITY * theta[2], gravity1 = SWINGUP_GRAVITY * theta[3];
    const double gravity[2][2] = {{gravity1 + gravity2, gravity2}, {gravity2, gravity2}};
    double mass[3], inverse[2][2], slope[2][4], scale;
    int i, j, k;

    swingup_mass(theta, 1.0, mass);
    scale = 1.0 / (mass[0] * mass[2] - mass[1] * mass[1]);
    inverse[0][0] = mass[2] * scale;
    inverse[0][1] = inverse[1][0] = -mass[1] * scale;
    inverse[1][1] = mass[0] * scale;
    /* The accelerations: [X Y] e, and the inverse of the mass matrix times the torques. */
    for (i = 0; i < 2; i++) {
        for (j = 0; j < 2; j++) {
            slope[i][j] = inverse[i][0] * gravity[0][j] + inverse[i][1] * gravity[1][j];
            slope[i][j + 2] = -inverse[i][j] * damping[j];
        }
    }
    for (i = 0; i < 2; i++) {
        for (j = 0; j < 4; j++) {
            double twice = j < 2 ? 0.0 : slope[i][j - 2];
            for (k = 0; k < 2; k++) {
                twice += slope[i][k + 2] * slope[k][j];
            }
            step[i][j] = (i == j) + (i + 2 == j) * h + half * slope[i][j];
            step[i + 2][j] = (i + 2 == j) + h * slope[i][j] + half * twice;
        }
        for (j = 4; j < 6; j++) {
            const double *w = inverse[j == 4 ? SWINGUP_DRIVEN : 1 - SWINGUP_DRIVEN];
            step[i][j] = half * w[i];
            step[i + 2][j] = h * w[i] + half * (slope[i][2] * w[0] + slope[i][3] * w[1]);
        }
    }
}

/* One step of the Riccati recursion: P of the steps to go. */
static inline void swingup_riccati(swingup_regulator *c, double step[4][6])
{
    double moved[4][6], all[5][6], (*p)[4] = c->cost_to_go;
    int i, j, k;

    for (i = 0; i < 4; i++) {
        for (j = 0; j < 6; j++) {
            /* f stays as it is. */
            moved[i][j] = j < 5 ? 0.0 : c->friction[i];
            for (k = 0; k < 4; k++) {
                moved[i][j] += p[i][k] * step[k][j];
            }
        }
    }
    for (i = 0; i < 5; i++) {
        for (j = i; j < 6; j++) {
            all[i][j] = 0.0;
            for (k = 0; k < 4; k++) {
                all[i][j] += step[k][i] * moved[k][j];
            }
        }
    }
    for (i = 0; i < 4; i++) {
        const double gain = all[i][4] / (SWINGUP_TORQUE_WEIGHT + all[4][4]);
        for (j = i; j < 4; j++) {
            p[i][j] = p[j][i] = all[i][j] - gain * all[j][4];
        }
        p[i][i] += swingup_state_weights[i];
        c->friction[i] = all[i][5] - gain * all[4][5];
    }
}

/* The errors with which the linear plant has the undriven joint's momentum and torque of gravity as the pendulum has
 * them at these errors; whether gravity pushes that joint outwards. */
static inline int swingup_as_if_linear(const double theta[9], double error[4])
{
    const int undriven = 1 - SWINGUP_DRIVEN;
    const double second = SWINGUP_GRAVITY * theta[2], first = undriven ? 0.0 : SWINGUP_GRAVITY * theta[3];
    const double gravity[2] = {first + second, second}, sum = error[0] + error[1];
    const double torque = first * sin(error[0]) + second * sin(sum);
    const double slope = first * cos(error[0]) + second * cos(sum);
    double straight[3], bent[3], momentum;

    swingup_mass(theta, 1.0, straight);
    swingup_mass(theta, cos(error[1]), bent);
    momentum = bent[2 * undriven] * error[2 + undriven] + bent[1] * error[3 - undriven];
    error[undriven] = (torque - gravity[1 - undriven] * error[1 - undriven]) / gravity[undriven];
    error[2 + undriven] = (momentum - straight[1] * error[3 - undriven]) / straight[2 * undriven];
    return slope > 0.0;
}

/* P of the plant of the policy's file. */
static inline void swingup_start(swingup_regulator *c)
{
    int i;
    for (i = 0; i < 16; i++) {
        c->cost_to_go[i / 4][i % 4] = swingup_cost_to_go[i / 4][i % 4];
        c->friction[i / 4] = swingup_cost_to_go[i / 4][4];
    }
}

/* Whether the regulator acts, and its torque of the driven joint for a state, of the plant theta. */
static inline int swingup_regulate(swingup_regulator *c, const double theta[9], const double x[4], double *torque)
{
    const int finite = swingup_finite(x, 4);
    const double dry = theta[7 - SWINGUP_DRIVEN];
    double step[4][6], damping[2], counted[2], error[4], share = SWINGUP_TORQUE_WEIGHT, cost = 0.0, friction;
    int i, j, outwards, two;

    if (!c->begun) {
        swingup_start(c);
    }
    c->begun = 1;
    two = swingup_dry_friction(theta, c->is_far, damping, counted);
    swingup_upright(theta, damping, step);
    for (i = 0; i < SWINGUP_RICCATI_STEPS; i++) {
        swingup_riccati(c, step);
    }
    if (!swingup_finite(&c->cost_to_go[0][0], 16) || !swingup_finite(c->friction, 4)) {
        swingup_start(c);
    }
    *torque = 0.0;
    error[0] = swingup_turned(x[0] - SWINGUP_PI);
    error[1] = swingup_turned(x[1]);
    error[2] = x[2];
    error[3] = x[3];
    friction = -counted[0] * atan(counted[1] * x[3 - SWINGUP_DRIVEN]);
    outwards = swingup_as_if_linear(theta, error);
    for (i = 0; i < 4; i++) {
        double pushed = 0.0;
        for (j = 0; j < 4; j++) {
            cost += error[i] * c->cost_to_go[i][j] * error[j];
            pushed += c->cost_to_go[i][j] * step[j][4];
        }
        share += step[i][4] * pushed;
        *torque -= (c->friction[i] * step[i][4] + pushed * step[i][5]) * friction;
        for (j = 0; j < 4; j++) {
            *torque -= pushed * step[i][j] * error[j];
        }
    }
    *torque = swingup_clip(*torque / share, SWINGUP_TORQUE_LIMIT / SWINGUP_TORQUE_UNIT);
    if (finite) {
        const double enter = SWINGUP_ENTER / (1.0 + fabs(dry) / SWINGUP_ENTER_COULOMB);
        const double leave = enter + (SWINGUP_LEAVE - SWINGUP_ENTER) / (1.0 + fabs(dry) / SWINGUP_LEAVE_COULOMB);
        c->is_far = two && cost > (c->is_far ? SWINGUP_NEAR_BELOW : SWINGUP_FAR_ABOVE);
        c->acting = outwards && (c->acting ? cost <= leave : cost < enter);
    }
    return c->acting;
}

#endif

#endif
