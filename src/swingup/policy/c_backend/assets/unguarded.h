/* ---- no safety guard ---- */

typedef struct {
    int reason;
} swingup_guard;

static inline int swingup_allows(swingup_guard *c, double t, const double x[4])
{
    (void)c;
    (void)t;
    (void)x;
    return 1;
}

static inline void swingup_stopped(swingup_guard *c, double u[2])
{
    (void)c;
    u[0] = u[1] = 0.0;
}

static inline void swingup_limited(swingup_guard *c, double u[2])
{
    (void)c;
    (void)u;
}
