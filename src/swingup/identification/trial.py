"""Trials of torque sequences on many plants at once, from hanging at rest: how far, how fast, and which states.

Delay and lag are left out: they shift the motion by milliseconds.
"""

import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..physics.implicit_friction import Friction, advance
from .prediction import NAMES, THREADS, Setting, lump_base
from .waves import PERIOD
from .windows import INTERVAL

LANES = 256
"""Motions that one call of the compiled program simulates."""


@dataclass(frozen=True)
class Trial:
    """Motions by sequence and plant."""

    states: Float[np.ndarray, "sequences plants intervals 4"]
    """From the start on, an interval apart."""
    angle: Float[np.ndarray, "sequences plants"]
    """Largest angle of a joint (rad); infinite where the motion diverged."""
    speed: Float[np.ndarray, "sequences plants"]
    """Largest speed of a joint (rad/s); likewise."""

    def holds(self, angle: float, speed: float) -> np.ndarray:
        """Whether each sequence stays within limits on all plants."""
        return np.all((self.angle <= angle) & (self.speed <= speed), axis=1)


def try_out(
    setting: Setting,
    models: Float[np.ndarray, "plants 15"],
    sequences: Float[np.ndarray, "sequences rows 2"],
    interval: float = INTERVAL,
) -> Trial:
    """Simulate every sequence on every plant.

    Args:
        setting: of the plants.
        models: of the plants.
        sequences: torques ``PERIOD`` apart (N m), which fill whole intervals.
        interval: time between the states that are kept (s).
    """
    count, plants = len(sequences), len(models)
    which, whose = (part.ravel() for part in np.divmod(np.arange(count * plants), plants))
    program = _compiled(setting, round(interval / PERIOD))
    found = in_chunks(LANES, len(which), lambda rows: program(models[whose[rows]], sequences[which[rows]]))
    states, angle, speed = (part.reshape(count, plants, *part.shape[1:]) for part in found)
    angle, speed = (np.nan_to_num(part, nan=np.inf) for part in (angle, speed))
    return Trial(np.nan_to_num(states, nan=0.0), angle, speed)


def in_chunks(size: int, count: int, run: Callable[[np.ndarray], Any]) -> list[np.ndarray]:
    """Run a compiled program on ``size`` rows of ``count`` at a time, on a thread for each core.

    The last chunk is filled up with the first row, so that the program compiles once.
    """

    def part(first: int) -> list[np.ndarray]:
        rows = np.arange(first, first + size)
        with jax.enable_x64(True):  # a setting of the thread
            found = run(np.where(rows < count, rows, 0))
        return [np.asarray(each)[: count - first] for each in found]

    with ThreadPoolExecutor(THREADS) as pool:
        parts = list(pool.map(part, range(0, count, size)))
    return [np.concatenate(each) for each in zip(*parts, strict=True)]


@functools.lru_cache(maxsize=4)
def _compiled(setting: Setting, every: int) -> Callable[..., Any]:
    substeps = round(PERIOD / setting.step)

    def simulate(model: Array, rows: Float[Array, "rows 2"]) -> Any:
        m = dict(zip(NAMES, model, strict=True))
        plant = lump_base(setting, m)
        friction = Friction((m["b1"], m["b2"]), (m["cf1"], m["cf2"]), setting.steepness)
        gains = jnp.stack([m["gain1"], m["gain2"]])

        def row(carry: Any, u: Array) -> Any:
            x, angle, speed = carry
            for _ in range(substeps):
                x = advance(plant, friction, x, (u[0], u[1]), setting.step)
            angle = jnp.maximum(angle, jnp.maximum(jnp.abs(x[0]), jnp.abs(x[1])))
            speed = jnp.maximum(speed, jnp.maximum(jnp.abs(x[2]), jnp.abs(x[3])))
            return (x, angle, speed), None

        def interval(carry: Any, u: Array) -> Any:
            return jax.lax.scan(row, carry, u)[0], jnp.stack(carry[0])

        torques = (rows * gains).reshape(-1, every, 2)
        zero = jnp.zeros(())
        (_, angle, speed), states = jax.lax.scan(interval, ((zero,) * 4, zero, zero), torques)
        return states, angle, speed

    return jax.jit(jax.vmap(simulate))
