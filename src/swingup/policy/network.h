/*
 * The network of any policy; network.py has its equations.
 */
#ifndef SWINGUP_NETWORK_H
#define SWINGUP_NETWORK_H

#include "numbers.h"

/* What the data may name: activations and bounds. */
#define SWINGUP_RELU 0
#define SWINGUP_TANH 1
#define SWINGUP_ELU 2
#define SWINGUP_SILU 3
#define SWINGUP_GELU 4
#define SWINGUP_CLIP 5

/* What follows a hidden layer. */
static inline double swingup_activate(double x)
{
#if SWINGUP_ACTIVATION == SWINGUP_TANH
    return tanh(x);
#elif SWINGUP_ACTIVATION == SWINGUP_ELU
    return x > 0.0 ? x : exp(x) - 1.0;
#elif SWINGUP_ACTIVATION == SWINGUP_SILU
    return 0.5 * x * (1.0 + tanh(0.5 * x));
#elif SWINGUP_ACTIVATION == SWINGUP_GELU
    return 0.5 * x * (1.0 + tanh(0.7978845608028654 * (x + 0.044715 * x * x * x)));
#else
    return x > 0.0 ? x : 0.0;
#endif
}

/* An action in [-1, 1] of an output of the last layer. */
static inline double swingup_bound(double x)
{
#if SWINGUP_BOUNDS == SWINGUP_CLIP
    return swingup_clip(x, 1.0);
#else
    return tanh(x);
#endif
}

/*
 * A layer x <- W x + b, in place. Weights lie input by input, in the inner loop's order; inputs that a rectifier made 0
 * are passed over.
 */
static inline void swingup_layer(
    const float *weight, const double *bias, int inputs, int outputs, int hidden, double x[SWINGUP_WIDEST])
{
    double sum[SWINGUP_WIDEST];
    int k, j;
    for (j = 0; j < outputs; j++) {
        sum[j] = SWINGUP_READ(bias + j);
    }
    for (k = 0; k < inputs; k++) {
        const double value = x[k];
        if (value != 0.0) {
            for (j = 0; j < outputs; j++) {
                sum[j] += (double)SWINGUP_READ(weight + k * outputs + j) * value;
            }
        }
    }
    for (j = 0; j < outputs; j++) {
        x[j] = hidden ? swingup_activate(sum[j]) : sum[j];
    }
}

/* The last layer's outputs, in place of the observation. */
static inline void swingup_forward(double x[SWINGUP_WIDEST])
{
#if SWINGUP_NORMALISED
    int i;
    for (i = 0; i < SWINGUP_NORMALISED; i++) {
        const double centred = x[i] - SWINGUP_READ(swingup_input_mean + i);
        x[i] = swingup_clip(centred / SWINGUP_READ(swingup_input_deviation + i), SWINGUP_INPUT_CLIP);
    }
#endif
    /* A macro shows the compiler the sizes: at -O2, gcc makes such loops twice as fast. */
#define SWINGUP_APPLY(index, inputs, outputs, hidden) \
    swingup_layer(swingup_weight_##index, swingup_bias_##index, inputs, outputs, hidden, x);
    SWINGUP_LAYERS(SWINGUP_APPLY)
#undef SWINGUP_APPLY
}

#endif
