"""Domains: ranges of the parameters of a pendulum and its loop; each episode draws its own values.

A range of one value is a known fact; wider ranges are domain randomisation. The package's domains are files in
``tasks/domains``, with the source of every number.
"""

import dataclasses
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from ..checks import LARGEST, suggestion
from ..errors import SwingupError
from ..physics.parameters import NAMES, Parameters, Robot, identified_parameters, validated
from ..renamed import current_name
from ..text import one_line, quoted
from ..types import Key
from ..yaml_map import read_map
from .disturbance import Disturbance, Motor, Pushes

LOOP_DT = 0.002
"""Time of a step of loop and plant (s)."""

PLANT = tuple(name for name in NAMES if name not in ("tl1", "tl2"))
"""Parameters of the plant that a domain may set; the others are as identified."""

MASSES = ("m2", "l1", "r2", "I1", "I2", "Ir", "gr")
"""Parameters in the mass matrix, which must be positive definite for all their combinations."""

LOOP = {
    "torque_limit": 6.0, "passive_limit": 0.0, "delay": 0.0, "velocity_noise": 0.0, "torque_noise": 0.0,
    "response": 1.0, "rate_limit": 1e6, "ripple": 0.0, "ripple_periods": 36.0, "push": 0.0,
}  # fmt: skip
"""Values of the loop that a domain may set, and their defaults: a perfect loop."""

LARGEST_LOOP_VALUES = {"delay": 0.2, "response": 2.0, "velocity_noise": 10.0, "torque_noise": 10.0}
"""Beyond these, nothing can be controlled."""

PUSH_WIDTH = 0.05
"""Standard deviation of a push (s), the benchmark's shortest."""
PUSH_TIME = 2.0
"""The peak of an episode's push comes at most this long after its start (s)."""

SHIPPED = ("identified", "randomised")
"""Domains that the package ships."""


@dataclass(frozen=True)
class Domain:
    """A range of values, low to high, for everything about plant and loop; hashable."""

    ranges: tuple[tuple[str, float, float], ...]
    name: str = field(default="DOMAIN.yml", compare=False)
    """The name or the file that ``load_domain`` read. Not compared, so that equal ranges compile once."""

    def __post_init__(self) -> None:
        """Refuse what cannot work.

        Raises:
            SwingupError: a name is unknown, a range ends below its start, or a value makes no pendulum or loop.
        """
        for name, low, high in self.ranges:
            if name not in PLANT and name not in LOOP:
                known = (*PLANT, *LOOP)
                raise SwingupError(
                    f"unknown name {quoted(name)}: use some of {', '.join(known)}{suggestion(name, known)}"
                )
            if not low <= high:
                raise SwingupError(f"{name} = [{low:g}, {high:g}] must be a range from low to high")
            most = LARGEST_LOOP_VALUES.get(name, LARGEST)
            if name in LOOP and not 0 <= low <= high <= most:
                raise SwingupError(f"{name} = [{low:g}, {high:g}] must lie between 0 and {most:g}")
        # Draws may pair any ends of the masses' ranges, and some pairs make no pendulum though both ends alone do.
        # The other parameters stand alone: both ends are enough.
        plant = {name: (low, high) for name, low, high in self.ranges if name in PLANT}
        apart, identified = [name for name in MASSES if name in plant], identified_parameters()
        # dict.fromkeys: a range of one value has one end.
        corners = itertools.product(*(dict.fromkeys(plant[name]) for name in apart))
        for end, corner in itertools.product((0, 1), corners):
            values = {name: pair[end] for name, pair in plant.items()} | dict(zip(apart, corner, strict=True))
            validated(dataclasses.replace(identified, **values))

    @property
    def depth(self) -> int:
        """Number of states that the loop remembers, enough for the longest delay."""
        return whole_delay_steps({name: high for name, _, high in self.ranges}.get("delay", 0.0)) + 1

    def middle(self, name: str) -> float:
        """Middle of a range, or the default if the domain leaves the name out."""
        defaults = vars(identified_parameters()) | LOOP
        low, high = {each: (low, high) for each, low, high in self.ranges}.get(
            name, (defaults[name], defaults[name])
        )
        return 0.5 * (low + high)

    def __str__(self) -> str:
        """Its name and its ranges."""
        return f"{self.name} {self.as_dict()}"

    def as_dict(self) -> dict[str, list[float]]:
        """As JSON values."""
        return {name: [low, high] for name, low, high in self.ranges}

    def draw(self, key: Key, robot: Robot) -> tuple[Parameters, Disturbance]:
        """A plant and the disturbance of its loop, each number drawn evenly from its range."""
        value_key, push_key, noise_key = jax.random.split(key, 3)
        low = jnp.array([low for _, low, _ in self.ranges])
        high = jnp.array([high for _, _, high in self.ranges])
        drawn = jax.random.uniform(value_key, low.shape, low.dtype, low, jnp.maximum(high, low))
        values = dict(zip([name for name, _, _ in self.ranges], drawn, strict=True))
        loop = {name: values.get(name, jnp.asarray(default)) for name, default in LOOP.items()}
        limits = jnp.where(jnp.array(robot.actuation) > 0, loop["torque_limit"], loop["passive_limit"])
        plant = {name: value for name, value in values.items() if name in PLANT}
        parameters = dataclasses.replace(identified_parameters(), **plant, tl1=limits[0], tl2=limits[1])
        time, size = jax.random.uniform(push_key, (2, 2, 1))
        peak = loop["push"] * (2 * size - 1) * jnp.array(robot.actuation)[:, None]
        disturbance = Disturbance(
            velocity_noise=loop["velocity_noise"],
            torque_noise=loop["torque_noise"],
            response=loop["response"],
            # As whole_delay_steps, for a drawn delay.
            delay_steps=jnp.floor(loop["delay"] / LOOP_DT + 1e-4).astype(int),
            pushes=Pushes(PUSH_TIME * time, jnp.full((2, 1), PUSH_WIDTH), peak),
            # Two words for threefry; other implementations of JAX's keys have four.
            noise=jax.random.key_data(noise_key).astype(jnp.uint32)[-2:],
            motor=Motor(loop["rate_limit"], loop["ripple"], loop["ripple_periods"]),
        )
        return parameters, disturbance


def whole_delay_steps(delay: float) -> int:
    """Whole loop steps in a delay (s); 1e-4 of a step is added, since rounding may lose a whole one."""
    return int(delay / LOOP_DT + 1e-4)


def make_domain(content: Mapping[str, Any], name: str = "DOMAIN.yml") -> Domain:
    """A domain from values by name: a number, or a range of two.

    Raises:
        SwingupError: a name is unknown, or a value is none.
    """
    return Domain(tuple((each, *_range(each, value)) for each, value in content.items()), name)


def load_domain(source: str | Path) -> Domain:
    """A domain that the package ships, by its name, or a YAML file of ``name: value`` and ``name: [low, high]``.

    Raises:
        SwingupError: there is no such domain, the file cannot be read, or its content makes none.
    """
    source = current_name("domain", str(source))
    if source in SHIPPED:
        with resources.as_file(resources.files(__package__) / "domains" / f"{source}.yml") as path:
            return make_domain(read_map(path, "domain"), str(source))
    if not str(source).endswith((".yml", ".yaml")):
        near = suggestion(source, SHIPPED)
        raise SwingupError(f"unknown domain {quoted(source)}: use {', '.join(SHIPPED)} or a YAML file (.yml){near}")
    try:
        return make_domain(read_map(source, "domain"), str(source))
    except SwingupError as error:
        raise SwingupError(f"domain {one_line(source)}: {error}") from error


def _range(name: str, value: Any) -> tuple[float, float]:
    ends = value if isinstance(value, list | tuple) else [value, value]
    numbers = [number for number in map(_number, ends) if number is not None]
    if len(ends) != 2 or len(numbers) != 2:
        raise SwingupError(f"{name} = {quoted(value)} must be a number, or a range [low, high]")
    return numbers[0], numbers[1]


def _number(value: Any) -> float | None:
    """A number, or a text that is one: YAML's 4e-5 has no point."""
    try:
        return None if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
