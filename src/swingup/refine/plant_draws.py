"""Plants to learn on, drawn about the leaderboards': none of them is on the grid of model errors, which judges."""

from dataclasses import dataclass

import jax
import numpy as np

from ..benchmark.grid import vary
from ..benchmark.rules import ROBUSTNESS_RULES, ModelSweep
from ..physics.parameters import Parameters, Robot, leaderboard_parameters

SWEEPS = ROBUSTNESS_RULES["v2"].model
"""The parameters that change, and their ranges."""


@dataclass(frozen=True)
class PlantDraws:
    """How many plants of each kind are drawn."""

    single: int = 160
    """One parameter is off, anywhere in its range."""
    joint: int = 160
    """All are off, each within ``share`` of its range."""
    friction: int = 120
    """The passive joint has friction, up to the end of its range: Coulomb friction in two of three, damping in the
    third. In half of them all parameters are off as well, each within ``friction_share`` of its range."""
    share: float = 0.5
    """Of the range about the nominal value."""
    friction_share: float = 0.35
    """The same where the passive joint has friction."""
    margin: float = 0.03
    """Part of a range by which a single parameter, and the friction, may lie beyond it."""

    @property
    def plants(self) -> int:
        """Of all kinds."""
        return self.single + self.joint + self.friction


def draw_plants(random: np.random.Generator, robot: Robot, draws: PlantDraws) -> Parameters:
    """Plants with leaves of shape (n,): single ones first, then joint ones, then those with friction.

    Args:
        random: source of the numbers.
        robot: which joint is driven.
        draws: how many of each kind.
    """
    nominal, names = leaderboard_parameters(robot), list(SWEEPS)
    plants = []
    for _ in range(draws.single):
        sweep = SWEEPS[names[random.integers(len(names))]]
        plants.append(vary(nominal, sweep, _anywhere(random, sweep, draws.margin)))
    for _ in range(draws.joint):
        plants.append(_all_off(random, nominal, draws.share))
    for index in range(draws.friction):
        # Friction where no motor acts is what fails most.
        name = f"{'b' if index % 3 == 2 else 'cf'}{2 - robot.joint}"
        sweep = SWEEPS[name]
        plant = nominal if index % 2 else _all_off(random, nominal, draws.friction_share)
        most = sweep.sweep.high * (1 + draws.margin)
        plants.append(vary(plant, sweep, random.uniform(0.0, most) - getattr(plant, name)))
    stacked: Parameters = jax.tree.map(lambda *values: np.array(values, np.float64), *plants)
    return stacked


def _all_off(random: np.random.Generator, nominal: Parameters, share: float) -> Parameters:
    plant = nominal
    for sweep in SWEEPS.values():
        middle = 1.0 if sweep.relative else 0.0
        drawn = middle + share * (random.uniform(sweep.sweep.low, sweep.sweep.high) - middle)
        plant = vary(plant, sweep, drawn)
    return plant


def _anywhere(random: np.random.Generator, sweep: ModelSweep, margin: float) -> float:
    low, high = sweep.sweep.low, sweep.sweep.high
    beyond = margin * (high - low)
    # A range that begins at 0 ends there: a rotor's inertia is never negative.
    return random.uniform(low - beyond if low else low, high + beyond)
