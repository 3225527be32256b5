"""Many plants of a domain at once, from hanging at rest: how far, how fast, and which states and torques.

The torque of a driven joint is a sequence's and a feedback's, within the limit:

    u = clip(tau + kp (q_ref - q) + kd (dq_ref - dq), -limit, limit)

Delay and lag are left out: they shift the motion by milliseconds.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...dynamics.implicit_friction import implicit_step
from ...loop.domain import Domain
from ...plant.base_parameters import friction_of, lumped
from ...plant.plant import NAMES, Plant
from ..fit.prediction import INDEX, Integration, in_chunks, in_loop, vector_of
from .waves import PERIOD

LANES = 256
"""Motions that one call of the compiled program simulates."""


def draw_models(domain: Domain, count: int, seed: int) -> Float[np.ndarray, "count 15"]:
    """Models of plants and loops, uniform on the domain's ranges; the first is the middle of all ranges."""
    random = np.random.default_rng(seed)
    names = [name for name, _, _ in domain.ranges]
    low, high = (np.array([row[place] for row in domain.ranges]) for place in (1, 2))
    part = np.concatenate([np.full((1, len(names)), 0.5), random.random((count - 1, len(names)))])
    return np.stack([_model(domain, dict(zip(names, low + row * (high - low), strict=True))) for row in part])


def corner_models(domain: Domain) -> Float[np.ndarray, "corners 15"]:
    """Models of the plants at the ends of the domain's ranges, with the largest torque gains."""
    # A motor that delivers more than it is asked for moves the arm furthest.
    highest = {name: high for name, _, high in domain.ranges if name in ("gain1", "gain2")}
    return np.stack([_model(domain, highest, plant) for plant in domain.corners()])


def _model(domain: Domain, values: dict[str, float], plant: Plant | None = None) -> np.ndarray:
    """A model's vector; loop values that the domain does not have are typical ones."""
    own = {name: value for name, value in values.items() if name in NAMES}
    return in_loop(vector_of(domain.plant.changed(**own) if plant is None else plant), values)


class Sequences(NamedTuple):
    """Torques and motions, with the feedback that all are played with; rows are ``PERIOD`` apart."""

    torque: Float[np.ndarray, "sequences rows 2"]
    """tau (N m)"""
    reference: Float[np.ndarray, "sequences rows 4"]
    """q_ref, dq_ref (rad, rad/s)"""
    feedback: Float[np.ndarray, "2 2"]
    """kp of both joints (N m/rad), kd of both (N m s/rad)."""
    limits: Float[np.ndarray, "2"]
    """N m; 0 on a joint that is not driven."""


class Rollouts(NamedTuple):
    """Motions by sequence and plant."""

    angle: Float[np.ndarray, "sequences plants"]
    """Largest angle of a joint (rad); infinite where the motion diverged."""
    speed: Float[np.ndarray, "sequences plants"]
    """Largest speed of a joint (rad/s); infinite where the motion diverged."""
    states: Float[np.ndarray, "sequences plants rows 4"]
    """Before each row; empty where they are not kept."""
    torque: Float[np.ndarray, "sequences plants rows 2"]
    """Commands (N m); empty where they are not kept."""


def simulate(
    setting: Integration, models: Float[np.ndarray, "plants 15"], sequences: Sequences, keep: bool = False
) -> Rollouts:
    """Play every sequence on every plant; ``keep`` the states and torques of each row, which may need gigabytes."""
    count, plants = len(sequences.torque), len(models)
    which, whose = np.divmod(np.arange(count * plants), plants)
    program = _compiled(setting, keep)

    def run(rows: np.ndarray) -> Any:
        torque, reference, feedback, limits = sequences
        return program(models[whose[rows]], torque[which[rows]], reference[which[rows]], feedback, limits)

    found = in_chunks(LANES, len(which), run)
    parts = [part.reshape(count, plants, *part.shape[1:]) for part in found]
    reached = [np.nan_to_num(part, nan=np.inf) for part in parts[:2]]
    return Rollouts(*reached, *map(np.nan_to_num, parts[2:]))


@functools.lru_cache(maxsize=4)
def _compiled(setting: Integration, keep: bool) -> Callable[..., Any]:
    substeps = round(PERIOD / setting.step)

    def rollout(model: Array, torque: Array, reference: Array, feedback: Array, limits: Array) -> Any:
        plant, friction = lumped(model, setting.geometry), friction_of(model)
        gains = jnp.stack([model[INDEX["gain1"]], model[INDEX["gain2"]]])

        def row(carry: Any, now: Any) -> Any:
            (x, angle, speed), (tau, ref) = carry, now
            before = jnp.stack(x)
            u = tau + feedback[0] * (ref[:2] - before[:2]) + feedback[1] * (ref[2:] - before[2:])
            u = jnp.clip(u, -limits, limits)
            acting = u * gains
            for _ in range(substeps):
                x = implicit_step(plant, friction, x, (acting[0], acting[1]), setting.step, setting.steepness)
            angle = jnp.maximum(angle, jnp.maximum(jnp.abs(x[0]), jnp.abs(x[1])))
            speed = jnp.maximum(speed, jnp.maximum(jnp.abs(x[2]), jnp.abs(x[3])))
            return (x, angle, speed), (before, u) if keep else (before[:0], u[:0])

        zero = jnp.zeros(())
        (_, angle, speed), kept = jax.lax.scan(row, ((zero,) * 4, zero, zero), (torque, reference))
        return angle, speed, *kept

    return jax.jit(jax.vmap(rollout, (0, 0, 0, None, None)))
