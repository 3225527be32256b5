/* ---- online identification of the plant, as docs/policy-format.md of swingup describes it ---- */

#define SWINGUP_SPAN @SPAN@ /* steps between the three angles of a row */
#define SWINGUP_COMMANDS @COMMANDS@ /* torques that are remembered */

/* Nine base parameters of the nominal plant, and no lag (s); the covariance of these ten unknowns. */
static const double swingup_mean[10] = @MEAN@;
static const double swingup_prior[10][10] = {
@PRIOR@
};

typedef struct {
    double rows[3][2][11]; /* after each low-pass, of both joints; the torque's rate and the torque come last */
} swingup_filter;

/* In double precision whatever SWINGUP_REAL is, as all around the network is. */
typedef struct {
    int calls;                              /* measurements since the last restart */
    int delay_steps;                        /* the delay told last (steps) */
    double angles[2 * SWINGUP_SPAN + 1][2]; /* measured, without jumps of full turns, newest first (rad) */
    double torques[SWINGUP_COMMANDS];       /* commanded to the driven joint, newest first (N m) */
    double steps[SWINGUP_COMMANDS];         /* time for which each was held (s) */
    swingup_filter filter;
    double unknowns[10]; /* the base parameters, and the torque's lag (s) behind the delay */
    double covariance[10][10];
    double variance[2]; /* of what each joint's row leaves unexplained (N^2 m^2) */
    double held[2];     /* time for which each joint's row is still not used (s) */
    double base[9];     /* base parameters of a pendulum: those found, or as near to them as can be */
} swingup_identifier;

/* Nothing seen yet. */
static inline void swingup_begin(swingup_identifier *c)
{
    static const swingup_identifier fresh = {0};
    static const double variance[2] = @VARIANCE@;
    int i, j;
    *c = fresh;
    for (i = 0; i < 10; i++) {
        c->unknowns[i] = swingup_mean[i];
        for (j = 0; j < 10; j++) {
            c->covariance[i][j] = swingup_prior[i][j];
        }
    }
    for (i = 0; i < 2; i++) {
        c->variance[i] = variance[i];
    }
    for (i = 0; i < 9; i++) {
        c->base[i] = swingup_mean[i];
    }
    for (i = 0; i < SWINGUP_COMMANDS; i++) {
        c->steps[i] = @DT@;
    }
}

/* Half of both joints' equations, at the midpoint between angles (rad). */
typedef struct {
    double rates[2], momentum[2], turning, pull[2];
} swingup_half;

/* For angles that are a time (s) apart. */
static inline void swingup_halve(const double start[2], const double end[2], double time, swingup_half *half)
{
    const double rate1 = (end[0] - start[0]) / time, rate2 = (end[1] - start[1]) / time;
    const double q1 = 0.5 * (start[0] + end[0]), q2 = 0.5 * (start[1] + end[1]);
    const double sine1 = sin(q1), cosine1 = cos(q1), sine2 = sin(q2), cosine2 = cos(q2), along = @L1@ * cosine2;
    half->rates[0] = rate1;
    half->rates[1] = rate2;
    half->momentum[0] = along * (2.0 * rate1 + rate2);
    half->momentum[1] = along * rate1;
    half->turning = @L1@ * sine2 * rate1 * (rate1 + rate2);
    half->pull[0] = @GRAVITY@ * sine1;
    half->pull[1] = @GRAVITY@ * (sine1 * cosine2 + cosine1 * sine2);
}

/* Integral of arctan(steep v) over a rate v from 0 (rad/s). */
static inline double swingup_integral(double rate)
{
    const double steep = @STEEPNESS@ * rate;
    return rate * atan(steep) - log1p(steep * steep) / (2.0 * @STEEPNESS@);
}

/* The mean of arctan(steep v) while a rate v goes straight from start to end (rad/s). */
static inline double swingup_mean_arctan(double start, double end)
{
    if (fabs(end - start) > @CLOSE@) {
        return (swingup_integral(end) - swingup_integral(start)) / (end - start);
    }
    return atan(0.5 * @STEEPNESS@ * (start + end));
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

/* The newest rows of shoulder and elbow: a number for each base parameter, the torque's rate, the torque. */
static inline void swingup_rows(const swingup_identifier *c, double rows[2][11])
{
    const double gr = @GEAR@, *steps = c->steps + c->delay_steps, *torques = c->torques + c->delay_steps;
    double a[2], pull[2], turning, torque = 0.0, rate = 0.0, newer = 0.0, older = 0.0, mean, now = 0.0;
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
        for (k = 0; k < 11; k++) {
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
    for (i = 0; i < 2; i++) {
        rows[i][4 + i] = 0.5 * (one.rates[i] + two.rates[i]);
        rows[i][6 + i] = swingup_mean_arctan(one.rates[i], two.rates[i]);
    }
    /* The hat rises to the middle angle and falls to the others; each torque is held over its step. */
    for (k = 0; k < 2 * SWINGUP_SPAN; k++) {
        const double change = k < SWINGUP_SPAN ? steps[k] / newer : -steps[k] / older;
        torque += (now + 0.5 * change) * steps[k] * torques[k] / mean;
        rate += change * torques[k] / mean;
        now += change;
    }
    rows[SWINGUP_DRIVEN][9] = rate;
    rows[SWINGUP_DRIVEN][10] = torque;
}

/* One joint's low-passed row: the variance of its errors, and what it tells of the unknowns. */
static inline void swingup_update(swingup_identifier *c, int joint)
{
    static const double least[2] = @FLOOR@, most[2] = @MOST@;
    const double *row = c->filter.rows[2][joint];
    double known[10], unsure = 0.0, error = row[10], size = fabs(row[10]), lowest, r, distance, held, w, heavy, seen;
    int i, j;

    for (i = 0; i < 10; i++) {
        known[i] = 0.0;
        for (j = 0; j < 10; j++) {
            known[i] += c->covariance[i][j] * row[j];
        }
        unsure += row[i] * known[i];
        error -= row[i] * c->unknowns[i];
    }
    for (i = 0; i < 4; i++) {
        size += fabs(row[i]) * fabs(c->unknowns[i]);
    }
    lowest = least[joint] + (@RELATIVE@ * size) * (@RELATIVE@ * size);
    r = c->variance[joint] > lowest ? c->variance[joint] : lowest;
    distance = error * error / (unsure + r);
    held = distance > @GATE2@ ? @HOLD@ : c->held[joint] - @DT@;
    w = (@STUDENT@ + distance) / (@STUDENT@ + 1.0);
    heavy = r * @ALIKE@ * (w > 1.0 ? w : 1.0);
    /* A spoilt angle must not blind the identifier for seconds. */
    seen = distance * r < most[joint] ? distance * r : most[joint];
    c->variance[joint] += (seen > c->variance[joint] ? @RISE@ : @FALL@) * (seen - c->variance[joint]);
    c->held[joint] = held > 0.0 ? held : 0.0;
    for (i = 0; i < 10; i++) {
        const double gain = held > 0.0 ? 0.0 : known[i] / (unsure + heavy);
        c->unknowns[i] += gain * error;
        for (j = 0; j < 10; j++) {
            c->covariance[i][j] -= gain * known[j];
        }
    }
}

/* The low-passes, both rows, and the drift; 0 if what was found is not finite. */
static inline int swingup_learn(swingup_identifier *c)
{
    static const double drift[10] = @DRIFT@;
    double rows[2][11];
    int i, j, k, finite = 1;

    swingup_rows(c, rows);
    for (i = 0; i < 2; i++) {
        for (k = 0; k < 11; k++) {
            double value = rows[i][k];
            for (j = 0; j < 3; j++) {
                c->filter.rows[j][i][k] += @WEIGHT@ * (value - c->filter.rows[j][i][k]);
                value = c->filter.rows[j][i][k];
            }
        }
    }
    swingup_update(c, 0);
    swingup_update(c, 1);
    for (i = 0; i < 10; i++) {
        /* No less sure than at the start. */
        c->covariance[i][i] += c->covariance[i][i] < swingup_prior[i][i] ? drift[i] : 0.0;
        finite = finite && isfinite(c->unknowns[i]);
        for (j = 0; j < 10; j++) {
            finite = finite && isfinite(c->covariance[i][j]);
        }
    }
    return finite;
}

/* Base parameters of a pendulum: a mass matrix far from positive definite is moved towards the nominal one. */
static inline void swingup_project(swingup_identifier *c)
{
    /* Of the nominal mass matrix, stretched and folded: M11, M12, M22. */
    static const double nominal[2][3] = {@STRETCHED@, @FOLDED@};
    const double *found = c->unknowns;
    const double coupling = @L1@ * found[2], geared = @GEAR@ * found[8], reflected = @GEAR@ * geared;
    double share = 1.0;
    int i;

    for (i = 0; i < 2; i++) {
        const double cosine = i == 0 ? coupling : -coupling, *n = nominal[i];
        const double m11 = found[0] + 2.0 * cosine + reflected + found[8];
        const double m12 = found[1] + cosine - geared, m22 = found[1] + reflected;
        const double determinant = n[0] * n[2] - n[1] * n[1];
        const double half = 0.5 * (n[2] * m11 - 2.0 * n[1] * m12 + n[0] * m22) / determinant;
        const double product = (m11 * m22 - m12 * m12) / determinant;
        /* Both eigenvalues are real; rounding may not make the root's argument negative. */
        const double smallest = half - sqrt(fabs(half * half - product));
        const double allowed = (1.0 - @MARGIN@) / (1.0 - (smallest < @MARGIN@ ? smallest : @MARGIN@));
        share = allowed < share ? allowed : share;
    }
    for (i = 0; i < 9; i++) {
        c->base[i] = swingup_mean[i] + share * (found[i] - swingup_mean[i]);
    }
}

/* After a pause: what was found stays, the motion before is forgotten. */
static inline void swingup_interrupt(swingup_identifier *c)
{
    static const swingup_filter empty = {{{{0.0}}}};
    int k;
    c->calls = 0;
    c->filter = empty;
    for (k = 0; k < SWINGUP_COMMANDS; k++) {
        c->torques[k] = 0.0;
        c->steps[k] = @DT@;
    }
}

/* Learn from the angles of x, which are delay_steps old, a pause (s) after the call before. */
static inline void swingup_identify(swingup_identifier *c, const double x[4], int delay_steps, double pause)
{
    static const swingup_filter empty = {{{{0.0}}}};
    const int angles = 2 * SWINGUP_SPAN + 1;
    /* Not what is NaN either. */
    const int near = fabs(x[0]) < @FARTHEST@ && fabs(x[1]) < @FARTHEST@;
    const int late = !(pause >= 0.0 && pause <= @LONGEST@);
    double step = pause > 0.0 ? pause : @DT@;
    swingup_identifier learned;
    int i, k;

    /* Such an angle would stay in the differences. */
    if (late || !near) {
        swingup_interrupt(c);
    }
    if (!near) {
        return;
    }
    for (i = 0; i < 2; i++) {
        const double ahead = x[i] - c->angles[0][i];
        const double newest = c->angles[0][i] + (ahead - 2.0 * SWINGUP_PI * rint(ahead / (2.0 * SWINGUP_PI)));
        for (k = angles - 1; k > 0; k--) {
            c->angles[k][i] = c->calls == 0 ? x[i] : c->angles[k - 1][i];
        }
        c->angles[0][i] = c->calls == 0 ? x[i] : newest;
    }
    step = c->calls == 0 ? @DT@ : step > @SHORTEST@ ? step : @SHORTEST@;
    for (k = SWINGUP_COMMANDS - 1; k > 0; k--) {
        c->steps[k] = c->steps[k - 1];
    }
    c->steps[0] = step;
    /* The lag counts from the delay: their sum is what was found. The old rows belong to the old delay. */
    if (delay_steps != c->delay_steps) {
        c->unknowns[9] += swingup_age(c, c->delay_steps) - swingup_age(c, delay_steps);
        c->filter = empty;
        c->delay_steps = delay_steps;
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

/* Note the torque that the driven joint was commanded (N m). */
static inline void swingup_note(swingup_identifier *c, double torque)
{
    int k;
    for (k = SWINGUP_COMMANDS - 1; k > 0; k--) {
        c->torques[k] = c->torques[k - 1];
    }
    c->torques[0] = torque;
}
