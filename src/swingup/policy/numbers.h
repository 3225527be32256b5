/*
 * What all parts of a policy in C need of numbers.
 */
#ifndef SWINGUP_NUMBERS_H
#define SWINGUP_NUMBERS_H

#include <math.h>
#include <stdint.h>

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#error "compile without -ffast-math and -ffinite-math-only: NaN would pass all checks, with full torque"
#endif
#if SWINGUP_HAS_IDENTIFIER && !SWINGUP_HAS_ESTIMATOR
#error "an identifier needs an estimator: it needs the delay"
#endif

#define SWINGUP_PI 3.14159265358979323846

/*
 * What the network computes in. Define SWINGUP_REAL as float before the include where double is slow: torques then
 * differ by up to 1e-4 N m. All around the network computes in double precision.
 */
#ifndef SWINGUP_REAL
#define SWINGUP_REAL double
#endif
typedef SWINGUP_REAL swingup_real;

static inline double swingup_clip(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

static inline double swingup_max(double value, double other)
{
    return value > other ? value : other;
}

/* Whether the first numbers of an array are finite: by their bits, since a compiler may take isfinite for
 * true, and comparisons with NaN for any. */
static inline int swingup_finite(const double *values, int count)
{
    union {
        double number;
        uint64_t bits;
    } each;
    int i, finite = 1;
    for (i = 0; i < count; i++) {
        each.number = values[i];
        finite = finite && (each.bits >> 52 & 0x7ff) != 0x7ff;
    }
    return finite;
}

/* Whether a number is NaN, by its bits. */
static inline int swingup_is_nan(const double *value)
{
    union {
        double number;
        uint64_t bits;
    } each;
    each.number = *value;
    return each.bits << 1 > UINT64_C(0xffe0000000000000);
}

/* Write NaN by its bits. */
static inline void swingup_set_nan(double *value)
{
    union {
        uint64_t bits;
        double number;
    } nan;
    nan.bits = UINT64_C(0x7ff8000000000000);
    *value = nan.number;
}

/* Copy numbers. */
static inline void swingup_copy(double *to, const double *from, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] = from[i];
    }
}

/* Remember a number before the newer ones; the oldest one is forgotten. */
static inline void swingup_push(double *past, int count, double newest)
{
    int k;
    for (k = count - 1; k > 0; k--) {
        past[k] = past[k - 1];
    }
    past[0] = newest;
}

/* An angle's distance (rad) without whole turns. */
static inline double swingup_turned(double angle)
{
    return angle - 2.0 * SWINGUP_PI * rint(angle / (2.0 * SWINGUP_PI));
}

#endif
