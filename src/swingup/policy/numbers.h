/*
 * What all parts of a policy in C need of numbers.
 */
#ifndef SWINGUP_NUMBERS_H
#define SWINGUP_NUMBERS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "flash.h"

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#error "compile without -ffast-math and -ffinite-math-only: NaN would pass all checks, with full torque"
#endif

#define SWINGUP_PI 3.14159265358979323846

typedef double swingup_time; /* of the loop's clock (s), in a header in single precision as well */

/* A number's bits, and those of infinity: without the sign, those of NaN are above them. */
#if SWINGUP_SINGLE
typedef uint32_t swingup_bits;
#define SWINGUP_INFINITY UINT32_C(0x7f800000)
#define SWINGUP_NAN UINT32_C(0x7fc00000)
#else
#if defined(__SIZEOF_DOUBLE__) && __SIZEOF_DOUBLE__ < 8
#error "double has 32 bits here: export the header with --precision single"
#endif
typedef uint64_t swingup_bits;
#define SWINGUP_INFINITY UINT64_C(0x7ff0000000000000)
#define SWINGUP_NAN UINT64_C(0x7ff8000000000000)
#endif

#ifdef __AVR__ /* whose library lacks these, and whose functions read the first 64 kB of the flash */
#if !SWINGUP_SINGLE
#error "an AVR reads constants of 32 bits: export the header with --precision single"
#endif
#if SWINGUP_CONSTANT_BYTES > 60000
#error "the constants of this header do not fit into the first 64 kB of an AVR's flash: use smaller layers"
#endif
static inline double swingup_rint(double x)
{
    return floor(x + 0.5);
}

static inline double swingup_log1p(double x)
{
    const double u = 1.0 + x;
    return u == 1.0 ? x : log(u) * x / (u - 1.0);
}

static inline double swingup_expm1(double x)
{
    const double u = exp(x);
    return u == 1.0 ? x : u - 1.0 == -1.0 ? -1.0 : (u - 1.0) * x / log(u);
}
#else
#define swingup_rint(x) rint(x)
#define swingup_log1p(x) log1p(x)
#define swingup_expm1(x) expm1(x)
#endif

static inline double swingup_clip(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

static inline double swingup_max(double value, double other)
{
    return value > other ? value : other;
}

/* The bits of a number without its sign. */
static inline swingup_bits swingup_magnitude(const double *value)
{
    swingup_bits bits;
    memcpy(&bits, value, sizeof bits);
    return bits & (SWINGUP_INFINITY | (SWINGUP_INFINITY - 1));
}

/* Whether the first numbers of an array are finite: by their bits, since a compiler may take isfinite for
 * true, and comparisons with NaN for any. */
static inline int swingup_finite(const double *values, int count)
{
    int i, finite = 1;
    for (i = 0; i < count; i++) {
        finite = finite && swingup_magnitude(values + i) < SWINGUP_INFINITY;
    }
    return finite;
}

/* Whether a number is NaN, by its bits. */
static inline int swingup_is_nan(const double *value)
{
    return swingup_magnitude(value) > SWINGUP_INFINITY;
}

/* Write NaN by its bits. */
static inline void swingup_set_nan(double *value)
{
    const swingup_bits bits = SWINGUP_NAN;
    memcpy(value, &bits, sizeof bits);
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

#endif
