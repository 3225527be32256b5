/* ---- the policy behind its front end, as docs/policy-format.md of swingup describes it ---- */

#define SWINGUP_PERIOD @PERIOD@ /* time between calls (s) */

typedef struct {
    int called;      /* 0 before the first call */
    double time;     /* of the last call (s) */
    double rates[2]; /* filtered velocities (rad/s) */
    double seen[4];  /* the state that the policy saw */
} swingup_front_end;

static inline void swingup_act(swingup_front_end *c, double t, const double x[4], double u[2])
{
    static const double damping[2] = @DAMPING@, coulomb[2] = @COULOMB@;
    int going_on = c->called && t >= c->time && t - c->time <= 1.5 * SWINGUP_PERIOD;
    int i;

    for (i = 0; i < 4; i++) {
        going_on = going_on && isfinite(x[i]) && isfinite(c->seen[i]);
    }
    c->called = 1;
    c->time = t;
    for (i = 0; i < 2; i++) {
        c->rates[i] = going_on ? c->rates[i] + @WEIGHT@ * (x[i + 2] - c->rates[i]) : x[i + 2];
        c->seen[i] = x[i];
        c->seen[i + 2] = fabs(c->rates[i]) < @DEAD_BAND@ ? 0.0 : c->rates[i];
    }
    for (i = 0; i < 2; i++) {
        const double rate = c->seen[i + 2];
        u[i] = isfinite(rate) ? damping[i] * rate + coulomb[i] * atan(@STEEPNESS@ * rate) : (double)NAN;
    }
    u[1 - SWINGUP_DRIVEN] = swingup_clip(u[1 - SWINGUP_DRIVEN], @PASSIVE_LIMIT@);
    u[SWINGUP_DRIVEN] += swingup_policy(c->seen);
}
