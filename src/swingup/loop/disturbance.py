"""Everything between a controller and the pendulum as data: sensors, noise, delay, motors, pushes and the clock.

First one formula for each number of a :class:`Loop`, then a :class:`Disturbance`, a pytree of reals: batch it with
``vmap`` to run many at once. Its functions follow the order of one step of the public RealAIGym benchmark:
:func:`measured_state`, the controller, :func:`motor_torques`, the plant.
"""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from ..common.types import Count, Key, Scalar, State, Torque
from ..plant.equations import COULOMB_STEEPNESS, STRIBECK_RATE
from .loop import LONGEST_PERIOD, LOOP_DT, PERFECT_LOOP, Loop

SHORTEST_LAG = 1e-9  # Shorter lags count as zero (s)

JointAngles = Float[Array, "2"]  # q1 and q2 (rad)


class Effects(NamedTuple):
    """Which effects a compiled loop has; the others would cost time in each step. The public benchmark has none."""

    motors: bool = False  # Motors as the robot has them: with a rate limit, a ripple, and noise of their own
    drive: bool = False  # Motors lag, or deliver another torque than the command
    sensors: bool = False  # Angles have steps or offsets, or velocities are differences
    differences: bool = False
    """Velocities are differences of measured angles; otherwise the motors' drivers know the true ones."""
    late: bool = False  # Periods vary, or are not the boards'
    loads: bool = False  # Springs, constant torques or static friction act on the joints
    windup: bool = False  # The elbow's encoder does not follow its link
    sag: bool = False  # Motors lose torque with velocity
    gaps: bool = False  # Samples repeat, or are NaN


def measured_angles(loop: Loop, q: JointAngles) -> JointAngles:
    """Measured angles (rad): with the offset, rounded to the nearest step."""
    shown = q + jnp.stack([loop.offset1, loop.offset2])
    quantum = jnp.stack([loop.quantum1, loop.quantum2])
    # Both branches are computed: a division by 0 would leave NaN in gradients.
    grid = jnp.where(quantum > 0, quantum, 1.0)
    return jnp.where(quantum > 0, jnp.round(shown / grid) * grid, shown)


def sensed(loop: Loop, differences: bool, x: State, before: State, period: float | Scalar) -> State:
    """The measured state for the state x, and for the one ``before``, a ``period`` (s) earlier."""
    q = measured_angles(loop, x[:2])
    rates = (q - measured_angles(loop, before[:2])) / period if differences else x[2:]
    return jnp.concatenate([q, rates])


def rate_limited(loop: Loop, wanted: Torque, before: Torque, dt: float | Scalar) -> Torque:
    """A motor's own torque (N m) on its way from ``before`` to ``wanted``, dt (s) later."""
    maximum = loop.rate_limit * dt
    return before + jnp.clip(wanted - before, -maximum, maximum)


def joint_loads(loop: Loop, x: State) -> Torque:
    """Torques of springs, cables and static friction on both joints (N m)."""
    spring, load = jnp.stack([loop.spring1, loop.spring2]), jnp.stack([loop.load1, loop.load2])
    # Coulomb friction's arctangent, which fades as the joint breaks loose (Stribeck's curve).
    near_rest = jnp.exp(-((x[2:] / STRIBECK_RATE) ** 2)) * jnp.arctan(COULOMB_STEEPNESS * x[2:])
    return -(spring * x[:2] + load + jnp.stack([loop.stiction1, loop.stiction2]) * near_rest)


def motor_side(loop: Loop, x: State, torque: Scalar) -> State:
    """The state with the elbow's angle at its motor, where the encoder is, under the motor's torque (N m).

    Quasi-static: the rotor has no motion of its own, and the gear lies at the side to which its motor pushes.
    """
    return x.at[1].add(loop.compliance2 * torque + 0.5 * loop.backlash2 * jnp.sign(torque))


def sagging_limits(loop: Loop, limits: Torque, command: Torque, rates: Torque) -> Torque:
    """Torque limits (N m) of motors that drive their joints at rates (rad/s); in braking they have all."""
    left = jnp.maximum(limits - loop.sag * jnp.abs(rates), 0.0)
    return jnp.where(command * rates > 0, left, limits)


def held_steps(loop: Loop, step: Count, phase: Scalar, dt: float | Scalar) -> Count:
    """Steps since the last new sample, 0 outside of gaps, for a phase in (0, 1) and steps of dt (s)."""
    # Both branches are computed, also without gaps.
    every = 1.0 / jnp.maximum(loop.dropouts, 1e-9)
    within = jnp.mod(step * dt + phase * every, every)
    held = jnp.floor(within / dt).astype(int) + 1
    # A part of a step more, as in ``whole_steps``: rounding may lose one.
    return jnp.where((loop.dropouts > 0) & (held * dt <= loop.dropout + 1e-4 * dt), held, 0)


def lagging(loop: Loop, wanted: Torque, before: Torque, dt: float | Scalar) -> tuple[Torque, Torque]:
    """The mean torque (N m) over the next dt (s), and the torque at its end, from ``before`` to ``wanted``.

    The plant gets the mean, which has the same impulse as the exponential.
    """
    # A lag that is drawn may be 0 in some members of a batch, which all run the same program.
    ratio = dt / jnp.maximum(loop.lag, SHORTEST_LAG)
    left = jnp.exp(-ratio)
    return wanted + (before - wanted) * (1.0 - left) / ratio, wanted + (before - wanted) * left


def late_period(loop: Loop, uniform: Scalar, dt: float | Scalar) -> Scalar:
    """The period (s) of a turn for a uniform draw from (0, 1), where dt (s) is the nominal one.

    A period is the nominal one, or, with the probability ``late``, longer by an exponentially distributed time.
    Recordings of RealAIGym's robots look like this: their shortest period is the nominal one.
    """
    late = jnp.asarray(loop.late, uniform.dtype)
    # The share of draws below `late` is again uniform on (0, 1): its logarithm is exponentially distributed.
    rank = jnp.maximum(uniform, jnp.finfo(uniform.dtype).tiny) / jnp.where(late > 0, late, 1.0)
    excess = jnp.where(uniform < late, -loop.lateness * jnp.log(rank), 0.0)
    return jnp.minimum(dt + excess, LONGEST_PERIOD * dt)


class Times(eqx.Module):
    """The loop's own clock: the time now, and when the remembered states were measured."""

    now: Scalar  # s
    past: Float[Array, "depth"]  # Row k mod depth holds the time of step k (s), like the ring of states

    def remember(self, step: Count) -> "Times":
        """With the present time in the row of this step."""
        return Times(self.now, self.past.at[step % self.past.shape[0]].set(self.now))

    def age(self, step: Count) -> Scalar:
        """Time between this step and the one before it (s)."""
        depth = self.past.shape[0]
        return self.past[step % depth] - self.past[(step - 1) % depth]

    def after(self, period: float | Scalar) -> "Times":
        """A period (s) later."""
        return Times(self.now + period, self.past)


def start_times(depth: int, dt: float, dtype: jnp.dtype) -> Times:
    """The clock before the first step: at 0 s, and before that on time."""
    return Times(jnp.zeros((), dtype), (jnp.arange(depth, dtype=dtype) - depth) * dt)


Past = Float[Array, "depth 4"]
"""The last states as a ring: row k mod depth holds the state before step k, and the oldest is overwritten."""


class Pushes(eqx.Module):
    """Gaussian torque pushes on each joint."""

    centre: Float[Array | np.ndarray, "2 n"]
    """Time of each push's peak (s)."""
    width: Float[Array | np.ndarray, "2 n"]
    """Standard deviation of each push (s)."""
    amplitude: Float[Array | np.ndarray, "2 n"]
    """Torque at each push's peak (N m)."""

    def torque(self, t: Scalar) -> Torque:
        """Σ a exp(-(t - μ)² / 2σ²) of each joint at time t (s)."""
        distance = (t - jnp.asarray(self.centre)) / jnp.asarray(self.width)
        return jnp.sum(jnp.asarray(self.amplitude) * jnp.exp(-0.5 * distance**2), axis=1)


class Disturbance(eqx.Module):
    """Everything that disturbs one simulation, besides an error of the model."""

    loop: Loop
    """Numbers of sensors, motors and clock; its delay and its pushes count as ``delay_steps`` and ``pushes``."""
    delay_steps: int | Count
    """Age of the measured state (steps), below the depth of the past that is kept."""
    pushes: Pushes
    """Torques that act beside the motor's, and may exceed its limit."""
    noise: UInt32[Array | np.ndarray, "2"]
    """The two words of a threefry key, which fixes the noise."""
    effects: Effects = eqx.field(static=True, default=Effects())
    """Which of the loop's numbers act, besides noise and response, which always do."""

    @property
    def is_timed(self) -> bool:
        """Whether the loop has to keep its own time: its periods vary, or velocities are differences over it."""
        return self.effects.late or self.effects.differences

    @property
    def key(self) -> Key:
        """The key of all that is random."""
        # Named, since a program may have another default, with keys of another size.
        return jax.random.wrap_key_data(jnp.asarray(self.noise), impl="threefry2x32")

    def uniform(self, step: int | Count, number: int, dtype: jnp.dtype) -> Scalar:
        """A random number from (0, 1) of a step, apart from the step's noise and from those of other numbers."""
        return jax.random.uniform(jax.random.fold_in(jax.random.fold_in(self.key, step), number), (), dtype)

    def changed(self, **values: Any) -> "Disturbance":
        """With other numbers of the loop."""
        return dataclasses.replace(self, loop=dataclasses.replace(self.loop, **values))


def undisturbed(pushes: int = 1) -> Disturbance:
    """A disturbance that changes nothing, with room for ``pushes`` pushes a joint."""
    nothing = np.zeros((2, pushes))
    # Widths of 1, since the pushes divide by them.
    return Disturbance(PERFECT_LOOP, 0, Pushes(nothing, nothing + 1.0, nothing), np.zeros(2, np.uint32))


def disturbance_as_dict(disturbance: Disturbance) -> dict[str, Any]:
    """A disturbance of the board's loop as JSON values: numbers, the words of its noise's key, and any pushes."""
    names = ("velocity_noise", "torque_noise", "response")
    numbers: dict[str, Any] = {name: float(getattr(disturbance.loop, name)) for name in names}
    numbers["delay_steps"] = int(disturbance.delay_steps)
    numbers["noise"] = np.asarray(disturbance.noise).tolist()
    if np.any(np.asarray(disturbance.pushes.amplitude)):
        numbers["pushes"] = {name: np.asarray(values).tolist() for name, values in vars(disturbance.pushes).items()}
    return numbers


def step_noise(disturbance: Disturbance, step: Count, dtype: jnp.dtype) -> tuple[Float[Array, "2"], Torque]:
    """The noise of one step: on the two measured velocities (rad/s) and on the torques (N m).

    The benchmark has one driven joint, and draws once for its torque; with motors on both each has its own.
    """
    loop, torques = disturbance.loop, 2 if disturbance.effects.motors else 1
    # A function of seed, simulation and step: parts of a grid repeat what the whole grid draws.
    normal = jax.random.normal(jax.random.fold_in(disturbance.key, step), (2 + torques,), dtype)
    return loop.velocity_noise * normal[:2], loop.torque_noise * jnp.broadcast_to(normal[2:], (2,))


def remember(past: Past, step: Count, x: State) -> Past:
    """The past with the state before this step."""
    return past.at[step % past.shape[0]].set(x)


def step_period(disturbance: Disturbance, step: Count, dt: float, dtype: jnp.dtype) -> float | Scalar:
    """The time (s) from one step to the next."""
    if not disturbance.effects.late:
        return dt
    nominal = dt * (disturbance.loop.period / LOOP_DT)
    return late_period(disturbance.loop, disturbance.uniform(step, 1, dtype), nominal)


def sample_gap(disturbance: Disturbance, step: Count, dt: float, dtype: jnp.dtype) -> tuple[Count, Scalar]:
    """How many steps old the last new sample is before its delay, and 0, or NaN if this one is spoilt."""
    # Of the first step: gaps are evenly spaced in the whole run.
    phase, spoilt = disturbance.uniform(0, 2, dtype), disturbance.uniform(step, 3, dtype)
    broken = jnp.where(spoilt < disturbance.loop.spoilt, jnp.nan, jnp.zeros((), dtype))
    return held_steps(disturbance.loop, step, phase, dt * (disturbance.loop.period / LOOP_DT)), broken


def measured_state(
    disturbance: Disturbance,
    past: Past,
    step: Count,
    velocity_noise: Float[Array, "2"],
    times: Times | None = None,
    held: int | Count = 0,
) -> State:
    """The state that the controller receives: delayed, as the sensors see it, then noise on the velocities.

    Before the run is as old as the delay, the first state is measured: start with it in all rows of the past. The
    past is deeper than the delay. With velocities from differences it is one deeper, and the times of the states
    are needed. ``held`` is how many steps old the last new sample is.
    """
    seen = step - jnp.asarray(disturbance.delay_steps) - held
    measured = past[seen % past.shape[0]]
    if disturbance.effects.sensors:
        before, age = past[(seen - 1) % past.shape[0]], 1.0 if times is None else times.age(seen)
        measured = sensed(disturbance.loop, disturbance.effects.differences, measured, before, age)
    return measured.at[2:].add(velocity_noise)


def loaded(disturbance: Disturbance, u: Torque, x: State) -> Torque:
    """The torques on the joints (N m): those of motors and pushes, and the loads that they work against."""
    return u + joint_loads(disturbance.loop, x) if disturbance.effects.loads else u


def motor_torques(
    disturbance: Disturbance,
    command: Torque,
    before: Torque,
    t: Scalar,
    torque_noise: Torque,
    limits: Torque,
    x: State,
    dt: float | Scalar,
) -> tuple[Torque, Torque]:
    """The torques that act on the joints at time t (s), and the torques that the motors start from next.

    In the public benchmark the motor moves from the torque that acted before towards the command, takes noise and
    is clipped to its limits; the push comes on top. A robot's motor moves from its own torque, within its rate
    limit and its limits, and ripple, noise and push come on top. A joint with limit 0 is passive: nothing acts on
    it, not even its pushes, as in the public benchmark. With a ``drive`` the push is asked of the motors of both
    joints, as on the robot: it is added to the command after the limits. ``before`` are the torques (N m) that the
    motors start from: the second result of the step before, 0 at first. The state is for ripple and sag, the time
    of the step (s) for rate limit and lag.
    """
    # Pushes drawn for the passive joint have no effect: the benchmark's published numbers contain this.
    loop, effects, driven, pushes = disturbance.loop, disturbance.effects, limits > 0, disturbance.pushes.torque(t)
    noise, push = (jnp.where(driven, added, 0.0) for added in (torque_noise, pushes))
    if effects.sag:
        limits = sagging_limits(loop, limits, command, x[2:])
    ripple = jnp.zeros(2)
    if effects.motors:
        ripple = jnp.where(driven, loop.ripple * jnp.sin(loop.ripple_periods * x[:2]), 0.0)
    if effects.drive:
        wanted = jnp.clip(command, -limits, limits) + pushes
        mean, own = lagging(loop, before + loop.response * (wanted - before), before, dt)
        if effects.motors:
            mean, own = (rate_limited(loop, torque, before, dt) for torque in (mean, own))
        return jnp.stack([loop.gain1, loop.gain2]) * mean + ripple + noise, own
    torque = before + loop.response * (command - before)
    if not effects.motors:
        acting = jnp.clip(torque + noise, -limits, limits) + push
        # The push is part of what the motor starts from, as in the benchmark.
        return acting, acting
    own = jnp.clip(rate_limited(loop, torque, before, dt), -limits, limits)
    # The motors continue from their own torques: from the sums, ripple at rest would be integrated, and a push
    # would let them exceed their limits.
    return own + ripple + noise + push, own
