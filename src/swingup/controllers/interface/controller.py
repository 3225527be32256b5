"""The one interface of all controllers: explicit state, so that whole closed loops compile and batch."""

import abc
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ...common.errors import SwingupError, attribute, errors_named_after
from ...common.types import Scalar, State, Torque
from ...plant.plant import Robot
from .time import TimeLike

Carry = TypeVar("Carry")


class AbstractController(eqx.Module, Generic[Carry]):
    """A controller of the double pendulum: ``init() -> carry``, then ``(carry, t, x) -> (carry, u)``."""

    @abc.abstractmethod
    def init(self) -> Carry:
        """What the controller remembers before the first step."""

    @abc.abstractmethod
    def __call__(self, carry: Carry, t: TimeLike, x: State) -> tuple[Carry, Torque]:
        """The torques [u1, u2] (N m) for the state x measured at time t (s), and what to remember.

        Outside 64-bit mode pass ``interface.time.split_time(t)``: single precision loses a time of some hours.
        """


class AbstractPlantController(AbstractController[Carry]):
    """A controller that depends on its plant: a call may say which plant it is for.

    Subclasses implement ``control``; a call is ``control`` for the controller's own plant. Plants may be traced or
    batched, one for each pendulum.
    """

    @abc.abstractmethod
    def control(self, carry: Carry, t: TimeLike, x: State, base: Any) -> tuple[Carry, Torque]:
        """Do what a call does, for a plant with base parameters θ (9,), by ``plant.base_parameters.BASE_NAMES``.

        With None it is the controller's own plant.
        """

    def __call__(self, carry: Carry, t: TimeLike, x: State) -> tuple[Carry, Torque]:
        """The torques [u1, u2] (N m) for the state x measured at time t (s), and the memory for the next call."""
        return self.control(carry, t, x, None)


def call_for_plant(
    controller: AbstractController[Any], carry: Any, t: TimeLike, x: State, base: Any
) -> tuple[Any, Torque]:
    """A call of any controller; one that depends on its plant is told θ."""
    if isinstance(controller, AbstractPlantController):
        return controller.control(carry, t, x, base)
    return controller(carry, t, x)


def joint_torques(u: Scalar, robot: Robot, limit: Scalar | float) -> Torque:
    """Both joints' torques (N m): u, clipped to the limit, on the driven joint and 0 on the passive one."""
    # Selected, not multiplied: a NaN is one of the driven joint alone.
    return jnp.where(jnp.array(robot.actuation) > 0, jnp.clip(u, -limit, limit), 0.0)


def check_interface(controller: AbstractController[Any]) -> None:
    """Trace one call of a controller in JAX without running it; call this in 64-bit mode, as the judge runs it."""
    # By what is not hashed JAX cannot tell one compiled program from another: lists, sets, static arrays.
    with errors_named_after(
        "hashing its fields", "make lists and sets tuples, and keep arrays in fields that are not static"
    ):
        hash(split(controller)[1])
    with errors_named_after("tracing it"):
        start = controller.init()
        answer = jax.eval_shape(lambda memory, t, x: controller(memory, t, x), start, jnp.zeros(()), jnp.zeros(4))
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise SwingupError("a call of it must return two things: what to remember, and the torques [u1, u2]")
    after, command = answer
    if getattr(command, "shape", None) != (2,):
        shape = getattr(command, "shape", type(command).__name__)
        raise SwingupError(f"its torque has shape {shape}: return [u1, u2] of shape (2,) in N m")
    if jnp.issubdtype(command.dtype, jnp.complexfloating):
        raise SwingupError(f"its torque is {command.dtype}: return real numbers [u1, u2] in N m")
    if _structure(after) != _structure(start):
        raise SwingupError("its memory changes shape or dtype in a call: keep what init() returns")


def split(controller: AbstractController[Any]) -> tuple[Any, Any]:
    """Split into the numbers, which are arguments of compiled programs, and the rest, which is compiled in."""
    # Numbers as well: controllers that differ in them alone share a program.
    return eqx.partition(controller, eqx.is_array_like)


def check_robot(source: Any, robot: Robot) -> None:
    """Refuse a controller that says it is for another robot."""
    meant = attribute(source, "robot")
    if isinstance(meant, Robot) and meant != robot:
        raise SwingupError(f"it is for the {meant.name}, not the {robot.name}: judge it there")


def _structure(memory: Any) -> tuple[Any, list[tuple[tuple[int, ...], Any]]]:
    leaves, structure = jax.tree.flatten(memory)
    return structure, [(jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves]
