/*
 * A feedback law in the place of a network; feedback.py has its equations.
 */
#ifndef SWINGUP_FEEDBACK_H
#define SWINGUP_FEEDBACK_H

#include "regulator.h"

#if SWINGUP_HAS_FEEDBACK
typedef struct {
    int called, at_top;
    swingup_time begun; /* time of the first call (s) */
} swingup_feedback;

/* Distances from a target, angles to the nearest turn. */
static inline void swingup_errors(const double x[4], const double target[4], double error[4])
{
    int i;
    for (i = 0; i < 4; i++) {
        error[i] = i < 2 ? swingup_turned(x[i] - target[i]) : x[i] - target[i];
    }
}

#if SWINGUP_PIECES > 0
/* Whether the trajectory leads: from the first call until the pendulum has been near the top. */
static inline int swingup_leads(swingup_feedback *c, swingup_time t, const double error[4])
{
    int i, is_near = 1;
    for (i = 0; i < 4; i++) {
        is_near = is_near && fabs(error[i]) < swingup_threshold[i];
    }
    c->at_top |= is_near && swingup_finite(error, 4);
    c->begun = c->called ? c->begun : t;
    c->called = 1;
    return !c->at_top;
}

/* The torque (N m) along the trajectory, t s after the first call. */
static inline double swingup_along(const double x[4], double t)
{
    double s, torque, now[9], error[4];
    int piece = 0, i;

    t = t < swingup_piece_starts[0] ? swingup_piece_starts[0] : t;
    while (piece < SWINGUP_PIECES - 1 && t > swingup_piece_ends[piece]) {
        piece++;
    }
    t = t > swingup_piece_ends[piece] ? swingup_piece_ends[piece] : t;
    s = (t - swingup_piece_starts[piece]) / (swingup_piece_ends[piece] - swingup_piece_starts[piece]);
    for (i = 0; i < 9; i++) {
        const double *c = swingup_piece_coefficients + 36 * piece + i;
        now[i] = SWINGUP_READ(c) + s * (SWINGUP_READ(c + 9) + s * (SWINGUP_READ(c + 18) + s * SWINGUP_READ(c + 27)));
    }
    swingup_errors(x, now, error);
    torque = now[4];
    for (i = 0; i < 4; i++) {
        torque -= now[5 + i] * error[i];
    }
    return torque;
}
#endif

#if !SWINGUP_HAS_REGULATOR
/* The torque (N m) at the top. */
static inline double swingup_top(const double error[4])
{
    double cost = 0.0, torque = 0.0;
    int i, j;
    for (i = 0; i < 4; i++) {
        torque -= swingup_top_gains[i] * error[i];
        for (j = 0; j < 4; j++) {
            cost += error[i] * swingup_top_cost[i][j] * error[j];
        }
    }
    return cost <= SWINGUP_LARGEST_COST ? torque : 0.0;
}
#endif

/* The motor's torque (N m) from that of the law, with the driven joint's friction. */
static inline double swingup_compensated(double torque, const double x[4])
{
    return swingup_clip(torque, SWINGUP_TORQUE_LIMIT)
        + SWINGUP_COULOMB * atan(SWINGUP_STEEPNESS * x[2 + SWINGUP_DRIVEN]);
}
#endif

#endif
