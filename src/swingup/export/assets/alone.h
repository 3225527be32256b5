/* ---- the controller: the policy on the measured state ---- */

typedef struct {
    int unused;
} swingup_controller;

static inline void swingup_reset(swingup_controller *c)
{
    c->unused = 0;
}

static inline void swingup_control(swingup_controller *c, double t, const double x[4], double u[2])
{
    (void)c;
    (void)t;
    u[1 - SWINGUP_DRIVEN] = 0.0;
    u[SWINGUP_DRIVEN] = swingup_policy(x);
}
