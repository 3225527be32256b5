/*
 * The safety guard; guard.py has its rules. Without one the reason stays 0.
 */
#ifndef SWINGUP_GUARD_H
#define SWINGUP_GUARD_H

#include "wiring.h"

typedef struct {
    int reason;         /* why the controller was stopped; SWINGUP_GUARD_NONE while it acts */
    int joint;          /* the joint meant: 0 is the shoulder, 1 the elbow; -1 for none */
    swingup_time when;  /* time of that call (s) */
    double value;       /* what was beyond its limit or not finite */
    int called, still, brakes, broken;
    swingup_time time;            /* of the last call (s) */
    double step;                  /* since the one before (s) */
    double sample[4], torques[2]; /* last finite measurement, and torques */
    double gaps[2], stuck;        /* time for which a joint has shown nothing new, and stood still (s) */
    int seen[2];                  /* whether a joint has had a finite sample */
    double travels[2];            /* of the other joint since a joint's sample changed (rad) */
#if SWINGUP_HAS_GUARD
    swingup_watch watch;
#endif
} swingup_guard;

#if SWINGUP_HAS_GUARD
/* Latch the first fault; brake from it on, until a fault of sensor or clock. */
static inline void swingup_stop(swingup_guard *c, int reason, int joint, double value)
{
    const int motion =
        reason == SWINGUP_GUARD_ANGLE || reason == SWINGUP_GUARD_VELOCITY || reason == SWINGUP_GUARD_TORQUE;
    c->brakes = motion && SWINGUP_GUARD_BRAKING > 0.0 && (c->reason == SWINGUP_GUARD_NONE || c->brakes);
    if (c->reason == SWINGUP_GUARD_NONE) {
        c->reason = reason;
        c->joint = joint;
        c->when = c->time;
        c->value = value;
    }
}

/* Take in the measurement; stops the controller if it is unsound. */
static inline void swingup_check(swingup_guard *c, const double x[4], int first)
{
    const double borne = c->reason == SWINGUP_GUARD_NONE ? SWINGUP_GUARD_LONGEST_GAP : 0.0;
    double *sample = c->sample;
    double moves[2], reach[2];
    int i, finite[2], same[2];
    c->broken = 0;
    for (i = 0; i < 2; i++) {
        finite[i] = swingup_finite(x + i, 1) && swingup_finite(x + i + 2, 1);
        moves[i] = finite[i] && c->seen[i] ? swingup_turned(x[i] - sample[i]) : 0.0;
        reach[i] = SWINGUP_MAX_JUMP + SWINGUP_JUMP_RATE * (c->gaps[i] + c->step);
    }
    for (i = 0; i < 2; i++) {
        same[i] = !finite[i] || (!first && x[i] == sample[i] && x[i + 2] == sample[i + 2]);
        c->gaps[i] = finite[i] && (!same[i] || x[i + 2] == 0.0) ? 0.0 : c->gaps[i] + c->step;
        c->broken |= !finite[i];
        c->seen[i] |= finite[i];
        c->travels[i] = finite[i] && same[i] ? c->travels[i] + moves[1 - i] : 0.0;
        if (finite[i]) {
            sample[i] = x[i];
            sample[i + 2] = x[i + 2];
        }
    }
    i = fabs(c->torques[SWINGUP_DRIVEN]) > SWINGUP_PUSHING_SHARE * swingup_limits[SWINGUP_DRIVEN];
    c->stuck = same[SWINGUP_DRIVEN] && i ? c->stuck + c->step : 0.0;
    for (i = 0; i < 2; i++) {
        if (!finite[i] && c->gaps[i] > borne) {
            swingup_stop(c, SWINGUP_GUARD_NOT_FINITE, i, swingup_finite(x + i, 1) ? x[i + 2] : x[i]);
            return;
        }
    }
    for (i = 0; i < 2; i++) {
        if (fabs(sample[i]) > SWINGUP_GUARD_ANGLE_LIMIT) {
            swingup_stop(c, SWINGUP_GUARD_ANGLE, i, sample[i]);
            return;
        }
        if (fabs(sample[i + 2]) > SWINGUP_GUARD_VELOCITY_LIMIT) {
            swingup_stop(c, SWINGUP_GUARD_VELOCITY, i, sample[i + 2]);
            return;
        }
    }
    for (i = 0; i < 2; i++) {
        if (fabs(moves[i]) > reach[i]) {
            swingup_stop(c, SWINGUP_GUARD_JUMP, i, moves[i]);
            return;
        }
        if (c->gaps[i] > SWINGUP_GUARD_LONGEST_GAP) {
            swingup_stop(c, SWINGUP_GUARD_STALE, i, c->gaps[i]);
            return;
        }
        if (fabs(c->travels[i]) > SWINGUP_DEAD_TRAVEL) {
            swingup_stop(c, SWINGUP_GUARD_DEAD, i, c->travels[i]);
            return;
        }
    }
    if (c->stuck > SWINGUP_GUARD_STUCK_TIME) {
        swingup_stop(c, SWINGUP_GUARD_STALE, SWINGUP_DRIVEN, c->stuck);
    }
}

/* What the first second shows. */
static inline void swingup_watch_wiring(swingup_guard *c, swingup_time t, double pause, int first)
{
    double period;
    int wrong;
    if (SWINGUP_GUARD_WATCHED == 0.0) {
        return;
    }
    c->watch.age += pause;
    period = swingup_wrong_period(&c->watch, t, pause, first);
    if (period > 0.0) {
        swingup_stop(c, SWINGUP_GUARD_PERIOD, -1, period);
        return;
    }
    if (c->watch.age > SWINGUP_GUARD_WATCHED) {
        return;
    }
    wrong = swingup_wrong_wiring(&c->watch, t, c->sample, c->torques, pause);
    if (wrong > 0) {
        const double *row = swingup_wirings[wrong];
        swingup_stop(c, (int)row[5], (int)row[6], c->torques[SWINGUP_DRIVEN]);
    }
}

/* Whether the controller may act on the state x measured at time t (s). */
static inline int swingup_allows(swingup_guard *c, swingup_time t, const double x[4])
{
    const double now = (double)t, pause = (double)(t - c->time);
    const int first = !c->called;

    c->called = 1;
    c->time = t;
    if (!swingup_finite(&now, 1) || !(first || pause >= 0.0)) {
        swingup_stop(c, SWINGUP_GUARD_CLOCK, -1, first ? now : pause);
        return 0;
    }
    c->still = !first && pause == 0.0 ? c->still + 1 : 0;
    if (c->still > SWINGUP_MAX_STANDSTILLS) {
        swingup_stop(c, SWINGUP_GUARD_CLOCK, -1, pause);
        return 0;
    }
    if (!first && pause > SWINGUP_GUARD_LONGEST_GAP) {
        swingup_stop(c, SWINGUP_GUARD_LATE, -1, pause);
        return 0;
    }
    c->step = first || pause == 0.0 ? SWINGUP_GUARD_DT : pause;
    swingup_check(c, x, first);
    if (c->reason == SWINGUP_GUARD_NONE) {
        swingup_watch_wiring(c, t, first ? 0.0 : pause, first);
    }
    return c->reason == SWINGUP_GUARD_NONE;
}

/* The torques of a stopped controller: none, or damping while the measurement is sound. */
static inline void swingup_stopped(swingup_guard *c, double u[2])
{
    int i;
    for (i = 0; i < 2; i++) {
        const double rate = c->sample[i + 2];
        const int sound = c->brakes && fabs(rate) <= SWINGUP_BRAKED_RATE;
        c->torques[i] = u[i] = sound ? swingup_clip(-SWINGUP_GUARD_BRAKING * rate, swingup_limits[i]) : 0.0;
    }
}

/* The controller's torques within rate and limits; safe ones if one of them is not finite. */
static inline void swingup_limited(swingup_guard *c, double u[2])
{
    const double change = SWINGUP_GUARD_TORQUE_RATE * c->step;
    int i;
    for (i = 0; i < 2; i++) {
        if (!swingup_finite(u + i, 1) && c->broken) {
            swingup_copy(u, c->torques, 2);
            return;
        }
        if (!swingup_finite(u + i, 1)) {
            swingup_stop(c, SWINGUP_GUARD_TORQUE, i, u[i]);
            swingup_stopped(c, u);
            return;
        }
    }
    for (i = 0; i < 2; i++) {
        const double upper = c->torques[i] + change, lower = c->torques[i] - change;
        u[i] = u[i] > upper ? upper : u[i];
        u[i] = swingup_clip(u[i] < lower ? lower : u[i], swingup_limits[i]);
        c->torques[i] = u[i];
    }
}
#endif

#endif
