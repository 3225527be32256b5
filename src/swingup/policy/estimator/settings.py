"""Settings of the estimator, and the gains of its filters."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from ...common.riccati import solve_riccati
from ...common.settings import Range, Settings
from ...plant.plant import Plant
from ...plant.units import ACCELERATION, VELOCITY, arm_scales, scaled

POSITION_NOISE = 1e-4
"""Standard deviation of the measured angles (rad): that of an encoder of 2^14 counts is 1.1e-4."""


@dataclass(frozen=True)
class EstimatorSettings(Settings):
    """What the estimator expects of the measurement and of the loop; every value is chosen, not identified.

    The defaults suit design C.1; :func:`default_estimator` scales them to another plant.
    """

    PART: ClassVar[str] = "estimator"
    dt: Annotated[float, Range(1e-6, 0.1)] = 0.002
    """Time between calls (s). After a pause of over four of them the estimator restarts from the measurement."""
    velocity_noise: Annotated[float, Range(1e-6, 1e3), VELOCITY] = 0.25
    """Standard deviation of the measured velocities (rad/s)."""
    acceleration_noise: Annotated[float, Range(1e-6, 1e3), ACCELERATION] = 50.0
    """Standard deviation of what the model does not know of the accelerations (rad/s²)."""
    max_delay_steps: Annotated[int, Range(0, 1000)] = 25
    """Longest delay of the loop that is considered (steps)."""
    longest_gap: Annotated[float, Range(0.0, 1e3)] = 0.05
    """Longest time for which the model stands in for a measurement that shows nothing new (s)."""


def default_estimator(plant: Plant) -> EstimatorSettings:
    """The defaults in a plant's own units: noise of velocities and accelerations; encoder and loop stay."""
    return scaled(EstimatorSettings(), arm_scales(plant))


def kalman_gains(settings: EstimatorSettings) -> np.ndarray:
    """Steady-state Kalman gains (2, 2) of one joint: a double integrator whose acceleration is unsure.

    K = P (P + R)⁻¹ with the solution P of P = A (P - K P) Aᵀ + Q, the covariance of a prediction. It is found for
    any noise by doubling: step k gives P after 2^k measurements.
    """
    dt = settings.dt
    # In units of the measured noise, so that R = I.
    scale = np.array([POSITION_NOISE, settings.velocity_noise])
    A = (np.array([[1.0, dt], [0.0, 1.0]]) * scale / scale[:, None]).T
    into = settings.acceleration_noise * np.array([0.5 * dt**2, dt]) / scale
    P = solve_riccati(A, np.eye(2), np.outer(into, into))
    return scale[:, None] * (P @ np.linalg.inv(P + np.eye(2))) / scale
