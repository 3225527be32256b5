"""The regulator of ``policy/regulator.py`` in JAX: a controller around a policy."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.types import Scalar, State, Torque
from ...plant.base_parameters import Geometry, base_parameters
from ...plant.equations import Number
from ...plant.plant import Plant, Robot
from ...plant.units import BASE_UNITS, STATE, TORQUE, Scales, arm_scales
from ...policy import regulator
from ...policy.regulator import RICCATI_STEPS, Discrete, Loop, Q, R, RegulatorSettings, RegulatorState
from ..interface import AbstractController, AbstractPlantController, call_for_plant
from ..swingups.transition import Matrix, Vector, dot, symmetric_times, unpack
from .estimator import JAX

TRIANGLE = np.triu_indices(5)  # Rows and columns of what is remembered of P, row by row


class RegulatorMemory(NamedTuple):
    """What is remembered from call to call."""

    regulator: RegulatorState
    controller: Any  # What the policy remembers


class RegulatingController(AbstractPlantController[RegulatorMemory]):
    """A policy, and near the top the linear quadratic regulator."""

    wraps: ClassVar[bool] = True

    controller: AbstractController[Any]  # The policy; it is called always
    base: Float[Any, "9"]  # θ of the plant that it holds, where a call does not say
    start: Float[np.ndarray, "15"]  # P at first, its upper triangle; this and what follows are in C.1's units
    torque_limit: float  # Largest torque of the regulator
    geometry: Geometry = eqx.field(static=True)
    settings: RegulatorSettings = eqx.field(static=True)
    scales: Scales = eqx.field(static=True)  # The plant's units
    robot: Robot = eqx.field(static=True)  # Which joint is driven

    @property
    def loop(self) -> Loop:
        """What the regulator knows."""
        known = self.settings, self.geometry, self.robot.joint, self.torque_limit
        return Loop(*known, self.start, advanced, cost, command)

    def init(self) -> RegulatorMemory:
        """The policy acts."""
        return RegulatorMemory(regulator.begin(JAX, self.loop), self.controller.init())

    def control(
        self, carry: RegulatorMemory, t: Scalar, x: State, base: Float[Any, "9"] | None
    ) -> tuple[RegulatorMemory, Torque]:
        """The torque of the one that acts (N m); NaN if the state is not finite."""
        # Without an identifier the plant is the file's.
        base = self.base if base is None else base
        # Always, so that a policy with a memory keeps it while the regulator acts.
        inner, u = call_for_plant(self.controller, carry.controller, t, x, base)
        base = jnp.asarray(base, carry.regulator.cost_to_go.dtype)
        theta, far = unpack(self.scales.similar(base, *BASE_UNITS)), carry.regulator.far
        held = regulator.held(JAX, self.loop, theta, far)
        seen = self.scales.similar(x, *STATE)
        state, torque = regulator.regulate(JAX, self.loop, carry.regulator, held, seen)
        # Selected, not multiplied: a NaN is the driven joint's alone.
        torques = self.scales.scaled(torque, TORQUE).astype(u.dtype)
        regulated = jnp.where(jnp.array(self.robot.actuation) > 0, torques, 0.0)
        return RegulatorMemory(state, inner), jnp.where(state.acting, regulated, u)


def with_regulator(
    controller: AbstractController[Any], robot: Robot, plant: Plant, settings: RegulatorSettings, limit: float
) -> RegulatingController:
    """Put a regulator for a plant, with a largest torque (N m), behind a policy."""
    made = regulator.make_loop(settings, plant, robot.joint, limit, lambda P: P[TRIANGLE], advanced, cost, command)
    known = made.start, made.torque_limit, made.geometry, made.settings
    return RegulatingController(controller, base_parameters(plant), *known, arm_scales(plant), robot)


def advanced(P: Float[Array, "15"], step: Discrete) -> Float[Array, "15"]:
    """P after the steps of one call."""

    def advance(_: int, P: Float[Array, "15"]) -> Float[Array, "15"]:
        return jnp.stack([value for row in _riccati(_symmetric(P), step) for value in row])

    return jax.lax.fori_loop(0, RICCATI_STEPS, advance, P)


def cost(P: Float[Array, "15"], e: Vector) -> Scalar:
    """The cost-to-go eᵀ P e."""
    error = (*e, 0.0)
    found: Scalar = dot(error, symmetric_times(_symmetric(P), error))
    return found


def command(P: Float[Array, "15"], step: Discrete, e: Vector) -> Scalar:
    """The torque -K [e, f] (N m), K = bᵀ P A / (R + bᵀ P b)."""
    columns, b = _columns(step)
    pushed = symmetric_times(_symmetric(P), b)
    share = 1.0 / (R + dot(b, pushed))
    gains = tuple(share * dot(pushed, column) for column in columns)
    found: Scalar = -dot(gains, e)
    return found


def _columns(step: Discrete) -> tuple[tuple[Vector, ...], Vector]:
    """The columns of [A d; 0 1], and b, of [e, f]."""
    rates = tuple((*column, 0.0) for column in zip(*step.a, strict=True))
    return (*rates, (*step.d, 1.0)), (*step.b, 0.0)


def _symmetric(triangle: Float[Array, "15"]) -> Matrix:
    """Rows from the diagonal on."""
    values = unpack(triangle)
    return values[:5], values[5:9], values[9:12], values[12:14], values[14:]


def _riccati(P: Matrix, step: Discrete) -> Matrix:
    """P ← Q + Aᵀ P A - (Aᵀ P b)(Aᵀ P b)ᵀ / (R + bᵀ P b)."""
    columns, b = _columns(step)
    moved, pushed = [symmetric_times(P, column) for column in columns], symmetric_times(P, b)
    coupled = [dot(b, column) for column in moved]
    share = 1.0 / (R + dot(b, pushed))

    def entry(i: int, j: int) -> Number:
        value = dot(columns[i], moved[j]) - share * coupled[i] * coupled[j]
        return value + Q[i] if i == j else value

    rows = [tuple(entry(i, j) for j in range(i, 5)) for i in range(4)]
    return (*rows, (jnp.zeros_like(rows[0][0]),))
