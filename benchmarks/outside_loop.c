/*
 * A robot of its own around an exported header: physics, sensors, motors and clock, independent of the package.
 *
 * The elbow may be elastic or have backlash: its motor's side then is a third angle, where the encoder is and where
 * friction acts. RK4 at a tenth of a motor's lag or less; the contact needs the shorter step that the caller gives.
 */
#include "policy.h"

typedef struct {
    double m1, m2, l1, l2, r1, r2, I1, I2, Ir, gr, g, b1, b2, cf1, cf2; /* as in a plant's file */
    double limit1, limit2, gain1, gain2;                                /* what the motors deliver (N m) */
    double lag, dead, period, step;                                     /* of motors, commands, loop, physics (s) */
    double quantum, offset1, offset2;                                   /* of the encoders (rad) */
    double spring1, spring2, bias1, bias2;                              /* N m/rad about 0, and N m */
    double stiffness, contact, backlash;                                /* elbow: N m/rad, N m s/rad, rad */
    double stiction, sag;          /* share of dry friction at rest; limit lost by a rate (N m s/rad) */
    double dropout, missing, spoilt; /* held samples, missed calls (s), NaN samples: once a second */
    double q1, q2, phase;          /* at the start (rad), and of the faults (s) */
    double lqr, k1, k2, k3, k4, e1, e2, u1, u2; /* gains, the position that they hold, and torques there */
    double turned1, turned2, wired1, wired2; /* 1: encoder or motor reversed */
    double crossed, exchanged;               /* 1: encoders, or motors, are those of the other joint */
} robot;

enum { ANGLES = 3, STATES = 6, RING = 4096 };

static double friction(double b, double cf, double stiction, double rate)
{
    return b * rate + cf * (1.0 + stiction * exp(-rate * rate / 0.0025)) * atan(100.0 * rate);
}

/* Rates of [q1, q2, motor's q2] and their own rates under both torques. */
static void slope(const robot *p, const double x[STATES], const double u[2], double dx[STATES])
{
    const double q1 = x[0], q2 = x[1], v1 = x[3], v2 = x[4], w = x[5], c = p->m2 * p->l1 * p->r2;
    const double geared = p->gr * p->Ir, reflected = p->gr * geared;
    const int elastic = p->stiffness > 0.0;
    double a = p->I1 + p->I2 + p->m2 * p->l1 * p->l1 + 2.0 * c * cos(q2) + reflected + p->Ir;
    double b = p->I2 + c * cos(q2), d = p->I2, f1, f2, f3, det;
    int i;

    f1 = -(p->m1 * p->r1 + p->m2 * p->l1) * p->g * sin(q1) - p->m2 * p->r2 * p->g * sin(q1 + q2);
    f1 += c * sin(q2) * v2 * (2.0 * v1 + v2) + u[0] - friction(p->b1, p->cf1, p->stiction, v1);
    f1 -= p->spring1 * q1 + p->bias1;
    f2 = -p->m2 * p->r2 * p->g * sin(q1 + q2) - c * sin(q2) * v1 * v1 - p->spring2 * q2 - p->bias2;
    f3 = u[1] - friction(p->b2, p->cf2, p->stiction, elastic ? w : v2);
    for (i = 0; i < ANGLES; i++) {
        dx[i] = x[i + ANGLES];
    }
    if (!elastic) {
        b -= geared;
        d += reflected;
        f2 += f3;
        det = a * d - b * b;
        dx[3] = (d * f1 - b * f2) / det;
        dx[4] = dx[5] = (a * f2 - b * f1) / det;
        dx[2] = dx[1];
        return;
    }
    {
        const double gap = x[2] - q2, half = 0.5 * p->backlash;
        const double deep = gap > half ? gap - half : gap < -half ? gap + half : 0.0;
        const double drive = deep == 0.0 ? 0.0 : p->stiffness * deep + p->contact * (w - v2);
        f2 += drive;
        /* The motor's row, reflected w' - geared v1' = f3 - drive, is put into the shoulder's. */
        f3 -= drive;
        f1 += geared * f3 / reflected;
        a -= geared * geared / reflected;
        det = a * d - b * b;
        dx[3] = (d * f1 - b * f2) / det;
        dx[4] = (a * f2 - b * f1) / det;
        dx[5] = (f3 + geared * dx[3]) / reflected;
    }
}

static void advance(const robot *p, double x[STATES], const double u[2], double h)
{
    static const double at[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    double sum[STATES], k[STATES] = {0.0}, moved[STATES];
    int i, n;
    for (i = 0; i < STATES; i++) {
        sum[i] = x[i];
    }
    for (n = 0; n < 4; n++) {
        for (i = 0; i < STATES; i++) {
            moved[i] = x[i] + at[n] * h * k[i];
        }
        slope(p, moved, u, k);
        for (i = 0; i < STATES; i++) {
            sum[i] += weight[n] * h * k[i];
        }
    }
    for (i = 0; i < STATES; i++) {
        x[i] = sum[i];
    }
}

/* What the encoders show, before they round. */
static void encoders(const robot *p, const double x[STATES], double shown[2])
{
    const double q1 = (p->turned1 > 0.0 ? -x[0] : x[0]) + p->offset1;
    const double q2 = (p->turned2 > 0.0 ? -x[2] : x[2]) + p->offset2;
    shown[0] = p->crossed > 0.0 ? q2 : q1;
    shown[1] = p->crossed > 0.0 ? q1 : q2;
}

static double rounded(double angle, double quantum)
{
    return quantum > 0.0 ? quantum * rint(angle / quantum) : angle;
}

/* u = u* - K e on the driven joint for the true plant, friction compensated on both. */
static void hold(const robot *p, const double x[4], double u[2])
{
    const double e1 = remainder(x[0] - p->e1, 2.0 * SWINGUP_PI), e2 = remainder(x[1] - p->e2, 2.0 * SWINGUP_PI);
    u[0] = p->u1 + friction(p->b1, p->cf1, 0.0, x[2]);
    u[1] = p->u2 + friction(p->b2, p->cf2, 0.0, x[3]);
    u[SWINGUP_DRIVEN] -= p->k1 * e1 + p->k2 * e2 + p->k3 * x[2] + p->k4 * x[3];
}

/* One run of some seconds: 1 if the tip is above 0.9 (l1 + l2) throughout the last two; the guard's reason. */
int simulate(const robot *p, double seconds, int *reason, double *trace);

int simulate(const robot *p, double seconds, int *reason, double *trace)
{
    const int inner = (int)(p->period / p->step + 0.5), late = (int)(p->dead / p->step + 0.5);
    const double limits[2] = {p->limit1, p->limit2}, gains[2] = {p->gain1, p->gain2}, left = exp(-p->step / p->lag);
    static swingup_controller controller;
    static double asked[RING][2];
    double x[STATES] = {p->q1, p->q2, p->q2, 0.0, 0.0, 0.0}, torque[2] = {0.0, 0.0}, u[2] = {0.0, 0.0};
    double older[2], seen[4] = {0.0}, next[4] = {0.0};
    const long calls = (long)(seconds / p->period);
    long call, tick = 0;
    int i, k, up = 1;

    swingup_reset(&controller);
    for (k = 0; k < RING; k++) {
        asked[k][0] = asked[k][1] = 0.0;
    }
    encoders(p, x, older);
    for (i = 0; i < 2; i++) {
        next[i] = older[i] = rounded(older[i], p->quantum);
    }
    for (call = 0; call < calls; call++) {
        const double t = (double)call * p->period, within = fmod(t + p->phase, 1.0);
        const double *sample = next;
        double x_now[4], shown[2];
        int absent;

        encoders(p, x, shown);
        /* The controller sees the turn before. */
        if (!(p->dropout > 0.0 && within < p->dropout - 0.5 * p->period)) {
            for (i = 0; i < 4; i++) {
                seen[i] = sample[i];
            }
        }
        for (i = 0; i < 2; i++) {
            const double q = rounded(shown[i], p->quantum);
            next[i] = q;
            next[i + 2] = (q - older[i]) / p->period;
            older[i] = q;
        }
        for (i = 0; i < 4; i++) {
            x_now[i] = p->spoilt > 0.0 && within < 0.99 * p->period ? (double)NAN : seen[i];
        }
        absent = p->missing > 0.0 && within < p->missing - 0.5 * p->period;
        if (!absent) {
            if (p->lqr > 0.0) {
                hold(p, x_now, u);
            } else {
                swingup_control(&controller, t, x_now, u);
            }
        }
        for (k = 0; k < inner; k++, tick++) {
            double *now = asked[tick % RING];
            const double *acting = asked[(tick + RING - late) % RING];
            double given[2];
            for (i = 0; i < 2; i++) {
                now[i] = u[p->exchanged > 0.0 ? 1 - i : i] * ((i == 0 ? p->wired1 : p->wired2) > 0.0 ? -1.0 : 1.0);
            }
            for (i = 0; i < 2; i++) {
                const double rate = i == 0 ? x[3] : x[5], want = gains[i] * swingup_clip(acting[i], limits[i]);
                double most = limits[i];
                torque[i] = want + (torque[i] - want) * left;
                if (torque[i] * rate > 0.0) {
                    most = fmax(most - p->sag * fabs(rate), 0.0);
                }
                given[i] = swingup_clip(torque[i], most);
                /* A controller that gives NaN lets go. */
                if (!swingup_finite(given + i, 1)) {
                    torque[i] = given[i] = 0.0;
                }
            }
            advance(p, x, given, p->step);
        }
        if (trace) {
            for (i = 0; i < 4; i++) {
                trace[10 * call + i] = x[i < 2 ? i : i + 1];
                trace[10 * call + 4 + i] = x_now[i];
            }
            trace[10 * call + 8] = u[0];
            trace[10 * call + 9] = u[1];
        }
        if (t > seconds - 2.0 && !(-p->l1 * cos(x[0]) - p->l2 * cos(x[0] + x[1]) > 0.9 * (p->l1 + p->l2))) {
            up = 0;
        }
    }
    *reason = swingup_guard_reason(&controller);
    return up;
}
