"""Many plants at once, from hanging at rest: how far, how fast, and which states and torques.

The torque of a driven joint is a sequence's and a feedback's, within the limit:

    u = clip(tau + kp (q_ref - q) + kd (dq_ref - dq), -limit, limit)

Delay and lag are left out: they shift the motion by milliseconds.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...dynamics.implicit_friction import advance
from ...plant.base_parameters import friction_of, lumped
from ..fit.prediction import INDEX, Setting, in_chunks
from ..log.windows import INTERVAL
from .waves import PERIOD

LANES = 256
"""Motions that one call of the compiled program simulates."""


@dataclass(frozen=True)
class Sequences:
    """Torques and motions, with the feedback that all are played with; rows are ``PERIOD`` apart."""

    torque: Float[np.ndarray, "sequences rows 2"]
    """tau (N m)"""
    reference: Float[np.ndarray, "sequences rows 4"]
    """q_ref, dq_ref (rad, rad/s)"""
    feedback: Float[np.ndarray, "2 2"]
    """kp of both joints (N m/rad), kd of both (N m s/rad)."""
    limits: Float[np.ndarray, "2"]
    """N m; 0 on a joint that is not driven."""


@dataclass(frozen=True)
class Rollouts:
    """Motions by sequence and plant."""

    states: Float[np.ndarray, "sequences plants steps 4"]
    """From the start on: ``INTERVAL`` apart, or those of each row where torques are kept."""
    torque: Float[np.ndarray, "sequences plants rows 2"] | None
    """As asked for (N m), where they are kept."""
    angle: Float[np.ndarray, "sequences plants"]
    """Largest angle of a joint (rad); infinite where the motion diverged."""
    speed: Float[np.ndarray, "sequences plants"]
    """Largest speed of a joint (rad/s); likewise."""

    def holds(self, angle: float, speed: float) -> np.ndarray:
        """Whether each sequence stays within limits on all plants."""
        return np.all((self.angle <= angle) & (self.speed <= speed), axis=1)


def simulate(
    setting: Setting, models: Float[np.ndarray, "plants 15"], sequences: Sequences, keep: bool = False
) -> Rollouts:
    """Play every sequence on every plant.

    Args:
        setting: of the plants.
        models: of the plants.
        sequences: they fill whole intervals.
        keep: whether to keep the states and torques of each row.
    """
    count, plants = len(sequences.torque), len(models)
    which, whose = np.divmod(np.arange(count * plants), plants)
    program = _compiled(setting, 1 if keep else round(INTERVAL / PERIOD), keep)

    def run(rows: np.ndarray) -> Any:
        s = which[rows]
        played = sequences.torque[s], sequences.reference[s], sequences.feedback, sequences.limits
        return program(models[whose[rows]], *played)

    found = in_chunks(LANES, len(which), run)
    parts = [part.reshape(count, plants, *part.shape[1:]) for part in found]
    angle, speed = (np.nan_to_num(part, nan=np.inf) for part in parts[:2])
    torque = np.nan_to_num(parts[3], nan=0.0) if keep else None
    return Rollouts(np.nan_to_num(parts[2], nan=0.0), torque, angle, speed)


@functools.lru_cache(maxsize=4)
def _compiled(setting: Setting, every: int, keep: bool) -> Callable[..., Any]:
    substeps = round(PERIOD / setting.step)

    def rollout(model: Array, torque: Array, reference: Array, feedback: Array, limits: Array) -> Any:
        plant, friction = lumped(model, setting.geometry), friction_of(model)
        gains = jnp.stack([model[INDEX["gain1"]], model[INDEX["gain2"]]])

        def row(carry: Any, now: Any) -> Any:
            (x, angle, speed), (tau, ref) = carry, now
            u = tau + feedback[0] * (ref[:2] - jnp.stack(x[:2])) + feedback[1] * (ref[2:] - jnp.stack(x[2:]))
            u = jnp.clip(u, -limits, limits)
            acting = u * gains
            for _ in range(substeps):
                x = advance(plant, friction, x, (acting[0], acting[1]), setting.step, setting.steepness)
            angle = jnp.maximum(angle, jnp.maximum(jnp.abs(x[0]), jnp.abs(x[1])))
            speed = jnp.maximum(speed, jnp.maximum(jnp.abs(x[2]), jnp.abs(x[3])))
            return (x, angle, speed), u if keep else None

        def interval(carry: Any, now: Any) -> Any:
            after, u = jax.lax.scan(row, carry, now)
            return after, (jnp.stack(carry[0]), u)

        zero = jnp.zeros(())
        rows = torque.reshape(-1, every, 2), reference.reshape(-1, every, 4)
        (_, angle, speed), (states, u) = jax.lax.scan(interval, ((zero,) * 4, zero, zero), rows)
        return (angle, speed, states, u.reshape(-1, 2)) if keep else (angle, speed, states)

    return jax.jit(jax.vmap(rollout, (0, 0, 0, None, None)))
