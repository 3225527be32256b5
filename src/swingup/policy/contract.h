/*
 * A policy with what stands around it: the contract of contract.py in C. All of its numbers stand before it, as
 * swingup writes them (export/c_header.py). These switches, each 0 or 1, say what is around the network:
 *
 *     SWINGUP_HAS_ESTIMATOR     a state estimator, which finds the loop's delay
 *     SWINGUP_HAS_IDENTIFIER    what finds the estimator's plant in the loop
 *     SWINGUP_HAS_REGULATOR     what takes over near the top
 *     SWINGUP_HAS_GUARD         what stops the controller at a limit or a broken measurement
 *     SWINGUP_HAS_FEEDBACK      a feedback law in the network's place
 */
#ifndef SWINGUP_CONTRACT_H
#define SWINGUP_CONTRACT_H

#if SWINGUP_HAS_IDENTIFIER && !SWINGUP_HAS_ESTIMATOR
#error "an identifier needs an estimator: it needs the delay"
#endif

#include "estimator.h"
#include "feedback.h"
#include "guard.h"
#include "pendulum.h"
#include "regulator.h"

typedef struct {
    swingup_guard guard;
    double asked[2]; /* torques of the last call that was not early, before guard and limits (N m) */
#if SWINGUP_HAS_ESTIMATOR
    swingup_estimator estimator;
#endif
#if SWINGUP_HAS_IDENTIFIER
    double base[9]; /* of the identified plant, in SI units */
#endif
#if SWINGUP_HAS_REGULATOR
    swingup_regulator regulator;
#endif
#if SWINGUP_HAS_FEEDBACK
    swingup_feedback feedback;
#endif
} swingup_controller;

#if SWINGUP_HAS_IDENTIFIER
/* Note the identified plant, in SI units. */
static inline void swingup_note_plant(swingup_controller *c)
{
    int i;
    for (i = 0; i < 9; i++) {
        c->base[i] = swingup_base_units[i] * c->estimator.identifier.base[i];
    }
}
#endif

static inline void swingup_reset(swingup_controller *c)
{
    memset(c, 0, sizeof *c);
#if SWINGUP_HAS_IDENTIFIER
    swingup_begin(&c->estimator.identifier);
    swingup_note_plant(c);
#endif
}

#if SWINGUP_HAS_IDENTIFIER
/* The nine base parameters found so far, ordered as docs/policy-format.md has them; at first the file's plant's. */
static inline const double *swingup_base_parameters(const swingup_controller *c)
{
    return c->base;
}
#endif

#if SWINGUP_HAS_FEEDBACK
/* The driven joint's torque (N m) of the law for a state, which is there in C.1's units as well. */
static inline double swingup_act(swingup_controller *c, swingup_time t, const double x[4], const double own[4])
{
    static const double goal[4] = {SWINGUP_PI, 0.0, 0.0, 0.0};
    double error[4], torque;

    swingup_errors(x, goal, error);
#if SWINGUP_HAS_REGULATOR
    torque = swingup_regulate(&c->regulator, swingup_held, own, &torque) ? SWINGUP_TORQUE_UNIT * torque : 0.0;
#else
    torque = swingup_top(error);
#endif
#if SWINGUP_PIECES > 0
    if (swingup_leads(&c->feedback, t, error)) {
        torque = swingup_along(x, (double)(t - c->feedback.begun));
    }
#endif
    (void)c;
    (void)t;
    (void)own;
    return swingup_compensated(torque, x);
}
#else
/* The driven joint's torque (N m) for a state in C.1's units, from the regulator or the policy; friction is
 * compensated later. */
static inline double swingup_act(swingup_controller *c, swingup_time t, const double given[4], const double x[4])
{
#if SWINGUP_HAS_IDENTIFIER
    const double *base = c->estimator.identifier.residual_base;
#else
    const double *base = swingup_theta;
#endif
#if SWINGUP_HAS_REGULATOR
    double torque;
    if (swingup_regulate(&c->regulator, base, x, &torque)) {
        return SWINGUP_TORQUE_UNIT * torque;
    }
#endif
    (void)c;
    (void)t;
    (void)given;
    return swingup_network(x, base);
}
#endif

/* What the motors are commanded (N m), before guard and limits; whether it is new. */
static inline int swingup_ask(swingup_controller *c, swingup_time t, const double x[4], double u[2])
{
    const double own[4] = {x[0], x[1], SWINGUP_TIME_UNIT * x[2], SWINGUP_TIME_UNIT * x[3]};
    double seen[4] = {own[0], own[1], own[2], own[3]};
    double shown[4] = {x[0], x[1], x[2], x[3]}; /* the same in SI units */

#if SWINGUP_HAS_ESTIMATOR
    if (swingup_early(&c->estimator, t) && swingup_finite(c->asked, 2)) {
        swingup_copy(u, c->asked, 2);
        return 0;
    }
    swingup_observe(&c->estimator, t, own, seen);
    shown[0] = seen[0];
    shown[1] = seen[1];
    shown[2] = seen[2] / SWINGUP_TIME_UNIT;
    shown[3] = seen[3] / SWINGUP_TIME_UNIT;
#endif
    u[1 - SWINGUP_DRIVEN] = 0.0;
    u[SWINGUP_DRIVEN] = swingup_act(c, t, shown, seen);
#if SWINGUP_HAS_IDENTIFIER
    swingup_compensate(&c->estimator.identifier, seen, u);
#endif
    /* The clips would make a finite torque of a broken measurement. */
    if (!swingup_finite(seen, 4)) {
        swingup_set_nan(u + SWINGUP_DRIVEN);
        u[1 - SWINGUP_DRIVEN] = 0.0;
    }
    swingup_copy(c->asked, u, 2);
    return 1;
}

#if !SWINGUP_HAS_GUARD
/* Torques within the motors' limits; NaN stays. */
static inline void swingup_cut(double u[2])
{
    int i;
    for (i = 0; i < 2; i++) {
        if (!swingup_is_nan(u + i)) {
            u[i] = swingup_clip(u[i], swingup_limits[i]);
        }
    }
}
#endif

/* The torques u (N m) for the measured state at time t (s), whose angles are the encoders'. */
static inline void swingup_control(swingup_controller *c, swingup_time t, const double measured[4], double u[2])
{
    const double x[4] = {measured[0] - swingup_zeros[0], measured[1] - swingup_zeros[1], measured[2], measured[3]};
    int asked;

#if SWINGUP_HAS_GUARD
    if (!swingup_allows(&c->guard, t, x)) {
        swingup_stopped(&c->guard, u);
        return;
    }
#endif
    asked = swingup_ask(c, t, x, u);
#if SWINGUP_HAS_GUARD
    swingup_limited(&c->guard, u);
#else
    swingup_cut(u);
#endif
#if SWINGUP_HAS_ESTIMATOR
    /* The model needs the torques that the motors were given. */
    if (asked) {
        const double given[2] = {u[0] / SWINGUP_TORQUE_UNIT, u[1] / SWINGUP_TORQUE_UNIT};
        swingup_remember(&c->estimator, given);
    }
#endif
#if SWINGUP_HAS_IDENTIFIER
    swingup_note_plant(c);
#endif
    (void)asked;
}

/* Why the safety guard stopped the controller, a number; 0 while it acts, or without a guard. */
static inline int swingup_guard_reason(const swingup_controller *c)
{
    return c->guard.reason;
}

/* The same in words. */
static inline const char *swingup_guard_sentence(const swingup_controller *c)
{
    static const char *const sentences[] = {SWINGUP_GUARD_SENTENCES};
    return sentences[c->guard.reason];
}

#endif
