"""The state estimator of ``policy/estimator.py`` in JAX: a controller around one that sees the estimate."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.errors import SwingupError
from ...common.types import Scalar, State, Torque
from ...dynamics.integrate import midpoint_step
from ...plant import equations
from ...plant.damped import Friction, damped_midpoint_step
from ...plant.equations import lump
from ...plant.plant import Plant
from ...plant.robots import Robot
from ...policy import estimator
from ...policy.estimator import EstimatorState, Model
from ...policy.identifier import Found
from ...policy.identifier_settings import check_identifier
from ...policy.settings import EstimatorSettings, default_estimator, kalman_gains
from ..interface.controller import AbstractController, call_for_plant, check_robot
from .identifier import Identifier
from .maths import JAX


class EstimatorMemory(NamedTuple):
    """What is remembered from call to call."""

    estimator: EstimatorState
    controller: Any
    """What the controller behind remembers."""


class EstimatingController(AbstractController[EstimatorMemory]):
    """A controller that sees an estimate of the state instead of its measurement."""

    controller: AbstractController[Any]
    """The controller behind; one that depends on its plant is told what the identifier finds."""
    parameters: Plant
    """The model."""
    gains: Float[np.ndarray, "2 2"]
    """Kalman gains of a joint, from the misses of its angle and its rate to corrections of both."""
    settings: EstimatorSettings = eqx.field(static=True)
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""
    damped: bool = eqx.field(static=True, default=False)
    """Whether the model has friction."""
    identifier: Identifier | None = None
    """Identifies the plant; None for the nominal model."""

    @property
    def passive_limit(self) -> float:
        """Largest torque on the passive joint (N m): the identifier's compensation, and what the controller has."""
        behind = float(getattr(self.controller, "passive_limit", 0.0))
        return behind if self.identifier is None else behind + self.identifier.settings.passive_limit

    @property
    def joint(self) -> int:
        """Index of the driven joint."""
        return self.robot.joint

    @property
    def limits(self) -> Torque:
        """Largest torques that are counted (N m): the motor's, infinite for the undriven joint."""
        own = self.parameters.tl1, self.parameters.tl2
        return jnp.array([own[joint] if joint == self.joint else jnp.inf for joint in (0, 1)])

    def init(self) -> EstimatorMemory:
        """Nothing seen yet."""
        return EstimatorMemory(estimator.begin(JAX, self), self.controller.init())

    def __call__(self, carry: EstimatorMemory, t: Scalar, x: State) -> tuple[EstimatorMemory, Torque]:
        """The controller's torques for the estimated state (N m), with compensation; x is the measurement."""
        # In the memory's own type: a compiled loop keeps the types of its carry.
        now = jnp.asarray(t, carry.estimator.time.dtype)
        state, seen = estimator.observe(JAX, self, carry.estimator, self.found(carry), now, x)
        found = self.found(EstimatorMemory(state, None))
        if found is None:
            inner, u = self.controller(carry.controller, t, seen)
        else:
            inner, u = call_for_plant(self.controller, carry.controller, t, seen, jnp.stack(found.told))
            u = u + estimator.compensation(JAX, self, found.asked, seen).astype(u.dtype)
        return EstimatorMemory(estimator.remember(JAX, self, state, u), inner), u

    def found(self, memory: EstimatorMemory) -> Found | None:
        """What the identifier has found of the plant; None without one."""
        identified = memory.estimator.identified
        return None if self.identifier is None or identified is None else self.identifier.found(identified)

    def step(self, model: Model, x: State, torque: Scalar, dt: Scalar) -> State:
        """The state a time dt (s) after x under the driven joint's torque (N m)."""
        p, u = self.parameters, torque * jnp.array(self.robot.actuation, x.dtype)
        if model is None and not self.damped:
            return midpoint_step(p, x, u, dt)
        plant, friction = model or (lump(p), Friction((p.b1, p.b2), (p.cf1, p.cf2)))
        return jnp.array(damped_midpoint_step(plant, friction, x, u, dt, JAX))

    def response(self, model: Model, x: State) -> Float[Array, "2"]:
        """M⁻¹ times the torque of 1 N m on the driven joint (rad/s²)."""
        plant, driven = (
            lump(self.parameters) if model is None else model[0],
            jnp.array(self.robot.actuation, x.dtype),
        )
        return jnp.asarray(equations.response(plant, jnp.cos(x[1]), driven, jnp.stack))


def with_estimator(
    controller: AbstractController[Any],
    robot: Robot,
    parameters: Plant,
    settings: EstimatorSettings | None = None,
    identifier: Identifier | None = None,
) -> EstimatingController:
    """Put an estimator in front of a controller.

    Args:
        controller: the controller; called with estimates of the state.
        robot: which joint is driven.
        parameters: the model, with the motor's torque limit.
        settings: what to expect of measurement and loop; the defaults in the model's units if None.
        identifier: finds the plant, whose model the estimator then has; None for the nominal model.
    """
    check_robot(controller, robot)
    settings = default_estimator(parameters) if settings is None else settings
    if identifier is not None:
        _check_fits(identifier, robot, settings)
    p = parameters
    # Values of JAX may be traced: they count as friction.
    damped = any(isinstance(value, jax.Array) or value != 0 for value in (p.b1, p.b2, p.cf1, p.cf2))
    return EstimatingController(controller, parameters, kalman_gains(settings), settings, robot, damped, identifier)


def _check_fits(identifier: Identifier, robot: Robot, settings: EstimatorSettings) -> None:
    """Refuse an identifier that was made for another robot, another period or shorter delays."""
    if identifier.robot.name != robot.name:
        raise SwingupError(f"the identifier is for the {identifier.robot.name}: make one for the {robot.name}")
    check_identifier(identifier.settings, settings)
