"""The pendulum linearised upright at rest, for base parameters θ, in arithmetic of any numbers.

With the errors e = (q1 - π, q2, q̇1, q̇2):

    M ë_q = G e_q - D ė_q + B u,   M = M(q2 = 0),   D = diag(b1 + d(cf1), b2 + d(cf2)).

The slope of the smoothed Coulomb friction at rest is 100 cf: by it a regulator would take the joint for frozen.
The damping d(cf) = cf + cf² / c (N m s/rad) stands for it, cf for friction that drives, below 0: the more friction,
the slower the motions that are left.
A torque f on the undriven joint enters as u does on the other.
Python's floats and JAX's arrays serve alike.
"""

from typing import Any, NamedTuple

from ...plant.base_parameters import Geometry, friction_of, lumped
from ...plant.equations import Number, mass_entries


class Discrete(NamedTuple):
    """e ← A e + d f + b u over one step."""

    a: tuple[tuple[Number, ...], ...]
    """Rows of A (4, 4)."""
    d: tuple[Number, ...]
    """(4,), of a torque f on the undriven joint."""
    b: tuple[Number, ...]
    """(4,), of the torque u on the driven joint."""


def upright_step(theta: Any, geometry: Geometry, driven: int, coulomb_damping: Number, h: float) -> Discrete:
    """A = I + h A_c + h² A_c² / 2, b = h b_c + h² A_c b_c / 2 and d, alike, of the linear equations.

    The mass matrix of θ is positive definite. c is ``coulomb_damping`` (N m rad/s), the step's length h (s).
    """
    plant, ((b1, b2), (cf1, cf2)) = lumped(theta, geometry), friction_of(theta)
    m11, m12, m22 = mass_entries(plant, 1.0)
    scale = 1.0 / (m11 * m22 - m12 * m12)
    i11, i12, i22 = m22 * scale, -m12 * scale, m11 * scale
    # A_c = [[0, I], [X, Y]] with X = M⁻¹ G and Y = -M⁻¹ D; b_c = [0, w].
    second, first = plant.gravity2, plant.gravity1 + plant.gravity2
    # (cf + |cf|) cf is 2 cf² for friction that resists, and 0 for one that drives.
    damping1 = b1 + cf1 + (cf1 + abs(cf1)) * cf1 / (2.0 * coulomb_damping)
    damping2 = b2 + cf2 + (cf2 + abs(cf2)) * cf2 / (2.0 * coulomb_damping)
    x11, x12 = i11 * first + i12 * second, (i11 + i12) * second
    x21, x22 = i12 * first + i22 * second, (i12 + i22) * second
    y11, y12, y21, y22 = -i11 * damping1, -i12 * damping2, -i12 * damping1, -i22 * damping2
    s = 0.5 * h * h
    # The lower rows are those of I + h A_c, and of h²/2 times A_c² = [[X, Y], [Y X, X + Y²]].
    rates1 = (
        h * x11 + s * (y11 * x11 + y12 * x21),
        h * x12 + s * (y11 * x12 + y12 * x22),
        1.0 + h * y11 + s * (x11 + y11 * y11 + y12 * y21),
        h * y12 + s * (x12 + y11 * y12 + y12 * y22),
    )
    rates2 = (
        h * x21 + s * (y21 * x11 + y22 * x21),
        h * x22 + s * (y21 * x12 + y22 * x22),
        h * y21 + s * (x21 + y21 * y11 + y22 * y21),
        1.0 + h * y22 + s * (x22 + y21 * y12 + y22 * y22),
    )
    angles1, angles2 = (
        (1.0 + s * x11, s * x12, h + s * y11, s * y12),
        (s * x21, 1.0 + s * x22, s * y21, h + s * y22),
    )
    moved = [
        (s * w1, s * w2, h * w1 + s * (y11 * w1 + y12 * w2), h * w2 + s * (y21 * w1 + y22 * w2))
        for w1, w2 in ((i11, i12), (i12, i22))
    ]
    return Discrete((angles1, angles2, rates1, rates2), moved[1 - driven], moved[driven])
