"""What the sensors, the motors and the clock of a loop do: one formula for each number of a :class:`Loop`."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Count, Scalar, State, Torque
from ..plant.equations import COULOMB_STEEPNESS
from .loop import LONGEST_PERIOD, Loop

SHORTEST_LAG = 1e-9
"""Shorter lags count as zero (s)."""

STRIBECK_RATE = 0.05
"""Rate at which static friction fades (rad/s). Chosen: joints break loose within a few encoder steps."""

JointAngles = Float[Array, "2"]
"""q1 and q2 (rad)."""


class Effects(NamedTuple):
    """Which effects a compiled loop has; the others would cost time in each step. The public benchmark has none."""

    motors: bool = False
    """Motors as the robot has them: with a rate limit, a ripple, and noise of their own."""
    drive: bool = False
    """Motors lag, or deliver another torque than they were asked for."""
    sensors: bool = False
    """Angles have steps or offsets, or velocities are differences."""
    differences: bool = False
    """Velocities are differences of measured angles; otherwise the motors' drivers know the true ones."""
    late: bool = False
    """Periods vary, or are not the boards'."""
    loads: bool = False
    """Springs, constant torques or static friction act on the joints."""
    windup: bool = False
    """The elbow's encoder does not follow its link."""
    sag: bool = False
    """Motors lose torque with velocity."""
    gaps: bool = False
    """Samples repeat, or are NaN."""


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
    most = loop.rate_limit * dt
    return before + jnp.clip(wanted - before, -most, most)


def ripple_torque(loop: Loop, q: JointAngles) -> Torque:
    """Ripple torque (N m) at angles q (rad)."""
    return loop.ripple * jnp.sin(loop.ripple_periods * q)


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

    now: Scalar
    """s"""
    past: Float[Array, "depth"]
    """Row k mod depth holds the time of step k (s), like the ring of states."""

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
