/* ---- the controller: all of the above ---- */

typedef struct {
    swingup_guard guard;
    swingup_estimator estimator;
    swingup_front_end front_end;
} swingup_controller;

static inline void swingup_reset(swingup_controller *c)
{
    static const swingup_controller fresh = {0};
    *c = fresh;
@BEGIN@}

@READER@static inline void swingup_control(swingup_controller *c, double t, const double x[4], double u[2])
{
    double seen[4];

    if (!swingup_allows(&c->guard, t, x)) {
        swingup_stopped(&c->guard, u);
        return;
    }
    swingup_observe(&c->estimator, t, x, seen);
    swingup_act(&c->front_end, t, seen@KNOWN@, u);
@COMPENSATE@    swingup_limited(&c->guard, u);
    /* The estimator needs what the motors were given. */
    swingup_remember(&c->estimator, u);
}

/* Why the safety guard stopped the controller, a number; 0 while it acts, or without a guard. */
static inline int swingup_guard_reason(const swingup_controller *c)
{
    return c->guard.reason;
}

/* The same in words. */
static inline const char *swingup_guard_sentence(const swingup_controller *c)
{
    static const char *const sentences[] = {@SENTENCES@};
    return sentences[c->guard.reason];
}
