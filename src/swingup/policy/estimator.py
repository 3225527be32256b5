"""A state estimator from the nominal model, the commanded torques and the measurements, in Python.

Encoders are good and velocities are noisy, on the real robots as in the robustness benchmark. A Kalman filter takes
velocities mostly from successive positions and the model. The loop may have a delay (an old measurement, a slow
motor): a bank of such filters, one for each delay, tells which explains the measured motion best, and the estimate
is carried ahead over that time with the torques that are still on their way.

It remembers the estimate x̂ of the *measured* state, which is as old as the delay; the commanded torques
u_0 ... u_N, u_0 the last one; for each delay n = 0 ... N a deviation d_n = (d_q, d_v) of its filter's estimate from
x̂, and evidence S_n; and the delay m. At each call with the measurement z, a time h after the last one (Δ if 0):

1. p = f(x̂, u_m, h) with one step f of the model; e = z - p, its angles to the nearest turn. The filters differ
   only in the torque, and accelerations are linear in the torque. A double integrator therefore carries the
   deviations on, with b = ∂q̈/∂u at x̂:

       a_n = (u_n - u_m) b,   d_q ← d_q + h d_v + ½ h² a_n,   d_v ← d_v + h a_n.

2. S_n ← exp(-Δ/T) S_n + log(1 + |e_q - d_q|²/s²). The new m is the n with the least S_n + c n, the smallest of
   equal ones, and none below the angles' own age.
3. d_n ← d_n - K d_n, x̂ ← p + K e + d_m, d_n ← d_n - d_m, with the Kalman gains K of ``settings.kalman_gains``.
4. The estimate restarts, x̂ ← z, all u_n and d_n ← 0, S and m as before the call, if there was no call before, if
   the last one was more than 4 Δ ago or is in the future, or if a rate of x̂ is not within 100 standard
   deviations of the measured one. The controller then sees z.
5. Otherwise it sees x̂ carried ahead by m steps, which last as long as those since the angles were measured, or h:
   four equal steps of the model, with the mean of the torques that act in each, as if commands were held from call
   to call; z if that is not finite.

A z that is not finite, or repeats all digits of the last finite one with a velocity other than 0, shows nothing
new. In such a gap of at most ``longest_gap`` the model stands in: e = 0 and K = 0, S stays, no measured rate
restarts the estimate, and the identifier begins its motion anew.

With an identifier z is the measurement less the offsets found, the model is the plant found before this call, and h
is the time between the angles where they are some calls old. The identifier is shown the measured angles last. The
friction and the load that it found are compensated on both joints, b q̇ + c arctan(100 q̇) + c' + k q at the state
seen, the undriven joint's within its limit; both torques are NaN if the state seen is not finite.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from ..common.riccati import solve_riccati
from ..common.settings import Range, Settings
from ..plant import equations
from ..plant.equations import ArrayOps, Number, Pair, damped_midpoint_step, friction
from ..plant.plant import Plant, lump
from ..plant.units import ACCELERATION, C1, TIME, VELOCITY, arm_scales, scaled, similar_plant
from . import identifier
from .identifier import LONGEST_STEP, Array, Found, IdentifierSettings, IdentifierState, Model
from .identifier import Loop as IdentifierLoop
from .identifier import make_loop as identifier_loop

POSITION_NOISE = 1e-4
"""Standard deviation of the measured angles (rad): that of an encoder of 2^14 counts is 1.1e-4."""


@dataclass(frozen=True)
class EstimatorSettings(Settings):
    """What the estimator expects of the measurement and of the loop; every value is chosen, not identified.

    The defaults suit design C.1; :func:`default_estimator` scales them to another plant.
    """

    PART: ClassVar[str] = "estimator"
    dt: Annotated[float, Range(1e-6, 0.1)] = 0.002
    """Time between calls (s). After a pause of over four of them the estimator restarts from the measurement."""
    velocity_noise: Annotated[float, Range(1e-6, 1e3), VELOCITY] = 0.25
    """Standard deviation of the measured velocities (rad/s)."""
    acceleration_noise: Annotated[float, Range(1e-6, 1e3), ACCELERATION] = 50.0
    """Standard deviation of what the model does not know of the accelerations (rad/s²)."""
    max_delay_steps: Annotated[int, Range(0, 1000)] = 25
    """Longest delay of the loop that is considered (steps)."""
    longest_gap: Annotated[float, Range(0.0, 1e3)] = 0.05
    """Longest time for which the model stands in for a measurement that shows nothing new (s)."""


def default_estimator(plant: Plant) -> EstimatorSettings:
    """The defaults in a plant's own units: noise of velocities and accelerations; encoder and loop stay."""
    return scaled(EstimatorSettings(), arm_scales(plant))


def kalman_gains(settings: EstimatorSettings) -> np.ndarray:
    """Steady-state Kalman gains (2, 2) of one joint: a double integrator whose acceleration is unsure.

    K = P (P + R)⁻¹ with the solution P of P = A (P - K P) Aᵀ + Q, the covariance of a prediction. It is found for
    any noise by doubling: step k gives P after 2^k measurements.
    """
    dt = settings.dt
    # In units of the measured noise, so that R = I.
    scale = np.array([POSITION_NOISE, settings.velocity_noise])
    A = (np.array([[1.0, dt], [0.0, 1.0]]) * scale / scale[:, None]).T
    into = settings.acceleration_noise * np.array([0.5 * dt**2, dt]) / scale
    P = solve_riccati(A, np.eye(2), np.outer(into, into))
    return scale[:, None] * (P @ np.linalg.inv(P + np.eye(2))) / scale


RESET_SIGMAS = 100
"""An estimate restarts where its rate is this many standard deviations off the measured one: that has jumped."""
PREDICTION_STEPS = 4
"""Steps in which the estimate is carried ahead over the delay."""
PIECES = np.arange(PREDICTION_STEPS, -1.0, -1.0)[:, None]
"""Ends of the pieces in which the estimate is carried ahead, in pieces before now (5, 1)."""
OUTLIER_SCALE = 1e-4
"""s: far larger errors of a predicted angle count little more (rad); a push must not decide the delay."""
DELAY_PENALTY = 20.0
"""c: log likelihood that a delay must gain for each step that it is longer."""
EVIDENCE_TIME = 5.0
"""T: time in which evidence on the delay fades (s)."""


class Loop(NamedTuple):
    """What an estimator knows of its loop."""

    settings: EstimatorSettings
    joint: int
    """Index of the driven joint."""
    model: Model
    """The nominal plant."""
    delays: np.ndarray
    """0 to the longest one (steps)."""
    gains: tuple[float, ...]
    """Kalman gains of a joint, row by row: from the misses of its angle and its rate to corrections of both."""
    finding: IdentifierLoop | None = None
    """Identifies the plant; None for the nominal model."""
    time_unit: float = 1.0
    """Unit of all other times (s); calls come with their time in seconds."""


def make_loop(
    settings: EstimatorSettings, plant: Plant, joint: int, finding: IdentifierSettings | None = None
) -> Loop:
    """What an estimator knows of a plant's loop, in C.1's units.

    The plant is the nominal one. With settings of an identifier, ``finding``, the model is what that finds.
    """
    scales, identifies = arm_scales(plant), None
    own, plant = C1.over(scales), similar_plant(plant, scales)
    times = {name: scales.similar(getattr(settings, name), TIME) for name in ("dt", "longest_gap")}
    s = replace(scaled(settings, own), **times)
    if finding is not None:
        identifies = identifier_loop(plant, joint, s.dt, s.max_delay_steps, scaled(finding, own))
    delays, model = np.arange(s.max_delay_steps + 1.0), Model(lump(plant), plant.friction, None)
    gains = tuple(kalman_gains(s).ravel().tolist())
    return Loop(s, joint, model, delays, gains, identifies, scales.time)


class EstimatorState(NamedTuple):
    """What is remembered from call to call."""

    time: Any
    """Time of the last call (s), -inf before the first: what a later time, less this, gives is a number."""
    state: Array
    """Estimate (4,) of the measured state, which is as old as the delay."""
    torques: Array
    """Commanded torques (depth,), newest first (N m)."""
    deviations: tuple[Array, Array]
    """The bank: what the filter with each delay estimates besides ``state``, angles and rates (depth, 2)."""
    evidence: Array
    """Evidence (depth,) against each delay, the lower the better."""
    delay_steps: Number
    """The delay found (steps)."""
    sample: Array
    """The last measurement (4,) that was finite."""
    gap: Number
    """Time since a measurement was new (s)."""
    identified: IdentifierState | None = None
    """What the identifier remembers; None without one."""


def begin(maths: ArrayOps, loop: Loop) -> EstimatorState:
    """Nothing seen yet."""
    xp, depth = maths.xp, loop.settings.max_delay_steps + 1
    return EstimatorState(
        time=xp.array(-math.inf),
        state=xp.zeros(4),
        torques=xp.zeros(depth),
        deviations=(xp.zeros((depth, 2)), xp.zeros((depth, 2))),
        evidence=xp.zeros(depth),
        delay_steps=xp.array(0),
        sample=xp.zeros(4),
        gap=xp.zeros(()),
        identified=None if loop.finding is None else identifier.begin(maths, loop.finding),
    )


def observe(
    maths: ArrayOps, loop: Loop, state: EstimatorState, found: Found | None, t: Any, x: Array
) -> tuple[EstimatorState, Array]:
    """An estimate of the state now.

    ``found`` is what an identifier has found before. The time t (s) is of the kind of the state's; x (4,) is
    measured (rad, rad/s).
    """
    xp, period, measured = maths.xp, loop.settings.dt, x
    pause = (t - state.time) / loop.time_unit
    # The first call (an infinite pause) and a clock of NaN fail both comparisons.
    in_time = (pause >= 0) & (pause <= LONGEST_STEP * period)
    # Both branches below may be computed: a late call needs a finite step, too.
    dt, model = maths.where(in_time & (pause > 0), pause, period), loop.model
    finite, (q1, q2, v1, v2), last = maths.finite(x), maths.numbers(x), maths.numbers(state.sample)
    repeats = (q1 == last[0]) & (q2 == last[1]) & (v1 == last[2]) & (v2 == last[3]) & ((v1 != 0) | (v2 != 0))
    gap = state.gap + dt
    gap = maths.where(finite, maths.where(repeats, gap, 0.0), gap)
    lost = (gap > 0) & (gap <= loop.settings.longest_gap) & (pause < math.inf)
    sample = maths.where(finite, x, state.sample)
    between, age, passed = dt, 0, 0.0
    if found is not None and state.identified is not None:
        x, model = x - maths.vector([*found.offsets, 0.0, 0.0]), found.model
        between, age = identifier.interval(maths, state.identified, dt), state.identified.age
        passed = identifier.elapsed(maths, state.identified, dt)
    followed = _follow(maths, loop, state, x, lost, between, model, age)
    # What is not finite fails the comparison, and is lost.
    miss1, miss2 = maths.numbers(abs(x - followed.state)[2:])
    jump = RESET_SIGMAS * loop.settings.velocity_noise
    kept = in_time & (lost | ((miss1 <= jump) & (miss2 <= jump)))
    after = maths.choose(xp.logical_not(kept), lambda: _restart(maths, state, x), followed)
    # The filter's estimate is as old as the delay; the controller needs the present state.
    time = passed + (after.delay_steps - age) * dt
    ahead = maths.choose(after.delay_steps > 0, lambda: _ahead(maths, loop, after, time, model), after.state)
    seen = maths.choose(kept & maths.finite(ahead), lambda: ahead, x)
    shown = maths.where(lost, math.nan * measured, measured)
    # In a gap the identifier is shown NaN, so that its motion begins anew.
    identified = _identify(maths, loop, after, in_time, pause, shown)
    return after._replace(time=t, sample=sample, gap=gap, identified=identified), seen


def compensation(maths: ArrayOps, loop: Loop, found: Found, seen: Array) -> Array:
    """Torques (2,) against friction and load found (N m); NaN if the state seen (4,) is not finite."""
    assert loop.finding is not None  # the caller has what it found
    most, finite = loop.finding.passive_limit, maths.finite(seen)
    q1, q2, *rates = maths.numbers(seen)
    loads: Pair = (0.0, 0.0) if found.commanded_load is None else found.commanded_load.at(q1, q2)
    torques = []
    for joint, (b, cf, rate, load) in enumerate(zip(*found.commanded_friction, rates, loads, strict=True)):
        # The arctangent and the clip would make a finite torque of an infinite velocity.
        torque = friction(b, cf, maths.where(finite, rate, math.nan), maths.arctan) + load
        torques.append(torque if joint == loop.joint else maths.clip(torque, -most, most))
    return maths.vector(torques)


def remember(maths: ArrayOps, loop: Loop, state: EstimatorState, u: Array) -> EstimatorState:
    """Note the torques (2,) that both motors were asked for, within their limits (N m)."""
    torques = maths.xp.concatenate([u[loop.joint][None], state.torques[:-1]])
    identified = None if state.identified is None else identifier.remember(maths, state.identified, u)
    return state._replace(torques=torques, identified=identified)


def _identify(
    maths: ArrayOps, loop: Loop, state: EstimatorState, in_time: Any, pause: Number, x: Array
) -> IdentifierState | None:
    """Show the identifier, if any, the angles measured a pause (s) after the last ones, perhaps too late."""
    before, behind, period = state.identified, loop.finding, loop.settings.dt
    if behind is None or before is None:
        return None
    late = maths.xp.logical_not(in_time)
    going_on = maths.choose(late, lambda: identifier.restart(maths, behind, before), before)
    step = maths.where(pause == 0, period, pause)
    return identifier.observe(maths, behind, going_on, x[:2], state.delay_steps, step)


def _restart(maths: ArrayOps, state: EstimatorState, x: Array) -> EstimatorState:
    """Believe the measurement. The evidence on the delay is kept: it belongs to the loop, not to the motion."""
    zeros = maths.xp.zeros_like(state.deviations[0])
    return state._replace(state=x, torques=maths.xp.zeros_like(state.torques), deviations=(zeros, zeros))


def _follow(
    maths: ArrayOps, loop: Loop, state: EstimatorState, x: Array, lost: Any, dt: Number, model: Model, age: Number
) -> EstimatorState:
    """One step of dt (s) of the filter in charge and of the bank, for angles of an age (calls), or in a gap."""
    xp = maths.xp
    follows = maths.where(lost, 0.0, 1.0)
    gains, torque = tuple(follows * each for each in loop.gains), maths.number(state.torques[state.delay_steps])
    predicted = step(maths, loop, model, state.state, (torque,), dt)
    # In a gap the measurement may be NaN, which 0 times it would not remove.
    miss = maths.choose(lost, lambda: 0.0 * predicted, x - predicted)
    angles, rates = maths.nearest(miss[:2]), miss[2:]

    extra = (state.torques - torque)[:, None] * response(maths, loop, model, state.state)
    bank_angles, bank_rates = state.deviations
    bank_angles = bank_angles + dt * bank_rates + 0.5 * dt**2 * extra
    bank_rates = bank_rates + dt * extra

    # Angles alone: the delay shows there, and velocities are noisy.
    squares = (angles - bank_angles) ** 2
    far = (squares[:, 0] + squares[:, 1]) / OUTLIER_SCALE**2
    evidence = math.exp(-loop.settings.dt / EVIDENCE_TIME) * state.evidence + xp.log1p(far)
    evidence = maths.where(lost, state.evidence, evidence)
    # A delay below the angles' own age cannot be.
    delays = xp.asarray(loop.delays, evidence.dtype)
    delay_steps = xp.argmin(xp.where(delays < age, math.inf, evidence + DELAY_PENALTY * delays))

    corrected = _correction(gains, bank_angles, bank_rates)
    bank_angles, bank_rates = bank_angles - corrected[0], bank_rates - corrected[1]
    angles, rates = _correction(gains, angles, rates)
    # They count from the filter in charge, which may be another one now.
    own_angles, own_rates = bank_angles[delay_steps], bank_rates[delay_steps]
    return state._replace(
        state=xp.concatenate([predicted[:2] + angles + own_angles, predicted[2:] + rates + own_rates]),
        deviations=(bank_angles - own_angles, bank_rates - own_rates),
        evidence=evidence,
        delay_steps=delay_steps.astype(state.delay_steps.dtype),
    )


def _correction(gains: tuple[Number, ...], angles: Array, rates: Array) -> tuple[Array, Array]:
    """What the Kalman gains make of misses."""
    return gains[0] * angles + gains[1] * rates, gains[2] * angles + gains[3] * rates


def _ahead(maths: ArrayOps, loop: Loop, state: EstimatorState, time: Number, model: Model) -> Array:
    """The state after the delay, a time (s), in pieces with the mean of the torques that act in each."""
    xp, steps = maths.xp, maths.number(state.delay_steps / PREDICTION_STEPS)
    # How much of each torque's step lies before a piece's ends: it began and will end so many steps ago.
    pieces, delays = (xp.asarray(each, state.evidence.dtype) for each in (PIECES, loop.delays))
    passed = xp.minimum(xp.maximum(pieces * steps - delays, 0.0), 1.0)
    # Without a delay the pieces are empty: 0 / 0 would be NaN.
    torques = ((passed[:-1] - passed[1:]) * state.torques).sum(axis=1) / maths.maximum(steps, 1e-6)
    return step(maths, loop, model, state.state, maths.numbers(torques), time / PREDICTION_STEPS)


def step(maths: ArrayOps, loop: Loop, model: Model, x: Array, torques: tuple[Number, ...], dt: Number) -> Array:
    """The state (4,) after steps of dt (s) from x, each with its torque of the driven joint (N m)."""
    (plant, losses, load), numbers = model, maths.numbers(x)
    for torque in torques:
        u = (torque, 0.0) if loop.joint == 0 else (0.0, torque)
        if load is not None:
            against = load.at(numbers[0], numbers[1])
            u = u[0] - against[0], u[1] - against[1]
        numbers = damped_midpoint_step(plant, losses, numbers, u, dt, maths)
    return maths.vector(numbers)


def response(maths: ArrayOps, loop: Loop, model: Model, x: Array) -> Array:
    """M⁻¹ times the torque of 1 N m on the driven joint (2,) (rad/s²)."""
    driven = (1.0, 0.0) if loop.joint == 0 else (0.0, 1.0)
    _, cos2 = maths.sine_cosine(maths.numbers(x)[1])
    return maths.vector(equations.response(model.plant, cos2, driven))
