"""Who stands beside a controller on a robot: a supervisor stops the run, throws the pendulum or pushes it.

A supervisor is called once a step with the measured state, before the controller. Like a controller it has explicit
state, so that whole closed loops compile and batch.
"""

import abc
from typing import Generic, TypeVar

import equinox as eqx
import jax.numpy as jnp

from ...common.types import Flag, Scalar, State, Torque

Memory = TypeVar("Memory")


class Intervention(eqx.Module):
    """What a supervisor does in one step."""

    takes: Flag
    """It drives both joints: the controller is neither called nor told."""
    torque: Torque
    """The torques (N m) that replace the controller's then, before the motors' limits."""
    push: Torque
    """Torques (N m) that are added to the controller's in any case, before the motors' limits."""
    stops: Flag
    """The run is over: what follows is not scored."""


def no_intervention(dtype: jnp.dtype) -> Intervention:
    """The controller alone drives."""
    return Intervention(jnp.array(False), jnp.zeros(2, dtype), jnp.zeros(2, dtype), jnp.array(False))


class AbstractSupervisor(eqx.Module, Generic[Memory]):
    """``start() -> memory``, then ``(memory, t, x) -> (memory, intervention)`` at every step."""

    @abc.abstractmethod
    def start(self, dtype: jnp.dtype) -> Memory:
        """What the supervisor remembers before the first step."""

    @abc.abstractmethod
    def __call__(self, memory: Memory, t: Scalar, x: State) -> tuple[Memory, Intervention]:
        """What to remember, and what to do, for the state x measured at time t (s)."""
