/*
 * The runtime of a policy. All of its numbers stand before it, as swingup writes them: export/c_backend/data.py says
 * where each comes from. the folders of swingup/policy have the
 * equations: estimator/core.py, identifier/core.py, regulator/core.py and guard/core.py. These switches, each 0 or 1, say what is around the network.
 *
 *     SWINGUP_HAS_ESTIMATOR     a state estimator, which finds the loop's delay
 *     SWINGUP_HAS_IDENTIFIER    what finds the estimator's plant in the loop
 *     SWINGUP_HAS_REGULATOR     what takes over near the top
 *     SWINGUP_HAS_GUARD         what stops the controller at a limit or a broken measurement
 */
#ifndef SWINGUP_RUNTIME_H
#define SWINGUP_RUNTIME_H

#include <math.h>
#include <stdint.h>

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#error "compile without -ffast-math and -ffinite-math-only: NaN would pass all checks, with full torque"
#endif
#if SWINGUP_HAS_IDENTIFIER && !SWINGUP_HAS_ESTIMATOR
#error "an identifier needs an estimator: it is told the delay"
#endif

#define SWINGUP_PI 3.14159265358979323846

/*
 * What the network computes in. Define SWINGUP_REAL as float before the include where double is slow: torques then
 * differ by up to 1e-4 N m. All around the network computes in double precision.
 */
#ifndef SWINGUP_REAL
#define SWINGUP_REAL double
#endif
typedef SWINGUP_REAL swingup_real;

static inline double swingup_clip(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

static inline double swingup_more(double value, double other)
{
    return value > other ? value : other;
}

/* Whether the first numbers of an array are finite: by their bits, since a compiler may take isfinite for true. */
static inline int swingup_finite(const double *values, int count)
{
    union {
        double number;
        uint64_t bits;
    } each;
    int i, finite = 1;
    for (i = 0; i < count; i++) {
        each.number = values[i];
        finite = finite && (each.bits >> 52 & 0x7ff) != 0x7ff;
    }
    return finite;
}

/* An angle's distance (rad) without whole turns. */
static inline double swingup_turned(double angle)
{
    return angle - 2.0 * SWINGUP_PI * rint(angle / (2.0 * SWINGUP_PI));
}

/* ---- the network ---- */

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
    return swingup_network(x, swingup_theta);
}

#if SWINGUP_HAS_ESTIMATOR
/* ---- the estimator's model of the plant ---- */

typedef struct {
    double m11, m12, m22, coupling, gravity1, gravity2; /* of the mass matrix (kg m^2) and of gravity (N m) */
    const double *damping, *coulomb;                    /* friction of both joints (N m s/rad, N m) */
} swingup_plant;

/* The plant with these base parameters, and friction: damping of both joints, then Coulomb friction. */
static inline void swingup_believe(swingup_plant *p, const double base[9], const double friction[4])
{
    const double geared = SWINGUP_GEAR * base[8], reflected = SWINGUP_GEAR * geared;
    p->m11 = base[0] + reflected + base[8];
    p->m12 = base[1] - geared;
    p->m22 = base[1] + reflected;
    p->coupling = SWINGUP_L1 * base[2];
    p->gravity1 = SWINGUP_GRAVITY * base[3];
    p->gravity2 = SWINGUP_GRAVITY * base[2];
    p->damping = friction;
    p->coulomb = friction + 2;
}

/*
 * Accelerations (rad/s^2) under a torque of the driven joint (N m). Friction is linear about the rates of x and acts on
 * those at the end of a step of h (s) that starts with the rates first[2].
 */
static inline void swingup_acceleration(
    const swingup_plant *p, const double x[4], double torque, const double *first, double h, double a[2])
{
    const double cosine = p->coupling * cos(x[1]), sine = p->coupling * sin(x[1]);
    const double weight = p->gravity2 * sin(x[0] + x[1]), m12 = p->m12 + cosine;
    double m[2], f[2], determinant;
    int i;
    m[0] = p->m11 + 2.0 * cosine;
    m[1] = p->m22;
    f[0] = -p->gravity1 * sin(x[0]) - weight + sine * x[3] * (2.0 * x[2] + x[3]);
    f[1] = -weight - sine * x[2] * x[2];
    f[SWINGUP_DRIVEN] += torque;
    for (i = 0; i < 2; i++) {
        const double steep = SWINGUP_STEEPNESS * x[i + 2];
        const double slope = p->damping[i] + SWINGUP_STEEPNESS * p->coulomb[i] / (1.0 + steep * steep);
        f[i] -= p->damping[i] * x[i + 2] + p->coulomb[i] * atan(steep) - slope * (x[i + 2] - first[i]);
        m[i] += h * slope;
    }
    determinant = m[0] * m[1] - m12 * m12;
    a[0] = (m[1] * f[0] - m12 * f[1]) / determinant;
    a[1] = (m[0] * f[1] - m12 * f[0]) / determinant;
}

/* One step over h (s), in place, of the midpoint rule with implicit friction; without friction it is explicit. */
static inline void swingup_step(const swingup_plant *p, double x[4], double torque, double h)
{
    double a[2], middle[4];
    swingup_acceleration(p, x, torque, x + 2, 0.5 * h, a);
    middle[0] = x[0] + 0.5 * h * x[2];
    middle[1] = x[1] + 0.5 * h * x[3];
    middle[2] = x[2] + 0.5 * h * a[0];
    middle[3] = x[3] + 0.5 * h * a[1];
    swingup_acceleration(p, middle, torque, x + 2, h, a);
    x[0] += h * middle[2];
    x[1] += h * middle[3];
    x[2] += h * a[0];
    x[3] += h * a[1];
}

/* What one N m on the driven joint adds to the accelerations (rad/s^2) at the angles of x. */
static inline void swingup_response(const swingup_plant *p, const double x[4], double response[2])
{
    const double cosine = p->coupling * cos(x[1]);
    const double m11 = p->m11 + 2.0 * cosine, m12 = p->m12 + cosine, determinant = m11 * p->m22 - m12 * m12;
    response[SWINGUP_DRIVEN] = (SWINGUP_DRIVEN == 0 ? p->m22 : m11) / determinant;
    response[1 - SWINGUP_DRIVEN] = -m12 / determinant;
}
#endif

#if SWINGUP_HAS_IDENTIFIER
/* ---- the identifier of the plant ---- */

/*
 * The unknowns: nine base parameters, what the offsets of both angles add to gravity's torques (kg m), the torque's
 * lag (s) behind the delay, and the part of its command that the undriven joint's motor delivers.
 */
#define SWINGUP_UNKNOWNS 13
#define SWINGUP_TILT 9
#define SWINGUP_LAG 11
#define SWINGUP_GAIN 12

typedef struct {
    /* After each low-pass, of both joints: a number for each unknown, and the torque. */
    double rows[3][2][SWINGUP_UNKNOWNS + 1];
} swingup_filter;

typedef struct {
    int calls;                              /* measurements since the last restart */
    int delay_steps;                        /* the delay told last (steps), or age where that is more */
    int age;                                /* 1 if the angles are those of the call before, else 0 */
    double missed[2];                       /* what the motion misses with age 0, and with age 1 */
    double angles[2 * SWINGUP_SPAN + 1][2]; /* measured, without jumps of full turns, newest first (rad) */
    double torques[SWINGUP_COMMANDS][2];    /* asked of both motors, newest first (N m) */
    double steps[SWINGUP_COMMANDS];         /* time for which each was held (s) */
    swingup_filter filter;
    double unknowns[SWINGUP_UNKNOWNS];
    double covariance[SWINGUP_UNKNOWNS][SWINGUP_UNKNOWNS];
    double variance[2]; /* of what each joint's row leaves unexplained (N^2 m^2) */
    double held[2];     /* time for which each joint's row is still not used (s) */
    double base[9];     /* base parameters of a pendulum: those found, or as near to them as can be */
    double told[9];     /* the same with the friction that the compensation leaves */
    double felt[4];     /* friction of the estimator's model: damping of both joints, then Coulomb friction */
    double asked[4];    /* the same, of the friction whose counterpart the motors are asked for */
    double offsets[2];  /* how much the measured angles are too large (rad) */
} swingup_identifier;

/* The compensation of the friction found, and the offsets of the angles. */
static inline void swingup_share(swingup_identifier *c)
{
    const double *tilt = c->unknowns + SWINGUP_TILT;
    const double delivered = swingup_more(c->unknowns[SWINGUP_GAIN], 0.0);
    const double asks = SWINGUP_PASSIVE_LIMIT > 0.0 ? 1.0 / swingup_more(delivered, SWINGUP_LEAST_GAIN) : 0.0;
    int i;
    for (i = 0; i < 9; i++) {
        c->told[i] = c->base[i];
    }
    for (i = 0; i < 4; i++) {
        const int driven = i % 2 == SWINGUP_DRIVEN;
        c->asked[i] = swingup_more(c->base[4 + i], 0.0) * (driven ? 1.0 : asks);
        c->told[4 + i] -= (driven ? 1.0 : delivered) * c->asked[i];
        /* It brakes, or the implicit step would be singular near rest. The estimator counts the driven motor alone. */
        c->felt[i] = swingup_more(driven ? c->base[4 + i] : c->told[4 + i], 0.0);
    }
    c->offsets[0] = swingup_clip(tilt[0] / c->base[3], SWINGUP_MOST_OFFSET);
    c->offsets[1] = swingup_clip(tilt[1] / c->base[2], SWINGUP_MOST_OFFSET) - c->offsets[0];
}

/* Add the torques (N m) against the friction found, for the state seen; NaN if that is not finite. */
static inline void swingup_compensate(const swingup_identifier *c, const double seen[4], double u[2])
{
    const int finite = swingup_finite(seen, 4);
    int i;
    for (i = 0; i < 2; i++) {
        const double rate = seen[i + 2], torque = c->asked[i] * rate + c->asked[i + 2] * atan(SWINGUP_STEEPNESS * rate);
        /* The arctangent and the clip would make a finite torque of an infinite velocity. */
        u[i] += !finite ? (double)NAN : i == SWINGUP_DRIVEN ? torque : swingup_clip(torque, SWINGUP_PASSIVE_LIMIT);
    }
}

/* Nothing seen yet. */
static inline void swingup_begin(swingup_identifier *c)
{
    static const swingup_identifier fresh = {0};
    int i, j;
    *c = fresh;
    for (i = 0; i < SWINGUP_UNKNOWNS; i++) {
        c->unknowns[i] = swingup_mean[i];
        for (j = 0; j < SWINGUP_UNKNOWNS; j++) {
            c->covariance[i][j] = swingup_prior[i][j];
        }
    }
    for (i = 0; i < 2; i++) {
        c->variance[i] = swingup_first_variance[i];
    }
    for (i = 0; i < 9; i++) {
        c->base[i] = swingup_mean[i];
    }
    for (i = 0; i < SWINGUP_COMMANDS; i++) {
        c->steps[i] = SWINGUP_DT;
    }
    swingup_share(c);
}

/* Half of both joints' equations, at the midpoint between angles (rad). */
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
    return rate * atan(steep) - log1p(steep * steep) / (2.0 * SWINGUP_STEEPNESS);
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

/* The newest rows of shoulder and elbow: a number for each unknown, and the driven joint's torque. */
static inline void swingup_rows(const swingup_identifier *c, double rows[2][SWINGUP_UNKNOWNS + 1])
{
    const double gr = SWINGUP_GEAR, *steps = c->steps + c->age, (*torques)[2] = c->torques + c->delay_steps;
    double a[2], pull[2], slope[2], bend[2], turning, torque[2] = {0.0, 0.0}, rate = 0.0;
    double newer = 0.0, older = 0.0, mean, now = 0.0;
    swingup_half one, two;
    int i, k;

    for (k = 0; k < SWINGUP_SPAN; k++) {
        newer += steps[k];
        older += steps[SWINGUP_SPAN + k];
    }
    mean = 0.5 * (newer + older);
    swingup_halve(c->angles[2 * SWINGUP_SPAN], c->angles[SWINGUP_SPAN], older, &one);
    swingup_halve(c->angles[SWINGUP_SPAN], c->angles[0], newer, &two);
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
    for (i = 0; i < 2; i++) {
        rows[i][4 + i] = 0.5 * (one.rates[i] + two.rates[i]);
        rows[i][6 + i] = swingup_mean_arctan(one.rates[i], two.rates[i]);
    }
    /* The hat rises to the middle angle and falls to the others; each torque is held over its step. */
    for (k = 0; k < 2 * SWINGUP_SPAN; k++) {
        const double change = k < SWINGUP_SPAN ? steps[k] / newer : -steps[k] / older;
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

/* One joint's low-passed row: the variance of its errors, and what it tells of the unknowns. */
static inline void swingup_update(swingup_identifier *c, int joint)
{
    const double least = swingup_least_variance[joint], most = swingup_most_variance[joint];
    const double *row = c->filter.rows[2][joint];
    double known[SWINGUP_UNKNOWNS], unsure = 0.0, error = row[SWINGUP_UNKNOWNS], size = fabs(error);
    double lowest, r, distance, held, w, heavy, seen;
    int i, j;

    for (i = 0; i < SWINGUP_UNKNOWNS; i++) {
        known[i] = 0.0;
        for (j = 0; j < SWINGUP_UNKNOWNS; j++) {
            known[i] += c->covariance[i][j] * row[j];
        }
        unsure += row[i] * known[i];
        error -= row[i] * c->unknowns[i];
    }
    for (i = 0; i < 4; i++) {
        size += fabs(row[i]) * fabs(c->unknowns[i]);
    }
    lowest = least + (SWINGUP_RELATIVE_FLOOR * size) * (SWINGUP_RELATIVE_FLOOR * size);
    r = c->variance[joint] > lowest ? c->variance[joint] : lowest;
    distance = error * error / (unsure + r);
    held = distance > SWINGUP_GATE_SQUARED ? SWINGUP_HOLD : c->held[joint] - SWINGUP_DT;
    w = (SWINGUP_STUDENT + distance) / (SWINGUP_STUDENT + 1.0);
    heavy = r * SWINGUP_ALIKE * (w > 1.0 ? w : 1.0);
    /* A spoilt angle must not blind the identifier for seconds. */
    seen = distance * r < most ? distance * r : most;
    c->variance[joint] += (seen > c->variance[joint] ? SWINGUP_RISE : SWINGUP_FALL) * (seen - c->variance[joint]);
    c->held[joint] = held > 0.0 ? held : 0.0;
    for (i = 0; i < SWINGUP_UNKNOWNS; i++) {
        const double gain = held > 0.0 ? 0.0 : known[i] / (unsure + heavy);
        c->unknowns[i] += gain * error;
        for (j = 0; j < SWINGUP_UNKNOWNS; j++) {
            c->covariance[i][j] -= gain * known[j];
        }
    }
}

/* The low-passes, both rows, and the drift; 0 if what was found is not finite. */
static inline int swingup_learn(swingup_identifier *c)
{
    double rows[2][SWINGUP_UNKNOWNS + 1];
    int i, j, k;

    swingup_rows(c, rows);
    for (i = 0; i < 2; i++) {
        for (k = 0; k <= SWINGUP_UNKNOWNS; k++) {
            double value = rows[i][k];
            for (j = 0; j < 3; j++) {
                c->filter.rows[j][i][k] += SWINGUP_POLE * (value - c->filter.rows[j][i][k]);
                value = c->filter.rows[j][i][k];
            }
        }
    }
    swingup_update(c, 0);
    swingup_update(c, 1);
    for (i = 0; i < SWINGUP_UNKNOWNS; i++) {
        /* No less sure than at the start. */
        c->covariance[i][i] += c->covariance[i][i] < swingup_prior[i][i] ? swingup_drift[i] : 0.0;
    }
    return swingup_finite(c->unknowns, SWINGUP_UNKNOWNS) &&
           swingup_finite(&c->covariance[0][0], SWINGUP_UNKNOWNS * SWINGUP_UNKNOWNS);
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
        const double allowed = (1.0 - SWINGUP_MARGIN) / (1.0 - (smallest < SWINGUP_MARGIN ? smallest : SWINGUP_MARGIN));
        share = allowed < share ? allowed : share;
    }
    for (i = 0; i < 9; i++) {
        c->base[i] = swingup_mean[i] + share * (found[i] - swingup_mean[i]);
    }
    swingup_share(c);
}

/* After a pause: what was found stays, the motion before is forgotten. */
static inline void swingup_interrupt(swingup_identifier *c)
{
    static const swingup_filter empty = {{{{0.0}}}};
    int k;
    c->calls = 0;
    c->filter = empty;
    for (k = 0; k < SWINGUP_COMMANDS; k++) {
        c->torques[k][0] = c->torques[k][1] = 0.0;
        c->steps[k] = SWINGUP_DT;
    }
}

/* Time between the angles of the call before and those of this one, h (s) after it. */
static inline double swingup_interval(const swingup_identifier *c, double h)
{
    return c->age > 0 ? c->steps[0] : h;
}

/* The angles' age (calls): a longer step shows as a longer way in the same call, or in the next. */
static inline int swingup_weigh_ages(swingup_identifier *c)
{
    const double time = swingup_age(c, 2 * SWINGUP_SPAN);
    double more;
    int i, k;
    for (k = 0; k < 2; k++) {
        double misses = 0.0;
        for (i = 0; i < 2; i++) {
            const double rate = (c->angles[0][i] - c->angles[2 * SWINGUP_SPAN][i]) / time;
            const double miss = c->angles[0][i] - 2.0 * c->angles[1][i] + c->angles[2][i] -
                                rate * (c->steps[k] - c->steps[k + 1]);
            misses += miss * miss;
        }
        c->missed[k] *= SWINGUP_UNEVEN_FADING;
        c->missed[k] += c->calls > 2 * SWINGUP_SPAN ? log1p(misses / SWINGUP_UNEVEN_SQUARED) : 0.0;
    }
    more = c->missed[0] - c->missed[1];
    return more > SWINGUP_AGE_CAUTION ? 1 : more < -SWINGUP_AGE_CAUTION ? 0 : c->age;
}

/* Learn from the angles of x, which are delay_steps old, a pause (s) after the call before. */
static inline void swingup_identify(swingup_identifier *c, const double x[4], int delay_steps, double pause)
{
    static const swingup_filter empty = {{{{0.0}}}};
    const int angles = 2 * SWINGUP_SPAN + 1;
    /* Not what is NaN either. */
    const int near = fabs(x[0]) < SWINGUP_FARTHEST && fabs(x[1]) < SWINGUP_FARTHEST;
    const int late = !(pause >= 0.0 && pause <= SWINGUP_LONGEST_STEP);
    double step = pause > 0.0 ? pause : SWINGUP_DT;
    swingup_identifier learned;
    int i, k, age;

    /* Such an angle would stay in the differences. */
    if (late || !near) {
        swingup_interrupt(c);
    }
    if (!near) {
        return;
    }
    for (i = 0; i < 2; i++) {
        const double newest = c->angles[0][i] + swingup_turned(x[i] - c->angles[0][i]);
        for (k = angles - 1; k > 0; k--) {
            c->angles[k][i] = c->calls == 0 ? x[i] : c->angles[k - 1][i];
        }
        c->angles[0][i] = c->calls == 0 ? x[i] : newest;
    }
    step = c->calls == 0 ? SWINGUP_DT : step > SWINGUP_SHORTEST_STEP ? step : SWINGUP_SHORTEST_STEP;
    for (k = SWINGUP_COMMANDS - 1; k > 0; k--) {
        c->steps[k] = c->steps[k - 1];
    }
    c->steps[0] = step;
    age = swingup_weigh_ages(c);
    delay_steps = delay_steps > age ? delay_steps : age;
    /* The lag counts from the delay: their sum is what was found. The old rows belong to the old delay. */
    if (delay_steps != c->delay_steps || age != c->age) {
        c->unknowns[SWINGUP_LAG] += swingup_age(c, c->delay_steps) - swingup_age(c, delay_steps);
        c->filter = empty;
        c->delay_steps = delay_steps;
        c->age = age;
    }
    c->calls += c->calls < angles + SWINGUP_COMMANDS;
    /* The torques before a restart are not known. */
    if (c->calls >= angles + delay_steps) {
        learned = *c;
        if (swingup_learn(&learned)) {
            swingup_project(&learned);
            *c = learned;
        }
    }
}

/* Note the torques that both motors were asked for, the driven one within its limit (N m). */
static inline void swingup_note(swingup_identifier *c, double driven, double passive)
{
    int k;
    for (k = SWINGUP_COMMANDS - 1; k > 0; k--) {
        c->torques[k][0] = c->torques[k - 1][0];
        c->torques[k][1] = c->torques[k - 1][1];
    }
    c->torques[0][SWINGUP_DRIVEN] = driven;
    c->torques[0][1 - SWINGUP_DRIVEN] = passive;
}
#endif

#if SWINGUP_HAS_ESTIMATOR
/* ---- the state estimator ---- */

typedef struct {
    int called;                           /* 0 before the first call */
    int delay_steps;                      /* the delay found (steps) */
    double time;                          /* of the last call (s) */
    double state[4];                      /* estimate of the measured state, as old as the delay */
    double torques[SWINGUP_DELAYS];       /* commanded, newest first (N m) */
    double deviations[SWINGUP_DELAYS][4]; /* what the filter with each delay estimates besides */
    double surprise[SWINGUP_DELAYS];      /* evidence against each delay */
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
 * One step over h (s) of the filter in charge and of the bank, for angles of a known age (calls); 0, and no change, if
 * the estimate is lost.
 */
static inline int swingup_follow(swingup_estimator *c, const swingup_plant *plant, const double x[4], double h, int age)
{
    const double torque = c->torques[c->delay_steps];
    double drifted[SWINGUP_DELAYS][4], surprise[SWINGUP_DELAYS], least = 0.0;
    double predicted[4], miss[4], correction[4], change[4], response[2];
    int i, n, best = 0;

    for (i = 0; i < 4; i++) {
        predicted[i] = c->state[i];
    }
    swingup_step(plant, predicted, torque, h);
    for (i = 0; i < 4; i++) {
        miss[i] = x[i] - predicted[i];
    }
    for (i = 0; i < 2; i++) {
        miss[i] = swingup_turned(miss[i]);
    }
    swingup_response(plant, c->state, response);

    for (n = 0; n < SWINGUP_DELAYS; n++) {
        double far = 0.0, evidence;
        for (i = 0; i < 2; i++) {
            const double extra = (c->torques[n] - torque) * response[i];
            const double *d = c->deviations[n];
            drifted[n][i] = d[i] + h * d[i + 2] + 0.5 * h * h * extra;
            drifted[n][i + 2] = d[i + 2] + h * extra;
            far += (miss[i] - drifted[n][i]) * (miss[i] - drifted[n][i]);
        }
        surprise[n] = SWINGUP_FADING * c->surprise[n] + log1p(far / SWINGUP_RESIDUAL_SQUARED);
        evidence = surprise[n] + SWINGUP_CAUTION * n;
        if (!swingup_finite(&evidence, 1)) {
            return 0;
        }
        /* A delay below the angles' own age cannot be. */
        if (n <= age || evidence < least) {
            least = evidence;
            best = n;
        }
    }

    for (n = 0; n < SWINGUP_DELAYS; n++) {
        swingup_correction(drifted[n], correction);
        for (i = 0; i < 4; i++) {
            drifted[n][i] -= correction[i];
        }
    }
    swingup_correction(miss, change);
    for (i = 0; i < 4; i++) {
        predicted[i] += change[i] + drifted[best][i];
    }
    if (!(fabs(x[2] - predicted[2]) <= SWINGUP_LOST_RATE && fabs(x[3] - predicted[3]) <= SWINGUP_LOST_RATE)) {
        return 0;
    }
    for (i = 0; i < 4; i++) {
        const double in_charge = drifted[best][i];
        c->state[i] = predicted[i];
        for (n = 0; n < SWINGUP_DELAYS; n++) {
            c->deviations[n][i] = drifted[n][i] - in_charge;
        }
    }
    for (n = 0; n < SWINGUP_DELAYS; n++) {
        c->surprise[n] = surprise[n];
    }
    c->delay_steps = best;
    return 1;
}

/* Sum of the torques commanded in the last n steps, linear between whole n, n >= 0. */
static inline double swingup_commanded(const swingup_estimator *c, double n)
{
    double sum = 0.0;
    int k;
    for (k = 0; k < SWINGUP_DELAYS && k + 1 <= n; k++) {
        sum += c->torques[k];
    }
    return k < SWINGUP_DELAYS ? sum + (n - k) * c->torques[k] : sum;
}

/* The state after the delay, steps of h (s), in pieces with the mean of the torques that act in each. */
static inline void swingup_ahead(const swingup_estimator *c, const swingup_plant *plant, double x[4], double h)
{
    const double steps = (double)c->delay_steps / SWINGUP_PIECES;
    int piece;
    for (piece = SWINGUP_PIECES; piece > 0 && c->delay_steps > 0; piece--) {
        const double sum = swingup_commanded(c, piece * steps) - swingup_commanded(c, (piece - 1) * steps);
        swingup_step(plant, x, sum / steps, steps * h);
    }
}

/* An estimate of the state now, for the state measured at time t (s). */
static inline void swingup_observe(swingup_estimator *c, double t, const double measured[4], double seen[4])
{
    const double pause = t - c->time, h = pause > 0.0 ? pause : SWINGUP_DT;
    const int late = !c->called || !(pause >= 0.0 && pause <= 1.5 * SWINGUP_DT);
#if SWINGUP_HAS_IDENTIFIER
    swingup_identifier *found = &c->identifier;
    const double *base = found->base, *friction = found->felt, *offsets = found->offsets;
    const double x[4] = {measured[0] - offsets[0], measured[1] - offsets[1], measured[2], measured[3]};
    const double interval = swingup_interval(found, h);
    const int age = found->age;
#else
    const double *x = measured, *base = swingup_theta, *friction = swingup_theta + 4;
    const double interval = h;
    const int age = 0;
#endif
    swingup_plant plant;
    int i, n;

    swingup_believe(&plant, base, friction);
    if (late || !swingup_follow(c, &plant, x, interval, age)) {
        for (i = 0; i < 4; i++) {
            c->state[i] = seen[i] = x[i];
        }
        for (n = 0; n < SWINGUP_DELAYS; n++) {
            c->torques[n] = 0.0;
            for (i = 0; i < 4; i++) {
                c->deviations[n][i] = 0.0;
            }
        }
    } else {
        for (i = 0; i < 4; i++) {
            seen[i] = c->state[i];
        }
        swingup_ahead(c, &plant, seen, h);
        if (!swingup_finite(seen, 4)) {
            for (i = 0; i < 4; i++) {
                seen[i] = x[i];
            }
        }
    }
#if SWINGUP_HAS_IDENTIFIER
    swingup_identify(found, measured, c->delay_steps, c->called ? pause : -1.0);
#endif
    c->called = 1;
    c->time = t;
}

/* Note the torques that the motors were asked for (N m). */
static inline void swingup_remember(swingup_estimator *c, const double u[2])
{
    int n;
    for (n = SWINGUP_DELAYS - 1; n > 0; n--) {
        c->torques[n] = c->torques[n - 1];
    }
    c->torques[0] = swingup_clip(u[SWINGUP_DRIVEN], swingup_limits[SWINGUP_DRIVEN]);
#if SWINGUP_HAS_IDENTIFIER
    swingup_note(&c->identifier, c->torques[0], u[1 - SWINGUP_DRIVEN]);
#endif
}
#endif

#if SWINGUP_HAS_REGULATOR
/* ---- the regulator near the top ---- */

typedef struct {
    int begun;               /* 0 before the first call */
    int acting;              /* whether the regulator acts */
    double cost_to_go[4][4]; /* P */
} swingup_regulator;

/* [A b] of one step of the recursion, for base parameters theta. */
static inline void swingup_upright(const double theta[9], double step[4][5])
{
    const double h = SWINGUP_RICCATI_STEP, half = 0.5 * h * h;
    const double gravity2 = SWINGUP_GRAVITY * theta[2], gravity1 = SWINGUP_GRAVITY * theta[3];
    const double geared = SWINGUP_GEAR * theta[8], reflected = SWINGUP_GEAR * geared, coupling = SWINGUP_L1 * theta[2];
    const double m11 = theta[0] + 2.0 * coupling + reflected + theta[8], m12 = theta[1] + coupling - geared;
    const double m22 = theta[1] + reflected, scale = 1.0 / (m11 * m22 - m12 * m12);
    const double inverse[2][2] = {{m22 * scale, -m12 * scale}, {-m12 * scale, m11 * scale}};
    const double gravity[2][2] = {{gravity1 + gravity2, gravity2}, {gravity2, gravity2}};
    double slope[2][4], w[2];
    int i, j, k;

    /* The accelerations: [X Y] e + w u. */
    for (i = 0; i < 2; i++) {
        for (j = 0; j < 2; j++) {
            slope[i][j] = inverse[i][0] * gravity[0][j] + inverse[i][1] * gravity[1][j];
            slope[i][j + 2] = -inverse[i][j] * (theta[4 + j] + SWINGUP_COULOMB_DAMPING * theta[6 + j]);
        }
        w[i] = inverse[i][SWINGUP_DRIVEN];
    }
    for (i = 0; i < 2; i++) {
        for (j = 0; j < 4; j++) {
            double twice = j < 2 ? 0.0 : slope[i][j - 2];
            for (k = 0; k < 2; k++) {
                twice += slope[i][k + 2] * slope[k][j];
            }
            step[i][j] = (i == j) + (i + 2 == j) * h + half * slope[i][j];
            step[i + 2][j] = (i + 2 == j) + h * slope[i][j] + half * twice;
        }
        step[i][4] = half * w[i];
        step[i + 2][4] = h * w[i] + half * (slope[i][2] * w[0] + slope[i][3] * w[1]);
    }
}

/* One step of the Riccati recursion: P of the steps to go. */
static inline void swingup_riccati(double p[4][4], double step[4][5])
{
    double moved[4][5], all[5][5];
    int i, j, k;

    for (i = 0; i < 4; i++) {
        for (j = 0; j < 5; j++) {
            moved[i][j] = 0.0;
            for (k = 0; k < 4; k++) {
                moved[i][j] += p[i][k] * step[k][j];
            }
        }
    }
    for (i = 0; i < 5; i++) {
        for (j = i; j < 5; j++) {
            all[i][j] = 0.0;
            for (k = 0; k < 4; k++) {
                all[i][j] += step[k][i] * moved[k][j];
            }
        }
    }
    for (i = 0; i < 4; i++) {
        for (j = i; j < 4; j++) {
            p[i][j] = p[j][i] = all[i][j] - all[i][4] * all[j][4] / (SWINGUP_TORQUE_WEIGHT + all[4][4]);
        }
        p[i][i] += swingup_state_weights[i];
    }
}

/* P of the plant of the policy's file. */
static inline void swingup_start(swingup_regulator *c)
{
    int i;
    for (i = 0; i < 16; i++) {
        c->cost_to_go[i / 4][i % 4] = swingup_cost_to_go[i / 4][i % 4];
    }
}

/* Whether the regulator acts, and its torque of the driven joint for a state, of the plant theta. */
static inline int swingup_regulate(swingup_regulator *c, const double theta[9], const double x[4], double *torque)
{
    const int finite = swingup_finite(x, 4);
    double step[4][5], error[4], share = SWINGUP_TORQUE_WEIGHT, cost = 0.0;
    int i, j;

    if (!c->begun) {
        swingup_start(c);
    }
    c->begun = 1;
    swingup_upright(theta, step);
    for (i = 0; i < SWINGUP_RICCATI_STEPS; i++) {
        swingup_riccati(c->cost_to_go, step);
    }
    if (!swingup_finite(&c->cost_to_go[0][0], 16)) {
        swingup_start(c);
    }
    *torque = 0.0;
    error[0] = swingup_turned(x[0] - SWINGUP_PI);
    error[1] = swingup_turned(x[1]);
    error[2] = x[2];
    error[3] = x[3];
    for (i = 0; i < 4; i++) {
        double pushed = 0.0;
        for (j = 0; j < 4; j++) {
            cost += error[i] * c->cost_to_go[i][j] * error[j];
            pushed += c->cost_to_go[i][j] * step[j][4];
        }
        share += step[i][4] * pushed;
        for (j = 0; j < 4; j++) {
            *torque -= pushed * step[i][j] * error[j];
        }
    }
    /* The clip would make an infinite rate the largest torque. */
    *torque = finite ? swingup_clip(*torque / share, SWINGUP_TORQUE_LIMIT) : (double)NAN;
    if (finite) {
        const double dry = fabs(theta[7 - SWINGUP_DRIVEN]);
        const double enter = SWINGUP_ENTER / (1.0 + dry / SWINGUP_ENTER_COULOMB);
        const double leave = enter + (SWINGUP_LEAVE - SWINGUP_ENTER) / (1.0 + dry / SWINGUP_LEAVE_COULOMB);
        c->acting = c->acting ? cost <= leave : cost < enter;
    }
    return c->acting;
}

#endif

/* ---- the safety guard; without one its reason stays 0 ---- */

typedef struct {
    int reason;         /* why the controller was stopped; SWINGUP_GUARD_NONE while it acts */
    int joint;          /* the joint meant: 0 is the shoulder, 1 the elbow; -1 for none */
    double when, value; /* time of that call (s), and what was beyond its limit or not finite */
    int called, still, brakes;
    double time, step;            /* of the last call, and since the one before (s) */
    double sample[4], torques[2]; /* last measurement and torques */
    double repeated[2], stuck;    /* time for which a measurement has repeated (s) */
} swingup_guard;

#if SWINGUP_HAS_GUARD
/* Latch the first fault; brake from it on, until a fault of sensor or clock. */
static inline void swingup_stop(swingup_guard *c, int reason, int joint, double value)
{
    const int motion =
        reason == SWINGUP_GUARD_ANGLE || reason == SWINGUP_GUARD_VELOCITY || reason == SWINGUP_GUARD_TORQUE;
    c->brakes = motion && SWINGUP_BRAKING > 0.0 && (c->reason == SWINGUP_GUARD_NONE || c->brakes);
    if (c->reason == SWINGUP_GUARD_NONE) {
        c->reason = reason;
        c->joint = joint;
        c->when = c->time;
        c->value = value;
    }
}

/* Stops the controller if a joint's measurement is not finite or beyond a limit; whether it is. */
static inline int swingup_out_of_bounds(swingup_guard *c)
{
    const double *x = c->sample;
    int i, j;
    for (i = 0; i < 2; i++) {
        for (j = i; j < 4; j += 2) {
            if (!swingup_finite(x + j, 1)) {
                swingup_stop(c, SWINGUP_GUARD_NOT_FINITE, i, x[j]);
                return 1;
            }
        }
    }
    for (i = 0; i < 2; i++) {
        if (fabs(x[i]) > SWINGUP_ANGLE_LIMIT) {
            swingup_stop(c, SWINGUP_GUARD_ANGLE, i, x[i]);
            return 1;
        }
        if (fabs(x[i + 2]) > SWINGUP_VELOCITY_LIMIT) {
            swingup_stop(c, SWINGUP_GUARD_VELOCITY, i, x[i + 2]);
            return 1;
        }
    }
    return 0;
}

/* Stops the controller if a joint that must be moving has had the same measurement for too long. */
static inline void swingup_stale(swingup_guard *c, const double before[4])
{
    const double *x = c->sample;
    int i, same[2];
    for (i = 0; i < 2; i++) {
        same[i] = x[i] == before[i] && x[i + 2] == before[i + 2];
        c->repeated[i] = same[i] && x[i + 2] != 0.0 ? c->repeated[i] + c->step : 0.0;
    }
    i = fabs(c->torques[SWINGUP_DRIVEN]) > SWINGUP_PUSHING * swingup_limits[SWINGUP_DRIVEN];
    c->stuck = same[SWINGUP_DRIVEN] && i ? c->stuck + c->step : 0.0;
    for (i = 0; i < 2; i++) {
        if (c->repeated[i] > SWINGUP_STALE_TIME) {
            swingup_stop(c, SWINGUP_GUARD_STALE, i, c->repeated[i]);
            return;
        }
    }
    if (c->stuck > SWINGUP_STUCK_TIME) {
        swingup_stop(c, SWINGUP_GUARD_STALE, SWINGUP_DRIVEN, c->stuck);
    }
}

/* Whether the controller may act on the state x measured at time t (s). */
static inline int swingup_allows(swingup_guard *c, double t, const double x[4])
{
    const double pause = t - c->time;
    const int first = !c->called;
    double before[4];
    int i;

    c->called = 1;
    c->time = t;
    if (!swingup_finite(&t, 1) || !(first || pause >= 0.0)) {
        swingup_stop(c, SWINGUP_GUARD_CLOCK, -1, first ? t : pause);
        return 0;
    }
    c->still = !first && pause == 0.0 ? c->still + 1 : 0;
    if (c->still > SWINGUP_STANDSTILLS) {
        swingup_stop(c, SWINGUP_GUARD_CLOCK, -1, pause);
        return 0;
    }
    if (!first && pause > SWINGUP_LONGEST_PAUSE) {
        swingup_stop(c, SWINGUP_GUARD_LATE, -1, pause);
        return 0;
    }
    c->step = first || pause == 0.0 ? SWINGUP_GUARD_PERIOD : pause;
    for (i = 0; i < 4; i++) {
        before[i] = c->sample[i];
        c->sample[i] = x[i];
    }
    if (!swingup_out_of_bounds(c) && !first) {
        swingup_stale(c, before);
    }
    return c->reason == SWINGUP_GUARD_NONE;
}

/* The torques of a stopped controller: none, or damping while the measurement is sound. */
static inline void swingup_stopped(swingup_guard *c, double u[2])
{
    int i;
    for (i = 0; i < 2; i++) {
        const double rate = c->sample[i + 2];
        const int sound = c->brakes && fabs(rate) <= SWINGUP_BRAKED_RATE;
        c->torques[i] = u[i] = sound ? swingup_clip(-SWINGUP_BRAKING * rate, swingup_limits[i]) : 0.0;
    }
}

/* The controller's torques within rate and limits; safe ones if one of them is not finite. */
static inline void swingup_limited(swingup_guard *c, double u[2])
{
    const double change = SWINGUP_TORQUE_RATE * c->step;
    int i;
    for (i = 0; i < 2; i++) {
        if (!swingup_finite(u + i, 1)) {
            swingup_stop(c, SWINGUP_GUARD_TORQUE, i, u[i]);
            swingup_stopped(c, u);
            return;
        }
    }
    for (i = 0; i < 2; i++) {
        const double most = c->torques[i] + change, least = c->torques[i] - change;
        u[i] = u[i] > most ? most : u[i];
        u[i] = swingup_clip(u[i] < least ? least : u[i], swingup_limits[i]);
        c->torques[i] = u[i];
    }
}
#endif

/* ---- the controller ---- */

typedef struct {
    swingup_guard guard;
#if SWINGUP_HAS_ESTIMATOR
    swingup_estimator estimator;
#endif
#if SWINGUP_HAS_REGULATOR
    swingup_regulator regulator;
#endif
} swingup_controller;

static inline void swingup_reset(swingup_controller *c)
{
    static const swingup_controller fresh = {0};
    *c = fresh;
#if SWINGUP_HAS_IDENTIFIER
    swingup_begin(&c->estimator.identifier);
#endif
}

#if SWINGUP_HAS_IDENTIFIER
/* The nine base parameters found so far, ordered as docs/policy-format.md has them; at first the file's plant's. */
static inline const double *swingup_base_parameters(const swingup_controller *c)
{
    return c->estimator.identifier.base;
}
#endif

/* The driven joint's torque (N m) for a state x, from the regulator or the policy; friction is compensated later. */
static inline double swingup_act(swingup_controller *c, const double x[4])
{
#if SWINGUP_HAS_IDENTIFIER
    const double *base = c->estimator.identifier.told;
#else
    const double *base = swingup_theta;
#endif
#if SWINGUP_HAS_REGULATOR
    double torque;
    if (swingup_regulate(&c->regulator, base, x, &torque)) {
        return torque;
    }
#endif
    (void)c;
    return swingup_network(x, base);
}

/* The torques u (N m) for the state x measured at time t (s). */
static inline void swingup_control(swingup_controller *c, double t, const double x[4], double u[2])
{
    double seen[4] = {x[0], x[1], x[2], x[3]};

    (void)t;
#if SWINGUP_HAS_GUARD
    if (!swingup_allows(&c->guard, t, x)) {
        swingup_stopped(&c->guard, u);
        return;
    }
#endif
#if SWINGUP_HAS_ESTIMATOR
    swingup_observe(&c->estimator, t, x, seen);
#endif
    u[1 - SWINGUP_DRIVEN] = 0.0;
    u[SWINGUP_DRIVEN] = swingup_act(c, seen);
#if SWINGUP_HAS_IDENTIFIER
    swingup_compensate(&c->estimator.identifier, seen, u);
#endif
#if SWINGUP_HAS_GUARD
    swingup_limited(&c->guard, u);
#else
    /* NaN stays NaN. */
    u[0] = swingup_clip(u[0], swingup_limits[0]);
    u[1] = swingup_clip(u[1], swingup_limits[1]);
#endif
#if SWINGUP_HAS_ESTIMATOR
    /* It needs what the motors were given. */
    swingup_remember(&c->estimator, u);
#endif
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
