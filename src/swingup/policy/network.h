/*
 * The network; network.py has its equations.
 */
#ifndef SWINGUP_NETWORK_H
#define SWINGUP_NETWORK_H

#include "numbers.h"

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
#if SWINGUP_NORMALISED
    for (i = 0; i < SWINGUP_STATE_INPUTS; i++) {
        const double normal = (observation[i] - swingup_input_mean[i]) / swingup_input_deviation[i];
        observation[i] = swingup_clip(normal, SWINGUP_INPUT_CLIP);
    }
#endif
#if SWINGUP_SEES_PLANT
    for (i = 0; i < 9; i++) {
        const double seen = (base[i] - swingup_plant_centre[i]) / swingup_plant_scale[i];
        observation[SWINGUP_STATE_INPUTS + i] = swingup_clip(seen, SWINGUP_PLANT_CLIP);
    }
#else
    (void)base;
#endif
}

/*
 * A layer x <- W x + b, in place. Weights lie input by input, in the inner loop's order; inputs that a rectifier made 0
 * are passed over.
 */
static inline void swingup_layer(
    const float *weight, const double *bias, int inputs, int outputs, int rectified, swingup_real x[SWINGUP_WIDEST])
{
    swingup_real sum[SWINGUP_WIDEST];
    int k, j;
    for (j = 0; j < outputs; j++) {
        sum[j] = (swingup_real)bias[j];
    }
    for (k = 0; k < inputs; k++) {
        const swingup_real value = x[k];
        if (value != 0) {
            for (j = 0; j < outputs; j++) {
                sum[j] += (swingup_real)weight[k * outputs + j] * value;
            }
        }
    }
    for (j = 0; j < outputs; j++) {
        x[j] = sum[j] > 0 || !rectified ? sum[j] : 0;
    }
}

/* The torque (N m) of the driven joint for a state x of a plant with these base parameters. */
static inline double swingup_network(const double x[4], const double base[9])
{
    double observation[SWINGUP_INPUTS];
    swingup_real features[SWINGUP_WIDEST];
    int i;

    if (!swingup_finite(x, 4)) {
        return (double)NAN;
    }
    swingup_observation(x, base, observation);
    for (i = 0; i < SWINGUP_INPUTS; i++) {
        features[i] = (swingup_real)observation[i];
    }
    /* A macro shows the compiler the sizes: at -O2, gcc makes such loops twice as fast. */
#define SWINGUP_APPLY(index, inputs, outputs, rectified) \
    swingup_layer(swingup_weight_##index, swingup_bias_##index, inputs, outputs, rectified, features);
    SWINGUP_LAYERS(SWINGUP_APPLY)
#undef SWINGUP_APPLY
    return SWINGUP_TORQUE_LIMIT * tanh(features[0]);
}

/* The policy alone, for the plant of its file. */
static inline double swingup_policy(const double x[4])
{
    const double own[4] = {x[0], x[1], SWINGUP_TIME_UNIT * x[2], SWINGUP_TIME_UNIT * x[3]};
    return swingup_network(own, swingup_theta);
}

#endif
