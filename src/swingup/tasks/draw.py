"""Draws from a domain: one plant and the disturbance of its loop, each number evenly from its range."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..physics.plant import Plant
from ..plants.domain import PLANT, Domain
from ..plants.loop import CLOCK, DRIVE, LOOP_DT, SENSOR
from ..robots import Robot
from ..types import Key
from .clock import Clock
from .disturbance import Disturbance, Pushes
from .motors import Drive, Motor
from .sensor import Sensor

PUSH_WIDTH = 0.05
"""Standard deviation of a push (s), the benchmark's shortest."""
PUSH_TIME = 2.0
"""The peak of an episode's push comes at most this long after its start (s)."""

Values = dict[str, Float[Array, ""]]
"""Drawn numbers by name."""


def draw(domain: Domain, key: Key, robot: Robot) -> tuple[Plant, Disturbance]:
    """A plant and the disturbance of its loop, each number drawn evenly from its range in the domain."""
    value_key, push_key, noise_key = jax.random.split(key, 3)
    low = jnp.array([low for _, low, _ in domain.ranges])
    high = jnp.array([high for _, _, high in domain.ranges])
    drawn = jax.random.uniform(value_key, low.shape, low.dtype, low, jnp.maximum(high, low))
    given = dict(zip([name for name, _, _ in domain.ranges], drawn, strict=True))
    values = {name: jnp.asarray(value) for name, value in domain.defaults.items()} | given
    plant = {name: values[name] for name in PLANT if name in given}
    limits = _torque_limits(values, given, robot)
    parameters = dataclasses.replace(domain.base, **plant, tl1=limits[0], tl2=limits[1])
    disturbance = Disturbance(
        velocity_noise=values["velocity_noise"],
        torque_noise=values["torque_noise"],
        response=values["response"],
        # As whole_delay_steps, for a drawn delay.
        delay_steps=jnp.floor(values["delay"] / LOOP_DT + 1e-4).astype(int),
        pushes=_pushes(values, push_key, robot),
        # Two words for threefry; other implementations of JAX's keys have four.
        noise=jax.random.key_data(noise_key).astype(jnp.uint32)[-2:],
        motor=Motor(values["rate_limit"], values["ripple"], values["ripple_periods"]),
        sensor=_sensor(domain, values),
        clock=None if domain.names.isdisjoint(CLOCK) else Clock(values["late"], values["lateness"]),
        drive=None if domain.names.isdisjoint(DRIVE) else Drive(_joints(values, "gain"), values["lag"]),
    )
    return parameters, disturbance


def _joints(values: Values, name: str) -> Float[Array, "2"]:
    return jnp.stack([values[f"{name}1"], values[f"{name}2"]])


def _sensor(domain: Domain, values: Values) -> Sensor | None:
    """None where angles are exact and velocities the motors' own."""
    if domain.names.isdisjoint(SENSOR) and not domain.differences:
        return None
    return Sensor(_joints(values, "quantum"), _joints(values, "offset"), domain.differences)


def _torque_limits(values: Values, given: Values, robot: Robot) -> Float[Array, "2"]:
    """Of both motors (N m): the driven one's is the plant's own where the domain gives none."""
    driven = given.get("torque_limit", _joints(values, "tl"))
    return jnp.where(jnp.array(robot.actuation) > 0, driven, values["passive_limit"])


def _pushes(values: Values, key: Key, robot: Robot) -> Pushes:
    """One push on each joint, at a time and with a peak that are drawn."""
    time, size = jax.random.uniform(key, (2, 2, 1))
    driven = jnp.array(robot.actuation)[:, None]
    # Multiplied first: the draws of domains without a push on the passive joint keep their bits.
    peak = values["push"] * (2 * size - 1) * driven + values["passive_push"] * (2 * size - 1) * (1 - driven)
    return Pushes(PUSH_TIME * time, jnp.full((2, 1), PUSH_WIDTH), peak)
