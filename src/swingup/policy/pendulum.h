/*
 * A pendulum's network: what it is shown of the state, and the torque that it gives; network.py has the equations.
 */
#ifndef SWINGUP_PENDULUM_H
#define SWINGUP_PENDULUM_H

#if !SWINGUP_HAS_FEEDBACK
#include "network.h"

/* What it is shown of a state x and of the plant's base parameters. */
static inline void swingup_observation(const double x[4], const double base[9], double observation[SWINGUP_INPUTS])
{
    int i;
    for (i = 0; i < 2; i++) {
#if SWINGUP_WRAPPED
        double angle = fmod(x[i], 2.0 * SWINGUP_PI);
        angle = angle < 0.0 ? angle + 2.0 * SWINGUP_PI : angle;
        observation[i] = (angle - SWINGUP_PI) / SWINGUP_PI;
#else
        observation[2 * i] = sin(x[i]);
        observation[2 * i + 1] = cos(x[i]);
#endif
        observation[SWINGUP_STATE_INPUTS - 2 + i] =
            swingup_clip(x[i + 2], SWINGUP_VELOCITY_SCALE) / SWINGUP_VELOCITY_SCALE;
    }
#if SWINGUP_SEES_PLANT
    for (i = 0; i < 9; i++) {
        const double seen = (base[i] - swingup_plant_centre[i]) / swingup_plant_scale[i];
        observation[SWINGUP_STATE_INPUTS + i] = swingup_clip(seen, SWINGUP_PLANT_CLIP);
    }
#else
    (void)base;
#endif
}

/* The torque (N m) of the driven joint for a state x of a plant with these base parameters. */
static inline double swingup_network(const double x[4], const double base[9])
{
    double features[SWINGUP_WIDEST];

    if (!swingup_finite(x, 4)) {
        swingup_set_nan(features);
        return features[0];
    }
    swingup_observation(x, base, features);
    swingup_forward(features);
    return SWINGUP_TORQUE_LIMIT * swingup_bound(features[0]);
}

/* The policy alone, for the plant of its file. */
static inline double swingup_policy(const double x[4])
{
    const double q1 = x[0] - swingup_zeros[0], q2 = x[1] - swingup_zeros[1];
    const double own[4] = {q1, q2, SWINGUP_TIME_UNIT * x[2], SWINGUP_TIME_UNIT * x[3]};
    return swingup_network(own, swingup_theta);
}
#endif

#endif
