"""What a policy is refined on: plants, disturbances and first states drawn at random, never those of the benchmark.

Ranges are those of the benchmark's rules, a little wider; every number drawn is new in every step.
"""

import dataclasses
import functools
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from ..benchmark.grid import delay_steps, vary
from ..benchmark.rollout import Scenario
from ..benchmark.rules import ROBUSTNESS_RULES, Sweep
from ..errors import SwingupError
from ..physics.angles import UPRIGHT
from ..physics.parameters import Parameters, Robot, leaderboard_parameters
from ..tasks.disturbance import Disturbance, Pushes, undisturbed
from ..tasks.throws import thrown_states

RULES = ROBUSTNESS_RULES["v2"]
PUSHES = 3
"""Pushes a joint that an episode has room for."""
DEPTH = delay_steps(RULES.delay.high, RULES.dt) + 2
"""States that are remembered for delays."""

KINDS = ("nominal", "model", "pushed", "measured", "anywhere", "thrown")
"""Kinds of episodes."""


@dataclass(frozen=True)
class Draws:
    """How many episodes of each kind are drawn for a step, and how widely."""

    nominal: int = 32
    """Hanging, on the nominal plant."""
    model: int = 64
    """One or two of the plant's parameters are wrong."""
    pushed: int = 16
    """One to three pushes on the driven joint, on the nominal plant."""
    measured: int = 8
    """One of velocity noise, torque noise, delay or a slow or hasty motor."""
    anywhere: int = 8
    """From any configuration, at velocities of up to some ``speed``."""
    thrown: int = 0
    """From where the throws of the global-policy score leave the pendulum."""
    widen: float = 1.1
    """Parameters of the plant are drawn from the benchmark's ranges times this."""
    speed: float = 8.0
    """Largest standard deviation of the first velocities of ``anywhere`` (rad/s)."""
    upright: float = 0.6
    """Share of the episodes of ``model`` and ``measured`` that start near upright."""
    start: float = 0.02
    """Largest standard deviation of the first states of all others (rad, rad/s)."""

    def __post_init__(self) -> None:
        """Refuse what cannot work.

        Raises:
            SwingupError: a value is negative, or no episode is left.
        """
        for name, value in vars(self).items():
            if not 0 <= value < 1e6:
                raise SwingupError(f"{name} = {value} must be a number from 0 on")
        if self.episodes < 1:
            raise SwingupError(f"no episodes: ask for some of {', '.join(KINDS)}")

    @property
    def episodes(self) -> int:
        """Episodes of a step."""
        return sum(getattr(self, kind) for kind in KINDS)


class Episodes(eqx.Module):
    """A batch of episodes."""

    scenario: Scenario
    x0: Float[Array | np.ndarray, "n 4"]
    nominal: Bool[Array | np.ndarray, "n"]
    """Whether the score itself counts in it."""


def draw(random: np.random.Generator, robot: Robot, draws: Draws, strength: float = 1.0) -> Episodes:
    """Draw the episodes of one step, shuffled, in single precision.

    Args:
        random: source of the numbers.
        robot: which joint is driven.
        draws: how many of each kind.
        strength: of all errors and disturbances, from 0 to 1.
    """
    plant = leaderboard_parameters(robot)
    thrown = thrown_states(random, plant, draws.thrown) if draws.thrown else ()
    kinds = [
        *[_nominal] * draws.nominal, *[_model] * draws.model, *[_pushed] * draws.pushed,
        *[_measured] * draws.measured, *[_anywhere] * draws.anywhere,
        *[functools.partial(_start, x0=x0) for x0 in thrown],
    ]  # fmt: skip
    episodes = [kinds[index](random, plant, draws, strength) for index in random.permutation(len(kinds))]
    return jax.tree.map(lambda *leaves: _single(np.stack([np.asarray(leaf) for leaf in leaves])), *episodes)


def _nominal(random: np.random.Generator, plant: Parameters, draws: Draws, strength: float) -> Episodes:
    return _episode(random, draws, plant, nominal=True)


def _model(random: np.random.Generator, plant: Parameters, draws: Draws, strength: float) -> Episodes:
    names = random.choice(list(RULES.model), random.integers(1, 3), replace=False)
    for name in names:
        model = RULES.model[name]
        value = _within(random, model.sweep, draws.widen * strength)
        plant = vary(plant, model, max(value, 0.0) if name == "Ir" else value)
    return _maybe_upright(random, draws, _episode(random, draws, plant))


def _pushed(random: np.random.Generator, plant: Parameters, draws: Draws, strength: float) -> Episodes:
    """Peaks from 0.5 s on, with time to recover between them."""
    rules, number = RULES.perturbations, random.integers(1, PUSHES + 1)
    least, most = rules.amplitude
    centre, width, amplitude = np.zeros(PUSHES), np.ones(PUSHES), np.zeros(PUSHES)
    centre[:number] = random.uniform(0.5, 1.3) + np.cumsum(random.uniform(0.8, 1.4, number)) - 0.8
    width[:number] = random.uniform(*rules.width, number)
    sizes = random.uniform(least - most, most - least, number)
    amplitude[:number] = strength * (sizes + np.copysign(least, sizes))
    pushes = Pushes(*(np.stack([row, row]) for row in (centre, width, amplitude)))
    return _episode(random, draws, plant, pushes=pushes)


def _measured(random: np.random.Generator, plant: Parameters, draws: Draws, strength: float) -> Episodes:
    name = random.choice(["velocity_noise", "delay", "torque_noise", "response"], p=[0.4, 0.4, 0.1, 0.1])
    sweep: Sweep = RULES.torque_response if name == "response" else getattr(RULES, name)
    value = random.uniform(sweep.low, sweep.high)
    value = 1.0 + strength * (value - 1.0) if name == "response" else strength * value
    disturbance: dict[str, Any] = {name: delay_steps(value, RULES.dt) if name == "delay" else value}
    return _maybe_upright(random, draws, _episode(random, draws, plant, **disturbance))


def _anywhere(random: np.random.Generator, plant: Parameters, draws: Draws, strength: float) -> Episodes:
    rates = strength * draws.speed * random.uniform() * random.normal(size=2)
    x0 = np.concatenate([random.uniform(-np.pi, np.pi, 2), rates])
    return _start(random, plant, draws, strength, x0)


def _start(
    random: np.random.Generator, plant: Parameters, draws: Draws, strength: float, x0: np.ndarray
) -> Episodes:
    episode = _episode(random, draws, plant)
    return Episodes(episode.scenario, x0, episode.nominal)


def _episode(
    random: np.random.Generator, draws: Draws, plant: Parameters, nominal: bool = False, **disturbance: Any
) -> Episodes:
    noise = random.integers(0, 2**32, 2, dtype=np.uint32)
    disturbed: Disturbance = dataclasses.replace(undisturbed(PUSHES), noise=noise, **disturbance)
    x0 = draws.start * random.uniform() * random.normal(size=4)
    return Episodes(Scenario(plant, disturbed), x0, np.asarray(nominal))


def _maybe_upright(random: np.random.Generator, draws: Draws, episode: Episodes) -> Episodes:
    if random.uniform() >= draws.upright:
        return episode
    x0 = UPRIGHT + random.uniform() * np.array([0.2, 0.2, 1.0, 1.0]) * random.normal(size=4)
    return Episodes(episode.scenario, x0, episode.nominal)


def _within(random: np.random.Generator, sweep: Sweep, widen: float) -> float:
    middle, half = (sweep.low + sweep.high) / 2, (sweep.high - sweep.low) / 2 * widen
    return random.uniform(middle - half, middle + half)


def _single(leaf: np.ndarray) -> np.ndarray:
    """Single precision for reals; delays and noise stay whole numbers."""
    if leaf.dtype.kind == "f":
        return leaf.astype(np.float32)
    return leaf.astype(np.int32) if leaf.dtype.kind == "i" else leaf
