/* ---- the policy on the state that it is shown ---- */

typedef struct {
    int unused;
} swingup_front_end;

static inline void swingup_act(swingup_front_end *c, double t, const double x[4]@SIGHT@, double u[2])
{
    (void)c;
    (void)t;
    u[1 - SWINGUP_DRIVEN] = 0.0;
    u[SWINGUP_DRIVEN] = swingup_policy@TOLD@(x@BASE@);
}
