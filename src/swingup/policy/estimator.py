"""The state estimator: a bank of Kalman filters, one for each delay of the loop, and a prediction over that delay.

Encoders are good and velocities are noisy, on the real robots as in the robustness benchmark. A Kalman filter takes
velocities mostly from successive positions and the model. The loop may have a delay (an old measurement, a slow
motor): the filter whose delay explains the measured motion best is in charge, and its estimate is carried ahead
over that delay with the torques that are still on their way.

It remembers the estimate x̂ of the *measured* state, which is as old as the delay; the commanded torques
u_0 ... u_N, u_0 the last one; for each delay n = 0 ... N a deviation d_n = (d_q, d_v) of its filter's estimate from
x̂, and evidence S_n; and the delay m. At each call with the measurement z, a time h after the last one (Δ if 0):

1. p = f(x̂, u_m, h) with one step f of the model; e = z - p, its angles to the nearest turn. The filters differ
   only in the torque, and accelerations are linear in the torque. A double integrator therefore carries the
   deviations on, with b = ∂q̈/∂u at x̂:

       a_n = (u_n - u_m) b,   d_q ← d_q + h d_v + ½ h² a_n,   d_v ← d_v + h a_n.

2. S_n ← exp(-Δ/T) S_n + log(1 + |e_q - d_q|²/s²). The new m is the n with the minimal S_n + c n, the smallest of
   equal ones, and not below the angles' own age.
3. d_n ← d_n - K d_n, x̂ ← p + K e + d_m, d_n ← d_n - d_m, with the Kalman gains K of ``kalman_gains``.
4. The estimate restarts, x̂ ← z, all u_n and d_n ← 0, S and m as before the call, if there was no call before, if
   the last one was more than 4 Δ ago or is in the future, or if a rate of x̂ is not within 100 standard
   deviations of the measured one. The controller then sees z.
5. Otherwise it sees x̂ carried ahead by m steps, which last as long as those since the angles were measured, or h:
   four equal steps of the model, with the mean of the torques that act in each, as if commands were held from call
   to call; z if that is not finite.

A z that is not finite, or repeats all digits of the last finite one with a velocity other than 0, shows nothing
new. In such a gap of at most ``longest_gap`` the model stands in: e = 0 and K = 0, S stays, no measured rate
restarts the estimate, and the identifier begins its motion anew.

With an identifier z is the measurement less the identified offsets, the model is the plant identified before this
call, and h is the time between the angles where they are some calls old. The identifier is shown the measured
angles last. The identified friction and load are compensated on both joints, b q̇ + c arctan(100 q̇) + c' + k q at
the state seen, on the passive joint within its limit. If the state seen is not finite, the driven joint's torque is
NaN and the passive one's 0.
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
from .identifier import (
    Array,
    IdentifiedPlant,
    IdentifierConstants,
    IdentifierSettings,
    IdentifierState,
    PredictionModel,
    identifier_constants,
)

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
"""The estimate restarts where its rate is this many standard deviations off the measured one, which has jumped."""
PREDICTION_STEPS = 4  # Steps of the model in which the estimate is carried ahead over the delay
PIECE_ENDS = np.arange(PREDICTION_STEPS, -1.0, -1.0)[:, None]  # Ends of these steps before now, in steps (5, 1)
OUTLIER_SCALE = 1e-4
"""s: far larger errors of a predicted angle count little more (rad); a push must not decide the delay."""
DELAY_PENALTY = 20.0  # c: log likelihood that a delay must gain for each step that it is longer
EVIDENCE_TIME = 5.0  # T: time in which evidence on the delay fades (s)


class EstimatorConstants(NamedTuple):
    """Constants of the estimator, derived from plant and settings, in C.1's units."""

    settings: EstimatorSettings
    joint: int  # index of the driven joint
    model: PredictionModel  # the nominal plant
    delays: np.ndarray  # 0 to the maximum (steps)
    gains: tuple[float, ...]  # Kalman gains of a joint, row by row, from errors to corrections of angle and rate
    identifier: IdentifierConstants | None  # None for the nominal model
    time_unit: float  # of all other times (s); calls come with their time in seconds


def settings_in_c1(
    settings: EstimatorSettings, plant: Plant, identifier: IdentifierSettings | None = None
) -> tuple[EstimatorSettings, IdentifierSettings | None]:
    """A plant's settings in C.1's units, within the same ranges."""
    scales = arm_scales(plant)
    times = {name: scales.similar(getattr(settings, name), TIME) for name in ("dt", "longest_gap")}
    own = C1.over(scales)
    return replace(scaled(settings, own), **times), None if identifier is None else scaled(identifier, own)


def estimator_constants(
    settings: EstimatorSettings, plant: Plant, joint: int, identifier: IdentifierSettings | None = None
) -> EstimatorConstants:
    """Constants for a nominal plant; with settings of an identifier, the model is the plant that it identifies."""
    scales, identifies = arm_scales(plant), None
    s, identifier = settings_in_c1(settings, plant, identifier)
    plant = similar_plant(plant, scales)
    if identifier is not None:
        identifies = identifier_constants(plant, joint, s.dt, s.max_delay_steps, identifier)
    delays, model = np.arange(s.max_delay_steps + 1.0), PredictionModel(lump(plant), plant.friction, None)
    gains = tuple(kalman_gains(s).ravel().tolist())
    return EstimatorConstants(s, joint, model, delays, gains, identifies, scales.time)


class EstimatorState(NamedTuple):
    """What is remembered from call to call."""

    time: Any  # of the last call (s), -inf before the first: a later time less this is a number
    state: Array  # estimate x̂ (4,) of the measured state, which is as old as the delay
    torques: Array  # commanded torques (depth,), newest first (N m)
    deviations: tuple[Array, Array]  # of each delay's filter from x̂, angles and rates (depth, 2)
    evidence: Array  # evidence (depth,) against each delay
    delay_steps: Number  # the delay found (steps)
    sample: Array  # the last measurement (4,) that was finite
    gap: Number  # time since a measurement was new (s)
    identifier: IdentifierState | None = None


def begin(ops: ArrayOps, constants: EstimatorConstants) -> EstimatorState:
    """The state before the first call."""
    xp, depth = ops.xp, constants.settings.max_delay_steps + 1
    return EstimatorState(
        time=xp.array(-math.inf),
        state=xp.zeros(4),
        torques=xp.zeros(depth),
        deviations=(xp.zeros((depth, 2)), xp.zeros((depth, 2))),
        evidence=xp.zeros(depth),
        delay_steps=xp.array(0),
        sample=xp.zeros(4),
        gap=xp.zeros(()),
        identifier=None if constants.identifier is None else identifier.begin(ops, constants.identifier),
    )


def observe(
    ops: ArrayOps,
    constants: EstimatorConstants,
    state: EstimatorState,
    plant: IdentifiedPlant | None,
    t: Any,
    x: Array,
) -> tuple[EstimatorState, Array]:
    """One call: correct the estimate of the measured state, then carry it ahead to the present.

    ``plant`` is what the identifier knew before this call. The time t (s) is of the kind of the state's; x (4,) is
    the measurement (rad, rad/s).
    """
    xp, period, measured = ops.xp, constants.settings.dt, x
    pause = (t - state.time) / constants.time_unit
    # The first call (an infinite pause) and a clock of NaN fail both comparisons.
    in_time = (pause >= 0) & (pause <= identifier.MAX_STEP * period)
    # Both branches below may be computed: a late call needs a finite step, too.
    dt, model = ops.where(in_time & (pause > 0), pause, period), constants.model
    finite, (q1, q2, v1, v2), last = ops.finite(x), ops.numbers(x), ops.numbers(state.sample)
    # A pendulum at rest may repeat its digits, a moving one with a noisy sensor does not.
    repeats = (q1 == last[0]) & (q2 == last[1]) & (v1 == last[2]) & (v2 == last[3]) & ((v1 != 0) | (v2 != 0))
    gap = state.gap + ops.where((pause > 0) & (pause < math.inf), pause, period)
    gap = ops.where(finite, ops.where(repeats, gap, 0.0), gap)
    bridges = (gap > 0) & (gap <= constants.settings.longest_gap) & (pause < math.inf)
    sample = ops.where(finite, x, state.sample)
    interval, age, elapsed = dt, 0, 0.0
    if plant is not None and state.identifier is not None:
        x, model = x - ops.vector([*plant.offsets, 0.0, 0.0]), plant.model
        interval, age = identifier.interval(ops, state.identifier, dt), state.identifier.age
        elapsed = identifier.elapsed(ops, state.identifier, dt)
    followed = _follow(ops, constants, state, x, bridges, interval, model, age)
    # An error that is not finite fails the comparison: the estimate restarts.
    error1, error2 = ops.numbers(abs(x - followed.state)[2:])
    jump = RESET_SIGMAS * constants.settings.velocity_noise
    continues = in_time & (bridges | ((error1 <= jump) & (error2 <= jump)))
    after = ops.choose(xp.logical_not(continues), lambda: _restart(ops, state, x), followed)
    # The filter's estimate is as old as the delay; the controller needs the present state.
    time = elapsed + (after.delay_steps - age) * dt
    ahead = ops.choose(after.delay_steps > 0, lambda: _ahead(ops, constants, after, time, model), after.state)
    seen = ops.choose(continues & ops.finite(ahead), lambda: ahead, x)
    # In a gap the identifier is shown NaN, so that its motion begins anew.
    shown = ops.where(bridges, math.nan * measured, measured)
    identified = _identify(ops, constants, after, in_time, pause, shown)
    return after._replace(time=t, sample=sample, gap=gap, identifier=identified), seen


def compensation(ops: ArrayOps, constants: EstimatorConstants, plant: IdentifiedPlant, seen: Array) -> Array:
    """Torques (2,) against the identified friction and load (N m), for the state seen (4,).

    If that is not finite, the driven joint's is NaN and the passive one's 0.
    """
    assert constants.identifier is not None  # it has identified the plant
    limit, finite = constants.identifier.passive_limit, ops.finite(seen)
    q1, q2, *rates = ops.numbers(seen)
    loads: Pair = (0.0, 0.0) if plant.commanded_loads is None else plant.commanded_loads.at(q1, q2)
    torques = []
    for joint, (b, cf, rate, load) in enumerate(zip(*plant.commanded_friction, rates, loads, strict=True)):
        torque = friction(b, cf, rate, ops.arctan) + load
        driven = joint == constants.joint
        torque = torque if driven else ops.clip(torque, -limit, limit)
        # The arctangent and the clip would make a finite torque of an infinite velocity.
        torques.append(ops.where(finite, torque, math.nan if driven else 0.0))
    return ops.vector(torques)


def remember(ops: ArrayOps, constants: EstimatorConstants, state: EstimatorState, u: Array) -> EstimatorState:
    """Note the torques (2,) that both motors were commanded, within their limits (N m)."""
    torques = ops.xp.concatenate([u[constants.joint][None], state.torques[:-1]])
    identified = None if state.identifier is None else identifier.remember(ops, state.identifier, u)
    return state._replace(torques=torques, identifier=identified)


def _identify(
    ops: ArrayOps, constants: EstimatorConstants, state: EstimatorState, in_time: Any, pause: Number, x: Array
) -> IdentifierState | None:
    """Show the identifier, if any, the angles of x, measured a pause (s) after the last ones."""
    before, known, period = state.identifier, constants.identifier, constants.settings.dt
    if known is None or before is None:
        return None
    late = ops.xp.logical_not(in_time)
    begun = ops.choose(late, lambda: identifier.restart(ops, known, before), before)
    step = ops.where(pause == 0, period, pause)
    return identifier.observe(ops, known, begun, x[:2], state.delay_steps, step)


def _restart(ops: ArrayOps, state: EstimatorState, x: Array) -> EstimatorState:
    """Believe the measurement. The evidence on the delay is kept: it belongs to the loop, not to the motion."""
    zeros = ops.xp.zeros_like(state.deviations[0])
    return state._replace(state=x, torques=ops.xp.zeros_like(state.torques), deviations=(zeros, zeros))


def _follow(
    ops: ArrayOps,
    constants: EstimatorConstants,
    state: EstimatorState,
    x: Array,
    bridges: Any,
    dt: Number,
    model: PredictionModel,
    age: Number,
) -> EstimatorState:
    """One step of dt (s) of the filter in charge and of the bank: steps 1 to 3, for angles of an age (calls).

    Where the model bridges a gap, nothing is corrected.
    """
    xp = ops.xp
    measures = ops.where(bridges, 0.0, 1.0)
    gains, torque = tuple(measures * each for each in constants.gains), ops.number(state.torques[state.delay_steps])
    predicted = step(ops, constants, model, state.state, (torque,), dt)
    # In a gap the measurement may be NaN, which 0 times it would not remove.
    error = ops.choose(bridges, lambda: 0.0 * predicted, x - predicted)
    angles, rates = ops.nearest(error[:2]), error[2:]

    # One nonlinear model serves all filters: they differ in the torque alone, which enters linearly.
    extra = (state.torques - torque)[:, None] * response(ops, constants, model, state.state)
    bank_angles, bank_rates = state.deviations
    bank_angles = bank_angles + dt * bank_rates + 0.5 * dt**2 * extra
    bank_rates = bank_rates + dt * extra

    # Angles alone: the delay shows there, and velocities are noisy.
    squares = (angles - bank_angles) ** 2
    distance = (squares[:, 0] + squares[:, 1]) / OUTLIER_SCALE**2
    evidence = math.exp(-constants.settings.dt / EVIDENCE_TIME) * state.evidence + xp.log1p(distance)
    evidence = ops.where(bridges, state.evidence, evidence)
    # A delay below the angles' own age cannot be.
    delays = xp.asarray(constants.delays, evidence.dtype)
    delay_steps = xp.argmin(xp.where(delays < age, math.inf, evidence + DELAY_PENALTY * delays))

    corrected = _correction(gains, bank_angles, bank_rates)
    bank_angles, bank_rates = bank_angles - corrected[0], bank_rates - corrected[1]
    angles, rates = _correction(gains, angles, rates)
    # Deviations count from the filter in charge, which may be another one now.
    own_angles, own_rates = bank_angles[delay_steps], bank_rates[delay_steps]
    return state._replace(
        state=xp.concatenate([predicted[:2] + angles + own_angles, predicted[2:] + rates + own_rates]),
        deviations=(bank_angles - own_angles, bank_rates - own_rates),
        evidence=evidence,
        delay_steps=delay_steps.astype(state.delay_steps.dtype),
    )


def _correction(gains: tuple[Number, ...], angles: Array, rates: Array) -> tuple[Array, Array]:
    """Kalman gains times errors of angles and rates."""
    return gains[0] * angles + gains[1] * rates, gains[2] * angles + gains[3] * rates


def _ahead(
    ops: ArrayOps, constants: EstimatorConstants, state: EstimatorState, time: Number, model: PredictionModel
) -> Array:
    """The state after the delay, a time (s), in steps with the mean of the torques that act in each."""
    xp, steps = ops.xp, ops.number(state.delay_steps / PREDICTION_STEPS)
    # How much of each command lies before a step's ends: it began and will end so many calls ago.
    ends, delays = (xp.asarray(each, state.evidence.dtype) for each in (PIECE_ENDS, constants.delays))
    passed = xp.minimum(xp.maximum(ends * steps - delays, 0.0), 1.0)
    # Without a delay the steps are empty: 0 / 0 would be NaN.
    torques = ((passed[:-1] - passed[1:]) * state.torques).sum(axis=1) / ops.maximum(steps, 1e-6)
    return step(ops, constants, model, state.state, ops.numbers(torques), time / PREDICTION_STEPS)


def step(
    ops: ArrayOps,
    constants: EstimatorConstants,
    model: PredictionModel,
    x: Array,
    torques: tuple[Number, ...],
    dt: Number,
) -> Array:
    """The state (4,) after steps of dt (s) from x, each with its torque of the driven joint (N m)."""
    (plant, losses, load), numbers = model, ops.numbers(x)
    for torque in torques:
        u = (torque, 0.0) if constants.joint == 0 else (0.0, torque)
        if load is not None:
            against = load.at(numbers[0], numbers[1])
            u = u[0] - against[0], u[1] - against[1]
        numbers = damped_midpoint_step(plant, losses, numbers, u, dt, ops)
    return ops.vector(numbers)


def response(ops: ArrayOps, constants: EstimatorConstants, model: PredictionModel, x: Array) -> Array:
    """M⁻¹ times the torque of 1 N m on the driven joint (2,) (rad/s²)."""
    driven = (1.0, 0.0) if constants.joint == 0 else (0.0, 1.0)
    _, cos2 = ops.sine_cosine(ops.numbers(x)[1])
    return ops.vector(equations.response(model.plant, cos2, driven))
