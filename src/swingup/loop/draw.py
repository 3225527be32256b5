"""Draws from a domain: one plant and the disturbance of its loop, each number uniform on its range."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp

from ..common.types import Key
from ..plant.plant import NAMES, ZEROS, Plant, Robot
from .disturbance import Disturbance, Pushes
from .domain import Domain, PlantInLoop
from .loop import VALUES, Loop

PUSH_WIDTH = 0.05  # Standard deviation of a push (s), the benchmark's shortest
PUSH_TIME = 2.0  # The peak of an episode's push comes at most this long after its start (s)

DRAWN_FIRST = (
    "r1", "m1", "r2", "I1", "I2", "Ir", "b1", "b2", "cf1", "cf2", "tl1", "passive_limit", "gain1", "gain2", "lag",
    "delay", "late", "lateness", "quantum1", "quantum2", "offset1", "offset2",
)  # fmt: skip
"""The numbers to which a draw gives its first random values; the others follow in the order of their fields."""
ORDER = (*dict.fromkeys([*DRAWN_FIRST, *(name for name in NAMES if name not in ZEROS), *VALUES]), *ZEROS)
"""The place of each name among the random values of a draw. Another order, or a new number that is not the last
one here, would change the draws of all domains, and so the boards' scores."""


def draw(domain: Domain, key: Key, robot: Robot) -> tuple[Plant, Disturbance]:
    """A plant and the disturbance of its loop, each number uniform on its range in the domain."""
    value_key, push_key, noise_key = jax.random.split(key, 3)
    plant, loop = draw_values(domain, value_key)
    driven, motors = jnp.array(robot.actuation), jnp.stack([plant.tl1, plant.tl2])
    limits = jnp.where(driven > 0, motors, jnp.minimum(loop.passive_limit, motors))
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


def draw_values(domain: Domain, key: Key, margin: float = 0.0) -> PlantInLoop:
    """A plant and its loop, each number uniform on its range, and beyond both ends by a ``margin`` of the range.

    A number's random value depends on its name and the key alone, not on the domain's other numbers.
    """
    low, high = (jnp.array([end.value(name) for name in ORDER]) for end in (domain.low, domain.high))
    margins = margin * (high - low)
    drawn = jax.random.uniform(key, low.shape, low.dtype, low - margins, jnp.maximum(high, low) + margins)
    values: dict[str, Any] = dict(zip(ORDER, drawn, strict=True))
    plant = domain.low.plant.changed(**{name: values[name] for name in NAMES})
    return PlantInLoop(plant, dataclasses.replace(domain.low.loop, **{name: values[name] for name in VALUES}))


def vary(plant: Plant, parameter: str, value: float, relative: bool = False, mass: str | None = None) -> Plant:
    """The plant with a value added to a parameter, or the parameter multiplied by it where it is ``relative``.

    With a ``mass``, a parameter's name, it is the product of both that changes, as m1 r1.
    """
    if relative:
        factor = 1.0 if mass is None else getattr(plant, mass)
        # The benchmark varies m r and divides by m. Another order of operations would round differently.
        value = factor * getattr(plant, parameter) * value / factor
    else:
        # Added: the leaderboards' plant has 0 of what changes so, other plants have not.
        value = getattr(plant, parameter) + value
    return plant.changed(**{parameter: value})


def _pushes(loop: Loop, key: Key, robot: Robot) -> Pushes:
    """One push on each joint, with a drawn time and peak."""
    time, size = jax.random.uniform(key, (2, 2, 1))
    driven = jnp.array(robot.actuation)[:, None]
    # Multiplied first: the draws of domains without a push on the passive joint keep their bits.
    peak = loop.push * (2 * size - 1) * driven + loop.passive_push * (2 * size - 1) * (1 - driven)
    return Pushes(PUSH_TIME * time, jnp.full((2, 1), PUSH_WIDTH), peak)
