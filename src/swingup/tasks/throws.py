"""Throws: at times a PID takes both joints from the controller and drives them to a random configuration.

Source: the rules of the global-policy benchmark (ICRA 2025). The PID's quirks belong to them: its error is not
wrapped, its error sum and its last error run on from throw to throw, and its period is not the loop's.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..physics.dynamics import gravity_torque
from ..physics.parameters import Parameters
from ..types import Count, Flag, Scalar, State, Torque

WITHOUT_DERIVATIVE = 2
"""First calls of the run in which the PID takes its derivative for 0."""


class Throws(eqx.Module):
    """When the pendulum is thrown, where to, and the PID that does it."""

    number: Int[Array | np.ndarray, "steps"]
    """Number of the throw at each step, -1 between throws."""
    target: Float[Array | np.ndarray, "throws 2"]
    """Angles that each throw aims at (rad)."""
    kp: float | Scalar
    """N m/rad"""
    ki: float | Scalar
    """N m/(rad s)"""
    kd: float | Scalar
    """N m s/rad"""
    dt: float | Scalar
    """What the PID believes to be its period (s)."""
    limit: float | Scalar
    """Torque limit of the PID (N m)."""


class PID(eqx.Module):
    """What the PID remembers between calls."""

    calls: Count
    total: Float[Array, "2"]
    """Sum of the errors so far (rad)."""
    last: Float[Array, "2"]
    """Error of the last call (rad)."""


def start_pid(dtype: jnp.dtype) -> PID:
    """A PID before its first call."""
    return PID(jnp.zeros((), int), jnp.zeros(2, dtype), jnp.zeros(2, dtype))


def is_thrown(throws: Throws, step: Count) -> Flag:
    """Whether the PID has the pendulum at this step: the controller is then neither called nor told."""
    return jnp.asarray(throws.number)[step] >= 0


def throw(throws: Throws, parameters: Parameters, pid: PID, step: Count, x: State) -> tuple[PID, Torque]:
    """The PID's torque (N m) at this step, with the gravity torque taken off, before the motors' limits."""
    error = jnp.asarray(throws.target)[jnp.asarray(throws.number)[step]] - x[:2]
    total = pid.total + error
    derivative = jnp.where(pid.calls < WITHOUT_DERIVATIVE, 0.0, (error - pid.last) / throws.dt)
    u = throws.kp * error + throws.ki * throws.dt * total + throws.kd * derivative
    command = jnp.clip(u, -throws.limit, throws.limit) - gravity_torque(parameters, x)
    return PID(pid.calls + 1, total, error), command
