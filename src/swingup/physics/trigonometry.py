"""Sine and cosine together, as short polynomials that compile to vector instructions.

XLA's CPU backend calls the C library for every single sine in double precision, which also keeps the loop around it
from being vectorised; single precision is left to XLA. Accurate to 2e-16 up to 1e5 rad. Source of the coefficients:
fdlibm (Sun Microsystems, 1993).
"""

from typing import Any, TypeAlias

import jax
import jax.numpy as jnp

Real: TypeAlias = Any
"""A Python float or an array of JAX."""

HALF_PI = (1.57079632673412561417e00, 6.07710050650619224932e-11)
"""π/2 as a sum whose first part has 33 bits, so that its small multiples are exact."""
SINE = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
"""Of z, z², ... in sin(r)/r - 1 with z = r², |r| < π/4."""
COSINE = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip
"""Of z², z³, ... in cos(r) - 1 + z/2."""


def sine_cosine(angle: Real) -> tuple[Real, Real]:
    """(sin, cos) of an angle (rad)."""
    angle = jnp.asarray(angle)
    return _polynomials(angle) if angle.dtype == jnp.float64 else (jnp.sin(angle), jnp.cos(angle))


@jax.custom_jvp
def _polynomials(angle: Real) -> tuple[Real, Real]:
    turns = jnp.round(angle * (2.0 / jnp.pi))
    r = (angle - turns * HALF_PI[0]) - turns * HALF_PI[1]
    z = r * r
    sine, cosine = r + r * z * _polynomial(SINE, z), 1.0 - 0.5 * z + z * z * _polynomial(COSINE, z)
    quadrant = turns - 4.0 * jnp.floor(0.25 * turns)
    swapped = (quadrant == 1.0) | (quadrant == 3.0)
    sine, cosine = jnp.where(swapped, cosine, sine), jnp.where(swapped, sine, cosine)
    first, second = (quadrant == 1.0) | (quadrant == 2.0), quadrant >= 2.0
    return jnp.where(second, -sine, sine), jnp.where(first, -cosine, cosine)


@_polynomials.defjvp
def _derivative(primals: tuple[Real], tangents: tuple[Real]) -> tuple[tuple[Real, Real], tuple[Real, Real]]:
    sine, cosine = sine_cosine(primals[0])
    return (sine, cosine), (cosine * tangents[0], -sine * tangents[0])


def _polynomial(coefficients: tuple[float, ...], z: Real) -> Real:
    total: Real = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        total = coefficient + z * total
    return total
