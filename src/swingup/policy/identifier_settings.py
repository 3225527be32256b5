"""Settings of the identifier of the plant's base parameters; every value is chosen, not identified."""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..checks import finite_number, whole_number
from ..physics.base_parameters import BASE, Spread, base_covariance, base_parameters

UNKNOWNS = BASE + 1
"""The base parameters, and the torque's lag (s) behind the delay that the identifier is told."""
LAG = BASE
"""Place of the lag."""


@dataclass(frozen=True)
class IdentifierSettings:
    """What the identifier expects of the plant, the measurement and the torques."""

    dt: float = 0.002
    """Time between calls (s)."""
    span: int = 4
    """Steps between the three angles of a row: rates resolve the encoder's step over this time."""
    bandwidth: float = 60.0
    """Of each pole of the low-pass on both sides of the equation (rad/s)."""
    passive_deviation: float = 0.03
    """First standard deviation of what an undriven joint's low-passed row leaves unexplained (N m)."""
    passive_floor: float = 0.02
    """Its least value (N m)."""
    driven_deviation: float = 0.12
    """As ``passive_deviation``, for the driven joint, whose motor is noisy and is pushed."""
    driven_floor: float = 0.03
    """Its least value (N m)."""
    relative_floor: float = 0.002
    """Part of a floor that grows with the size of a row's terms: errors of the discretisation."""
    rise: float = 0.02
    """Time in which the deviation follows larger residuals (s)."""
    fall: float = 0.5
    """Time in which it follows smaller ones (s)."""
    gate: float = 3.0
    """Residuals of more than this many of their standard deviations are pushes."""
    hold: float = 0.1
    """Time after a push in which its row is not used (s)."""
    lag: float = 0.01
    """Standard deviation of the torque's lag (s)."""
    walk: float = 0.01
    """Drift of the unknowns, in prior standard deviations after 1 s."""
    margin: float = 0.2
    """The identified mass matrix is at least this share of the nominal one, in every configuration."""
    max_delay_steps: int = 25
    """Longest delay that the identifier is told (steps)."""

    def __post_init__(self) -> None:
        """Refuse what cannot work.

        Raises:
            SwingupError: a value is no number of its range.
        """
        whole = {"span": (1, 50), "max_delay_steps": (0, 1000)}
        most = {"dt": 0.1, "margin": 0.99, "relative_floor": 1.0}
        for field in fields(self):
            name, value = f"identifier setting {field.name}", getattr(self, field.name)
            if field.name in whole:
                object.__setattr__(self, field.name, whole_number(name, value, *whole[field.name]))
            else:
                number = finite_number(name, value, 1e-6, most.get(field.name, 1000.0))
                object.__setattr__(self, field.name, number)

    @property
    def step(self) -> float:
        """Time between the three angles of a row (s)."""
        return self.span * self.dt

    @property
    def pole(self) -> float:
        """Weight of the newest value in each of the three first-order low-passes."""
        return 1.0 - math.exp(-self.bandwidth * self.dt)

    @property
    def alike(self) -> float:
        """Successive low-passed rows that count as one observation, since their errors are alike."""
        return max(1.0, POLES / (self.bandwidth * self.dt))


POLES = 3
"""First-order low-passes in a row: second differences of an encoder's steps need three."""


def prior(plant: Any, settings: IdentifierSettings, spread: Spread | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Mean (10,) and covariance (10, 10) of the unknowns before anything is measured, from a nominal plant.

    Args:
        plant: anything with the attributes of ``physics.parameters.Parameters``.
        settings: with the deviation of the lag.
        spread: how far plants lie from the nominal one; None for the ranges of the robustness benchmark.
    """
    covariance = np.zeros((UNKNOWNS, UNKNOWNS))
    covariance[:BASE, :BASE] = base_covariance(plant, Spread() if spread is None else spread)
    covariance[LAG, LAG] = settings.lag**2
    return np.append(base_parameters(plant), 0.0), covariance


def hat_weights(span: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights (2 span,) of the last torques, newest first: the hat's mean, and its change a step (1/step).

    The torque is held over each step, and the hat is integrated over it.
    """
    up = (np.arange(span) + 0.5) / span**2
    newer = np.full(span, 1.0 / span**2)
    return np.concatenate([up, up[::-1]]), np.concatenate([newer, -newer])
