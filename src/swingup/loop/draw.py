"""Draws from a domain: one plant and the disturbance of its loop, each number uniform on its range."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from ..common.types import Key
from ..plant.plant import Plant, Robot
from .disturbance import Disturbance, Pushes
from .domain import Domain, PlantInLoop
from .loop import Loop

PUSH_WIDTH = 0.05
"""Standard deviation of a push (s), the benchmark's shortest."""
PUSH_TIME = 2.0
"""The peak of an episode's push comes at most this long after its start (s)."""


def draw(domain: Domain, key: Key, robot: Robot) -> tuple[Plant, Disturbance]:
    """A plant and the disturbance of its loop, each number uniform on its range in the domain."""
    value_key, push_key, noise_key = jax.random.split(key, 3)
    plant, loop = _draw_values(domain, value_key)
    driven = jnp.array(robot.actuation)
    limits = jnp.where(driven > 0, jnp.stack([plant.tl1, plant.tl2]), loop.passive_limit)
    disturbance = Disturbance(
        loop,
        # As whole_steps, for a drawn delay.
        delay_steps=jnp.floor(loop.delay / loop.period + 1e-4).astype(int),
        pushes=_pushes(loop, push_key, robot),
        # Two words for threefry; other implementations of JAX's keys have four.
        noise=jax.random.key_data(noise_key).astype(jnp.uint32)[-2:],
        effects=domain.effects,
    )
    return dataclasses.replace(plant, tl1=limits[0], tl2=limits[1]), disturbance


def _draw_values(domain: Domain, key: Key) -> PlantInLoop:
    ends, order = (domain.low, domain.high), np.array(domain.order)
    low, high = (jnp.array(jax.tree.leaves(end))[order] for end in ends)
    drawn = jax.random.uniform(key, low.shape, low.dtype, low, jnp.maximum(high, low))
    values: PlantInLoop = jax.tree.unflatten(jax.tree.structure(domain.low), list(drawn[np.argsort(order)]))
    return values


def _pushes(loop: Loop, key: Key, robot: Robot) -> Pushes:
    """One push on each joint, at a time and with a peak that are drawn."""
    time, size = jax.random.uniform(key, (2, 2, 1))
    driven = jnp.array(robot.actuation)[:, None]
    # Multiplied first: the draws of domains without a push on the passive joint keep their bits.
    peak = loop.push * (2 * size - 1) * driven + loop.passive_push * (2 * size - 1) * (1 - driven)
    return Pushes(PUSH_TIME * time, jnp.full((2, 1), PUSH_WIDTH), peak)
