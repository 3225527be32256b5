"""A search for a swing-up: random first torques, optimised side by side on a coarse grid; the cheapest one wins.

An iteration from one guess may end in a local optimum that hangs. From many guesses some come up, where the torque
limit allows it; the search proves nothing where none does.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..errors import SwingupError
from .ilqr import ILQRSettings, Solution, solve
from .riccati_passes import Cost
from .transition import PendulumTransition


@dataclass(frozen=True)
class SearchSettings:
    """The grid, the guesses, and their optimisation."""

    settings: ILQRSettings
    steps: int = 300
    """Steps of the coarse grid."""
    starts: int = 8
    """Guesses."""
    amplitude: float = 1.0
    """Largest standard deviation of a guess's sines (N m)."""
    waves: tuple[float, ...] = (1.2, 2.4, 3.6, 4.8, 6.0)
    """Periods of the sines in the whole duration."""


SEARCH = SearchSettings(
    ILQRSettings(
        max_iterations=600,
        tolerance=1e-6,
        regularisation=1.0,
        min_regularisation=1e-6,
        max_regularisation=1e8,
        torque_limit=5.0,
        decrease=0.5,
        increase=3.0,
        step_sizes=(1.0, 0.3, 0.1, 0.03, 0.01),
    )
)
"""In C.1's units."""


def guesses(search: SearchSettings, seed: int) -> Float[np.ndarray, "starts n"]:
    """Random sums of slow sines, zero in the last fifth of the time (N m)."""
    random, time = np.random.default_rng(seed), np.linspace(0.0, 1.0, search.steps)
    shape = (search.starts, len(search.waves), 1)
    size = search.amplitude * random.uniform(0.0, 1.0, (search.starts, 1, 1)) * random.normal(size=shape)
    phase = random.uniform(0.0, 2 * np.pi, shape)
    waves = size * np.sin(2 * np.pi * np.array(search.waves)[:, None] * time + phase)
    torque: np.ndarray = waves.sum(axis=1) * (time < 0.8)
    return torque


def search_torques(
    transition: PendulumTransition, cost: Cost, search: SearchSettings, seed: int
) -> Float[np.ndarray, "n"]:
    """The torques of the cheapest optimised guess, on the coarse grid (N m); call it in 64-bit mode.

    Raises:
        SwingupError: no guess led to a finite cost.
    """
    found = _solve_all(transition, cost, jnp.asarray(guesses(search, seed)), search.settings)
    costs = np.asarray(found.cost)
    if not np.isfinite(costs).any():
        raise SwingupError(f"no first torque of seed {seed} leads to a finite cost: use another seed")
    return np.asarray(found.torque)[int(np.nanargmin(costs))]


@jax.jit(static_argnames="settings")
def _solve_all(
    transition: PendulumTransition, cost: Cost, torques: Float[Any, "starts n"], settings: ILQRSettings
) -> Solution:
    return jax.vmap(lambda torque: solve(transition, cost, jnp.zeros(4), torque, settings))(torques)
