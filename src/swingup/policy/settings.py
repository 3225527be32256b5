"""Settings of the estimator, and the choice of a safety guard."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from ..common.settings import Range, check_ranges, read_settings
from ..plant.plant import Plant
from ..plant.units import ACCELERATION, VELOCITY, scaled, scales_of
from .guard import GUARD, GuardChoice
from .guard import GuardSettings as GuardSettings
from .riccati import solve_riccati

LOST = 100
"""An estimated rate this many standard deviations off the measured one is lost: the measurement has jumped."""
PIECES = 4
"""Steps in which the estimate is carried ahead over the delay."""


@dataclass(frozen=True)
class EstimatorSettings:
    """What the estimator expects of the measurement and of the loop; every value is chosen, not identified.

    The defaults suit design C.1; :func:`default_estimator` scales them to another plant.
    """

    PART: ClassVar[str] = "estimator"
    dt: Annotated[float, Range(1e-6, 0.1)] = 0.002
    """Time between calls (s). After a longer pause the estimator restarts from the measurement."""
    position_noise: Annotated[float, Range(1e-6, 1e3)] = 1e-4
    """Standard deviation of the measured angles (rad): that of an encoder of 2^14 counts is 1.1e-4."""
    velocity_noise: Annotated[float, Range(1e-6, 1e3), VELOCITY] = 0.25
    """Standard deviation of the measured velocities (rad/s)."""
    acceleration_noise: Annotated[float, Range(1e-6, 1e3), ACCELERATION] = 50.0
    """Standard deviation of what the model does not know of the accelerations (rad/s²)."""
    max_delay_steps: Annotated[int, Range(0, 1000)] = 25
    """Longest delay of the loop that is considered (steps)."""
    residual_scale: Annotated[float, Range(1e-6, 1e3)] = 1e-4
    """Far larger errors of a predicted angle count little more (rad): a push must not decide the delay."""
    caution: Annotated[float, Range(0.0, 1e3)] = 20.0
    """Log likelihood that a delay must gain for each step that it is longer."""
    memory: Annotated[float, Range(1e-6, 1e3)] = 5.0
    """Time in which evidence on the delay fades (s)."""

    def __post_init__(self) -> None:
        """Refuse what cannot work.

        Raises:
            SwingupError: a value is no number of its range.
        """
        check_ranges(self)


def default_estimator(plant: Plant) -> EstimatorSettings:
    """The defaults in a plant's own units: noise of velocities and accelerations; encoder and loop stay.

    Args:
        plant: the plant.
    """
    return scaled(EstimatorSettings(), scales_of(plant))


def kalman_gains(settings: EstimatorSettings) -> np.ndarray:
    """Steady-state Kalman gains (2, 2) of one joint: a double integrator whose acceleration is unsure.

    K = P (P + R)⁻¹ with the solution P of P = A (P - K P) Aᵀ + Q, the covariance of a prediction. It is found for
    any noise by doubling: step k gives P after 2^k measurements.
    """
    dt = settings.dt
    # In units of the measured noise, so that R = I.
    scale = np.array([settings.position_noise, settings.velocity_noise])
    A = (np.array([[1.0, dt], [0.0, 1.0]]) * scale / scale[:, None]).T
    into = settings.acceleration_noise * np.array([0.5 * dt**2, dt]) / scale
    P = solve_riccati(A, np.eye(2), np.outer(into, into))
    return scale[:, None] * (P @ np.linalg.inv(P + np.eye(2))) / scale


def default_guard(dt: float | None = None) -> GuardSettings:
    """The guard of a loop with ``dt`` (s) between calls; None for any. It bears ten missed or repeated calls."""
    if dt is None:
        return GuardSettings()
    return GuardSettings(dt=dt, longest_pause=10 * dt, stale_time=10 * dt, stuck_time=100 * dt)


def choose_guard(choice: GuardChoice, own: GuardSettings | None, dt: float | None) -> GuardSettings | None:
    """The guard that a caller chose for a policy; None for none.

    Args:
        choice: what the caller wants.
        own: the policy file's.
        dt: time between calls that the policy expects (s); None for any.
    """
    if choice is None or choice is False:
        return own if choice is None else None
    if isinstance(choice, GuardSettings):
        return choice
    return own or default_guard(dt) if choice is True else read_settings({GUARD: choice}, GuardSettings)
