/* ---- the policy behind its front end, as docs/policy-format.md of swingup describes it ---- */

#define SWINGUP_PERIOD @PERIOD@ /* time between calls (s) */
#define SWINGUP_SPACING @SPACING@ /* calls from one remembered state to the next */
#define SWINGUP_TORQUES @TORQUES@ /* past torques that the policy is shown */
#define SWINGUP_HISTORY @HISTORY@ /* earlier states that it is shown */
#define SWINGUP_PAST (SWINGUP_HISTORY * SWINGUP_SPACING + 1)
#define SWINGUP_ASKED (SWINGUP_TORQUES * SWINGUP_SPACING)

typedef struct {
    int called;                       /* 0 before the first call */
    double time;                      /* of the last call (s) */
    double rates[2];                  /* filtered velocities (rad/s) */
    double past[SWINGUP_PAST][4];     /* states as they were seen, the latest first */
    double torques[SWINGUP_ASKED + 1]; /* the policy's, in units of its limit, the latest first */
} swingup_front_end;

static inline void swingup_act(swingup_front_end *c, double t, const double x[4], double u[2])
{
    static const double damping[2] = @DAMPING@, coulomb[2] = @COULOMB@;
    double shown[@SHOWN@], torque;
    int going_on = c->called && t >= c->time && t - c->time <= 1.5 * SWINGUP_PERIOD;
    int i, k, n;

    for (i = 0; i < 4; i++) {
        going_on = going_on && isfinite(x[i]) && isfinite(c->past[0][i]);
    }
    c->called = 1;
    c->time = t;
    for (n = SWINGUP_PAST - 1; n > 0 && going_on; n--) {
        for (i = 0; i < 4; i++) {
            c->past[n][i] = c->past[n - 1][i];
        }
    }
    for (i = 0; i < 2; i++) {
        c->rates[i] = going_on ? c->rates[i] + @WEIGHT@ * (x[i + 2] - c->rates[i]) : x[i + 2];
        c->past[0][i] = x[i];
        c->past[0][i + 2] = fabs(c->rates[i]) < @DEAD_BAND@ ? 0.0 : c->rates[i];
    }
    if (!going_on) {
        for (n = 1; n < SWINGUP_PAST; n++) {
            for (i = 0; i < 4; i++) {
                c->past[n][i] = c->past[0][i];
            }
        }
        for (n = 0; n < SWINGUP_ASKED; n++) {
            c->torques[n] = 0.0;
        }
    }

    for (k = 0; k <= SWINGUP_HISTORY; k++) {
        double *place = k == 0 ? shown : shown + 4 * k + SWINGUP_TORQUES;
        for (i = 0; i < 4; i++) {
            place[i] = c->past[k * SWINGUP_SPACING][i];
        }
    }
    for (k = 0; k < SWINGUP_TORQUES; k++) {
        double sum = 0.0;
        for (n = 0; n < SWINGUP_SPACING; n++) {
            sum += c->torques[k * SWINGUP_SPACING + n];
        }
        shown[4 + k] = sum / SWINGUP_SPACING;
    }
    torque = swingup_policy(shown);
    for (n = SWINGUP_ASKED; n > 0; n--) {
        c->torques[n] = c->torques[n - 1];
    }
    c->torques[0] = torque / SWINGUP_TORQUE_LIMIT;

    for (i = 0; i < 2; i++) {
        const double rate = c->past[0][i + 2];
        u[i] = isfinite(rate) ? damping[i] * rate + coulomb[i] * atan(@STEEPNESS@ * rate) : NAN;
    }
    u[1 - SWINGUP_DRIVEN] = swingup_clip(u[1 - SWINGUP_DRIVEN], @PASSIVE_LIMIT@);
    u[SWINGUP_DRIVEN] += torque;
}
