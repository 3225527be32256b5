"""The regulator of ``policy/regulator.py`` in JAX: a controller around a policy."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.types import Scalar, State, Torque
from ...plant.base_parameters import Geometry, base_parameters, geometry_of
from ...plant.equations import Number
from ...plant.plant import Plant
from ...plant.robots import Robot
from ...policy import regulator
from ...policy.regulator import RegulatorState
from ...policy.regulator_settings import RegulatorSettings, fixed_point
from ...policy.upright import Discrete
from ..interface.controller import AbstractController, AbstractPlantController, call_for_plant
from ..swingups.scalar_algebra import Matrix, Vector, dot, symmetric_times, unpack
from .maths import JAX

TRIANGLE = np.triu_indices(4)
"""Rows and columns of what is remembered of P, row by row."""


class RegulatorMemory(NamedTuple):
    """What is remembered from call to call."""

    regulator: RegulatorState
    controller: Any
    """What the policy remembers."""


class RegulatingController(AbstractPlantController[RegulatorMemory]):
    """A policy, and near the top u = -K e of the linear quadratic regulator."""

    controller: AbstractController[Any]
    """The policy; it is called always."""
    base: Float[Any, "9"]
    """θ of the plant that it holds, where a call does not say."""
    start: Float[np.ndarray, "10"]
    """P at first, its upper triangle."""
    torque_limit: float
    """Largest torque of the regulator (N m)."""
    geometry: Geometry = eqx.field(static=True)
    settings: RegulatorSettings = eqx.field(static=True)
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""

    @property
    def joint(self) -> int:
        """Index of the driven joint."""
        return self.robot.joint

    def init(self) -> RegulatorMemory:
        """The policy acts."""
        return RegulatorMemory(regulator.begin(JAX, self), self.controller.init())

    def control(
        self, carry: RegulatorMemory, t: Scalar, x: State, base: Float[Any, "9"] | None
    ) -> tuple[RegulatorMemory, Torque]:
        """The torque of the one that acts (N m); NaN if the state is not finite."""
        base = self.base if base is None else base
        inner, u = call_for_plant(self.controller, carry.controller, t, x, base)
        held = regulator.held(self, unpack(jnp.asarray(base, carry.regulator.cost_to_go.dtype)))
        state, torque = regulator.regulate(JAX, self, carry.regulator, held, x)
        regulated = torque.astype(u.dtype) * jnp.array(self.robot.actuation, u.dtype)
        return RegulatorMemory(state, inner), jnp.where(state.acting, regulated, u)

    def advanced(self, P: Float[Array, "10"], step: Discrete) -> Float[Array, "10"]:
        """P after the steps of one call."""
        weights, torque_weight = self.settings.step_weights

        def advance(_: int, P: Float[Array, "10"]) -> Float[Array, "10"]:
            rows = _riccati(_symmetric(P), step, weights, torque_weight)
            return jnp.stack([value for row in rows for value in row])

        return jax.lax.fori_loop(0, self.settings.riccati_steps, advance, P)

    def cost(self, P: Float[Array, "10"], e: Vector) -> Scalar:
        """The cost-to-go eᵀ P e."""
        found: Scalar = dot(e, symmetric_times(_symmetric(P), e))
        return found

    def command(self, P: Float[Array, "10"], step: Discrete, e: Vector) -> Scalar:
        """The torque -K e (N m)."""
        found: Scalar = -dot(_gains(_symmetric(P), step, self.settings.step_weights[1]), e)
        return found


def with_regulator(
    controller: AbstractController[Any], robot: Robot, plant: Plant, settings: RegulatorSettings, limit: float
) -> RegulatingController:
    """Put a regulator for a plant behind a policy.

    Args:
        controller: the policy.
        robot: which joint is driven.
        plant: its own plant.
        settings: weights, recursion and bounds.
        limit: largest torque of the regulator (N m).
    """
    start, base = fixed_point(plant, robot.joint, settings)[TRIANGLE], base_parameters(plant)
    return RegulatingController(controller, base, start, limit, geometry_of(plant), settings, robot)


def _symmetric(triangle: Float[Array, "10"]) -> Matrix:
    """Rows from the diagonal on."""
    values = unpack(triangle)
    return values[:4], values[4:7], values[7:9], values[9:]


def _riccati(P: Matrix, step: Discrete, weights: tuple[float, ...], torque_weight: float) -> Matrix:
    """P ← Q + Aᵀ P A - (Aᵀ P b)(Aᵀ P b)ᵀ / (R + bᵀ P b)."""
    columns = tuple(zip(*step.a, strict=True))
    moved, pushed = [symmetric_times(P, column) for column in columns], symmetric_times(P, step.b)
    coupled = [dot(step.b, column) for column in moved]
    share = 1.0 / (torque_weight + dot(step.b, pushed))

    def entry(i: int, j: int) -> Number:
        value = dot(columns[i], moved[j]) - share * coupled[i] * coupled[j]
        return value + weights[i] if i == j else value

    return tuple(tuple(entry(i, j) for j in range(i, 4)) for i in range(4))


def _gains(P: Matrix, step: Discrete, torque_weight: float) -> Vector:
    """K = bᵀ P A / (R + bᵀ P b)."""
    pushed = symmetric_times(P, step.b)
    share = 1.0 / (torque_weight + dot(step.b, pushed))
    return tuple(share * dot(pushed, column) for column in zip(*step.a, strict=True))
