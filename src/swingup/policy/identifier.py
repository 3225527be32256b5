"""Online identification of the plant's base parameters: recursive least squares on rows of momentum.

At each measurement, with the rows Y of ``plant.momentum`` for the last angles and the torques of that time:

1. z ← (Y, u̇, -v, u) through three first-order low-passes of equal pole, all columns alike. Now
   Y (θ, κ) + u̇ λ - v γ = u holds for the low-passed columns: κ stands for the offsets of the angles, λ (s) is a lag
   of the torque beyond the known delay, v is the passive motor's command against its joint's friction, and γ the
   share of it that this motor delivers. u and u̇ are 0 in the passive joint's row, v is 0 in the driven one's. Where
   loads are expected, the left side also has c + k q of the row's joint, at the middle angle.
2. For each joint's row φ, y, with the unknowns x = (θ, κ, λ, γ), their covariance P, and the variance r of the
   residuals, with a floor f and a bound b:

       e = y - φᵀ x,   s = φᵀ P φ,   r' = max(r, f),   d² = e² / (s + r'),
       k = P φ / (s + n r' w),   w = max(1, (ν + d²)/(ν + 1)),   x ← x + k e,   P ← P - k (P φ)ᵀ,
       r ← r + a (min(d² r', b) - r),   a = 1 - exp(-h/T), T = rise if r grows, fall if not;

   h is the shortest step of the row's time, the loop's own period. n counts the neighbouring rows whose errors are
   alike. w is the inverse of Student's weight. A row with d above the gate shows a push: this row and the rows for
   a while after it change r alone.
3. Noise of the angles, of variance σ², biases φ φᵀ, and least squares find too little inertia. In both low-passed
   accelerations the noise has the variances s = c σ², which add D = s1 j1 j1ᵀ + s2 j2 j2ᵀ to φ φᵀ in the mean, with
   j the derivatives of φ by the accelerations. The bias is taken back:

       x ← x + P D x / (n r' w).

   c grows with the period. σ² follows δ²/20, up to a bound, where the last three steps are even: the third
   differences δ of an angle show its noise and little of its motion.
4. P grows by a small drift. There is no forgetting: what is not excited stays as sure as it was.

A robot's loop may hand over the angles of an earlier call: so many calls ago is their age. Where the times between
calls are uneven, the motion from angle to angle shows to which calls the angles belong; where they are even, it
does not matter. The torques of a row begin as many calls ago as the delay, or the age if that is longer. If either
changes, the lag changes by the opposite time, since their sum was identified, and the low-passes start again.

Learning starts once the rows' angles and torques are known since the first call or the last pause. Numbers that are
not finite after a call, and angles beyond 1e6 rad, change nothing. Other parts get θ0 + ς (θ - θ0) with the maximal
ς in [0, 1] for which the mass matrix is at least ``MIN_MASS_SHARE`` times that of the nominal θ0.

The driven motor delivers its command: the estimator counts that torque, and the policy sees the other friction. The
passive joint's motor may be weak or dead: its torque belongs to the plant, and γ is identified.

The driven motor's torque does not enter the passive joint's row. That row alone gives its part of θ up to scale,
and noise of the motor and pushes on the driven joint do not enter it; the driven joint's row adds the scale.
Measured rates are not used: their noise costs nothing. Sources: filtered regression, Slotine and Li (Applied
Nonlinear Control, 9.2); compensated bias, Sagara and Wada (International Journal of Control 25, 1977); recursive
least squares with a variance that adapts to innovations, Mehra (IEEE Transactions on Automatic Control 15, 1970).
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

UNKNOWNS = BASE + 4  # The base parameters, and behind them the unknowns whose indices follow
TILT1, TILT2 = BASE, BASE + 1
"""κ1 = k o1 and κ2 = m2 r2 (o1 + o2) (kg m), for measured angles that are o1 and o2 (rad) too large."""
LAG = BASE + 2  # λ: the torque's lag (s) beyond the delay that the estimator found
GAIN = BASE + 3  # γ: share of its command that the passive joint's motor delivers
LOADS = UNKNOWNS + 4
"""Unknowns where loads are expected: constant torques against both joints (N m) and springs (N m/rad) come last."""

SPAN_TIME = 0.008  # Time between the three angles of a row (s): rates resolve the encoder's step over it
BANDWIDTH = 60.0
"""Bandwidth of each pole of the low-pass on both sides of the equation (rad/s). Rows within its rise time have
similar errors and count as one."""
POLES = 3  # First-order low-passes in a row: second differences of an encoder's steps need three
PASSIVE_DEVIATION, PASSIVE_FLOOR = 0.012, 0.005
"""Initial and minimum standard deviation of the passive joint's low-passed residual (N m)."""
DRIVEN_DEVIATION, DRIVEN_FLOOR = 0.04, 0.01  # The same for the driven joint, whose motor is noisy and is pushed
RELATIVE_FLOOR = 0.002
"""Part of a floor that grows with the size of a row's terms: errors of the discretisation."""
MAX_DEVIATION = 10.0  # Maximum standard deviation of the residuals, as a multiple of the initial one
RISE_TIME, FALL_TIME = 0.02, 0.1  # Times in which the deviation follows larger residuals and smaller ones (s)
GATE_SIGMAS = 3.0  # A residual of more than this many of its standard deviations is a push
GATE_TIME = 0.1  # Time after a push in which the joint's row is not used (s)
FREEDOM = 4.0  # ν: degrees of freedom of Student's distribution of the errors
LAG_DEVIATION = 0.01  # Prior standard deviation of the torque's lag (s)
OFFSET_DEVIATION = 0.03  # Prior standard deviation of the angles' offsets (rad)
GAIN_DEVIATION = 0.5  # Prior standard deviation of the passive motor's delivered share; its mean is 1
DRIFT = 0.01  # Drift of the unknowns, in prior standard deviations after 1 s
MIN_MASS_SHARE = 0.2
"""The identified mass matrix is at least this share of the nominal one, in every configuration."""
MAX_OFFSET = 0.1  # Maximum offset of an angle that is believed (rad)
MAX_ANGLE = 1e6  # An angle beyond this is not a measurement (rad): its digits do not resolve the turn
UNEVEN_ANGLE = 1e-3  # Unit (rad) of the errors by which a call's motion contradicts an age of the angles
AGE_FADING = 0.9995  # Factor on the evidence against each age, at each call
AGE_MARGIN = 4.0  # Evidence by which another age must be more likely before it is believed
NOISE_TIME = 0.05  # Time in which the noise of the angles is followed (s)
MAX_NOISE = 1e-3  # Maximum standard deviation of an angle's noise (rad)
EVEN_TOLERANCE = 0.1  # Steps that differ by less, in periods, are even: the noise shows in them
MAX_STEP = 4.0
"""A call that comes more than this many periods after the last one restarts estimator and identifier."""
MIN_STEP = 0.6
"""A call that comes sooner, in periods, keeps the torques: rates would show nothing but the encoder's step."""
MIN_GAIN = 0.6  # Lower bound on the delivered share that the passive motor's command is divided by

Array = Any  # An array of NumPy or JAX; shapes are in the comments


@dataclass(frozen=True)
class IdentifierSettings(Settings):
    """What a robot's owner may choose of the identifier; period and delays are the estimator's."""

    PART: ClassVar[str] = "identifier"
    passive_limit: Annotated[float, Range(0.0, 1e3), TORQUE] = 0.5
    """Maximum torque that compensates the passive joint's friction and load (N m); 0 for none."""
    load_deviation: Annotated[float, Range(0.0, 1e3), TORQUE] = 0.0
    """Standard deviation of a constant torque against each joint (N m)."""
    spring_deviation: Annotated[float, Range(0.0, 1e3), TORQUE] = 0.0
    """Standard deviation of the stiffness of a spring or cable at each joint, relaxed at 0 (N m/rad)."""


def row_span(period: float) -> int:
    """Steps between the three angles of a row, at a period between calls (s)."""
    return max(2, round(SPAN_TIME / period))


def command_count(period: float, max_delay_steps: int) -> int:
    """Commands to remember. Angles may be a call old whatever the maximum delay is."""
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
    # κ2 belongs to the angle of link 2 in space, to which both offsets add.
    both = clip(tilt2 / theta[2], -MAX_OFFSET, MAX_OFFSET)
    first = clip(tilt1 / theta[3], -MAX_OFFSET, MAX_OFFSET)
    return first, both - first


class JointLoads(NamedTuple):
    """Torques c + k q against both joints, of cables or springs: c (N m), k (N m/rad)."""

    constant: Pair
    spring: Pair

    def at(self, q1: Any, q2: Any) -> Pair:
        """The torques (N m) at angles (rad)."""
        return self.constant[0] + self.spring[0] * q1, self.constant[1] + self.spring[1] * q2


class PredictionModel(NamedTuple):
    """The plant that the estimator predicts with; None for no friction, or for no loads."""

    plant: Lumped
    friction: Friction | None
    loads: JointLoads | None


class Compensation(NamedTuple):
    """Parts of a :class:`Friction` or of :class:`JointLoads`."""

    commanded: Any  # What the motors are commanded; never negative friction
    residual: Any  # What remains; negative friction is not compensated
    predicted: Any
    """What to predict with: all of the driven joint's, whose torque is counted, and what remains of the other's.
    Negative friction counts as zero: the implicit step near rest would be singular with it."""


def compensation(identified: Any, gain: Number, joint: int, passive_limit: float, maximum: Any) -> Compensation:
    """Share out the identified friction or loads between the motors and the plant, in any kind of number.

    The gain is the share of its command that the passive joint's motor delivers, in units of what the driven one
    does. Its compensation is at most ``passive_limit`` (N m), 0 for none.
    """
    kind, delivered = type(identified), maximum(gain, 0.0)
    # A weak motor's command must not grow without bound: what it does not deliver stays in the plant.
    factor = 1.0 / maximum(delivered, MIN_GAIN) if passive_limit else 0.0
    parts = []
    for values in identified:
        commanded, residual, predicted = [], [], []
        for index, value in enumerate(values):
            # The gain counts in units of the driven motor's, whose own is 1 therefore.
            share, part = (1.0, 1.0) if index == joint else (factor, delivered)
            commanded.append(share * (maximum(value, 0.0) if kind is Friction else value))
            residual.append(value - part * commanded[index])
            # The estimator adds the driven motor's whole command, so that its model must hold the whole friction.
            modelled = value if index == joint else residual[index]
            predicted.append(maximum(modelled, 0.0) if kind is Friction else modelled)
        parts.append((tuple(commanded), tuple(residual), tuple(predicted)))
    return Compensation(*(kind(*pairs) for pairs in zip(*parts, strict=True)))


class IdentifierConstants(NamedTuple):
    """Constants of the identifier, derived from plant and settings, in C.1's units."""

    joint: int  # index of the driven joint
    period: float  # nominal time between calls (s)
    max_delay_steps: int  # maximum delay that the estimator may find (steps)
    passive_limit: float  # maximum torque that compensates the passive joint's friction (N m); 0 for none
    geometry: Geometry  # known lengths and gears of the plant
    mean: Array  # prior mean (n,): θ of the nominal plant, no offsets, no lag, a gain of 1, no loads
    covariance: Array  # prior covariance (n, n)
    noise_gain: float  # variance of a low-passed row's accelerations over that of the angles' noise (1/s⁴)


def identifier_constants(
    plant: Plant, joint: int, period: float, max_delay_steps: int, settings: IdentifierSettings
) -> IdentifierConstants:
    """Constants for a plant and its loop, whose period (s) and maximum delay (steps) are the estimator's."""
    derived = geometry_of(plant), *prior(plant, settings), noise_gain(period)
    return IdentifierConstants(joint, period, max_delay_steps, settings.passive_limit, *derived)


class IdentifierState(NamedTuple):
    """What is remembered from call to call."""

    angles: Array  # measured angles (depth, 2) without jumps of full turns, newest first (rad)
    torques: Array  # commanded torques (past, 2), newest first (N m)
    steps: Array  # time for which each torque was held (past,) (s)
    calls: Number  # measurements since the last restart
    delay_steps: Number  # the estimator's last delay (steps), or ``age`` where that is more
    age_evidence: Array  # evidence (ages,) against each age of the angles, from 0 on
    age: Number  # the angles' age (calls)
    filtered: tuple[Array, ...]  # of the low-passes: rows (2, n + 1) of both joints, a column an unknown, then u
    unknowns: Array  # θ, κ1 and κ2 (kg m), the lag (s), the passive motor's gain, and loads (n,)
    covariance: Array  # (n, n)
    variance: Pair  # of each joint's residuals (N² m²)
    gate: Pair  # time for which each joint's row is still not used (s)
    noise: Pair  # variance of the noise of both angles (rad²)


class IdentifiedPlant(NamedTuple):
    """What other parts need of the unknowns."""

    theta: tuple[Number, ...]
    """Base parameters of a pendulum: the identified ones, or as near to them as the mass matrix allows."""
    model: PredictionModel
    """The plant to predict with, whose mass matrix is positive definite. Friction is never negative; the passive
    joint's, and its loads, are what the compensation leaves of them."""
    commanded_friction: Friction  # Friction whose counterpart the motors are commanded
    commanded_loads: JointLoads | None
    """Loads that the motors are commanded to carry; None where no load is expected."""
    residual_base: tuple[Number, ...]
    """θ for policy and regulator: with the friction that the compensation leaves."""
    offsets: Pair  # How much the measured angles are too large (rad)


EYE = np.eye(LOADS)  # Faster than making a diagonal matrix at each call
THIRD_DIFFERENCE = 20.0  # 1² + 3² + 3² + 1²: its variance over that of the angles' noise


def begin(ops: ArrayOps, constants: IdentifierConstants) -> IdentifierState:
    """The state before the first call: the prior."""
    xp, past = ops.xp, command_count(constants.period, constants.max_delay_steps)
    zero = xp.zeros(())
    first, second = (zero + _initial_deviation(constants, joint) ** 2 for joint in (0, 1))
    return IdentifierState(
        angles=xp.zeros((2 * row_span(constants.period) + 1, 2)),
        torques=xp.zeros((past, 2)),
        steps=xp.full(past, constants.period),
        calls=xp.array(0),
        delay_steps=xp.array(0),
        age_evidence=xp.zeros(max(constants.max_delay_steps, 1) + 1),
        age=xp.array(0),
        filtered=(xp.zeros((2, len(constants.mean) + 1)),) * POLES,
        unknowns=xp.array(constants.mean),
        covariance=xp.array(constants.covariance),
        variance=(first, second),
        gate=(zero, zero),
        noise=(zero, zero),
    )


def restart(ops: ArrayOps, constants: IdentifierConstants, state: IdentifierState) -> IdentifierState:
    """After a pause: the unknowns stay, the motion before is forgotten."""
    xp = ops.xp
    return state._replace(
        torques=xp.zeros_like(state.torques),
        steps=xp.full_like(state.steps, constants.period),
        calls=0 * state.calls,
        filtered=(xp.zeros_like(state.filtered[0]),) * POLES,
    )


def remember(ops: ArrayOps, state: IdentifierState, u: Array) -> IdentifierState:
    """Note the torques (2,) that both motors were commanded, the driven one within its limit (N m)."""
    return state._replace(torques=ops.xp.concatenate([u[None], state.torques[:-1]]))


def interval(ops: ArrayOps, state: IdentifierState, step: Number) -> Number:
    """Time between the last measured angles and those of this call, ``step`` after the last one (s)."""
    return ops.choose(state.age > 0, lambda: ops.number(state.steps[state.age - 1]), step)


def elapsed(ops: ArrayOps, state: IdentifierState, step: Number) -> Number:
    """Time since the angles of this call, not yet observed, were the plant's (s)."""
    before = (ops.xp.arange(len(state.steps)) < state.age - 1) @ state.steps
    return ops.where(state.age > 0, step, 0.0) + ops.number(before)


def observe(
    ops: ArrayOps,
    constants: IdentifierConstants,
    state: IdentifierState,
    q: Array,
    delay_steps: Number,
    step: Number,
) -> IdentifierState:
    """One call: remember the angles, then learn from the rows that they complete.

    Angles q (2,) (rad) count without whole turns. They are ``delay_steps`` old. The step since the last call (s)
    means nothing after a restart.
    """
    recorded = _record(ops, constants, state, q, delay_steps, step)
    learned = _learn(ops, constants, recorded)
    # The torques before a restart are not known.
    complete = recorded.calls >= len(recorded.angles) + recorded.delay_steps
    finite = ops.finite(learned.unknowns) & ops.finite(learned.covariance)
    after = ops.choose(complete & finite, lambda: learned, recorded)
    # A huge angle would stay in the differences; NaN fails the comparison.
    q1, q2 = ops.numbers(abs(q))
    near = (q1 < MAX_ANGLE) & (q2 < MAX_ANGLE)
    return ops.choose(ops.xp.logical_not(near), lambda: restart(ops, constants, state), after)


def identified_plant(ops: ArrayOps, constants: IdentifierConstants, state: IdentifierState) -> IdentifiedPlant:
    """What other parts need of the unknowns."""
    x = ops.numbers(state.unknowns)
    nominal = ops.numbers(ops.xp.asarray(constants.mean[:BASE], state.unknowns.dtype))
    share = feasible_fraction(x, nominal, constants.geometry, MIN_MASS_SHARE, ops.minimum, ops.root)
    theta = tuple(n + share * (one - n) for one, n in zip(x[:BASE], nominal, strict=True))
    motors = x[GAIN], constants.joint, constants.passive_limit, ops.maximum
    commanded, residual, predicted = compensation(friction_of(theta), *motors)
    commanded_loads = loads = None
    if len(x) > UNKNOWNS:
        identified = JointLoads(x[UNKNOWNS : UNKNOWNS + 2], x[UNKNOWNS + 2 :])
        commanded_loads, _, loads = compensation(identified, *motors)
    return IdentifiedPlant(
        theta=theta,
        model=PredictionModel(lumped(theta, constants.geometry), predicted, loads),
        commanded_friction=commanded,
        commanded_loads=commanded_loads,
        residual_base=(*theta[:4], *residual.damping, *residual.coulomb, theta[8]),
        offsets=offsets(x[TILT1], x[TILT2], theta, ops.clip),
    )


def _initial_deviation(constants: IdentifierConstants, joint: int) -> float:
    """Initial standard deviation of a joint's residuals (N m)."""
    return DRIVEN_DEVIATION if joint == constants.joint else PASSIVE_DEVIATION


def _record(
    ops: ArrayOps,
    constants: IdentifierConstants,
    state: IdentifierState,
    q: Array,
    delay_steps: Number,
    step: Number,
) -> IdentifierState:
    """Remember the angles and the step, and follow delay and age."""
    xp, period, first = ops.xp, constants.period, state.calls == 0
    newest = state.angles[0] + ops.nearest(q - state.angles[0])
    angles = xp.concatenate([newest[None], state.angles[:-1]])
    # The time before the first call means nothing, and a step of 0 would make infinite rates.
    step = ops.where(first | (step <= 0.0), period, step)
    steps = xp.concatenate([ops.vector([step]), state.steps[:-1]])
    evidence, age = _follow_age(ops, state, angles, steps)
    delay_steps = ops.maximum(delay_steps, age)

    def shifted() -> tuple[Array, tuple[Array, ...]]:
        # The lag counts from the delay: their sum was identified. The old columns belong to the old delay.
        k = xp.arange(len(steps))
        before, now = (k < state.delay_steps).astype(steps.dtype), (k < delay_steps).astype(steps.dtype)
        unknowns = state.unknowns + (xp.arange(len(constants.mean)) == LAG) * ((before - now) @ steps)
        return unknowns, (xp.zeros_like(state.filtered[0]),) * POLES

    changed = (delay_steps != state.delay_steps) | (age != state.age)
    unknowns, filtered = ops.choose(changed, shifted, (state.unknowns, state.filtered))
    return state._replace(
        angles=ops.choose(first, lambda: xp.broadcast_to(q, angles.shape), angles),
        steps=steps,
        # Bounded, since a run may last for days: learning begins at fewer calls.
        calls=ops.minimum(state.calls + 1, len(angles) + len(state.torques)),
        delay_steps=delay_steps,
        age_evidence=evidence,
        age=age,
        unknowns=unknowns,
        filtered=filtered,
    )


def _follow_age(ops: ArrayOps, state: IdentifierState, angles: Array, steps: Array) -> tuple[Array, Number]:
    """Evidence against each age, and the age: a longer step shows as a longer way at once, or calls later."""
    xp, whole, ages = ops.xp, len(state.angles) - 1, len(state.age_evidence)
    rate1, rate2 = ops.numbers((angles[0] - angles[whole]) / steps[:whole].sum())
    bend1, bend2 = ops.numbers(angles[0] - 2 * angles[1] + angles[2])
    # At a constant rate the second difference of the angles is the rate times that of the steps' ends.
    longer = steps[:ages] - steps[1 : ages + 1]
    error = xp.log1p(((bend1 - rate1 * longer) ** 2 + (bend2 - rate2 * longer) ** 2) / UNEVEN_ANGLE**2)
    evidence = AGE_FADING * state.age_evidence + ops.where(state.calls > whole, error, 0.0)
    likely = xp.argmin(evidence).astype(state.age.dtype)
    # Not at once: each change of the age empties the low-passes.
    surer = evidence[state.age] - evidence[likely] > AGE_MARGIN
    return evidence, ops.where(surer, likely, state.age)


def _learn(ops: ArrayOps, constants: IdentifierConstants, state: IdentifierState) -> IdentifierState:
    """Low-pass the newest rows, update the unknowns by each joint's, and let them drift: steps 1 to 4."""
    steps = ops.window(state.steps, state.age, len(state.angles) - 1)
    # The loop's own period: a call that comes late now and then must not change the low-passes or the rows.
    step = ops.number(steps.min())
    stages, weight = [_rows(ops, constants, state, steps, step)], -ops.expm1(-BANDWIDTH * step)
    for stage in state.filtered:
        stages.append(stage + weight * (stages[-1] - stage))
    state = state._replace(filtered=tuple(stages[1:]), noise=_noise(ops, constants, state, step))
    for joint in (0, 1):
        state = _update(ops, constants, joint, stages[-1][joint], state, step)
    covariance = state.covariance
    prior_variance = ops.xp.asarray(constants.covariance, covariance.dtype).diagonal()
    # Friction changes and offsets shift: without a drift the old motion would outweigh the new one for ever. The
    # drift stops at the prior, which covers every plant that is expected.
    drift = DRIFT**2 * step * prior_variance * (covariance.diagonal() < prior_variance)
    diagonal = ops.xp.asarray(EYE[: len(covariance), : len(covariance)], covariance.dtype) * drift
    return state._replace(covariance=covariance + diagonal)


def _noise(ops: ArrayOps, constants: IdentifierConstants, state: IdentifierState, step: Number) -> Pair:
    """Variance of both angles' noise (rad²), from third differences."""
    newest, second, third, last = (ops.numbers(state.angles[place]) for place in range(4))
    steps = ops.window(state.steps, state.age, 3)
    # An uneven step shows in the differences like noise.
    even = steps.max() - steps.min() < EVEN_TOLERANCE * constants.period
    follow = ops.where(even, -ops.expm1(-step / NOISE_TIME), 0.0)
    variances = []
    for variance, a, b, c, d in zip(state.noise, newest, second, third, last, strict=True):
        difference = a - d - 3.0 * (b - c)
        estimate = ops.minimum(difference * difference / THIRD_DIFFERENCE, MAX_NOISE**2)
        variances.append(variance + follow * (estimate - variance))
    return variances[0], variances[1]


def _noise_bias(
    ops: ArrayOps, constants: IdentifierConstants, joint: int, state: IdentifierState, step: Number
) -> Array:
    """D x (n,): the bias of a joint's normal equations by the noise of the angles."""
    x = ops.numbers(state.unknowns)
    _, cos2 = ops.sine_cosine(ops.number(state.angles[0, 1]))
    m11, m12, m22 = mass_entries(lumped(x, constants.geometry), cos2)
    # What the low-passes leave of white noise grows with the step.
    s1, s2 = (constants.noise_gain * step / constants.period * each for each in state.noise)
    acceleration = (s1 * m11, s2 * m12) if joint == 0 else (s1 * m12, s2 * m22)
    row = inertial_row(joint, acceleration, cos2, constants.geometry)
    return ops.vector([*row, *[0.0 * s1] * (len(x) - BASE)])


def _rows(
    ops: ArrayOps, constants: IdentifierConstants, state: IdentifierState, steps: Array, step: Number
) -> Array:
    """The newest rows (2, n + 1) before the low-passes: a column for each of n unknowns, and u.

    They cover the last steps (s); ``step`` is the loop's period (s).
    """
    joint, max_span = constants.joint, row_span(constants.period)
    ages = ops.xp.concatenate([ops.xp.zeros(1, steps.dtype), ops.xp.cumsum(steps)])
    # A slower loop than the nominal one fills the time of a row with fewer steps.
    span = ops.place(ops.clip(max_span * constants.period / step, 1, max_span))
    oldest, middle, newest = (ops.numbers(state.angles[place]) for place in (2 * span, span, 0))
    # The torques of a row begin as old as its angles or older: what acted then was commanded before.
    acting = ops.window(state.torques, state.delay_steps, 2 * max_span)
    peak, whole = (ops.number(ages[place]) for place in (span, 2 * span))
    # ρ of the nominal plant (``plant/momentum.py``): with the unknowns' own the rows would not be linear.
    ratio = ops.xp.asarray(constants.mean[2] / constants.mean[3], steps.dtype)[()]
    times = whole - peak, peak
    shoulder, elbow = momentum_rows(oldest, middle, newest, times, constants.geometry, ratio, ops)
    mean, slope = hat_weights(ops.xp, steps, ages, peak, whole)
    torques, rates = ops.numbers(mean.dot(acting)), ops.numbers(slope.dot(acting))
    # A zero of this kind of number, since JAX stacks the rows.
    zero = 0.0 * torques[joint]
    only = functools.partial(_replaced, (zero, zero))
    # Each unknown's coefficients in both joints' rows, in the unknowns' order; last the right side.
    table = [*zip(shoulder, elbow, strict=True), only(joint, rates[joint]), only(1 - joint, -torques[1 - joint])]
    if len(constants.mean) > UNKNOWNS:
        table += [only(0, zero + 1.0), only(1, zero + 1.0), only(0, middle[0]), only(1, middle[1])]
    first, second = zip(*table, only(joint, torques[joint]), strict=True)
    return ops.vector([*first, *second]).reshape(2, len(constants.mean) + 1)


def hat_weights(xp: Any, steps: Array, ages: Array, newer: Number, whole: Number) -> tuple[Array, Array]:
    """Weights (n,) of the last n torques, newest first: for the hat's mean, and for its mean rate (1/s).

    The torque is held over each step, and the hat is integrated over it. Durations of the steps (s) come newest
    first; ages (n + 1,) are the times from their ends to the newest. The hat's peak is as old as ``newer``, its
    beginning as ``whole``, which are two of the ages. Older torques have no weight.
    """
    hat = xp.maximum(xp.minimum(ages / newer, (whole - ages) / (whole - newer)), 0.0) / (0.5 * whole)
    return 0.5 * (hat[1:] + hat[:-1]) * steps, hat[1:] - hat[:-1]


def _update(
    ops: ArrayOps, constants: IdentifierConstants, joint: int, columns: Array, state: IdentifierState, step: Number
) -> IdentifierState:
    """One recursive least-squares step by a joint's low-passed row, robust to pushes: steps 2 and 3."""
    driven, unknowns, covariance = joint == constants.joint, state.unknowns, state.covariance
    variance, gate = state.variance[joint], state.gate[joint]
    row, target, number = columns[:-1], ops.number(columns[-1]), ops.number
    # The method: for so few numbers the operator @ takes twice as long in NumPy.
    uncertain = covariance.dot(row)
    predictive_variance, error = number(row.dot(uncertain)), target - number(row.dot(unknowns))
    relative = RELATIVE_FLOOR * (abs(target) + number(abs(row[:4]).dot(abs(unknowns[:4]))))
    # A product, since a power of Python's floats raises OverflowError.
    floor = (DRIVEN_FLOOR if driven else PASSIVE_FLOOR) ** 2 + relative * relative
    r = ops.maximum(variance, floor)
    distance = error * error / (predictive_variance + r)
    gate = ops.where(distance > GATE_SIGMAS**2, GATE_TIME, gate - step)
    student = ops.maximum(1.0, (FREEDOM + distance) / (FREEDOM + 1.0))
    row_variance = r * ops.maximum(1.0, POLES / BANDWIDTH / step) * student
    # Behind the gate the row says nothing: its variance is infinite.
    row_variance = ops.where(gate > 0, math.inf, row_variance)
    gain = uncertain / (predictive_variance + row_variance)
    covariance = covariance - gain[:, None] * uncertain
    bias = covariance.dot(_noise_bias(ops, constants, joint, state, step)) / row_variance
    unknowns = unknowns + gain * error + bias
    # Bounded: one wrong angle must not blind the identifier for seconds.
    square = ops.minimum(distance * r, (MAX_DEVIATION * _initial_deviation(constants, joint)) ** 2)
    follow = -ops.expm1(-step / ops.where(square > variance, RISE_TIME, FALL_TIME))
    return state._replace(
        unknowns=unknowns,
        covariance=covariance,
        variance=_replaced(state.variance, joint, variance + follow * (square - variance)),
        gate=_replaced(state.gate, joint, ops.maximum(gate, 0.0)),
    )


def _replaced(pair: Pair, joint: int, number: Number) -> Pair:
    """A pair with another number of one joint."""
    return (number, pair[1]) if joint == 0 else (pair[0], number)
