"""The identifier of ``policy/identifier.py`` in JAX."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.types import Count, Scalar, Torque
from ...plant.base_parameters import Geometry, Spread, geometry_of
from ...plant.plant import Plant
from ...plant.robots import Robot
from ...policy import identifier
from ...policy.identifier import Found, IdentifierState
from ...policy.identifier_settings import IdentifierSettings, prior
from .maths import JAX


class Identifier(eqx.Module):
    """Identifies the plant of one loop: ``init``, ``observe`` at each measurement, ``remember`` each command."""

    mean: Float[Any, "13"]
    """θ of the nominal plant, no offsets, no lag, and a gain of 1."""
    covariance: Float[Any, "13 13"]
    """Prior covariance."""
    geometry: Geometry = eqx.field(static=True)
    settings: IdentifierSettings = eqx.field(static=True)
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""

    @property
    def joint(self) -> int:
        """Index of the driven joint."""
        return self.robot.joint

    def init(self) -> IdentifierState:
        """Nothing seen yet."""
        return identifier.begin(JAX, self)

    def restart(self, memory: IdentifierState) -> IdentifierState:
        """After a pause: what was found stays, the motion before is forgotten."""
        return identifier.restart(JAX, self, memory)

    def remember(self, memory: IdentifierState, u: Torque) -> IdentifierState:
        """Note the torques that both motors were asked for, the driven one within its limit (N m)."""
        return identifier.remember(JAX, memory, u)

    def observe(
        self, memory: IdentifierState, q: Float[Array, "2"], delay_steps: Count, step: Scalar
    ) -> IdentifierState:
        """Learn from measured angles.

        Args:
            memory: of the calls before.
            q: angles (rad), whole turns aside.
            delay_steps: how old they are (steps).
            step: time since the last call (s); of no meaning after a restart.
        """
        # In the memory's own types: a compiled loop keeps the types of its carry.
        delay_steps = jnp.asarray(delay_steps, memory.delay_steps.dtype)
        return identifier.observe(JAX, self, memory, q, delay_steps, jnp.asarray(step, memory.steps.dtype))

    def found(self, memory: IdentifierState) -> Found:
        """What it has found of the plant."""
        return identifier.found(JAX, self, memory)

    def deviation(self, memory: IdentifierState) -> Float[Array, "13"]:
        """Standard deviations of the unknowns, relative to the prior's: 1 is unknown, 0 is sure."""
        least = jnp.diagonal(memory.covariance) / jnp.diagonal(jnp.asarray(self.covariance))
        return jnp.sqrt(jnp.clip(least, 0.0, 1.0))


def make_identifier(
    robot: Robot,
    plant: Plant,
    settings: IdentifierSettings | None = None,
    spread: Spread | None = None,
) -> Identifier:
    """An identifier about a nominal plant.

    Args:
        robot: which joint is driven.
        plant: the nominal plant; its lengths, gear ratio and gravity are taken as known.
        settings: what to expect of the measurement and the torques.
        spread: how far plants lie from the nominal one; None for that of the settings.
    """
    settings = IdentifierSettings() if settings is None else settings
    settings = settings if spread is None else replace(settings, spread=spread)
    mean, covariance = prior(plant, settings)
    return Identifier(mean, covariance, geometry_of(plant), settings, robot)
