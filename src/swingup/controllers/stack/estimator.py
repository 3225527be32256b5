"""The state estimator of ``policy/estimator.py`` in JAX: a controller around one that sees the estimate."""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.types import Flag, State, Torque
from ...dynamics.trigonometry import arctan, sine_cosine
from ...plant.equations import ArrayOps
from ...plant.plant import Plant, Robot
from ...plant.units import BASE_UNITS, STATE, TORQUE, Scales, arm_scales
from ...policy import estimator, identifier
from ...policy.estimator import (
    EstimatorConstants,
    EstimatorSettings,
    EstimatorState,
    default_estimator,
    estimator_constants,
)
from ...policy.identifier import IdentifiedPlant, IdentifierSettings
from ..interface import AbstractController, TimeLike, as_time, call_for_plant, check_robot, never
from ..swingups.transition import unpack

TreeT = TypeVar("TreeT")


def choose(condition: Flag, yes: Callable[[], TreeT], no: TreeT) -> TreeT:
    """What a function returns, or another pytree of the same structure, as compiled loops choose."""
    chosen: TreeT = jax.tree.map(lambda one, other: jnp.where(condition, one, other), yes(), no)
    return chosen


JAX = ArrayOps(
    xp=jnp,
    sine_cosine=sine_cosine,
    arctan=arctan,
    log1p=jnp.log1p,
    expm1=jnp.expm1,
    root=jnp.sqrt,
    minimum=jnp.minimum,
    maximum=jnp.maximum,
    finite=lambda values: jnp.isfinite(values).all(),
    where=jnp.where,
    place=lambda number: jnp.rint(number).astype(int),
    number=lambda value: value,
    numbers=unpack,
    vector=jnp.stack,
    window=lambda rows, start, size: jax.lax.dynamic_slice_in_dim(rows, start, size),
    choose=choose,
)
"""JAX's functions, in the precision of what they are given."""


class EstimatorMemory(NamedTuple):
    """What is remembered from call to call."""

    estimator: EstimatorState
    controller: Any  # What the controller behind remembers


class EstimatingController(AbstractController[EstimatorMemory]):
    """A controller that sees an estimate of the state instead of its measurement."""

    wraps: ClassVar[bool] = True

    controller: AbstractController[Any]
    """The controller behind; one that depends on its plant is called for the identified one."""
    plant: Plant = eqx.field(static=True)  # The model, with the motor's torque limit
    settings: EstimatorSettings = eqx.field(static=True)
    robot: Robot = eqx.field(static=True)  # Which joint is driven
    identifier: IdentifierSettings | None = eqx.field(static=True, default=None)
    """Settings of the identifier of the plant; None for the nominal model."""
    prior: tuple[Float[Array, "n"], Float[Array, "n n"]] | None = None
    """What the identifier begins with, mean and covariance in C.1's units; None for those of the plant."""

    @property
    def constants(self) -> EstimatorConstants:
        """Constants of the estimator, and of its identifier if it has one."""
        constants = estimator_constants(self.settings, self.plant, self.robot.joint, self.identifier)
        if self.prior is None or constants.identifier is None:
            return constants
        mean, covariance = self.prior
        return constants._replace(identifier=constants.identifier._replace(mean=mean, covariance=covariance))

    @property
    def scales(self) -> Scales:
        """The plant's units; estimator and identifier compute in C.1's."""
        return arm_scales(self.plant)

    @property
    def passive_limit(self) -> float:
        """Largest torque on the passive joint (N m): the identifier's compensation, and what the controller has."""
        behind = float(getattr(self.controller, "passive_limit", 0.0))
        return behind if self.identifier is None else behind + self.identifier.passive_limit

    def init(self) -> EstimatorMemory:
        """Nothing seen yet."""
        # Split, since single precision would lose a time of some hours.
        return EstimatorMemory(estimator.begin(JAX, self.constants)._replace(time=never()), self.controller.init())

    def __call__(self, carry: EstimatorMemory, t: TimeLike, x: State) -> tuple[EstimatorMemory, Torque]:
        """The controller's torques for the estimated state (N m), with compensation; x is the measurement."""
        constants, scales = self.constants, self.scales
        now = as_time(t).like(carry.estimator.time)
        state, own = estimator.observe(
            JAX, constants, carry.estimator, self.identified_plant(carry), now, scales.similar(x, *STATE)
        )
        plant = self.identified_plant(carry._replace(estimator=state))
        seen = scales.scaled(own, *STATE)
        if plant is None:
            inner, u = self.controller(carry.controller, t, seen)
        else:
            base = scales.scaled(jnp.stack(plant.residual_base), *BASE_UNITS)
            inner, u = call_for_plant(self.controller, carry.controller, t, seen, base)
            u = u + scales.scaled(estimator.compensation(JAX, constants, plant, own), TORQUE).astype(u.dtype)
        driven = self.plant.limit(self.robot.joint)
        limits = jnp.where(jnp.arange(2) == self.robot.joint, driven, self.passive_limit).astype(u.dtype)
        # Clipped before it is remembered: the model must have the torque that acts.
        u = jnp.clip(u, -limits, limits)
        return EstimatorMemory(estimator.remember(JAX, constants, state, scales.similar(u, TORQUE)), inner), u

    def identified_plant(self, memory: EstimatorMemory) -> IdentifiedPlant | None:
        """What the identifier knows of the plant; None without one."""
        constants, state = self.constants.identifier, memory.estimator.identifier
        if constants is None or state is None:
            return None
        return identifier.identified_plant(JAX, constants, state)


def with_estimator(
    controller: AbstractController[Any],
    robot: Robot,
    plant: Plant,
    settings: EstimatorSettings | None = None,
    identifier: IdentifierSettings | None = None,
) -> EstimatingController:
    """Put an estimator in front of a controller.

    The plant is the model, with the motor's torque limit; without settings the defaults are in its units. With
    settings of an identifier, the model is the plant that it identifies.
    """
    check_robot(controller, robot)
    return EstimatingController(controller, plant, settings or default_estimator(plant), robot, identifier)
