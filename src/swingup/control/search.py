"""A search for a swing-up: random first torques, optimised side by side on a coarse grid; the cheapest one wins.

An iteration from one guess may end in a local optimum that hangs. From many guesses some come up, where the torque
limit allows it; the search proves nothing where none does.
"""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..errors import SwingupError
from ..physics.angles import UPRIGHT
from .ilqr import ILQRSettings, Solution, feedback_gains, solve
from .riccati_passes import Cost, forward
from .scalar_algebra import unpack
from .transition import PendulumTransition


@dataclass(frozen=True)
class SearchSettings:
    """The grid, the guesses, and their optimisation."""

    settings: ILQRSettings
    steps: int = 300
    """Steps of the coarse grid."""
    starts: int = 6
    """Guesses."""
    amplitude: float = 0.3
    """Largest standard deviation of a guess's sines (N m). Large guesses end in worse optima."""
    waves: tuple[float, ...] = (1.2, 2.4, 3.6, 4.8, 6.0)
    """Periods of the sines in the whole duration."""
    durations: tuple[float, ...] = (1.0, 1.5, 2.0)
    """Multiples of the problem's duration. The next one is tried where a motion does not end upright."""


SEARCH = SearchSettings(
    ILQRSettings(
        max_iterations=600,
        tolerance=1e-6,
        regularisation=10.0,
        min_regularisation=1e-6,
        max_regularisation=1e8,
        torque_limit=5.0,
        decrease=0.5,
        increase=3.0,
        step_sizes=(1.0, 0.3, 0.1, 0.03, 0.01),
    )
)
"""In C.1's units."""


@dataclass(frozen=True)
class Coarse:
    """A motion on the coarse grid."""

    states: Float[np.ndarray, "n+1 4"]
    torque: Float[np.ndarray, "n"]
    gains: Float[np.ndarray, "n 4"]
    """K of its feedback."""

    @property
    def miss(self) -> float:
        """Larger distance of an angle from upright in the end (rad)."""
        return float(np.abs(self.states[-1] - UPRIGHT)[:2].max())


def guesses(search: SearchSettings, seed: int) -> Float[np.ndarray, "starts n"]:
    """Random sums of slow sines, zero in the last fifth of the time (N m)."""
    random, time = np.random.default_rng(seed), np.linspace(0.0, 1.0, search.steps)
    shape = (search.starts, len(search.waves), 1)
    size = search.amplitude * random.uniform(0.0, 1.0, (search.starts, 1, 1)) * random.normal(size=shape)
    phase = random.uniform(0.0, 2 * np.pi, shape)
    waves = size * np.sin(2 * np.pi * np.array(search.waves)[:, None] * time + phase)
    torque: np.ndarray = waves.sum(axis=1) * (time < 0.8)
    return torque


def search(transition: PendulumTransition, cost: Cost, settings: SearchSettings, seed: int) -> Coarse:
    """The cheapest optimised guess on the coarse grid; call it in 64-bit mode.

    Raises:
        SwingupError: no guess led to a finite cost.
    """
    found, gains = _solve_all(transition, cost, jnp.asarray(guesses(settings, seed)), settings.settings)
    costs = np.asarray(found.cost)
    if not np.isfinite(costs).any():
        raise SwingupError(f"no first torque of seed {seed} leads to a finite cost: use another seed")
    best = int(np.nanargmin(costs))
    return Coarse(np.asarray(found.states)[best], np.asarray(found.torque)[best], np.asarray(gains)[best])


@eqx.filter_jit
def _solve_all(
    transition: PendulumTransition, cost: Cost, torques: Float[Any, "starts n"], settings: ILQRSettings
) -> tuple[Solution, Float[Any, "starts n 4"]]:
    def one(torque: Float[Any, "n"]) -> tuple[Solution, Float[Any, "n 4"]]:
        found = solve(transition, cost, jnp.zeros(4), torque, settings)
        return found, feedback_gains(transition, cost, found.states, found.torque)

    return jax.vmap(one)(torques)


def follow(
    coarse: Coarse, transition: PendulumTransition, cost: Cost, limit: float, steps: int
) -> Float[np.ndarray, "n"]:
    """The torques that follow a motion on a finer grid, where it alone would soon be left (N m).

    Args:
        coarse: the motion.
        transition: the finer one.
        cost: of the finer grid.
        limit: of the torque (N m).
        steps: of the finer grid, which lasts as long as the coarse one.
    """
    rows = len(coarse.torque)
    place = np.arange(steps) * rows / steps
    held = place.astype(int)
    states = np.stack([np.interp(place, np.arange(rows + 1), column) for column in coarse.states.T], axis=1)
    about = unpack(jnp.asarray(states)), unpack(jnp.asarray(coarse.gains[held]))
    rolled = _forward(transition, cost, unpack(jnp.zeros(4)), jnp.asarray(coarse.torque[held]), limit, about)
    return np.asarray(rolled.u)


_forward = eqx.filter_jit(forward)
