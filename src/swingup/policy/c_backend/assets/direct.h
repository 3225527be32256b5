/* ---- the controller: the above on the measured state ---- */

typedef swingup_front_end swingup_controller;

static inline void swingup_reset(swingup_controller *c)
{
    static const swingup_controller fresh = {0};
    *c = fresh;
}

static inline void swingup_control(swingup_controller *c, double t, const double x[4], double u[2])
{
    swingup_act(c, t, x, u);
}
