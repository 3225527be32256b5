"""Sine, cosine and arctangent as short polynomials that compile to vector instructions.

XLA's CPU backend calls the C library for every sine in double precision and for every arctangent, and does not
vectorise the loop around the call. Sines in single precision are XLA's own. Accurate to 4e-16, the sines up to
1e5 rad. Source of the coefficients: fdlibm (Sun Microsystems, 1993).
"""

import math

import jax
import jax.numpy as jnp

from ..plant.equations import Number, Pair

HALF_PI = (1.57079632673412561417e00, 6.07710050650619224932e-11)
"""π/2 as a sum whose first part has 33 bits, so that its small multiples are exact."""
SINE = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
"""Coefficients of z, z², ... in sin(r)/r - 1 with z = r², |r| < π/4."""
COSINE = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip
"""Coefficients of z², z³, ... in cos(r) - 1 + z/2."""
ARCTANGENT = (
    -3.33333333333329318027e-01, 1.99999999998764832476e-01, -1.42857142725034663711e-01,
    1.11111104054623557880e-01, -9.09088713343650656196e-02, 7.69187620504482999495e-02,
    -6.66107313738753120669e-02, 5.83357013379057348645e-02, -4.97687799461593236017e-02,
    3.65315727442169155270e-02, -1.62858201153657823623e-02,
)  # fmt: skip
"""Coefficients of z, z², ... in arctan(r)/r - 1 with z = r², |r| < 7/16."""


def sine_cosine(angle: Number) -> Pair:
    """(sin, cos) of an angle (rad)."""
    angle = jnp.asarray(angle)
    return _polynomials(angle) if angle.dtype == jnp.float64 else (jnp.sin(angle), jnp.cos(angle))


@jax.custom_jvp
def _polynomials(angle: Number) -> Pair:
    # Cody and Waite's reduction: the first product is exact, so that no digits are lost in the difference.
    # Quarter turns: the rest r lies within ±π/4, where the polynomials hold.
    turns = jnp.round(angle * (2.0 / jnp.pi))
    r = (angle - turns * HALF_PI[0]) - turns * HALF_PI[1]
    z = r * r
    sine, cosine = r + r * z * _polynomial(SINE, z), 1.0 - 0.5 * z + z * z * _polynomial(COSINE, z)
    quadrant = turns - 4.0 * jnp.floor(0.25 * turns)
    # Each quarter turn swaps sine and cosine and changes one sign; selecting keeps the loop free of branches.
    swapped = (quadrant == 1.0) | (quadrant == 3.0)
    sine, cosine = jnp.where(swapped, cosine, sine), jnp.where(swapped, sine, cosine)
    first, second = (quadrant == 1.0) | (quadrant == 2.0), quadrant >= 2.0
    return jnp.where(second, -sine, sine), jnp.where(first, -cosine, cosine)


@_polynomials.defjvp
def _derivative(primals: tuple[Number], tangents: tuple[Number]) -> tuple[Pair, Pair]:
    # The exact derivatives: those of the polynomials would cost more terms and be less accurate.
    sine, cosine = sine_cosine(primals[0])
    return (sine, cosine), (cosine * tangents[0], -sine * tangents[0])


@jax.custom_jvp
def arctan(x: Number) -> Number:
    """The arctangent (rad)."""
    x = jnp.asarray(x)
    size = jnp.abs(x)
    # arctan(a) = π/4 + arctan((a - 1) / (a + 1)) = π/2 - arctan(1/a): the rest lies within ±tan(π/8).
    middle, large = size > math.tan(math.pi / 8), size > math.tan(3 * math.pi / 8)
    # One division serves the three cases. The numerator of an infinite x is -1, over infinity.
    above = jnp.where(large, -1.0, jnp.where(middle, size - 1.0, size))
    below = jnp.where(large, size, jnp.where(middle, size + 1.0, 1.0))
    r = above / below
    z = r * r
    start = jnp.where(large, 0.5 * math.pi, jnp.where(middle, 0.25 * math.pi, 0.0))
    found = start + (r + r * z * _polynomial(ARCTANGENT, z))
    return jnp.where(x < 0.0, -found, found)


@arctan.defjvp
def _arctan_derivative(primals: tuple[Number], tangents: tuple[Number]) -> tuple[Number, Number]:
    x = primals[0]
    return arctan(x), tangents[0] / (1.0 + x * x)


def _polynomial(coefficients: tuple[float, ...], z: Number) -> Number:
    total: Number = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        total = coefficient + z * total
    return total
