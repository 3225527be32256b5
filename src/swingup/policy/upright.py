"""The pendulum linearised upright at rest, for base parameters θ, in arithmetic of any numbers.

With the errors e = (q1 - π, q2, q̇1, q̇2):

    M ë_q = G e_q - D ė_q + B u,   M = M(q2 = 0),   D = diag(b1 + c cf1, b2 + c cf2).

The slope of the smoothed Coulomb friction at rest is 100 cf: by it a regulator would take the joint for frozen.
c cf is the damping (N m s/rad) that stands for it. Python's floats and JAX's arrays serve alike.
"""

from typing import Any, NamedTuple, TypeAlias

from ..physics.base_parameters import Known, friction_of, lumped
from ..physics.equations import Number, Pair, mass_entries

Rows: TypeAlias = tuple[Pair, Pair]
"""A matrix (2, 2)."""


class Discrete(NamedTuple):
    """e ← A e + b u over one step."""

    a: tuple[tuple[Number, ...], ...]
    """Rows of A (4, 4)."""
    b: tuple[Number, ...]
    """(4,)"""


def upright_step(theta: Any, known: Known, driven: int, coulomb_damping: Number, h: float) -> Discrete:
    """A = I + h A_c + h² A_c² / 2 and b = h b_c + h² A_c b_c / 2 of the linear equations.

    Args:
        theta: θ in the order of ``physics.base_parameters.BASE_NAMES``; its mass matrix is positive definite.
        known: what else is known of the plant.
        driven: place of the driven joint.
        coulomb_damping: c (s/rad).
        h: length of the step (s).
    """
    plant, ((b1, b2), (cf1, cf2)) = lumped(theta, known), friction_of(theta)
    m11, m12, m22 = mass_entries(plant, 1.0)
    scale = 1.0 / (m11 * m22 - m12 * m12)
    inverse = (m22 * scale, -m12 * scale), (-m12 * scale, m11 * scale)
    second, first = plant.gravity2, plant.gravity1 + plant.gravity2
    # A_c = [[0, I], [X, Y]] and b_c = [0, w].
    x = _product(inverse, ((first, second), (second, second)))
    y = _product(inverse, ((-b1 - coulomb_damping * cf1, 0.0), (0.0, -b2 - coulomb_damping * cf2)))
    w = inverse[0][driven], inverse[1][driven]
    return _discretised(x, y, w, h)


def _discretised(x: Rows, y: Rows, w: Pair, h: float) -> Discrete:
    s, yx, yy = 0.5 * h * h, _product(y, x), _product(y, y)
    angles = [
        (*(s * x[i][j] + (i == j) for j in (0, 1)), *(s * y[i][j] + h * (i == j) for j in (0, 1))) for i in (0, 1)
    ]
    rates = [
        (
            *(h * x[i][j] + s * yx[i][j] for j in (0, 1)),
            *(h * y[i][j] + s * (x[i][j] + yy[i][j]) + (i == j) for j in (0, 1)),
        )
        for i in (0, 1)
    ]
    moved = [h * w[i] + s * (y[i][0] * w[0] + y[i][1] * w[1]) for i in (0, 1)]
    return Discrete((*angles, *rates), (s * w[0], s * w[1], *moved))


def _product(a: Rows, b: Rows) -> Rows:
    (a11, a12), (a21, a22) = a
    (b11, b12), (b21, b22) = b
    return (a11 * b11 + a12 * b21, a11 * b12 + a12 * b22), (a21 * b11 + a22 * b21, a21 * b12 + a22 * b22)
