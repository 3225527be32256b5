"""The base parameters: the fewest numbers in which the equations of motion are linear.

    θ = [A, B, m2 r2, k, b1, b2, cf1, cf2, Ir],   A = I1 + I2 + m2 l1²,   B = I2,   k = m1 r1 + m2 l1

Lengths, gear ratio and gravity are known. The coupling of the links is l1 m2 r2, and gravity's torques are g k and
g m2 r2. Scaling θ and all torques by one factor leaves the motion unchanged, so the commanded torque sets the
scale: a motor that delivers 85 % of its command makes θ appear as 1/0.85 of the true one.
"""

from typing import Any, NamedTuple

import numpy as np

from .equations import Friction, Lumped, Number, mass_entries
from .plant import Plant

BASE_NAMES = ("A", "B", "m2r2", "k", "b1", "b2", "cf1", "cf2", "Ir")
"""Entries of θ: kg m², kg m², kg m, kg m, N m s/rad (two), N m (two), kg m²."""
BASE = len(BASE_NAMES)
FRICTIONS = slice(4, 8)  # Places of b1 to cf2 in θ

INERTIAL_SPREAD = 0.25
"""Standard deviation of I1, I2, m2, r1 and r2 over plants, as a share of each nominal value."""
OTHER_SPREADS = (0.1, 0.1, 0.2, 0.2, 1e-4)
"""Standard deviations of b1 and b2 (N m s/rad), cf1 and cf2 (N m), and Ir (kg m²)."""


class Geometry(NamedTuple):
    """The numbers of a plant that the equations in base parameters take as known."""

    l1: float  # Length of link 1 (m)
    g: float  # Gravity (m/s²)
    gr: float  # Gear ratio of the motors


def geometry_of(plant: Plant) -> Geometry:
    """The lengths, gravity and gear ratio of a plant."""
    return Geometry(float(plant.l1), float(plant.g), float(plant.gr))


def base_parameters(p: Plant, xp: Any = np) -> Any:
    """θ (9,) of a plant, whose numbers may be traced: with ``jax.numpy`` in their precision, else in double."""
    inertial = p.I1 + p.I2 + p.m2 * p.l1**2, p.I2, p.m2 * p.r2, p.m1 * p.r1 + p.m2 * p.l1
    return xp.array([*inertial, p.b1, p.b2, p.cf1, p.cf2, p.Ir], float if xp is np else None)


def base_covariance(p: Plant) -> np.ndarray:
    """Covariance (9, 9) of θ over plants about a nominal one, J diag(σ²) Jᵀ with the derivatives J of θ.

    The correlations matter: a heavier second link raises A, m2 r2 and k together.
    """
    l1, share = p.l1, INERTIAL_SPREAD
    # Columns: I1, I2, m2, r1 and r2 as shares of themselves, then b1 to Ir.
    jacobian = np.zeros((BASE, 10))
    jacobian[0, :3] = p.I1 * share, p.I2 * share, p.m2 * l1**2 * share
    jacobian[1, 1] = p.I2 * share
    jacobian[2, 2] = jacobian[2, 4] = p.m2 * p.r2 * share
    jacobian[3, 2:4] = p.m2 * l1 * share, p.m1 * p.r1 * share
    jacobian[range(4, BASE), range(5, 10)] = OTHER_SPREADS
    return jacobian @ jacobian.T


def lumped(theta: Any, geometry: Geometry) -> Lumped:
    """The combinations in which the equations of motion are written, for θ."""
    shoulder, elbow, second, first, rotor = theta[0], theta[1], theta[2], theta[3], theta[8]
    l1, g, gr = geometry
    geared = gr * rotor
    return Lumped(shoulder, elbow, l1 * second, g * first, g * second, gr * geared, geared, rotor)


def friction_of(theta: Any) -> Friction:
    """The friction of both joints, for θ."""
    return Friction((theta[4], theta[5]), (theta[6], theta[7]))


def feasible_fraction(
    theta: Any, nominal: Any, geometry: Geometry, margin: float, minimum: Any, root: Any
) -> Number:
    """The largest share s in [0, 1] for which the mass matrix of θ0 + s (θ - θ0) is at least margin M(θ0).

    M is linear in θ, so that the eigenvalues of M(θ0)⁻¹ M change linearly from 1 to those of θ. Their minimum over
    all q2 lies at cos q2 = ±1, where the determinant, concave in cos q2, is smallest. ``minimum`` and ``root`` are
    the functions for this kind of number.
    """
    share: Number = 1.0
    for cos2 in (1.0, -1.0):
        n11, n12, n22 = mass_entries(lumped(nominal, geometry), cos2)
        m11, m12, m22 = mass_entries(lumped(theta, geometry), cos2)
        determinant = n11 * n22 - n12 * n12
        # A 2 x 2 matrix has its eigenvalues at half its trace ± a root: that needs no library for JAX or in C.
        half = 0.5 * (n22 * m11 - 2 * n12 * m12 + n11 * m22) / determinant
        product = (m11 * m22 - m12 * m12) / determinant
        # Both eigenvalues are real; rounding may not make the root's argument negative.
        smallest = half - root(abs(half * half - product))
        # The inner minimum keeps a step that needs no cut at exactly 1.
        share = minimum(share, (1.0 - margin) / (1.0 - minimum(smallest, margin)))
    return share
