/*
 * @ABOUT@
 *
 * C99 and its <math.h>; no allocation, no global state, no other library. Sizes and weights are fixed.
 *
 *     swingup_controller controller;
 *     swingup_reset(&controller);                     before every run
 *     swingup_control(&controller, t, x, u);          at every step, @RATE@
 *
 * x = [q1, q2, dq1, dq2]: shoulder angle from hanging down, elbow angle relative to link 1 (rad), and their rates
 * (rad/s); t is the time (s); u = [u1, u2] are the torques of shoulder and elbow (N m), the passive joint's @PASSIVE@.
 * swingup_policy(x) is the policy alone: the torque of the driven joint, without memory.
@FOUND@ * @UNSOUND@ Not for -ffast-math, which cannot tell NaN.
 */
#ifndef SWINGUP_POLICY_H
#define SWINGUP_POLICY_H

#include <math.h>

#define SWINGUP_DRIVEN @DRIVEN@ /* index of the driven joint */
#define SWINGUP_TORQUE_LIMIT @TORQUE_LIMIT@ /* N m */
#define SWINGUP_PI 3.14159265358979323846

/* ---- the policy ---- */

/*
 * What the network computes in. Define SWINGUP_REAL as float before the include where double is slow: torques then
 * differ by up to 1e-4 N m. Weights are stored input by input; inputs that a rectifier made 0 are passed over.
 */
#ifndef SWINGUP_REAL
#define SWINGUP_REAL double
#endif
typedef SWINGUP_REAL swingup_real;

@ARRAYS@

static inline double swingup_clip(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

@LAYERS@

static inline double swingup_policy@TOLD@(const double x[4]@SIGHT@)
{
    double observation[@INPUTS@];
    swingup_real input[@INPUTS@];
@BUFFERS@
    int i;

    for (i = 0; i < 4; i++) {
        if (!isfinite(x[i])) {
            return (double)NAN;
        }
    }
@OBSERVE@
    for (i = 0; i < @INPUTS@; i++) {
        input[i] = (swingup_real)observation[i];
    }
@CALLS@
    return SWINGUP_TORQUE_LIMIT * tanh(@RESULT@[0]);
}

@FOLDED@@CONTROLLER@
#endif
