"""A regulator that takes over from a policy near the top, for the plant as it is known now.

A recursion of the Riccati equation goes on by a few steps at each call, with the plant linearised upright for base
parameters θ: the cost-to-go P follows θ within a few calls. θ is the file's plant, or what an identifier tells. The
steps are those of ``docs/policy-format.md``. Neither time nor the number of calls enters.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...control.controller import AbstractController
from ...control.scalar_algebra import Matrix, Vector, dot, symmetric_times, unpack
from ...physics.angles import UPRIGHT, nearest
from ...physics.base_parameters import Geometry, base_parameters, geometry_of
from ...physics.equations import Number
from ...physics.plant import Plant
from ...robots import Robot
from ...types import Flag, Scalar, State, Torque
from ..regulator_settings import RegulatorSettings, bounds, fixed_point
from ..upright import Discrete, upright_step
from .maths import choose

TRIANGLE = np.triu_indices(4)
"""Rows and columns of what is remembered of P."""


class RegulatorMemory(eqx.Module):
    """What is remembered from call to call."""

    cost_to_go: Float[Array, "10"]
    """The upper triangle of P, row by row."""
    acting: Flag
    """Whether the regulator acts."""
    controller: Any
    """What the policy remembers."""


class RegulatingController(AbstractController[RegulatorMemory]):
    """A policy, and near the top u = -K e of the linear quadratic regulator."""

    controller: AbstractController[Any]
    """The policy; it is called always."""
    base: Float[Any, "9"]
    """θ in the order of ``physics.base_parameters.BASE_NAMES``."""
    start: Float[np.ndarray, "10"]
    """P at first, its upper triangle."""
    torque_limit: float
    """Largest torque of the regulator (N m)."""
    geometry: Geometry = eqx.field(static=True)
    settings: RegulatorSettings = eqx.field(static=True)
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""

    def init(self) -> RegulatorMemory:
        """The policy acts."""
        return RegulatorMemory(jnp.asarray(self.start), jnp.array(False), self.controller.init())

    def __call__(self, carry: RegulatorMemory, t: Scalar, x: State) -> tuple[RegulatorMemory, Torque]:
        """The torque of the one that acts (N m); NaN if the state is not finite."""
        inner, u = self.controller(carry.controller, t, x)
        step = self._plant(carry.cost_to_go.dtype)
        P = self._recursion(carry.cost_to_go, step)
        error = x - jnp.asarray(UPRIGHT, x.dtype)
        e = unpack(error.at[:2].set(nearest(error[:2])))
        rows, limit = _symmetric(P), self.torque_limit
        finite = jnp.isfinite(x).all()
        acting = self._acts(carry.acting, dot(e, symmetric_times(rows, e)), finite)
        torque = jnp.clip(-dot(_gains(rows, step, self.settings.step_weights[1]), e), -limit, limit)
        # The clip would make an infinite rate the largest torque.
        torque = jnp.where(finite, torque, jnp.nan)
        regulated = torque.astype(u.dtype) * jnp.array(self.robot.actuation, u.dtype)
        return RegulatorMemory(P, acting, inner), jnp.where(acting, regulated, u)

    def _plant(self, dtype: Any) -> Discrete:
        """One step of the recursion for θ."""
        s, theta = self.settings, unpack(jnp.asarray(self.base, dtype))
        return upright_step(theta, self.geometry, self.robot.joint, s.coulomb_damping, s.riccati_step)

    def _recursion(self, before: Float[Array, "10"], step: Discrete) -> Float[Array, "10"]:
        """P after the steps of one call."""
        weights, torque_weight = self.settings.step_weights

        def advance(_: int, P: Float[Array, "10"]) -> Float[Array, "10"]:
            rows = _riccati(_symmetric(P), step, weights, torque_weight)
            return jnp.stack([value for row in rows for value in row])

        P = jax.lax.fori_loop(0, self.settings.riccati_steps, advance, before)
        return choose(jnp.isfinite(P).all(), lambda: P, jnp.asarray(self.start, P.dtype))

    def _acts(self, acting: Flag, cost_to_go: Scalar, finite: Flag) -> Flag:
        """Hysteresis: it takes over at ``enter`` and gives up by ``leave``; what is not finite changes nothing."""
        enter, leave = bounds(self.settings, self.base, self.robot.joint)
        within = jnp.where(acting, cost_to_go <= leave, cost_to_go < enter)
        return jnp.where(finite, within, acting)


def with_regulator(
    controller: AbstractController[Any], robot: Robot, plant: Plant, settings: RegulatorSettings, limit: float
) -> RegulatingController:
    """Put a regulator for a plant behind a policy.

    Args:
        controller: the policy.
        robot: which joint is driven.
        plant: the plant until another one is told.
        settings: weights, recursion and bounds.
        limit: largest torque of the regulator (N m).

    Raises:
        SwingupError: no regulator holds the plant.
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
