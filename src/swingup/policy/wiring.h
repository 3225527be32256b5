/*
 * What the guard looks at in the first second; wiring.py has the rules.
 */
#ifndef SWINGUP_WIRING_H
#define SWINGUP_WIRING_H

#include "model.h"

#if SWINGUP_HAS_GUARD
typedef struct {
    int calls, counted, ends, blocks, strong; /* calls with time between them, and whether they count; blocks */
    swingup_time first, time[3];       /* of the first call, and at the ends of blocks (s) */
    double age, angles[3][2];          /* since the first call (s); at the ends of blocks (rad) */
    double impulse[2][2], moment[2][2]; /* of the block before and this one: integrals of u and of u t */
    double sums[SWINGUP_WIRINGS][2], energies[2];
} swingup_watch;

/* An angle's distance (rad) without whole turns: encoders may wrap. */
static inline double swingup_unwrapped(double angle)
{
    return fabs(angle) > SWINGUP_PI ? swingup_turned(angle) : angle;
}

/* The mean period (s) once half a second has passed, if it is wrong; else 0. */
static inline double swingup_wrong_period(swingup_watch *w, swingup_time t, double pause, int first)
{
    double mean;
    if (w->counted || SWINGUP_PERIOD == 0.0) {
        return 0.0;
    }
    if (first) {
        w->first = t;
    } else if (pause > 0.0) {
        w->calls++;
    }
    if (w->calls == 0 || (double)(t - w->first) < SWINGUP_CLOCK_TIME) {
        return 0.0;
    }
    mean = (double)(t - w->first) / (double)w->calls;
    w->counted = 1;
    return mean > SWINGUP_MIN_PERIOD * SWINGUP_PERIOD && mean < SWINGUP_MAX_PERIOD * SWINGUP_PERIOD ? 0.0 : mean;
}

/* Compare the motion of the last two blocks with each wiring's; the place of the one that explains all so far. */
static inline int swingup_judge(swingup_watch *w)
{
    static const double none[4] = {0.0};
    const double first = (double)(w->time[1] - w->time[0]), second = (double)(w->time[2] - w->time[1]);
    const double whole = (double)(w->time[2] - w->time[0]);
    double u[2], v[2], found[2], least = 0.0, right = 0.0, share = 0.0;
    swingup_plant plant;
    int i, k, wrong, best = 0;
    for (i = 0; i < 2; i++) {
        const double before = swingup_unwrapped(w->angles[1][i] - w->angles[0][i]) / first;
        const double after = swingup_unwrapped(w->angles[2][i] - w->angles[1][i]) / second;
        u[i] = 2.0 / whole * (w->moment[0][i] / first + w->impulse[1][i] - w->moment[1][i] / second);
        v[i] = 0.5 * SWINGUP_TIME_UNIT * (before + after);
        found[i] = 2.0 * SWINGUP_TIME_UNIT * SWINGUP_TIME_UNIT * (after - before) / whole;
    }
    if (fabs(u[SWINGUP_DRIVEN]) < SWINGUP_PUSH_SHARE * swingup_limits[SWINGUP_DRIVEN] ||
        fabs(v[0]) > SWINGUP_WATCHED_FAST || fabs(v[1]) > SWINGUP_WATCHED_FAST) {
        return 0;
    }
    swingup_believe(&plant, swingup_theta, none);
    w->blocks++;
    w->strong += fabs(u[SWINGUP_DRIVEN]) > SWINGUP_STRONG_SHARE * swingup_limits[SWINGUP_DRIVEN];
    for (k = 0; k < SWINGUP_WIRINGS; k++) {
        /* Signs of both angles, whether they are crossed; the torques' factor, and whether they are exchanged. */
        const double *row = swingup_wirings[k];
        const int crossed = row[2] > 0.0, exchanged = row[4] > 0.0;
        double x[4], torques[2], a[2];
        for (i = 0; i < 2; i++) {
            const int j = crossed ? 1 - i : i;
            x[i] = row[j] * w->angles[1][j];
            x[i + 2] = row[j] * v[j];
            torques[i] = row[3] * u[exchanged ? 1 - i : i] / SWINGUP_TORQUE_UNIT;
        }
        swingup_acceleration(&plant, x, torques, x + 2, 0.0, a);
        for (i = 0; i < 2; i++) {
            const int j = crossed ? 1 - i : i;
            const double error = row[j] * found[j] - a[i];
            w->sums[k][j] += error * error;
            if (k == 0) {
                w->energies[i] += found[i] * found[i] + a[i] * a[i];
            }
        }
    }
    for (k = 0; k < SWINGUP_WIRINGS; k++) {
        share = w->sums[k][0] / w->energies[0] + w->sums[k][1] / w->energies[1];
        right = k == 0 ? share : right;
        /* The last one is no torque, which is left in share. */
        if (k < SWINGUP_WIRINGS - 1 && (k == 0 || share < least)) {
            best = k;
            least = share;
        }
    }
    wrong = right > SWINGUP_WATCHED_WRONG;
    if (wrong && share < SWINGUP_STILL_SHARE * right && w->strong >= SWINGUP_STRONG_BLOCKS) {
        return SWINGUP_WIRINGS - 1;
    }
    if (share < SWINGUP_HELD_SHARE * right) {
        return 0;
    }
    right *= w->blocks >= SWINGUP_MANY_BLOCKS ? SWINGUP_MANY_SHARE : SWINGUP_BETTER_SHARE;
    return wrong && w->blocks >= SWINGUP_WATCHED_BLOCKS && least < right ? best : 0;
}

/* The place of the wiring that explains the motion, 0 while that is the right one. */
static inline int swingup_wrong_wiring(
    swingup_watch *w, swingup_time t, const double q[2], const double torques[2], double pause)
{
    const double block = SWINGUP_WATCHED_BLOCK * SWINGUP_TIME_UNIT;
    const double since = (double)(t - w->time[2]);
    int i, k;
    for (i = 0; i < 2 && w->ends > 0; i++) {
        w->impulse[1][i] += pause * torques[i];
        w->moment[1][i] += pause * torques[i] * (since - 0.5 * pause + SWINGUP_WATCHED_LATE);
    }
    if (w->ends > 0 && since < block) {
        return 0;
    }
    if (w->ends > 0 && since > 3.0 * block) {
        w->ends = 0;
    }
    w->time[0] = w->time[1];
    w->time[1] = w->time[2];
    w->time[2] = t;
    for (i = 0; i < 2; i++) {
        w->angles[0][i] = w->angles[1][i];
        w->angles[1][i] = w->angles[2][i];
        w->angles[2][i] = q[i];
    }
    w->ends++;
    k = w->ends >= 3 ? swingup_judge(w) : 0;
    for (i = 0; i < 2; i++) {
        w->impulse[0][i] = w->impulse[1][i];
        w->moment[0][i] = w->moment[1][i];
        w->impulse[1][i] = w->moment[1][i] = 0.0;
    }
    return k;
}
#endif

#endif
