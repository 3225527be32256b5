/*
 * The state estimator; estimator.py has its equations.
 */
#ifndef SWINGUP_ESTIMATOR_H
#define SWINGUP_ESTIMATOR_H

#include "identifier.h"
#include "numbers.h"
#include "model.h"

#if SWINGUP_HAS_ESTIMATOR
typedef struct {
    int called;                           /* 0 before the first call */
    int standstills;                      /* calls in a row at the time of the last one, also if that was early */
    int delay_steps;                      /* the delay found (steps) */
    swingup_time time, asked;             /* of the last call that was not early, and of the last one (s) */
    double sample[4];                     /* the last measurement that was finite */
    double gap;                           /* time since it was new (s) */
    double state[4];                      /* estimate of the measured state, as old as the delay */
    double torques[SWINGUP_DELAYS];       /* commanded, newest first (N m) */
    double deviations[SWINGUP_DELAYS][4]; /* what the filter with each delay estimates besides */
    double evidence[SWINGUP_DELAYS];      /* evidence against each delay */
#if SWINGUP_HAS_IDENTIFIER
    swingup_identifier identifier;
#endif
} swingup_estimator;

/* What the steady-state Kalman gains make of a miss. */
static inline void swingup_correction(const double miss[4], double correction[4])
{
    int joint;
    for (joint = 0; joint < 2; joint++) {
        correction[joint] = swingup_gains[0][0] * miss[joint] + swingup_gains[0][1] * miss[joint + 2];
        correction[joint + 2] = swingup_gains[1][0] * miss[joint] + swingup_gains[1][1] * miss[joint + 2];
    }
}

/*
 * One step over h (s) of the filter in charge and of the bank, for angles of a known age (calls), or without a
 * measurement (x = 0); 0, and no change, if the estimate is lost.
 */
static inline int swingup_follow(swingup_estimator *c, const swingup_plant *plant, const double *x, double h, int age)
{
    const double torque = c->torques[c->delay_steps];
    double drifted[SWINGUP_DELAYS][4], evidence[SWINGUP_DELAYS], minimum = 0.0;
    double predicted[4], miss[4], correction[4], change[4], response[2];
    int i, n, best = 0;

    if (x && !swingup_finite(x, 4)) {
        return 0;
    }
    swingup_copy(predicted, c->state, 4);
    swingup_step(plant, predicted, torque, h);
    for (i = 0; i < 4; i++) {
        miss[i] = x ? x[i] - predicted[i] : 0.0;
    }
    for (i = 0; i < 2; i++) {
        miss[i] = swingup_turned(miss[i]);
    }
    swingup_response(plant, c->state, response);

    for (n = 0; n < SWINGUP_DELAYS; n++) {
        double distance = 0.0, against;
        for (i = 0; i < 2; i++) {
            const double extra = (c->torques[n] - torque) * response[i];
            const double *d = c->deviations[n];
            drifted[n][i] = d[i] + h * d[i + 2] + 0.5 * h * h * extra;
            drifted[n][i + 2] = d[i + 2] + h * extra;
            distance += (miss[i] - drifted[n][i]) * (miss[i] - drifted[n][i]);
        }
        evidence[n] = x ? SWINGUP_FADING * c->evidence[n] + swingup_log1p(distance / SWINGUP_OUTLIER_SQUARED) : c->evidence[n];
        against = evidence[n] + SWINGUP_DELAY_PENALTY * (double)n;
        if (!swingup_finite(&against, 1)) {
            return 0;
        }
        /* A delay below the angles' own age cannot be. */
        if (n <= age || against < minimum) {
            minimum = against;
            best = n;
        }
    }

    for (n = 0; n < SWINGUP_DELAYS && x; n++) {
        swingup_correction(drifted[n], correction);
        for (i = 0; i < 4; i++) {
            drifted[n][i] -= correction[i];
        }
    }
    swingup_correction(miss, change);
    for (i = 0; i < 4; i++) {
        predicted[i] += change[i] + drifted[best][i];
    }
    if (x && !(fabs(x[2] - predicted[2]) <= SWINGUP_RESET_RATE && fabs(x[3] - predicted[3]) <= SWINGUP_RESET_RATE)) {
        return 0;
    }
    for (i = 0; i < 4; i++) {
        const double in_charge = drifted[best][i];
        c->state[i] = predicted[i];
        for (n = 0; n < SWINGUP_DELAYS; n++) {
            c->deviations[n][i] = drifted[n][i] - in_charge;
        }
    }
    swingup_copy(c->evidence, evidence, SWINGUP_DELAYS);
    c->delay_steps = best;
    return 1;
}

/* Sum of the torques commanded in the last n steps, linear between whole n, n >= 0. */
static inline double swingup_commanded(const swingup_estimator *c, double n)
{
    double sum = 0.0;
    int k;
    for (k = 0; k < SWINGUP_DELAYS && (double)(k + 1) <= n; k++) {
        sum += c->torques[k];
    }
    return k < SWINGUP_DELAYS ? sum + (n - (double)k) * c->torques[k] : sum;
}

/* The state after the delay, a time (s), in pieces with the mean of the torques that act in each. */
static inline void swingup_ahead(const swingup_estimator *c, const swingup_plant *plant, double x[4], double time)
{
    const double steps = (double)c->delay_steps / SWINGUP_PREDICTION_STEPS;
    int piece;
    for (piece = SWINGUP_PREDICTION_STEPS; piece > 0 && c->delay_steps > 0; piece--) {
        const double end = steps * (double)piece, start = steps * (double)(piece - 1);
        const double sum = swingup_commanded(c, end) - swingup_commanded(c, start);
        swingup_step(plant, x, sum / steps, time / SWINGUP_PREDICTION_STEPS);
    }
}

/* Whether a call at time t (s) comes so soon after the last one that the torques before are kept. */
static inline int swingup_early(swingup_estimator *c, swingup_time t)
{
    const double now = (double)t;
    if (!c->called || !swingup_finite(&now, 1)) {
        return 0;
    }
    /* A clock that never moves must not hold a torque. */
    c->standstills = t == c->asked ? c->standstills + 1 : 0;
    c->asked = t;
    return t >= c->time && t < c->time + (swingup_time)(SWINGUP_MIN_STEP * SWINGUP_TIME_UNIT)
           && c->standstills <= SWINGUP_MAX_STANDSTILLS;
}

/* Whether a state measured h (s) after the last one shows nothing new, for no longer than can be borne. */
static inline int swingup_bridges(swingup_estimator *c, const double x[4], double h)
{
    const int finite = swingup_finite(x, 4);
    int i, same = c->called && (x[2] != 0.0 || x[3] != 0.0);
    for (i = 0; i < 4; i++) {
        same = same && x[i] == c->sample[i];
        c->sample[i] = finite ? x[i] : c->sample[i];
    }
    c->gap = finite && !same ? 0.0 : c->gap + h;
    return c->gap > 0.0 && c->gap <= SWINGUP_LONGEST_GAP && c->called;
}

/* An estimate of the state now, for the state measured at time t (s). */
static inline void swingup_observe(swingup_estimator *c, swingup_time t, const double measured[4], double seen[4])
{
    const double now = (double)t, before = (double)c->time;
    const int timed = swingup_finite(&now, 1) && swingup_finite(&before, 1);
    const double pause = timed && c->called ? (double)(t - c->time) / SWINGUP_TIME_UNIT : -1.0;
    const double h = pause > 0.0 ? pause : SWINGUP_DT;
    const int late = !c->called || !(pause >= 0.0 && pause <= SWINGUP_MAX_STEP);
    const int bridges = swingup_bridges(c, measured, h);
#if SWINGUP_HAS_IDENTIFIER
    swingup_identifier *found = &c->identifier;
    const double *base = found->base, *friction = found->predicted_friction, *offsets = found->offsets;
    const double x[4] = {measured[0] - offsets[0], measured[1] - offsets[1], measured[2], measured[3]};
    const double interval = swingup_interval(found, h), passed = swingup_elapsed(found, h);
    const int age = found->age;
#else
    const double *x = measured, *base = swingup_theta, *friction = swingup_theta + 4;
    const double interval = h, passed = 0.0;
    const int age = 0;
#endif
    static const double none[4] = {0.0};
    swingup_plant plant;
    int n;

    swingup_believe(&plant, base, friction);
#if SWINGUP_HAS_IDENTIFIER
    plant.load = SWINGUP_HAS_LOADS ? found->predicted_loads : 0;
#endif
    if (!late && swingup_follow(c, &plant, bridges ? 0 : x, interval, age)) {
        swingup_copy(seen, c->state, 4);
        swingup_ahead(c, &plant, seen, passed + (double)(c->delay_steps - age) * h);
    } else {
        swingup_copy(seen, x, 4);
        swingup_copy(c->state, x, 4);
        for (n = 0; n < SWINGUP_DELAYS; n++) {
            c->torques[n] = 0.0;
            swingup_copy(c->deviations[n], none, 4);
        }
    }
    if (!swingup_finite(seen, 4)) {
        swingup_copy(seen, x, 4);
    }
#if SWINGUP_HAS_IDENTIFIER
    if (bridges) {
        swingup_interrupt(found);
    } else {
        swingup_identify(found, measured, c->delay_steps, c->called ? pause : -1.0);
    }
#endif
    c->called = 1;
    c->time = c->asked = t;
}

/* Note the torques that the motors were asked for, within their limits. */
static inline void swingup_remember(swingup_estimator *c, const double u[2])
{
    swingup_push(c->torques, SWINGUP_DELAYS, u[SWINGUP_DRIVEN]);
#if SWINGUP_HAS_IDENTIFIER
    swingup_note(&c->identifier, u);
#endif
}
#endif

#endif
