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
from typing import Any, NamedTuple

import numpy as np

from ...plant.base_parameters import BASE, feasible_fraction, friction_of, lumped
from ...plant.equations import ArrayOps, Friction, Number, Pair, mass_entries
from ...plant.momentum import inertial_row, momentum_rows
from . import settings as chosen
from .compensation import Load, Model, compensation
from .settings import LAG, LOADS, POLES, UNKNOWNS
from .state import Array, IdentifierState, Loop

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
    xp, past = maths.xp, chosen.commands(loop.period, loop.max_delay_steps)
    zero = xp.zeros(())
    first, second = (zero + _deviation(loop, joint) ** 2 for joint in (0, 1))
    return IdentifierState(
        angles=xp.zeros((2 * chosen.span(loop.period) + 1, 2)),
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
    step = maths.where(first, dt, maths.maximum(step, chosen.SHORTEST_STEP * dt))
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
    near = (far1 < chosen.LARGEST_ANGLE) & (far2 < chosen.LARGEST_ANGLE)
    return maths.choose(xp.logical_not(near), lambda: restart(maths, loop, before), state)


def found(maths: ArrayOps, loop: Loop, state: IdentifierState) -> Found:
    """What other parts need of the unknowns."""
    x = maths.numbers(state.unknowns)
    nominal = maths.numbers(maths.xp.asarray(loop.mean[:BASE], state.unknowns.dtype))
    share = feasible_fraction(x, nominal, loop.geometry, chosen.LEAST_MASS_SHARE, maths.minimum, maths.root)
    theta = tuple(n + share * (one - n) for one, n in zip(x[:BASE], nominal, strict=True))
    known = x[chosen.GAIN], loop.joint, loop.passive_limit, maths.maximum
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
        offsets=chosen.offsets(x[chosen.TILT1], x[chosen.TILT2], theta, maths.clip),
    )


def _deviation(loop: Loop, joint: int) -> float:
    """The first one of what a joint's row leaves unexplained (N m)."""
    return chosen.DRIVEN_DEVIATION if joint == loop.joint else chosen.PASSIVE_DEVIATION


def _age(maths: ArrayOps, state: IdentifierState, angles: Array, steps: Array) -> tuple[Array, Number]:
    """Weigh the ages of the angles: a longer step shows as a longer way in the same call, or in a later one."""
    xp, whole, ages = maths.xp, len(state.angles) - 1, len(state.missed)
    rate1, rate2 = maths.numbers((angles[0] - angles[whole]) / steps[:whole].sum())
    bend1, bend2 = maths.numbers(angles[0] - 2 * angles[1] + angles[2])
    # A constant rate bends the path by what one step is longer than the one before.
    longer = steps[:ages] - steps[1 : ages + 1]
    now = xp.log1p(((bend1 - rate1 * longer) ** 2 + (bend2 - rate2 * longer) ** 2) / chosen.UNEVEN_STEP**2)
    missed = chosen.UNEVEN_FADING * state.missed + maths.where(state.calls > whole, now, 0.0)
    likely = xp.argmin(missed).astype(state.age.dtype)
    # Not at once: each change of the age empties the low-passes.
    surer = missed[state.age] - missed[likely] > chosen.AGE_CAUTION
    return missed, maths.where(surer, likely, state.age)


def _learn(maths: ArrayOps, loop: Loop, state: IdentifierState) -> IdentifierState:
    """The low-passes, both rows, and the drift."""
    steps = maths.window(state.steps, state.age, len(state.angles) - 1)
    # The loop's own period: a call that comes late now and then must not change the low-passes or the rows.
    step = maths.number(steps.min())
    stages, weight = [_rows(maths, loop, state, steps, step)], -maths.expm1(-chosen.BANDWIDTH * step)
    for stage in state.filtered:
        stages.append(stage + weight * (stages[-1] - stage))
    state = state._replace(filtered=tuple(stages[1:]), noise=_noise(maths, loop, state, step))
    for joint in (0, 1):
        state = _update(maths, loop, joint, stages[-1][joint], state, step)
    covariance = state.covariance
    prior_variance = maths.xp.asarray(loop.covariance, covariance.dtype).diagonal()
    # Friction changes and offsets shift: without a drift old motion would outweigh all that comes. No less sure
    # than at the start: the drift must not exceed the prior.
    drift = chosen.DRIFT**2 * step * prior_variance * (covariance.diagonal() < prior_variance)
    diagonal = maths.xp.asarray(EYE[: len(covariance), : len(covariance)], covariance.dtype) * drift
    return state._replace(covariance=covariance + diagonal)


def _noise(maths: ArrayOps, loop: Loop, state: IdentifierState, step: Number) -> Pair:
    """Variance of both angles' noise (rad²)."""
    newest, second, third, last = (maths.numbers(state.angles[place]) for place in range(4))
    steps = maths.window(state.steps, state.age, 3)
    # An uneven step shows in the differences like noise.
    even = steps.max() - steps.min() < chosen.EVEN_STEPS * loop.period
    follow = maths.where(even, -maths.expm1(-step / chosen.NOISE_TIME), 0.0)
    found = []
    for variance, a, b, c, d in zip(state.noise, newest, second, third, last, strict=True):
        difference = a - d - 3.0 * (b - c)
        seen = maths.minimum(difference * difference / THIRD_DIFFERENCE, chosen.MOST_NOISE**2)
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
    joint, most = loop.joint, chosen.span(loop.period)
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
    rough = chosen.RELATIVE_FLOOR * (abs(target) + number(abs(row[:4]).dot(abs(unknowns[:4]))))
    # A product, since a power of Python's floats raises OverflowError.
    floor = (chosen.DRIVEN_FLOOR if driven else chosen.PASSIVE_FLOOR) ** 2 + rough * rough
    r = maths.maximum(variance, floor)
    distance = error * error / (predictive_variance + r)
    held = maths.where(distance > chosen.GATE_SIGMAS**2, chosen.GATE_HOLD, held - step)
    student = maths.maximum(1.0, (chosen.STUDENT + distance) / (chosen.STUDENT + 1.0))
    heavy = r * maths.maximum(1.0, POLES / chosen.BANDWIDTH / step) * student
    # A row that is held is infinitely heavy.
    heavy = maths.where(held > 0, math.inf, heavy)
    gain = uncertain / (predictive_variance + heavy)
    covariance = covariance - gain[:, None] * uncertain
    unknowns = unknowns + gain * error + covariance.dot(_spoilt(maths, loop, joint, state, step)) / heavy
    # A spoilt angle must not blind the identifier for seconds.
    seen = maths.minimum(distance * r, (chosen.MOST_DEVIATION * _deviation(loop, joint)) ** 2)
    follow = -maths.expm1(-step / maths.where(seen > variance, chosen.RISE_TIME, chosen.FALL_TIME))
    return state._replace(
        unknowns=unknowns,
        covariance=covariance,
        variance=_with(state.variance, joint, variance + follow * (seen - variance)),
        held=_with(state.held, joint, maths.maximum(held, 0.0)),
    )


def _with(pair: Pair, joint: int, number: Number) -> Pair:
    """A pair with another number of one joint."""
    return (number, pair[1]) if joint == 0 else (pair[0], number)
