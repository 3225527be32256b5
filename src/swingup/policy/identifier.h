/*
 * The identifier of the plant; identifier.py has its equations.
 */
#ifndef SWINGUP_IDENTIFIER_H
#define SWINGUP_IDENTIFIER_H

#include "model.h"
#include "numbers.h"

#if SWINGUP_HAS_IDENTIFIER
/*
 * The unknowns: nine base parameters, what the offsets of both angles add to gravity's torques (kg m), the torque's
 * lag (s) behind the delay, and the part of its command that the passive joint's motor delivers.
 */
#define SWINGUP_TILT 9
#define SWINGUP_LAG 11
#define SWINGUP_GAIN 12
/* Behind them, where loads are expected: constant torques against both joints (N m) and springs (N m/rad). */
#define SWINGUP_LOAD 13
#define SWINGUP_HAS_LOADS (SWINGUP_UNKNOWNS > SWINGUP_LOAD)
/* Angles may be a call old whatever the longest delay is. */
#define SWINGUP_AGES (SWINGUP_DELAYS > 1 ? SWINGUP_DELAYS : 2)

typedef struct {
    /* After each low-pass, of both joints: a number for each unknown, and the torque. */
    double rows[3][2][SWINGUP_UNKNOWNS + 1];
} swingup_filter;

typedef struct {
    int calls;                              /* measurements since the last restart */
    int delay_steps;                        /* the estimator's last delay (steps), or age where that is more */
    int age;                                /* how many calls ago the angles were the plant's */
    double age_evidence[SWINGUP_AGES];      /* evidence against each age of the angles */
    double angles[2 * SWINGUP_SPAN + 1][2]; /* measured, without jumps of full turns, newest first (rad) */
    double torques[SWINGUP_COMMANDS][2];    /* asked of both motors, newest first (N m) */
    double steps[SWINGUP_COMMANDS];         /* time for which each was held (s) */
    swingup_filter filter;
    double unknowns[SWINGUP_UNKNOWNS];
    double covariance[SWINGUP_UNKNOWNS][SWINGUP_UNKNOWNS];
    double variance[2];           /* of what each joint's row leaves unexplained (N^2 m^2) */
    double gate[2];               /* time for which each joint's row is still not used (s) */
    double noise[2];              /* variance of the noise of both angles (rad^2) */
    double base[9];               /* base parameters of a pendulum: those found, or as near to them as can be */
    double residual_base[9];      /* the same with the friction that the compensation leaves */
    double predicted_friction[4]; /* of the estimator's model: damping of both joints, then Coulomb friction */
    double commanded_friction[4]; /* the same, of the friction whose counterpart the motors are commanded */
    double commanded_loads[4];     /* constant torques of both joints, then springs, that the motors carry */
    double predicted_loads[4];     /* the same, of the estimator's model */
    double offsets[2];            /* how much the measured angles are too large (rad) */
} swingup_identifier;

/* The compensation of the friction found, and the offsets of the angles. */
static inline void swingup_share_out(swingup_identifier *c)
{
    const double *tilt = c->unknowns + SWINGUP_TILT;
    const double delivered = swingup_max(c->unknowns[SWINGUP_GAIN], 0.0);
    const double factor = SWINGUP_PASSIVE_LIMIT > 0.0 ? 1.0 / swingup_max(delivered, SWINGUP_MIN_GAIN) : 0.0;
    int i;
    swingup_copy(c->residual_base, c->base, 9);
    for (i = 0; i < 4; i++) {
        const int driven = i % 2 == SWINGUP_DRIVEN;
        c->commanded_friction[i] = swingup_max(c->base[4 + i], 0.0) * (driven ? 1.0 : factor);
        c->residual_base[4 + i] -= (driven ? 1.0 : delivered) * c->commanded_friction[i];
        /* It brakes, or the implicit step would be singular near rest. The estimator counts the driven motor alone. */
        c->predicted_friction[i] = swingup_max(driven ? c->base[4 + i] : c->residual_base[4 + i], 0.0);
    }
    for (i = 0; i < 4 && SWINGUP_HAS_LOADS; i++) {
        const int driven = i % 2 == SWINGUP_DRIVEN;
        const double found = c->unknowns[SWINGUP_UNKNOWNS - 4 + i];
        c->commanded_loads[i] = found * (driven ? 1.0 : factor);
        c->predicted_loads[i] = found * (driven ? 1.0 : 1.0 - factor * delivered);
    }
    c->offsets[0] = swingup_clip(tilt[0] / c->base[3], SWINGUP_MAX_OFFSET);
    c->offsets[1] = swingup_clip(tilt[1] / c->base[2], SWINGUP_MAX_OFFSET) - c->offsets[0];
}

/* Add the torques (N m) against the identified friction and load, for the state seen. */
static inline void swingup_compensate(const swingup_identifier *c, const double seen[4], double u[2])
{
    int i;
    for (i = 0; i < 2; i++) {
        const double rate = seen[i + 2], load = c->commanded_loads[i] + c->commanded_loads[i + 2] * seen[i];
        const double torque = c->commanded_friction[i] * rate + c->commanded_friction[i + 2] * atan(SWINGUP_STEEPNESS * rate) + load;
        const double within = i == SWINGUP_DRIVEN ? torque : swingup_clip(torque, SWINGUP_PASSIVE_LIMIT);
        u[i] += SWINGUP_TORQUE_UNIT * within;
    }
}

/* Nothing seen yet. */
static inline void swingup_begin(swingup_identifier *c)
{
    int i;
    memset(c, 0, sizeof *c);
    swingup_copy(c->unknowns, swingup_mean, SWINGUP_UNKNOWNS);
    for (i = 0; i < SWINGUP_UNKNOWNS; i++) {
        swingup_copy(c->covariance[i], swingup_prior[i], SWINGUP_UNKNOWNS);
    }
    swingup_copy(c->variance, swingup_initial_variance, 2);
    swingup_copy(c->base, swingup_mean, 9);
    for (i = 0; i < SWINGUP_COMMANDS; i++) {
        c->steps[i] = SWINGUP_DT;
    }
    swingup_share_out(c);
}

/* One half of both joints' equations, at the midpoint between angles (rad). */
typedef struct {
    double rates[2], momentum[2], turning, pull[2], slope[2], bend[2], bending;
} swingup_half;

/* For angles that are a time (s) apart. */
static inline void swingup_halve(const double start[2], const double end[2], double time, swingup_half *half)
{
    const double rate1 = (end[0] - start[0]) / time, rate2 = (end[1] - start[1]) / time;
    const double q1 = 0.5 * (start[0] + end[0]), q2 = 0.5 * (start[1] + end[1]);
    const double sine1 = sin(q1), cosine1 = cos(q1), sine2 = sin(q2), cosine2 = cos(q2);
    const double along = SWINGUP_L1 * cosine2, across = SWINGUP_L1 * sine2;
    half->rates[0] = rate1;
    half->rates[1] = rate2;
    half->momentum[0] = along * (2.0 * rate1 + rate2);
    half->momentum[1] = along * rate1;
    half->turning = across * rate1 * (rate1 + rate2);
    half->pull[0] = SWINGUP_GRAVITY * sine1;
    half->pull[1] = SWINGUP_GRAVITY * (sine1 * cosine2 + cosine1 * sine2);
    half->slope[0] = SWINGUP_GRAVITY * cosine1;
    half->slope[1] = SWINGUP_GRAVITY * (cosine1 * cosine2 - sine1 * sine2);
    /* Derivatives of the momenta and of turning by q2. */
    half->bend[0] = -across * (2.0 * rate1 + rate2);
    half->bend[1] = -across * rate1;
    half->bending = along * rate1 * (rate1 + rate2);
}

/* Integral of arctan(steep v) over a rate v from 0 (rad/s). */
static inline double swingup_integral(double rate)
{
    const double steep = SWINGUP_STEEPNESS * rate;
    return rate * atan(steep) - swingup_log1p(steep * steep) / (2.0 * SWINGUP_STEEPNESS);
}

/* The mean of arctan(steep v) while a rate v goes straight from start to end (rad/s). */
static inline double swingup_mean_arctan(double start, double end)
{
    if (fabs(end - start) > SWINGUP_CLOSE_RATES) {
        return (swingup_integral(end) - swingup_integral(start)) / (end - start);
    }
    return atan(0.5 * SWINGUP_STEEPNESS * (start + end));
}

/* Time from the end of the step before the last n ones to now (s). */
static inline double swingup_age(const swingup_identifier *c, int n)
{
    double age = 0.0;
    int k;
    for (k = 0; k < n; k++) {
        age += c->steps[k];
    }
    return age;
}

/* The loop's own period (s): a call that comes late now and then must not change the low-passes or the rows. */
static inline double swingup_period(const swingup_identifier *c)
{
    double shortest = c->steps[c->age];
    int k;
    for (k = 1; k < 2 * SWINGUP_SPAN; k++) {
        shortest = c->steps[c->age + k] < shortest ? c->steps[c->age + k] : shortest;
    }
    return shortest;
}

/* Steps in half of a row: as many as take its time in a loop of a period (s). */
static inline int swingup_span(double period)
{
    const double steps = SWINGUP_SPAN * SWINGUP_DT / period;
    return steps > SWINGUP_SPAN ? SWINGUP_SPAN : steps < 1.0 ? 1 : (int)swingup_rint(steps);
}

/* The newest rows of shoulder and elbow: a number for each unknown, and the driven joint's torque. */
static inline void swingup_rows(const swingup_identifier *c, double rows[2][SWINGUP_UNKNOWNS + 1])
{
    const double gr = SWINGUP_GEAR, *steps = c->steps + c->age, (*torques)[2] = c->torques + c->delay_steps;
    double a[2], pull[2], slope[2], bend[2], turning, torque[2] = {0.0, 0.0}, rate = 0.0;
    double newer = 0.0, older = 0.0, mean, now = 0.0;
    swingup_half one, two;
    const int span = swingup_span(swingup_period(c));
    int i, k;

    for (k = 0; k < span; k++) {
        newer += steps[k];
        older += steps[span + k];
    }
    mean = 0.5 * (newer + older);
    swingup_halve(c->angles[2 * span], c->angles[span], older, &one);
    swingup_halve(c->angles[span], c->angles[0], newer, &two);
    for (i = 0; i < 2; i++) {
        a[i] = (two.rates[i] - one.rates[i]) / mean;
        pull[i] = 0.5 * (one.pull[i] + two.pull[i]);
        slope[i] = 0.5 * (one.slope[i] + two.slope[i]);
        bend[i] = (two.bend[i] - one.bend[i]) / mean;
        for (k = 0; k <= SWINGUP_UNKNOWNS; k++) {
            rows[i][k] = 0.0;
        }
    }
    turning = 0.5 * (one.turning + two.turning);
    rows[0][0] = a[0];
    rows[0][1] = a[1];
    rows[0][2] = (two.momentum[0] - one.momentum[0]) / mean + pull[1];
    rows[0][3] = pull[0];
    rows[0][8] = (gr * gr + 1.0) * a[0] - gr * a[1];
    rows[1][1] = a[0] + a[1];
    rows[1][2] = (two.momentum[1] - one.momentum[1]) / mean + turning + pull[1];
    rows[1][8] = gr * gr * a[1] - gr * a[0];
    bend[1] += 0.5 * (one.bending + two.bending);
    for (i = 0; i < 2; i++) {
        rows[i][SWINGUP_TILT] = SWINGUP_TILT_RATIO * bend[i] - (i == 0 ? slope[0] : 0.0);
        rows[i][SWINGUP_TILT + 1] = -bend[i] - slope[1];
    }
    for (i = 0; i < 2 && SWINGUP_HAS_LOADS; i++) {
        rows[i][SWINGUP_UNKNOWNS - 4 + i] = 1.0;
        rows[i][SWINGUP_UNKNOWNS - 2 + i] = c->angles[span][i];
    }
    for (i = 0; i < 2; i++) {
        rows[i][4 + i] = 0.5 * (one.rates[i] + two.rates[i]);
        rows[i][6 + i] = swingup_mean_arctan(one.rates[i], two.rates[i]);
    }
    /* The hat rises to the middle angle and falls to the others; each torque is held over its step. */
    for (k = 0; k < 2 * span; k++) {
        const double change = k < span ? steps[k] / newer : -steps[k] / older;
        for (i = 0; i < 2; i++) {
            torque[i] += (now + 0.5 * change) * steps[k] * torques[k][i] / mean;
        }
        rate += change * torques[k][SWINGUP_DRIVEN] / mean;
        now += change;
    }
    rows[SWINGUP_DRIVEN][SWINGUP_LAG] = rate;
    rows[1 - SWINGUP_DRIVEN][SWINGUP_GAIN] = -torque[1 - SWINGUP_DRIVEN];
    rows[SWINGUP_DRIVEN][SWINGUP_UNKNOWNS] = torque[SWINGUP_DRIVEN];
}

/* The variance of the noise of both angles, from third differences. */
static inline void swingup_follow_noise(swingup_identifier *c, double step)
{
    const double *steps = c->steps + c->age;
    double shortest = steps[0], longest = steps[0];
    int i;
    for (i = 1; i < 3; i++) {
        shortest = steps[i] < shortest ? steps[i] : shortest;
        longest = steps[i] > longest ? steps[i] : longest;
    }
    /* An uneven step shows in the differences like noise. */
    for (i = 0; i < 2 && longest - shortest < SWINGUP_EVEN_TOLERANCE * SWINGUP_DT; i++) {
        const double difference = c->angles[0][i] - c->angles[3][i] - 3.0 * (c->angles[1][i] - c->angles[2][i]);
        const double seen = difference * difference / 20.0; /* 1 + 9 + 9 + 1 */
        const double bounded = seen < SWINGUP_MAX_NOISE * SWINGUP_MAX_NOISE ? seen : SWINGUP_MAX_NOISE * SWINGUP_MAX_NOISE;
        c->noise[i] += -swingup_expm1(-step / SWINGUP_NOISE_TIME) * (bounded - c->noise[i]);
    }
}

/* What the noise of the angles takes from a joint's row in the mean, of the base parameters 0 to 2 and 8. */
static inline void swingup_noise_bias(const swingup_identifier *c, int joint, double step, double bias[4])
{
    const double *x = c->unknowns, gr = SWINGUP_GEAR, gain = SWINGUP_NOISE_GAIN * step / SWINGUP_DT;
    const double along = SWINGUP_L1 * cos(c->angles[0][1]), m12 = x[1] + along * x[2] - gr * x[8];
    const double m11 = x[0] + 2.0 * along * x[2] + gr * gr * x[8] + x[8], m22 = x[1] + gr * gr * x[8];
    const double a1 = gain * c->noise[0] * (joint == 0 ? m11 : m12), a2 = gain * c->noise[1] * (joint == 0 ? m12 : m22);
    bias[0] = joint == 0 ? a1 : 0.0;
    bias[1] = joint == 0 ? a2 : a1 + a2;
    bias[2] = along * (joint == 0 ? 2.0 * a1 + a2 : a1);
    bias[3] = joint == 0 ? (gr * gr + 1.0) * a1 - gr * a2 : gr * gr * a2 - gr * a1;
}

/* One joint's low-passed row: the variance of its errors, and what it tells of the unknowns. */
static inline void swingup_update(swingup_identifier *c, int joint, double step)
{
    const double bound = swingup_max_variance[joint];
    const double *row = c->filter.rows[2][joint];
    double uncertain[SWINGUP_UNKNOWNS], bias[4], predictive_variance = 0.0, error = row[SWINGUP_UNKNOWNS], size = fabs(error);
    double floor_variance, r, distance, gate, w, row_variance, square;
    int i, j;

    for (i = 0; i < SWINGUP_UNKNOWNS; i++) {
        const double *p = c->covariance[i];
        double even = p[0] * row[0], odd = 0.0;
        /* Two sums, since each addition waits for the one before; the unknowns are 13 or 17, an odd number. */
        for (j = 1; j + 1 < SWINGUP_UNKNOWNS; j += 2) {
            odd += p[j] * row[j];
            even += p[j + 1] * row[j + 1];
        }
        uncertain[i] = even + odd;
        predictive_variance += row[i] * uncertain[i];
        error -= row[i] * c->unknowns[i];
    }
    for (i = 0; i < 4; i++) {
        size += fabs(row[i]) * fabs(c->unknowns[i]);
    }
    floor_variance = swingup_min_variance[joint] + (SWINGUP_RELATIVE_FLOOR * size) * (SWINGUP_RELATIVE_FLOOR * size);
    r = swingup_max(c->variance[joint], floor_variance);
    distance = error * error / (predictive_variance + r);
    gate = distance > SWINGUP_GATE_SQUARED ? SWINGUP_GATE_TIME : c->gate[joint] - step;
    w = (SWINGUP_FREEDOM + distance) / (SWINGUP_FREEDOM + 1.0);
    row_variance = r * swingup_max(1.0, SWINGUP_CORRELATION / step) * swingup_max(w, 1.0);
    /* Bounded: one wrong angle must not blind the identifier for seconds. */
    square = distance * r < bound ? distance * r : bound;
    c->variance[joint] += -swingup_expm1(-step / (square > c->variance[joint] ? SWINGUP_RISE_TIME : SWINGUP_FALL_TIME)) * (square - c->variance[joint]);
    c->gate[joint] = swingup_max(gate, 0.0);
    swingup_noise_bias(c, joint, step, bias);
    for (i = 0; i < SWINGUP_UNKNOWNS; i++) {
        const double gain = gate > 0.0 ? 0.0 : uncertain[i] / (predictive_variance + row_variance);
        c->unknowns[i] += gain * error;
        /* Half of the symmetric matrix is computed: at -O2 this loop was a quarter of a call's time. */
        for (j = 0; j <= i; j++) {
            c->covariance[i][j] -= gain * uncertain[j];
            c->covariance[j][i] = c->covariance[i][j];
        }
    }
    for (i = 0; i < SWINGUP_UNKNOWNS && !(gate > 0.0); i++) {
        const double *p = c->covariance[i];
        c->unknowns[i] += (p[0] * bias[0] + p[1] * bias[1] + p[2] * bias[2] + p[8] * bias[3]) / row_variance;
    }
}

/* The low-passes, both rows, and the drift; 0 if what was found is not finite. */
static inline int swingup_learn(swingup_identifier *c)
{
    const double step = swingup_period(c), weight = -swingup_expm1(-SWINGUP_BANDWIDTH * step);
    double rows[2][SWINGUP_UNKNOWNS + 1];
    int i, j, k, finite = 1;

    swingup_rows(c, rows);
    for (i = 0; i < 2; i++) {
        for (k = 0; k <= SWINGUP_UNKNOWNS; k++) {
            double value = rows[i][k];
            for (j = 0; j < 3; j++) {
                c->filter.rows[j][i][k] += weight * (value - c->filter.rows[j][i][k]);
                value = c->filter.rows[j][i][k];
            }
        }
    }
    swingup_follow_noise(c, step);
    swingup_update(c, 0, step);
    swingup_update(c, 1, step);
    for (i = 0; i < SWINGUP_UNKNOWNS; i++) {
        /* No less sure than at the start. */
        c->covariance[i][i] += c->covariance[i][i] < swingup_prior[i][i] ? swingup_drift[i] * step : 0.0;
        /* The diagonal speaks for the matrix: what an update takes from the rest is never more than from there. */
        finite = finite && swingup_finite(&c->covariance[i][i], 1);
    }
    return finite && swingup_finite(c->unknowns, SWINGUP_UNKNOWNS);
}

/* Base parameters of a pendulum: a mass matrix far from positive definite is moved towards the nominal one. */
static inline void swingup_project(swingup_identifier *c)
{
    const double *found = c->unknowns;
    const double coupling = SWINGUP_L1 * found[2], geared = SWINGUP_GEAR * found[8], reflected = SWINGUP_GEAR * geared;
    double share = 1.0;
    int i;

    for (i = 0; i < 2; i++) {
        const double cosine = i == 0 ? coupling : -coupling, *n = swingup_nominal_mass[i];
        const double m11 = found[0] + 2.0 * cosine + reflected + found[8];
        const double m12 = found[1] + cosine - geared, m22 = found[1] + reflected;
        const double determinant = n[0] * n[2] - n[1] * n[1];
        const double half = 0.5 * (n[2] * m11 - 2.0 * n[1] * m12 + n[0] * m22) / determinant;
        const double product = (m11 * m22 - m12 * m12) / determinant;
        /* Both eigenvalues are real; rounding may not make the root's argument negative. */
        const double smallest = half - sqrt(fabs(half * half - product));
        const double allowed = (1.0 - SWINGUP_MIN_MASS_SHARE) / (1.0 - (smallest < SWINGUP_MIN_MASS_SHARE ? smallest : SWINGUP_MIN_MASS_SHARE));
        share = allowed < share ? allowed : share;
    }
    for (i = 0; i < 9; i++) {
        c->base[i] = swingup_mean[i] + share * (found[i] - swingup_mean[i]);
    }
    swingup_share_out(c);
}

/* After a pause: what was found stays, the motion before is forgotten. */
static inline void swingup_interrupt(swingup_identifier *c)
{
    int k;
    c->calls = 0;
    memset(&c->filter, 0, sizeof c->filter);
    for (k = 0; k < SWINGUP_COMMANDS; k++) {
        c->torques[k][0] = c->torques[k][1] = 0.0;
        c->steps[k] = SWINGUP_DT;
    }
}

/* Time between the angles of the call before and those of this one, h (s) after it. */
static inline double swingup_interval(const swingup_identifier *c, double h)
{
    return c->age > 0 ? c->steps[c->age - 1] : h;
}

/* Time since the angles of this call, h (s) after the one before, were those of the plant. */
static inline double swingup_elapsed(const swingup_identifier *c, double h)
{
    return c->age > 0 ? h + swingup_age(c, c->age - 1) : 0.0;
}

/* The angles' age (calls): a longer step shows as a longer way in the same call, or in a later one. */
static inline int swingup_weigh_ages(swingup_identifier *c)
{
    const double time = swingup_age(c, 2 * SWINGUP_SPAN);
    double rate[2], bend[2], minimum = INFINITY;
    int i, k, likely = 0;
    for (i = 0; i < 2; i++) {
        rate[i] = (c->angles[0][i] - c->angles[2 * SWINGUP_SPAN][i]) / (time * SWINGUP_UNEVEN_ANGLE);
        bend[i] = (c->angles[0][i] - 2.0 * c->angles[1][i] + c->angles[2][i]) / SWINGUP_UNEVEN_ANGLE;
    }
    for (k = 0; k < SWINGUP_AGES; k++) {
        const double longer = c->steps[k] - c->steps[k + 1];
        const double miss1 = bend[0] - rate[0] * longer, miss2 = bend[1] - rate[1] * longer;
        const double now = c->calls > 2 * SWINGUP_SPAN ? swingup_log1p(miss1 * miss1 + miss2 * miss2) : 0.0;
        const double evidence = SWINGUP_AGE_FADING * c->age_evidence[k] + now;
        likely = evidence < minimum ? k : likely;
        minimum = evidence < minimum ? evidence : minimum;
        c->age_evidence[k] = evidence;
    }
    return c->age_evidence[c->age] - minimum > SWINGUP_AGE_MARGIN ? likely : c->age;
}

/* Learn from the angles of x, which are delay_steps old, a pause (s) after the call before. */
static inline void swingup_identify(swingup_identifier *c, const double x[4], int delay_steps, double pause)
{
    const int angles = 2 * SWINGUP_SPAN + 1;
    const int is_near = swingup_finite(x, 2) && fabs(x[0]) < SWINGUP_MAX_ANGLE && fabs(x[1]) < SWINGUP_MAX_ANGLE;
    const int late = !(pause >= 0.0 && pause <= SWINGUP_MAX_STEP);
    double step = pause > 0.0 ? pause : SWINGUP_DT;
    swingup_identifier before;
    int i, k, age;

    /* Such an angle would stay in the differences. */
    if (late || !is_near) {
        swingup_interrupt(c);
    }
    if (!is_near) {
        return;
    }
    for (i = 0; i < 2; i++) {
        const double newest = c->angles[0][i] + swingup_turned(x[i] - c->angles[0][i]);
        for (k = angles - 1; k > 0; k--) {
            c->angles[k][i] = c->calls == 0 ? x[i] : c->angles[k - 1][i];
        }
        c->angles[0][i] = c->calls == 0 ? x[i] : newest;
    }
    step = c->calls == 0 ? SWINGUP_DT : step;
    swingup_push(c->steps, SWINGUP_COMMANDS, step);
    age = swingup_weigh_ages(c);
    delay_steps = delay_steps > age ? delay_steps : age;
    /* The lag counts from the delay: their sum is what was found. The old rows belong to the old delay. */
    if (delay_steps != c->delay_steps || age != c->age) {
        c->unknowns[SWINGUP_LAG] += swingup_age(c, c->delay_steps) - swingup_age(c, delay_steps);
        memset(&c->filter, 0, sizeof c->filter);
        c->delay_steps = delay_steps;
        c->age = age;
    }
    c->calls += c->calls < angles + SWINGUP_COMMANDS;
    /* The torques before a restart are not known. */
    if (c->calls >= angles + delay_steps) {
        before = *c;
        if (swingup_learn(c)) {
            swingup_project(c);
        } else {
            *c = before;
        }
    }
}

/* Note the torques that both motors were asked for, the driven one within its limit (N m). */
static inline void swingup_note(swingup_identifier *c, const double u[2])
{
    int k;
    for (k = SWINGUP_COMMANDS - 1; k > 0; k--) {
        swingup_copy(c->torques[k], c->torques[k - 1], 2);
    }
    swingup_copy(c->torques[0], u, 2);
}
#endif

#endif
