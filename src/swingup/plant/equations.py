"""The equations of motion M(q) q̈ = G(q) + u - C(q, q̇) q̇ - F(q̇), once for all of Python.

The equations are arithmetic on sines, cosines, rates and torques. The same lines serve JAX's arrays (``dynamics``),
rows of scalars (iLQR's transition), and Python's own floats (the NumPy policies), whose functions are
:class:`ArrayOps`. This module imports nothing of JAX or equinox: NumPy's policies need it on machines that have
neither. Source: the public RealAIGym double-pendulum benchmark.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

Number: TypeAlias = Any  # A float, an array of NumPy, or an array of JAX

StateFloats: TypeAlias = tuple[float, float, float, float]
"""[q1, q2, dq1, dq2] as Python's floats, or one number for each of them."""

Pair: TypeAlias = tuple[Number, Number]
"""One number for the shoulder and one for the elbow; of ``sine_cosine``, the sine and the cosine."""

Stack: TypeAlias = Callable[[Any], Any]  # Makes a vector of a pair

COULOMB_STEEPNESS = 100.0  # Slope of the smoothed Coulomb friction cf arctan(100 q̇) (s/rad)
STRIBECK_RATE = 0.05  # Rate at which stiction fades (rad/s). Chosen: joints break loose within some encoder steps


class Lumped(NamedTuple):
    """The combinations of the plant's parameters that the equations of motion consist of."""

    shoulder: Number  # I1 + I2 + m2 l1², the part of M11 that no angle and no motor changes (kg m²)
    elbow: Number  # I2, inertia of link 2 about the elbow (kg m²)
    coupling: Number  # m2 l1 r2 (kg m²)
    gravity1: Number  # (m1 r1 + m2 l1) g (N m)
    gravity2: Number  # m2 g r2 (N m)
    reflected: Number  # gr² Ir, a rotor's inertia at its joint (kg m²)
    geared: Number  # gr Ir (kg m²)
    rotor: Number  # Ir (kg m²)


class Friction(NamedTuple):
    """Friction b q̇ + cf arctan(100 q̇) of both joints."""

    damping: Pair
    """b of shoulder and elbow (N m s/rad)."""
    coulomb: Pair
    """cf (N m)."""


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
        first = _joint_torque(torques[0], pulls[0], swings[0], losses[0])
        return response(plant, cos2, (first, _joint_torque(torques[1], pulls[1], swings[1], losses[1])))
    return response(plant, cos2, _joint_torque(torques, stack(pulls), stack(swings), stack(losses)), stack)


def _joint_torque(torque: Number, pull: Number, swing: Number, loss: Number) -> Number:
    return torque + pull - swing - loss


TURN = 2 * math.pi


class ArrayOps(NamedTuple):
    """What equations that are written once need of a kind of number: arrays of NumPy or JAX, and single numbers.

    NumPy's single numbers are Python's floats, which are faster than arrays for a dozen of them. JAX's are arrays
    without axes. The equations use operators on both; of a branch both sides must be computable.
    """

    xp: Any  # For arrays: the module numpy or jax.numpy
    sine_cosine: Callable[[Number], Pair]
    arctan: Callable[[Number], Number]
    log1p: Callable[[Number], Number]
    expm1: Callable[[Number], Number]
    root: Callable[[Number], Number]
    minimum: Callable[[Number, Number], Number]  # The smaller of two numbers
    maximum: Callable[[Number, Number], Number]
    finite: Callable[[Any], Any]  # Whether all numbers of an array are finite
    where: Callable[[Any, Number, Number], Number]
    place: Callable[[Number], Any]  # The nearest whole number, as a place in an array
    number: Callable[[Any], Number]  # The number of an array without axes
    numbers: Callable[[Any], tuple[Number, ...]]  # The numbers of a vector
    vector: Callable[[Any], Any]  # The vector of some numbers
    window: Callable[[Any, Any, int], Any]  # Rows of an array from a place that is found at run time: so many
    choose: Callable[[Any, Callable[[], Any], Any], Any]
    """What a function returns where a condition holds, else the last argument: arrays, numbers, or tuples of them.

    NumPy calls the function only where it must, JAX always.
    """

    def clip(self, value: Number, low: Number, high: Number) -> Number:
        """A number within bounds; NaN stays."""
        return self.minimum(self.maximum(value, low), high)

    def nearest(self, angles: Any) -> Any:
        """Differences of angles (rad), less full turns; small ones keep all digits."""
        # Less than half a turn rounds to no turn: nothing is subtracted, where a modulus would add and take π.
        return angles - TURN * self.xp.rint(angles / TURN)


def sine_cosine(angle: float) -> tuple[float, float]:
    """(sin, cos) of an angle (rad); NaN where it is not finite, for which math.sin raises an error."""
    return (math.sin(angle), math.cos(angle)) if math.isfinite(angle) else (math.nan, math.nan)


def finite(values: np.ndarray) -> bool:
    """Whether all numbers of an array are finite."""
    if values.ndim == 1:
        return all(map(math.isfinite, values.tolist()))
    # 0 times what is not finite is NaN; of a matrix a product is faster than a test of each number.
    return bool(np.vdot(values, 0.0 * values) == 0.0)


NUMPY = ArrayOps(
    xp=np,
    sine_cosine=sine_cosine,
    arctan=math.atan,
    log1p=math.log1p,
    expm1=math.expm1,
    root=math.sqrt,
    minimum=min,
    maximum=max,
    finite=finite,
    where=lambda condition, yes, no: yes if condition else no,
    place=round,
    # Python's floats: a product of NumPy's scalars takes three times as long.
    number=float,
    numbers=lambda values: tuple(values.tolist()),
    vector=np.array,
    window=lambda rows, start, size: rows[start : start + size],
    choose=lambda condition, yes, no: yes() if condition else no,
)
"""NumPy's functions, for arrays in double precision and Python's floats."""

ARRAYS = NUMPY._replace(
    sine_cosine=lambda angle: (np.sin(angle), np.cos(angle)), arctan=np.arctan, log1p=np.log1p, where=np.where
)
"""The functions for equations whose single numbers are arrays: many at once."""


def damped_midpoint_step(
    plant: Lumped, friction: Friction | None, x: Any, torques: Any, dt: Number, ops: ArrayOps
) -> StateFloats:
    """One step of the midpoint rule with implicit friction, from x = [q1, q2, dq1, dq2] (rad, rad/s).

    The torques (N m) act for dt (s). Smoothed Coulomb friction cf arctan(100 q̇) is stiff: near rest an explicit
    step of 2 ms may overshoot, and the estimator's prediction takes longer ones. Here friction is linear about the
    rates v that an explicit step would use, and acts on the rates at the step's end (implicit Euler):

        (M + h D) a = G + u - C v - F(v) + D (v - v₀),    D = diag(b + 100 cf / (1 + (100 v)²)),    q̇ = v₀ + h a

    A joint at rest stays there whatever the step. A step overshoots only where friction alone reverses a joint
    within it, h cf π/2 > M |v|, and by no more than that. Without friction this is the explicit midpoint rule.
    """
    # The first evaluation only finds the middle. The second makes the step, from x and over all of dt.
    half, rates = 0.5 * dt, (x[2], x[3])
    a1, a2 = _damped_acceleration(plant, friction, (x[0], x[1]), rates, rates, torques, half, ops)
    middle = x[0] + half * x[2], x[1] + half * x[3]
    v1, v2 = x[2] + half * a1, x[3] + half * a2
    a1, a2 = _damped_acceleration(plant, friction, middle, (v1, v2), rates, torques, dt, ops)
    return x[0] + dt * v1, x[1] + dt * v2, x[2] + dt * a1, x[3] + dt * a2


def _damped_acceleration(
    plant: Lumped,
    friction: Friction | None,
    angles: Pair,
    rates: Pair,
    start: Pair,
    torques: Any,
    step: Number,
    ops: ArrayOps,
) -> Pair:
    """q̈ (rad/s²) with friction linear about ``rates``, for a step (s) from the rates ``start`` (rad/s)."""
    (sin1, _), (sin2, cos2) = ops.sine_cosine(angles[0]), ops.sine_cosine(angles[1])
    sines = sin1, sin2, ops.sine_cosine(angles[0] + angles[1])[0]
    if friction is None:
        return acceleration(plant, sines, cos2, rates, torques)
    (b1, b2), (cf1, cf2) = friction
    slope1, loss1 = _tangent(b1, cf1, rates[0], start[0], ops.arctan)
    slope2, loss2 = _tangent(b2, cf2, rates[1], start[1], ops.arctan)
    # h D adds to the diagonal of M, where rotor inertia stands: `reflected` in M11 and M22, `rotor` in M11 alone.
    drag1, drag2 = step * slope1, step * slope2
    dragged = Lumped(*plant[:5], plant.reflected + drag2, plant.geared, plant.rotor + (drag1 - drag2))
    return acceleration(dragged, sines, cos2, rates, torques, (loss1, loss2))


def _tangent(b: Number, cf: Number, rate: Number, start: Number, arctan: Callable[[Any], Any]) -> Pair:
    """Tangent to the friction curve at ``rate``: its slope (N m s/rad), and its value at ``start`` (N m)."""
    steep = COULOMB_STEEPNESS * rate
    slope = b + COULOMB_STEEPNESS * cf / (1.0 + steep * steep)
    return slope, friction(b, cf, rate, arctan) - slope * (rate - start)
