"""The equations of motion M(q) q̈ = G(q) + u - C(q, q̇) q̇ - F(q̇), once for all of Python.

Everything here is arithmetic on sines, cosines, rates and torques that the caller computed. So the same lines serve
JAX's arrays (``dynamics``), rows of scalars (iLQR's transition), and Python's own floats (the NumPy policies). This
module imports nothing of JAX or equinox: NumPy's policies need it on machines that have neither. Source: the public
RealAIGym double-pendulum benchmark.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from .plant import Plant

Number: TypeAlias = Any
"""A float, an array of NumPy, or an array of JAX."""

StateFloats: TypeAlias = tuple[float, float, float, float]
"""[q1, q2, dq1, dq2] as Python's floats, or one number for each of them."""

Pair: TypeAlias = tuple[Number, Number]
"""One number for the shoulder and one for the elbow; of ``sine_cosine``, the sine and the cosine."""

Stack: TypeAlias = Callable[[Any], Any]
"""Makes a vector of a pair."""

COULOMB_STEEPNESS = 100.0
"""Slope of the smoothed Coulomb friction cf arctan(100 q̇) (s/rad)."""


class Lumped(NamedTuple):
    """The combinations of the plant's parameters that the equations of motion consist of."""

    shoulder: Number
    """I1 + I2 + m2 l1², the part of M11 that no angle and no motor changes (kg m²)."""
    elbow: Number
    """I2, inertia of link 2 about the elbow (kg m²)."""
    coupling: Number
    """m2 l1 r2 (kg m²)."""
    gravity1: Number
    """(m1 r1 + m2 l1) g (N m)."""
    gravity2: Number
    """m2 g r2 (N m)."""
    reflected: Number
    """gr² Ir, a rotor's inertia at its joint (kg m²)."""
    geared: Number
    """gr Ir (kg m²)."""
    rotor: Number
    """Ir (kg m²)."""


def lump(p: "Plant") -> Lumped:
    """The combinations for a plant."""
    return Lumped(
        # I2 is about the elbow: seen from the shoulder, link 2 adds its mass there.
        shoulder=p.I1 + p.I2 + p.m2 * p.l1**2,
        elbow=p.I2,
        coupling=p.m2 * p.l1 * p.r2,
        gravity1=(p.m1 * p.r1 + p.m2 * p.l1) * p.g,
        gravity2=p.m2 * p.g * p.r2,
        reflected=p.gr**2 * p.Ir,
        geared=p.gr * p.Ir,
        rotor=p.Ir,
    )


def mass_entries(plant: Lumped, cos2: Number) -> tuple[Number, Number, Number]:
    """M11, M12 = M21 and M22 (kg m²), with the motors' inertia."""
    shoulder, elbow, coupling, _, _, reflected, geared, rotor = plant
    # The elbow's rotor turns at q̇1 - gr q̇2 in space: its energy ½ Ir (q̇1 - gr q̇2)² couples the joints.
    m11 = shoulder + 2 * coupling * cos2 + reflected + rotor
    return m11, elbow + coupling * cos2 - geared, elbow + reflected


def gravity(plant: Lumped, sin1: Number, sin12: Number) -> Pair:
    """G(q) (N m), the torque with which gravity drives each joint; sin12 = sin(q1 + q2)."""
    # The shoulder carries the torque of link 2 as well.
    second = -plant.gravity2 * sin12
    return -plant.gravity1 * sin1 + second, second


def coriolis(plant: Lumped, sin2: Number, dq1: Number, dq2: Number) -> Pair:
    """C(q, q̇) q̇ (N m)."""
    h = plant.coupling * sin2
    return -h * dq2 * (2 * dq1 + dq2), h * dq1 * dq1


def friction(damping: Number, coulomb: Number, rate: Number, arctan: Callable[[Any], Any]) -> Number:
    """F(q̇) = b q̇ + cf arctan(100 q̇) of a joint (N m), viscous and smoothed Coulomb friction.

    b is the damping (N m s/rad), cf the Coulomb friction (N m), q̇ the rate (rad/s).
    """
    return damping * rate + coulomb * arctan(COULOMB_STEEPNESS * rate)


def response(plant: Lumped, cos2: Number, torques: Any, stack: Stack | None = None) -> Any:
    """M(q)⁻¹ τ (rad/s²): the accelerations that torques τ (N m) cause."""
    m11, m12, m22 = mass_entries(plant, cos2)
    determinant = m11 * m22 - m12 * m12
    # No unpacking: iterating over a vector of JAX is another operation than indexing it, and slower.
    adjugate1, adjugate2 = m22 * torques[0] - m12 * torques[1], m11 * torques[1] - m12 * torques[0]
    if stack is None:
        return adjugate1 / determinant, adjugate2 / determinant
    return stack((adjugate1, adjugate2)) / determinant


def acceleration(
    plant: Lumped,
    sines: tuple[Number, Number, Number],
    cos2: Number,
    rates: Pair,
    torques: Any,
    losses: Any = (0.0, 0.0),
    stack: Stack | None = None,
) -> Any:
    """q̈ (rad/s²).

    The sines are of q1, q2 and q1 + q2, the losses F(q̇) (N m): zeros of a plant without friction cost nothing once
    compiled. With a ``stack`` both joints are computed as one vector, which is the result too.
    """
    sin1, sin2, sin12 = sines
    pulls, swings = gravity(plant, sin1, sin12), coriolis(plant, sin2, rates[0], rates[1])
    if stack is None:
        first = _sum(torques[0], pulls[0], swings[0], losses[0])
        return response(plant, cos2, (first, _sum(torques[1], pulls[1], swings[1], losses[1])))
    return response(plant, cos2, _sum(torques, stack(pulls), stack(swings), stack(losses)), stack)


def _sum(torque: Number, pull: Number, swing: Number, loss: Number) -> Number:
    return torque + pull - swing - loss
