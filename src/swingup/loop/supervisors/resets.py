"""Resets: throws by a PID that come at planned times, and at once when the pendulum exceeds a limit.

Source: the rules of ICRA 2025 on the real robot. A reset at a limit is inserted before the planned ones, which it
delays. The rules' quirks are kept: the delay counts from the time for which the reset before was planned, not from
its end, and the PID's errors continue from reset to reset.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.types import Count, Flag, Scalar, State
from ...plant.plant import Plant
from .limits import Limits, Stop
from .supervisor import AbstractSupervisor, Intervention
from .throws import PID, Thrower, start_pid, throwing_torque


class ResetMemory(eqx.Module):
    """What the resets remember from call to call."""

    active: Flag
    """A reset runs: the PID has both joints."""
    begun: Count
    """Resets so far, planned or inserted."""
    planned: Count
    """Planned ones so far."""
    delay: Scalar
    """Time by which inserted resets delay the rest of the plan (s)."""
    before: Scalar
    """Time for which the last reset was planned, or at which it was inserted (s)."""
    clock: Scalar
    """Time of the present reset (s)."""
    t: Scalar
    """Time of the last call (s)."""
    clean: Count
    """Samples since the last that exceeded a limit."""
    pid: PID
    stopped: Flag


class Resets(AbstractSupervisor[ResetMemory]):
    """Throws the pendulum by plan and at limits, and stops the run at wider limits."""

    plan: Float[Array | np.ndarray, "resets"]
    """Planned times, in order (s)."""
    target: Float[Array | np.ndarray, "goals 2"]
    """Angles that one reset after another aims at (rad)."""
    duration: float | Scalar
    """A reset lasts longer than this (s)."""
    clean: int | Count
    """A reset ends only after this many samples in a row within the limits, the present one included."""
    limits: Limits
    """Beyond these a reset begins at once."""
    thrower: Thrower
    """The PID."""
    model: Plant
    """The model with which it compensates gravity."""
    stop: Stop

    def start(self, dtype: jnp.dtype) -> ResetMemory:
        """No reset so far, and not stopped."""
        zero, nothing, no = jnp.zeros((), dtype), jnp.zeros((), int), jnp.array(False)
        # As if samples before the run had been clean.
        clean, pid = jnp.asarray(self.clean, int), start_pid(dtype)
        return ResetMemory(no, nothing, nothing, zero, zero, zero, zero, clean, pid, self.stop.start(dtype))

    def __call__(self, memory: ResetMemory, t: Scalar, x: State) -> tuple[ResetMemory, Intervention]:
        """Begin or end a reset at time t (s), in which the PID drives; after a stop it is the brake.

        A reset that is due counts as planned, though a limit is exceeded as well.
        """
        exceeded = self.limits.exceeded(x)
        clean = jnp.where(exceeded, 0, memory.clean + 1)
        plan = jnp.append(jnp.asarray(self.plan), jnp.inf)[memory.planned] + memory.delay
        due = t >= plan
        begins = ~memory.active & (due | exceeded)
        clock = jnp.where(begins, 0.0, memory.clock)
        # Never in the call that begins it, since the clock is 0 then.
        active = (memory.active | begins) & ~((clock > self.duration) & (clean >= self.clean))
        begun = memory.begun + begins
        target = jnp.asarray(self.target)[jnp.maximum(begun - 1, 0)]
        thrown, torque = throwing_torque(self.thrower, self.model, memory.pid, target, x)
        stopped, end = self.stop(memory.stopped, t, x)
        after = ResetMemory(
            active=active,
            begun=begun,
            planned=memory.planned + (begins & due),
            # The first reset has none before it: `before` is 0 then.
            delay=jnp.where(begins & ~due, memory.delay + (t - memory.before), memory.delay),
            before=jnp.where(begins, jnp.where(due, plan, t), memory.before),
            clock=clock + jnp.where(active, t - memory.t, 0.0),
            t=jnp.asarray(t, memory.t.dtype),
            clean=clean,
            # Between resets the PID rests.
            pid=jax.tree.map(lambda new, old: jnp.where(active, new, old), thrown, memory.pid),
            stopped=stopped,
        )
        torque = jnp.where(stopped, end.torque, torque)
        return after, Intervention(active | stopped, torque, end.push, stopped)
