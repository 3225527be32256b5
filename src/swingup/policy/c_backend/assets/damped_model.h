/* ---- the estimator's model: @PLANT@ ---- */

/*
 * Accelerations (rad/s^2) under a torque of the driven joint (N m). Friction is linear about the rates of x and acts on
 * those at the end of a step of h (s) that starts with the rates first[2].
 */
static inline void swingup_acceleration(const double x[4], double torque, const double *first, double h, double a[2])
{
    static const double damping[2] = @DAMPING@, coulomb[2] = @COULOMB@;
    const double cosine = @COUPLING@ * cos(x[1]), sine = @COUPLING@ * sin(x[1]);
    const double weight = @GRAVITY2@ * sin(x[0] + x[1]), m12 = @M12@ + cosine;
    double m[2], f[2], determinant;
    int i;
    m[0] = @M11@ + 2.0 * cosine;
    m[1] = @M22@;
    f[0] = -@GRAVITY1@ * sin(x[0]) - weight + sine * x[3] * (2.0 * x[2] + x[3]);
    f[1] = -weight - sine * x[2] * x[2];
    f[SWINGUP_DRIVEN] += torque;
    for (i = 0; i < 2; i++) {
        const double steep = @STEEPNESS@ * x[i + 2];
        const double slope = damping[i] + @STEEPNESS@ * coulomb[i] / (1.0 + steep * steep);
        f[i] -= damping[i] * x[i + 2] + coulomb[i] * atan(steep) - slope * (x[i + 2] - first[i]);
        m[i] += h * slope;
    }
    determinant = m[0] * m[1] - m12 * m12;
    a[0] = (m[1] * f[0] - m12 * f[1]) / determinant;
    a[1] = (m[0] * f[1] - m12 * f[0]) / determinant;
}

/* One step of the midpoint rule with implicit friction over h (s), in place. */
static inline void swingup_step(double x[4], double torque, double h)
{
    double a[2], middle[4];
    swingup_acceleration(x, torque, x + 2, 0.5 * h, a);
    middle[0] = x[0] + 0.5 * h * x[2];
    middle[1] = x[1] + 0.5 * h * x[3];
    middle[2] = x[2] + 0.5 * h * a[0];
    middle[3] = x[3] + 0.5 * h * a[1];
    swingup_acceleration(middle, torque, x + 2, h, a);
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
    swingup_acceleration(rest, 1.0, rest + 2, 0.0, response);
    swingup_acceleration(rest, 0.0, rest + 2, 0.0, still);
    response[0] -= still[0];
    response[1] -= still[1];
}
