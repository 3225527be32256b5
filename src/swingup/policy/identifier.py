"""Online identification of the plant's base parameters from measured angles and commanded torques, in Python.

At each measurement, with the rows Y of ``plant.momentum`` for the last angles and the torques of that time:

1. z ← (Y, u̇, -v, u) through three first-order low-passes of equal pole, all columns alike. Now
   Y (θ, κ) + u̇ λ - v γ = u holds for the low-passed columns: κ stands for the offsets of the angles, λ (s) is a lag
   of the torque beside the delay that is known. v is the torque asked of the undriven joint's motor against its
   friction, and γ the part of it that this motor delivers. u and u̇ are 0 in the undriven joint's row, v is in the
   driven one's. Where loads are expected the
   left side has c + k q of its joint as well, at the middle angle.
2. For each joint's row φ, y, with the unknowns x = (θ, κ, λ, γ), their covariance P, and the variance r of what the
   row leaves unexplained, with a floor f and a bound b:

       e = y - φᵀ x,   s = φᵀ P φ,   r' = max(r, f),   d² = e² / (s + r'),
       k = P φ / (s + n r' w),   w = max(1, (ν + d²)/(ν + 1)),   x ← x + k e,   P ← P - k (P φ)ᵀ,
       r ← r + a (min(d² r', b) - r),   a = 1 - exp(-h/T), T = rise if r grows, fall if not;

   h is the shortest step of the row's time, the loop's own period. n counts the neighbouring rows whose errors are
   alike. w is the inverse of Student's weight, ν = 4. A row with d above the gate, and rows for a while after it,
   change nothing but r: pushes.
3. Noise of the angles, of variance σ², spoils φ, and least squares find too little inertia. In both low-passed
   accelerations it has the variances s = c σ², which add D = s1 j1 j1ᵀ + s2 j2 j2ᵀ to φ φᵀ in the mean, with j the
   derivatives of φ by these. That is taken back:

       x ← x + P D x / (n r' w).

   c grows with the period. σ² follows δ²/20, up to a bound, where the last three steps are even: the third
   differences δ of an angle see its noise and little of its motion.
4. P grows by a small drift. There is no forgetting: what is not excited stays as sure as it was.

A robot's loop may hand over the angles of an earlier call: so many calls ago is their age. Where the times between
calls are uneven, the motion from angle to angle tells whose times they are; where they are even, it does not
matter. The torques of a row begin as many calls ago as the delay told, at least the age. If either changes, the lag
changes by the opposite time, since their sum is what was found, and the low-passes start again.

Learning starts once the rows' angles and torques are known since the first call or the last pause. Numbers that are
not finite after a call, and angles beyond 1e6 rad, change nothing. Other parts get θ0 + ς (θ - θ0) with the largest
ς in [0, 1] for which the mass matrix is at least ``LEAST_MASS_SHARE`` times that of the nominal θ0.

The motor's torque does not enter the undriven joint's row. That row alone gives its part of θ up to scale, and
noise of the motor and pushes on the driven joint do not enter it; the driven joint's row adds the scale. Rates are
not used at all: their noise costs nothing. Sources: filtered regression, Slotine and Li (Applied Nonlinear Control,
9.2); compensated bias, Sagara and Wada (International Journal of Control 25, 1977); recursive least squares with a
variance that adapts to innovations, Mehra (IEEE Transactions on Automatic Control 15, 1970).
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from ..common.errors import SwingupError
from ..common.settings import Range, Settings
from ..plant.base_parameters import (
    BASE,
    Geometry,
    base_covariance,
    base_parameters,
    feasible_fraction,
    friction_of,
    geometry_of,
    lumped,
)
from ..plant.equations import ArrayOps, Friction, Lumped, Number, Pair, mass_entries
from ..plant.momentum import inertial_row, momentum_rows
from ..plant.plant import Plant
from ..plant.units import TORQUE

UNKNOWNS = BASE + 4
"""The base parameters, and behind them what the constants below are the places of."""
TILT1, TILT2 = BASE, BASE + 1
"""κ1 = k o1 and κ2 = m2 r2 (o1 + o2) (kg m), for measured angles that are o1 and o2 (rad) too large."""
LAG = BASE + 2
"""The torque's lag (s) behind the delay that the identifier is told."""
GAIN = BASE + 3
"""Part of its command that the undriven joint's motor delivers."""
LOADS = UNKNOWNS + 4
"""Behind them, where loads are expected: constant torques against both joints (N m) and springs (N m/rad)."""

SPAN_TIME = 0.008
"""Time between the three angles of a row (s): rates resolve the encoder's step over it."""
BANDWIDTH = 60.0
"""Bandwidth of each pole of the low-pass on both sides of the equation (rad/s). Rows in the time that it takes have
errors that are alike and count as one."""
POLES = 3
"""First-order low-passes in a row: second differences of an encoder's steps need three."""
PASSIVE_DEVIATION, PASSIVE_FLOOR = 0.012, 0.005
"""First and least standard deviation of what an undriven joint's low-passed row leaves unexplained (N m)."""
DRIVEN_DEVIATION, DRIVEN_FLOOR = 0.04, 0.01
"""The same for the driven joint, whose motor is noisy and is pushed."""
RELATIVE_FLOOR = 0.002
"""Part of a floor that grows with the size of a row's terms: errors of the discretisation."""
MOST_DEVIATION = 10.0
"""Largest deviation that the residuals of a row raise its own to, in first ones."""
RISE_TIME, FALL_TIME = 0.02, 0.1
"""Times in which the deviation follows larger residuals and smaller ones (s)."""
GATE_SIGMAS = 3.0
"""Residuals of more than this many of their standard deviations are pushes."""
GATE_HOLD = 0.1
"""Time after a push in which its row is not used (s)."""
STUDENT = 4.0
"""ν: degrees of freedom of the errors' distribution."""
LAG_DEVIATION = 0.01
"""Standard deviation of the torque's lag (s)."""
OFFSET_DEVIATION = 0.03
"""Standard deviation of the angles' offsets (rad)."""
GAIN_DEVIATION = 0.5
"""Standard deviation of the part of its command that the undriven joint's motor delivers; its mean is 1."""
DRIFT = 0.01
"""Drift of the unknowns, in prior standard deviations after 1 s."""
LEAST_MASS_SHARE = 0.2
"""The identified mass matrix is at least this share of the nominal one, in every configuration."""
MOST_OFFSET = 0.1
"""Largest offset of an angle that is believed (rad)."""
LARGEST_ANGLE = 1e6
"""An angle beyond this is not a measurement (rad): its digits do not tell the turn."""
UNEVEN_STEP = 1e-3
"""Angle (rad) by which a call's motion may miss what the time since the last call explains."""
UNEVEN_FADING = 0.9995
"""Factor on what was missed, at each call."""
NOISE_TIME = 0.05
"""Time in which the noise of the angles is followed (s)."""
MOST_NOISE = 1e-3
"""Largest standard deviation of an angle's noise (rad)."""
EVEN_STEPS = 0.1
"""Steps that differ by less, in periods, are even: the noise shows in them."""
AGE_CAUTION = 4.0
"""Evidence that it takes to believe that angles are a call old, or that they are not."""
LONGEST_STEP = 4.0
"""A call that comes more than this many periods after the last one restarts estimator and identifier."""
SHORTEST_STEP = 0.6
"""A call that comes sooner, in periods, keeps the torques: rates would have nothing but the encoder's step."""


@dataclass(frozen=True)
class IdentifierSettings(Settings):
    """What a robot's owner may choose of the identifier; period and delays are the estimator's."""

    PART: ClassVar[str] = "identifier"
    passive_limit: Annotated[float, Range(0.0, 1e3), TORQUE] = 0.5
    """Largest torque that compensates the undriven joint's friction and load (N m); 0 for none."""
    load_deviation: Annotated[float, Range(0.0, 1e3), TORQUE] = 0.0
    """Standard deviation of a constant torque against each joint (N m)."""
    spring_deviation: Annotated[float, Range(0.0, 1e3), TORQUE] = 0.0
    """Standard deviation of the stiffness of a spring or cable at each joint, relaxed at 0 (N m/rad)."""


def row_span(period: float) -> int:
    """Steps between the three angles of a row, at a period between calls (s)."""
    return max(2, round(SPAN_TIME / period))


def commands(period: float, max_delay_steps: int) -> int:
    """Commands to remember. Angles may be a call old whatever the longest delay is."""
    return 2 * row_span(period) + max(max_delay_steps, 1)


def noise_gain(period: float) -> float:
    """Variance (1/s⁴) of a low-passed row's accelerations, for angles with white noise of variance 1."""
    half, keep = row_span(period), np.exp(-BANDWIDTH * period)
    low_pass = (1.0 - keep) * keep ** np.arange(round(20.0 / (BANDWIDTH * period)))
    response = np.zeros(2 * half + 1)
    response[[0, half, 2 * half]] = np.array([1.0, -2.0, 1.0]) / (half * period) ** 2
    for _ in range(POLES):
        response = np.convolve(response, low_pass)
    return float(response @ response)


def prior(plant: Plant, settings: IdentifierSettings | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n,) and covariance (n, n) of the unknowns before any measurement; n is 17 with loads, else 13."""
    s = settings or IdentifierSettings()
    deviations = s.load_deviation, s.load_deviation, s.spring_deviation, s.spring_deviation
    # Without loads each call is cheaper.
    loads = deviations if any(deviations) else ()
    size = UNKNOWNS + len(loads)
    mean, covariance = np.zeros(size), np.zeros((size, size))
    mean[:BASE] = base = base_parameters(plant)
    mean[GAIN] = 1.0
    covariance[:BASE, :BASE] = base_covariance(plant)
    second, first = base[2:4]
    if first == 0 or second == 0:
        raise SwingupError(
            f"a plant with m1 r1 + m2 l1 = {first:g} and m2 r2 = {second:g} kg m gives an identifier nothing to "
            "find the offsets by: give both links a centre of mass off their joint, or leave the identifier out"
        )
    # The unknowns are offsets times moments, in which the rows are linear.
    others = OFFSET_DEVIATION * first, OFFSET_DEVIATION * second, LAG_DEVIATION, GAIN_DEVIATION, *loads
    covariance[range(BASE, size), range(BASE, size)] = np.square(others)
    return mean, covariance


def offsets(tilt1: Any, tilt2: Any, theta: Any, clip: Callable[[Any, float, float], Any]) -> tuple[Any, Any]:
    """How much the measured angles are too large (rad), for tilts κ1 and κ2 (kg m) of any kind of number."""
    # κ2 belongs to the angle of link 2 in space, which both offsets spoil.
    both = clip(tilt2 / theta[2], -MOST_OFFSET, MOST_OFFSET)
    first = clip(tilt1 / theta[3], -MOST_OFFSET, MOST_OFFSET)
    return first, both - first


LEAST_GAIN = 0.6
"""The undriven joint's motor is asked for as much as if it delivered at least this share."""


class Load(NamedTuple):
    """Torques c + k q against both joints: of cables, of springs."""

    constant: Pair
    """c (N m)."""
    spring: Pair
    """k (N m/rad)."""

    def at(self, q1: Any, q2: Any) -> Pair:
        """The torques (N m) at angles (rad)."""
        return self.constant[0] + self.spring[0] * q1, self.constant[1] + self.spring[1] * q2


class Model(NamedTuple):
    """A plant to predict with, its friction if it has any, and the load on its joints if there is any."""

    plant: Lumped
    friction: Friction | None
    load: Load | None


class Compensation(NamedTuple):
    """Parts of a :class:`Friction` or a :class:`Load`."""

    commanded: Any
    """What the motors are commanded; never negative friction."""
    residual: Any
    """What remains; negative friction is not compensated."""
    predicted: Any
    """What to predict with: all of the driven joint's, whose torque is counted, and what is left of the other's.
    Negative friction counts as zero: the implicit step near rest would be singular with it."""


def compensation(found: Any, gain: Number, joint: int, passive_limit: float, maximum: Any) -> Compensation:
    """Share out what is found. Arithmetic for any kind of number.

    The gain is the part of its command that the undriven joint's motor delivers, in units of what the driven one
    does. Its compensation is at most ``passive_limit`` (N m), 0 for none.
    """
    kind, delivered = type(found), maximum(gain, 0.0)
    # A weak motor's command must not grow without bound: what it does not deliver stays in the plant.
    factor = 1.0 / maximum(delivered, LEAST_GAIN) if passive_limit else 0.0
    parts = []
    for values in found:
        commanded, residual, predicted = [], [], []
        for index, value in enumerate(values):
            # The gain counts in units of the driven motor's, whose own is 1 therefore.
            share, part = (1.0, 1.0) if index == joint else (factor, delivered)
            commanded.append(share * (maximum(value, 0.0) if kind is Friction else value))
            residual.append(value - part * commanded[index])
            # The estimator adds the driven motor's whole command, so that its model must hold the whole friction.
            seen = value if index == joint else residual[index]
            predicted.append(maximum(seen, 0.0) if kind is Friction else seen)
        parts.append((tuple(commanded), tuple(residual), tuple(predicted)))
    return Compensation(*(kind(*pairs) for pairs in zip(*parts, strict=True)))


Array = Any
"""An array of NumPy or JAX; shapes are in the comments."""


class Loop(NamedTuple):
    """What an identifier knows of its loop."""

    joint: int
    """Index of the driven joint."""
    period: float
    """Nominal time between calls (s)."""
    max_delay_steps: int
    """Longest delay that the identifier is told (steps)."""
    passive_limit: float
    """Largest torque that compensates the undriven joint's friction (N m); 0 for none."""
    geometry: Geometry
    """What is known of the plant's lengths and gears."""
    mean: Array
    """θ of the nominal plant, no offsets, no lag, a gain of 1, and no loads where they are expected (n,)."""
    covariance: Array
    """Prior covariance (n, n)."""
    noise_gain: float
    """Variance of a low-passed row's accelerations over that of the angles' noise (1/s⁴)."""


def make_loop(plant: Plant, joint: int, period: float, max_delay_steps: int, settings: IdentifierSettings) -> Loop:
    """What an identifier knows of a plant's loop, whose period (s) and longest delay (steps) are an estimator's."""
    passive_limit = settings.passive_limit
    known = geometry_of(plant), *prior(plant, settings), noise_gain(period)
    return Loop(joint, period, max_delay_steps, passive_limit, *known)


class IdentifierState(NamedTuple):
    """What is remembered from call to call."""

    angles: Array
    """Measured angles (depth, 2) without jumps of full turns, newest first (rad)."""
    torques: Array
    """Commanded torques (past, 2), newest first (N m)."""
    steps: Array
    """Time for which each torque was held (past,) (s)."""
    calls: Number
    """Measurements since the last restart."""
    delay_steps: Number
    """The delay told last (steps), or ``age`` where that is more."""
    missed: Array
    """What the motion misses if angles have each age, from 0 on (ages,)."""
    age: Number
    """The angles' age (calls)."""
    filtered: tuple[Array, ...]
    """States of the low-passes: rows (2, n + 1) of both joints, a column for each unknown and last u."""
    unknowns: Array
    """θ, κ1 and κ2 (kg m), the lag (s), the gain of the undriven joint's motor, and loads (n,)."""
    covariance: Array
    """(n, n)"""
    variance: Pair
    """Variance of what each joint's row leaves unexplained (N² m²)."""
    held: Pair
    """Time for which each joint's row is still not used (s)."""
    noise: Pair
    """Variance of the noise of both angles (rad²)."""


EYE = np.eye(LOADS)
"""Faster than making a diagonal matrix at each call."""
THIRD_DIFFERENCE = 20.0
"""1² + 3² + 3² + 1²: its variance over that of the angles' noise."""


class Found(NamedTuple):
    """What other parts need of the unknowns."""

    theta: tuple[Number, ...]
    """Base parameters of a pendulum: those found, or as near to them as the mass matrix allows."""
    model: Model
    """The plant to predict with, whose mass matrix is positive definite. Friction is never negative; the undriven
    joint's, and its load, are what the compensation leaves of them."""
    commanded_friction: Friction
    """Friction whose counterpart the motors are commanded."""
    commanded_load: Load | None
    """Load that the motors are commanded to carry; None where no load is expected."""
    residual_base: tuple[Number, ...]
    """θ for policy and regulator: with the friction that the compensation leaves."""
    offsets: Pair
    """How much the measured angles are too large (rad)."""


def begin(maths: ArrayOps, loop: Loop) -> IdentifierState:
    """Nothing seen yet."""
    xp, past = maths.xp, commands(loop.period, loop.max_delay_steps)
    zero = xp.zeros(())
    first, second = (zero + _deviation(loop, joint) ** 2 for joint in (0, 1))
    return IdentifierState(
        angles=xp.zeros((2 * row_span(loop.period) + 1, 2)),
        torques=xp.zeros((past, 2)),
        steps=xp.full(past, loop.period),
        calls=xp.array(0),
        delay_steps=xp.array(0),
        missed=xp.zeros(max(loop.max_delay_steps, 1) + 1),
        age=xp.array(0),
        filtered=(xp.zeros((2, len(loop.mean) + 1)),) * POLES,
        unknowns=xp.array(loop.mean),
        covariance=xp.array(loop.covariance),
        variance=(first, second),
        held=(zero, zero),
        noise=(zero, zero),
    )


def restart(maths: ArrayOps, loop: Loop, state: IdentifierState) -> IdentifierState:
    """After a pause: what was found stays, the motion before is forgotten."""
    xp = maths.xp
    return state._replace(
        torques=xp.zeros_like(state.torques),
        steps=xp.full_like(state.steps, loop.period),
        calls=0 * state.calls,
        filtered=(xp.zeros_like(state.filtered[0]),) * POLES,
    )


def remember(maths: ArrayOps, state: IdentifierState, u: Array) -> IdentifierState:
    """Note the torques (2,) that both motors were asked for, the driven one within its limit (N m)."""
    return state._replace(torques=maths.xp.concatenate([u[None], state.torques[:-1]]))


def interval(maths: ArrayOps, state: IdentifierState, step: Number) -> Number:
    """Time from when the last measured angles are observed to these, ``step`` after the last call (s)."""
    return maths.choose(state.age > 0, lambda: maths.number(state.steps[state.age - 1]), step)


def elapsed(maths: ArrayOps, state: IdentifierState, step: Number) -> Number:
    """Time since the angles of this call, not yet observed, were those of the plant (s)."""
    before = (maths.xp.arange(len(state.steps)) < state.age - 1) @ state.steps
    return maths.where(state.age > 0, step, 0.0) + maths.number(before)


def observe(
    maths: ArrayOps, loop: Loop, state: IdentifierState, q: Array, delay_steps: Number, step: Number
) -> IdentifierState:
    """Learn from measured angles.

    Angles q (2,) (rad) count without whole turns. They are so many steps old. The step since the last call (s)
    means nothing after a restart.
    """
    xp, dt, before, first = maths.xp, loop.period, state, state.calls == 0
    newest = state.angles[0] + maths.nearest(q - state.angles[0])
    angles = xp.concatenate([newest[None], state.angles[:-1]])
    # The time before the first call means nothing, and a step of 0 would make infinite rates.
    step = maths.where(first, dt, maths.maximum(step, SHORTEST_STEP * dt))
    steps = xp.concatenate([maths.vector([step]), state.steps[:-1]])
    missed, age = _age(maths, state, angles, steps)
    delay_steps = maths.maximum(delay_steps, age)

    def shifted() -> tuple[Array, tuple[Array, ...]]:
        # The lag counts from the delay: their sum is what was found. The old columns belong to the old delay.
        k = xp.arange(len(steps))
        earlier, later = (k < state.delay_steps).astype(steps.dtype), (k < delay_steps).astype(steps.dtype)
        unknowns = state.unknowns + (xp.arange(len(loop.mean)) == LAG) * ((earlier - later) @ steps)
        return unknowns, (xp.zeros_like(state.filtered[0]),) * POLES

    changed = (delay_steps != state.delay_steps) | (age != state.age)
    unknowns, filtered = maths.choose(changed, shifted, (state.unknowns, state.filtered))
    calls = state.calls + 1
    state = state._replace(
        angles=maths.choose(first, lambda: xp.broadcast_to(q, angles.shape), angles),
        steps=steps,
        # Bounded, since a run may last for days, and more is not asked for.
        calls=maths.minimum(calls, len(angles) + len(state.torques)),
        delay_steps=delay_steps,
        missed=missed,
        age=age,
        unknowns=unknowns,
        filtered=filtered,
    )
    learned = _learn(maths, loop, state)
    # The torques before a restart are not known.
    full = calls >= len(angles) + delay_steps
    finite = maths.finite(learned.unknowns) & maths.finite(learned.covariance)
    state = maths.choose(full & finite, lambda: learned, state)
    # A huge angle would stay in the differences; NaN fails the comparison.
    far1, far2 = maths.numbers(abs(q))
    near = (far1 < LARGEST_ANGLE) & (far2 < LARGEST_ANGLE)
    return maths.choose(xp.logical_not(near), lambda: restart(maths, loop, before), state)


def found(maths: ArrayOps, loop: Loop, state: IdentifierState) -> Found:
    """What other parts need of the unknowns."""
    x = maths.numbers(state.unknowns)
    nominal = maths.numbers(maths.xp.asarray(loop.mean[:BASE], state.unknowns.dtype))
    share = feasible_fraction(x, nominal, loop.geometry, LEAST_MASS_SHARE, maths.minimum, maths.root)
    theta = tuple(n + share * (one - n) for one, n in zip(x[:BASE], nominal, strict=True))
    known = x[GAIN], loop.joint, loop.passive_limit, maths.maximum
    commanded, residual, predicted = compensation(friction_of(theta), *known)
    commanded_load = load = None
    if len(x) > UNKNOWNS:
        commanded_load, _, load = compensation(Load(x[UNKNOWNS : UNKNOWNS + 2], x[UNKNOWNS + 2 :]), *known)
    return Found(
        theta=theta,
        model=Model(lumped(theta, loop.geometry), predicted, load),
        commanded_friction=commanded,
        commanded_load=commanded_load,
        residual_base=(*theta[:4], *residual.damping, *residual.coulomb, theta[8]),
        offsets=offsets(x[TILT1], x[TILT2], theta, maths.clip),
    )


def _deviation(loop: Loop, joint: int) -> float:
    """The first one of what a joint's row leaves unexplained (N m)."""
    return DRIVEN_DEVIATION if joint == loop.joint else PASSIVE_DEVIATION


def _age(maths: ArrayOps, state: IdentifierState, angles: Array, steps: Array) -> tuple[Array, Number]:
    """Weigh the ages of the angles: a longer step shows as a longer way in the same call, or in a later one."""
    xp, whole, ages = maths.xp, len(state.angles) - 1, len(state.missed)
    rate1, rate2 = maths.numbers((angles[0] - angles[whole]) / steps[:whole].sum())
    bend1, bend2 = maths.numbers(angles[0] - 2 * angles[1] + angles[2])
    # A constant rate bends the path by what one step is longer than the one before.
    longer = steps[:ages] - steps[1 : ages + 1]
    now = xp.log1p(((bend1 - rate1 * longer) ** 2 + (bend2 - rate2 * longer) ** 2) / UNEVEN_STEP**2)
    missed = UNEVEN_FADING * state.missed + maths.where(state.calls > whole, now, 0.0)
    likely = xp.argmin(missed).astype(state.age.dtype)
    # Not at once: each change of the age empties the low-passes.
    surer = missed[state.age] - missed[likely] > AGE_CAUTION
    return missed, maths.where(surer, likely, state.age)


def _learn(maths: ArrayOps, loop: Loop, state: IdentifierState) -> IdentifierState:
    """The low-passes, both rows, and the drift."""
    steps = maths.window(state.steps, state.age, len(state.angles) - 1)
    # The loop's own period: a call that comes late now and then must not change the low-passes or the rows.
    step = maths.number(steps.min())
    stages, weight = [_rows(maths, loop, state, steps, step)], -maths.expm1(-BANDWIDTH * step)
    for stage in state.filtered:
        stages.append(stage + weight * (stages[-1] - stage))
    state = state._replace(filtered=tuple(stages[1:]), noise=_noise(maths, loop, state, step))
    for joint in (0, 1):
        state = _update(maths, loop, joint, stages[-1][joint], state, step)
    covariance = state.covariance
    prior_variance = maths.xp.asarray(loop.covariance, covariance.dtype).diagonal()
    # Friction changes and offsets shift: without a drift old motion would outweigh all that comes. No less sure
    # than at the start: the drift must not exceed the prior.
    drift = DRIFT**2 * step * prior_variance * (covariance.diagonal() < prior_variance)
    diagonal = maths.xp.asarray(EYE[: len(covariance), : len(covariance)], covariance.dtype) * drift
    return state._replace(covariance=covariance + diagonal)


def _noise(maths: ArrayOps, loop: Loop, state: IdentifierState, step: Number) -> Pair:
    """Variance of both angles' noise (rad²)."""
    newest, second, third, last = (maths.numbers(state.angles[place]) for place in range(4))
    steps = maths.window(state.steps, state.age, 3)
    # An uneven step shows in the differences like noise.
    even = steps.max() - steps.min() < EVEN_STEPS * loop.period
    follow = maths.where(even, -maths.expm1(-step / NOISE_TIME), 0.0)
    found = []
    for variance, a, b, c, d in zip(state.noise, newest, second, third, last, strict=True):
        difference = a - d - 3.0 * (b - c)
        seen = maths.minimum(difference * difference / THIRD_DIFFERENCE, MOST_NOISE**2)
        found.append(variance + follow * (seen - variance))
    return found[0], found[1]


def _spoilt(maths: ArrayOps, loop: Loop, joint: int, state: IdentifierState, step: Number) -> Array:
    """D x (n,): what the noise of the angles takes from a joint's row in the mean."""
    x = maths.numbers(state.unknowns)
    _, cos2 = maths.sine_cosine(maths.number(state.angles[0, 1]))
    m11, m12, m22 = mass_entries(lumped(x, loop.geometry), cos2)
    # What the low-passes leave of white noise grows with the step.
    s1, s2 = (loop.noise_gain * step / loop.period * each for each in state.noise)
    acceleration = (s1 * m11, s2 * m12) if joint == 0 else (s1 * m12, s2 * m22)
    row = inertial_row(joint, acceleration, cos2, loop.geometry)
    return maths.vector([*row, *[0.0 * s1] * (len(x) - BASE)])


def _rows(maths: ArrayOps, loop: Loop, state: IdentifierState, steps: Array, step: Number) -> Array:
    """The newest rows (2, n + 1) before the low-passes: a column for each of n unknowns, and u.

    They are of the last steps (s); ``step`` is the loop's period (s).
    """
    joint, most = loop.joint, row_span(loop.period)
    ages = maths.xp.concatenate([maths.xp.zeros(1, steps.dtype), maths.xp.cumsum(steps)])
    # A slower loop than the nominal one fills the time of a row with fewer steps.
    span = maths.place(maths.clip(most * loop.period / step, 1, most))
    oldest, middle, newest = (maths.numbers(state.angles[place]) for place in (2 * span, span, 0))
    # The torques of a row begin as old as its angles or older: what acted then was asked for before.
    acting = maths.window(state.torques, state.delay_steps, 2 * most)
    peak, whole = (maths.number(ages[place]) for place in (span, 2 * span))
    # ρ of the nominal plant (``plant/momentum.py``): with the unknowns' own the rows would not be linear.
    ratio = maths.xp.asarray(loop.mean[2] / loop.mean[3], steps.dtype)[()]
    shoulder, elbow = momentum_rows(oldest, middle, newest, (whole - peak, peak), loop.geometry, ratio, maths)
    mean, slope = hat_weights(maths.xp, steps, ages, peak, whole)
    torques, rates = maths.numbers(mean.dot(acting)), maths.numbers(slope.dot(acting))
    # A zero of this kind of number, since JAX stacks the rows.
    none = 0.0 * torques[joint]
    of_one = functools.partial(_with, (none, none))
    # What both joints' rows have of each unknown, in the unknowns' order; last the right side.
    table = [
        *zip(shoulder, elbow, strict=True),
        of_one(joint, rates[joint]),
        of_one(1 - joint, -torques[1 - joint]),
    ]
    if len(loop.mean) > UNKNOWNS:
        table += [of_one(0, none + 1.0), of_one(1, none + 1.0), of_one(0, middle[0]), of_one(1, middle[1])]
    first, second = zip(*table, of_one(joint, torques[joint]), strict=True)
    return maths.vector([*first, *second]).reshape(2, len(loop.mean) + 1)


def hat_weights(xp: Any, steps: Array, ages: Array, newer: Number, whole: Number) -> tuple[Array, Array]:
    """Weights (n,) of the last n torques, newest first: for the hat's mean, and for its mean rate (1/s).

    The torque is held over each step, and the hat is integrated over it. Durations of the steps (s) come newest
    first; ages (n + 1,) are the times from their ends to the newest. The hat's peak is as old as ``newer``, its
    beginning as ``whole``, which are two of the ages. Older torques have no weight.
    """
    hat = xp.maximum(xp.minimum(ages / newer, (whole - ages) / (whole - newer)), 0.0) / (0.5 * whole)
    return 0.5 * (hat[1:] + hat[:-1]) * steps, hat[1:] - hat[:-1]


def _update(
    maths: ArrayOps, loop: Loop, joint: int, columns: Array, state: IdentifierState, step: Number
) -> IdentifierState:
    """What a joint's row tells of the unknowns, and its noise: the errors' variance, and how long it is held."""
    driven, unknowns, covariance = joint == loop.joint, state.unknowns, state.covariance
    variance, held = state.variance[joint], state.held[joint]
    row, target, number = columns[:-1], maths.number(columns[-1]), maths.number
    # The method: for so few numbers the operator @ takes twice as long in NumPy.
    uncertain = covariance.dot(row)
    predictive_variance, error = number(row.dot(uncertain)), target - number(row.dot(unknowns))
    rough = RELATIVE_FLOOR * (abs(target) + number(abs(row[:4]).dot(abs(unknowns[:4]))))
    # A product, since a power of Python's floats raises OverflowError.
    floor = (DRIVEN_FLOOR if driven else PASSIVE_FLOOR) ** 2 + rough * rough
    r = maths.maximum(variance, floor)
    distance = error * error / (predictive_variance + r)
    held = maths.where(distance > GATE_SIGMAS**2, GATE_HOLD, held - step)
    student = maths.maximum(1.0, (STUDENT + distance) / (STUDENT + 1.0))
    heavy = r * maths.maximum(1.0, POLES / BANDWIDTH / step) * student
    # A row that is held is infinitely heavy.
    heavy = maths.where(held > 0, math.inf, heavy)
    gain = uncertain / (predictive_variance + heavy)
    covariance = covariance - gain[:, None] * uncertain
    unknowns = unknowns + gain * error + covariance.dot(_spoilt(maths, loop, joint, state, step)) / heavy
    # A spoilt angle must not blind the identifier for seconds.
    seen = maths.minimum(distance * r, (MOST_DEVIATION * _deviation(loop, joint)) ** 2)
    follow = -maths.expm1(-step / maths.where(seen > variance, RISE_TIME, FALL_TIME))
    return state._replace(
        unknowns=unknowns,
        covariance=covariance,
        variance=_with(state.variance, joint, variance + follow * (seen - variance)),
        held=_with(state.held, joint, maths.maximum(held, 0.0)),
    )


def _with(pair: Pair, joint: int, number: Number) -> Pair:
    """A pair with another number of one joint."""
    return (number, pair[1]) if joint == 0 else (pair[0], number)
