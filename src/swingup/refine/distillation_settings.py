"""What a distillation is made of: plants, runs on them, and learning; every value is chosen."""

from dataclasses import dataclass

import numpy as np

from ..plant.base_parameters import BASE
from .objective import EpisodeWeights
from .plant_draws import GEAR, PlantDraws


@dataclass(frozen=True)
class RecoverySettings:
    """Recoveries whose cost ends a distillation, and how many of them begin where: shares of their sum."""

    episodes: int = 48
    """In each step."""
    duration: float = 1.5
    """Length of one (s)."""
    thrown: float = 0.5
    """After throws of the global-policy score."""
    nominal: float = 0.0
    """Part of these that is on the nominal plant."""
    robots: float = 0.0
    """After throws of the real robot's board: longer and weaker."""
    top: float = 0.5
    """Near the top, at small costs-to-go."""
    passing: float = 0.0
    """Passing over the top, too fast to stop there."""
    hanging: float = 0.0
    """Hanging."""
    weights: EpisodeWeights = EpisodeWeights(down=3.0, away=2.0, fast=30.0)  # noqa: RUF009 - frozen
    """Weights of the recoveries' measures, beside the squared errors of the torque (N² m²)."""


@dataclass(frozen=True)
class DistillationSettings:
    """The plants, the runs on them, and the supervised learning."""

    draws: PlantDraws = PlantDraws()  # noqa: RUF009 - frozen
    nominal: int = 80
    """Copies of the nominal plant beside them."""
    layers: tuple[int, ...] = (128, 128, 128)
    """Widths of the student's hidden layers."""
    tube: float = 0.5
    """Distance (``teacher.WEIGHTS``) from a plant's swing-up within which the swing-up teaches."""
    rounds: int = 4
    """The first is the teachers'."""
    runs: int = 8
    """On each plant in a round."""
    duration: float = 2.5
    """Length of a run (s)."""
    thrown: float = 0.5
    """Share of the runs that begin after a throw or hanging still at an angle."""
    still: float = 0.3
    """Share of these that hang still, where a constant torque may hold the plant for good."""
    own: float = 0.8
    """Share of the runs in which the student acts, after the first round."""
    failing: float = 0.3
    """Share of a round's runs, after the first, on plants that the student does not swing up when told them."""
    noise: float = 0.6
    """Twice the standard deviation of the torques' noise on each joint in the roughest runs (N m)."""
    slowest: float = 0.4
    """Longest time in which the student's plant goes from the nominal one to the run's (s)."""
    steps: int = 80_000
    """Steps of Adam in the first and the last round; half as many in the others."""
    learning_rate: float = 1.5e-3
    """In the first round, 0.6 of it in the others; it falls to 0 on a cosine."""
    batch: int = 2048
    """States of runs in a minibatch."""
    outside_weight: float = 0.15
    """Weight of a state outside the tube, beside 1 within."""
    anywhere: int = 60_000
    """States from anywhere, with random velocities."""
    anywhere_batch: int = 256
    """States from anywhere in a minibatch."""
    anywhere_weight: float = 0.02
    """Weight of a state from anywhere."""
    score_steps: int = 1500
    """Steps after the last round in which the score's own gradient is added; 0 for none."""
    score_rate: float = 3e-4
    """Adam's largest step size in them."""
    score_weight: float = 3.0
    """Weight of the score, beside the squared errors of the torque (N² m²)."""
    score_episodes: int = 6
    """Swing-ups of the nominal plant in each of these steps."""
    score_duration: float = 1.8
    """Length of one swing-up (s)."""
    recoveries: RecoverySettings | None = RecoverySettings()
    """Recoveries on plants that the student is told, in each of these steps; None for none."""


def plant_scale(nominal: np.ndarray, gear: float = GEAR) -> np.ndarray:
    """Units of the base parameters (9,) for a network: of the inertial ones shares of the nominal value.

    What a rotor's inertia moves grows with the square of its gear ratio.
    """
    shares = np.append(nominal[:4], np.ones(BASE - 4))
    return shares * np.array([0.15, 0.15, 0.15, 0.15, 0.06, 0.06, 0.12, 0.12, 8e-5 * (GEAR / gear) ** 2])
