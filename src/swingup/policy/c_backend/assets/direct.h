/* ---- no state estimator: the policy sees what is measured ---- */

typedef struct {
    int unused;
} swingup_estimator;

static inline void swingup_observe(swingup_estimator *c, double t, const double x[4], double seen[4])
{
    int i;
    (void)c;
    (void)t;
    for (i = 0; i < 4; i++) {
        seen[i] = x[i];
    }
}

static inline void swingup_remember(swingup_estimator *c, const double u[2])
{
    (void)c;
    (void)u;
}
