/* ---- the estimator's model: @PLANT@ ---- */

/* Accelerations (rad/s^2) under a torque of the driven joint (N m). */
static inline void swingup_acceleration(const double x[4], double torque, double a[2])
{
    const double cosine = @COUPLING@ * cos(x[1]), sine = @COUPLING@ * sin(x[1]);
    const double m11 = @M11@ + 2.0 * cosine, m12 = @M12@ + cosine, m22 = @M22@;
    const double weight = @GRAVITY2@ * sin(x[0] + x[1]), determinant = m11 * m22 - m12 * m12;
    double f[2];
    f[0] = -@GRAVITY1@ * sin(x[0]) - weight + sine * x[3] * (2.0 * x[2] + x[3]);
    f[1] = -weight - sine * x[2] * x[2];
    f[SWINGUP_DRIVEN] += torque;
    a[0] = (m22 * f[0] - m12 * f[1]) / determinant;
    a[1] = (m11 * f[1] - m12 * f[0]) / determinant;
}

/* One step of the explicit midpoint rule over h (s), in place. */
static inline void swingup_step(double x[4], double torque, double h)
{
    double a[2], middle[4];
    swingup_acceleration(x, torque, a);
    middle[0] = x[0] + 0.5 * h * x[2];
    middle[1] = x[1] + 0.5 * h * x[3];
    middle[2] = x[2] + 0.5 * h * a[0];
    middle[3] = x[3] + 0.5 * h * a[1];
    swingup_acceleration(middle, torque, a);
    x[0] += h * middle[2];
    x[1] += h * middle[3];
    x[2] += h * a[0];
    x[3] += h * a[1];
}

/* What one N m on the driven joint adds to the accelerations (rad/s^2) at the angles of x. */
static inline void swingup_response(const double x[4], double response[2])
{
    const double rest[4] = {x[0], x[1], 0.0, 0.0};
    double still[2];
    swingup_acceleration(rest, 1.0, response);
    swingup_acceleration(rest, 0.0, still);
    response[0] -= still[0];
    response[1] -= still[1];
}
