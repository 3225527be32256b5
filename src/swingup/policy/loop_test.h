/*
 * The self-test of a pendulum's controller: short runs, and the torques that it must give.
 */
#ifndef SWINGUP_LOOP_TEST_H
#define SWINGUP_LOOP_TEST_H

#include "contract.h"

/* Run the self-test; returns 0, or the number of the first call that fails, from 1. The controller is then reset. */
static inline int swingup_self_test(swingup_controller *c)
{
    double x[4], u[2];
    int k, i, failed = 0;

    for (k = 0; k < SWINGUP_TESTS && !failed; k++) {
        const int call = k % SWINGUP_TEST_CALLS;
        if (call == 0) {
            swingup_reset(c);
        }
        for (i = 0; i < 4; i++) {
            x[i] = SWINGUP_READ(swingup_test_observations + 4 * k + i);
        }
        swingup_control(c, (swingup_time)SWINGUP_TEST_PERIOD * call, x, u);
        for (i = 0; i < 2; i++) {
            /* Negated, so that NaN fails. */
            if (!(fabs(u[i] - SWINGUP_READ(swingup_test_actions + 2 * k + i)) <= swingup_tolerance[i])) {
                failed = k + 1;
            }
        }
    }
    swingup_reset(c);
    return failed;
}

#endif
