/*
 * A policy of any task: an observation in, an action out; policy.py has its equations. Its data say with
 * SWINGUP_DISCRETE whether actions are choices.
 */
#ifndef SWINGUP_TASK_H
#define SWINGUP_TASK_H

#include "network.h"

#if SWINGUP_DISCRETE
#define SWINGUP_ACTION int
#else
#define SWINGUP_ACTION double
#endif

/*
 * The action for an observation, row by row where these have more than one axis. Returns 0; or 1, and no action, where
 * the observation is not finite.
 */
static inline int swingup_policy(const double observation[SWINGUP_INPUTS], SWINGUP_ACTION action[SWINGUP_ACTIONS])
{
    double features[SWINGUP_WIDEST];
    int i;

    if (!swingup_finite(observation, SWINGUP_INPUTS)) {
        return 1;
    }
    swingup_copy(features, observation, SWINGUP_INPUTS);
    swingup_forward(features);
#if SWINGUP_DISCRETE
    {
        const double *logits = features;
        int k;
        for (i = 0; i < SWINGUP_ACTIONS; i++) {
            int best = 0;
            for (k = 1; k < swingup_choices[i]; k++) {
                best = logits[k] > logits[best] ? k : best;
            }
            action[i] = swingup_start[i] + best;
            logits += swingup_choices[i];
        }
    }
#else
    for (i = 0; i < SWINGUP_ACTIONS; i++) {
        const double scaled = swingup_low[i] + 0.5 * (swingup_bound(features[i]) + 1.0) * (swingup_high[i] - swingup_low[i]);
        /* Rounding may carry it beyond a bound. */
        action[i] = scaled > swingup_high[i] ? swingup_high[i] : scaled < swingup_low[i] ? swingup_low[i] : scaled;
    }
#endif
    return 0;
}

/* Answer the observations of the self-test; returns 0, or the number of the first one that fails, from 1. */
static inline int swingup_self_test(void)
{
    double observation[SWINGUP_INPUTS];
    SWINGUP_ACTION action[SWINGUP_ACTIONS];
    int k, i;

    for (k = 0; k < SWINGUP_TESTS; k++) {
        for (i = 0; i < SWINGUP_INPUTS; i++) {
            observation[i] = SWINGUP_READ(swingup_test_observations + k * SWINGUP_INPUTS + i);
        }
        if (swingup_policy(observation, action)) {
            return k + 1;
        }
        for (i = 0; i < SWINGUP_ACTIONS; i++) {
            const double expected = SWINGUP_READ(swingup_test_actions + k * SWINGUP_ACTIONS + i);
            /* Negated, so that NaN fails. */
            if (!(fabs((double)action[i] - expected) <= swingup_tolerance[i])) {
                return k + 1;
            }
        }
    }
    return 0;
}

#endif
