"""Settings of the identifier of the plant's base parameters; every value is chosen, not identified.

In a policy file they are an object under the key ``identifier``, beside that of the estimator.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np

from ..common.errors import SwingupError
from ..common.settings import Range, check_ranges, read_settings
from ..plant.base_parameters import BASE, Spread, base_covariance, base_parameters
from ..plant.plant import Plant
from .settings import EstimatorSettings

UNKNOWNS = BASE + 4
"""The base parameters, and behind them what the constants below are the places of."""
TILT1, TILT2 = BASE, BASE + 1
"""κ1 = k o1 and κ2 = m2 r2 (o1 + o2) (kg m), for measured angles that are o1 and o2 (rad) too large."""
LAG = BASE + 2
"""The torque's lag (s) behind the delay that the identifier is told."""
GAIN = BASE + 3
"""Part of its command that the undriven joint's motor delivers."""
BENCHMARK = Spread()
"""The ranges of the robustness benchmark."""


@dataclass(frozen=True)
class IdentifierSettings:
    """What the identifier expects of the plant, the measurement and the torques."""

    PART: ClassVar[str] = "identifier"
    dt: Annotated[float, Range(1e-6, 0.1)] = 0.002
    """Time between calls (s)."""
    span: Annotated[int, Range(1, 50)] = 4
    """Steps between the three angles of a row: rates resolve the encoder's step over this time."""
    bandwidth: Annotated[float, Range(1e-6, 1e3)] = 60.0
    """Of each pole of the low-pass on both sides of the equation (rad/s)."""
    passive_deviation: Annotated[float, Range(1e-6, 1e3)] = 0.012
    """First standard deviation of what an undriven joint's low-passed row leaves unexplained (N m)."""
    passive_floor: Annotated[float, Range(1e-6, 1e3)] = 0.005
    """Its least value (N m)."""
    driven_deviation: Annotated[float, Range(1e-6, 1e3)] = 0.04
    """As ``passive_deviation``, for the driven joint, whose motor is noisy and is pushed."""
    driven_floor: Annotated[float, Range(1e-6, 1e3)] = 0.01
    """Its least value (N m)."""
    relative_floor: Annotated[float, Range(1e-6, 1.0)] = 0.002
    """Part of a floor that grows with the size of a row's terms: errors of the discretisation."""
    rise: Annotated[float, Range(1e-6, 1e3)] = 0.02
    """Time in which the deviation follows larger residuals (s)."""
    fall: Annotated[float, Range(1e-6, 1e3)] = 0.1
    """Time in which it follows smaller ones (s)."""
    gate: Annotated[float, Range(1e-6, 1e3)] = 3.0
    """Residuals of more than this many of their standard deviations are pushes."""
    hold: Annotated[float, Range(1e-6, 1e3)] = 0.1
    """Time after a push in which its row is not used (s)."""
    lag: Annotated[float, Range(1e-6, 1e3)] = 0.01
    """Standard deviation of the torque's lag (s)."""
    offset: Annotated[float, Range(1e-6, 1e3)] = 0.03
    """Standard deviation of the angles' offsets (rad)."""
    passive_gain: Annotated[float, Range(1e-6, 1e3)] = 0.5
    """Standard deviation of the part of its command that the undriven joint's motor delivers; its mean is 1."""
    passive_limit: Annotated[float, Range(0.0, 1e3)] = 0.5
    """Largest torque that compensates the undriven joint's friction (N m); 0 for none."""
    walk: Annotated[float, Range(1e-6, 1e3)] = 0.01
    """Drift of the unknowns, in prior standard deviations after 1 s."""
    margin: Annotated[float, Range(1e-6, 0.99)] = 0.2
    """The identified mass matrix is at least this share of the nominal one, in every configuration."""
    max_delay_steps: Annotated[int, Range(0, 1000)] = 25
    """Longest delay that the identifier is told (steps)."""
    spread: Spread = BENCHMARK
    """How far plants lie from the nominal one."""

    def __post_init__(self) -> None:
        """Refuse what cannot work.

        Raises:
            SwingupError: a value is no number of its range.
        """
        check_ranges(self)

    @property
    def pole(self) -> float:
        """Weight of the newest value in each of the three first-order low-passes."""
        return 1.0 - math.exp(-self.bandwidth * self.dt)

    @property
    def past(self) -> int:
        """Commands to remember. Angles may be a call old whatever the longest delay is."""
        return 2 * self.span + max(self.max_delay_steps, 1)

    @property
    def alike(self) -> float:
        """Successive low-passed rows that count as one observation, since their errors are alike."""
        return max(1.0, POLES / (self.bandwidth * self.dt))


POLES = 3
"""First-order low-passes in a row: second differences of an encoder's steps need three."""
STUDENT = 4.0
"""Degrees of freedom of the errors' distribution."""
MOST_DEVIATION = 10.0
"""Largest deviation that the residuals of a row raise its own to, in first ones."""
UNEVEN_STEP = 1e-3
"""Angle (rad) by which a call's motion may miss what the time since the last call explains."""
UNEVEN_FADING = 0.9995
"""Factor on what was missed, at each call."""
AGE_CAUTION = 4.0
"""Evidence that it takes to believe that angles are a call old, or that they are not."""
LONGEST_STEP = 4.0
"""A call that comes more than this many periods after the last one restarts the identifier."""
SHORTEST_STEP = 0.5
"""A shorter step counts as this many periods: rates would have nothing but the encoder's step."""
MOST_OFFSET = 0.1
"""Largest offset of an angle that is believed (rad)."""
FARTHEST = 1e6
"""An angle beyond this is no measurement (rad): its digits do not tell the turn."""


def prior(plant: Plant, settings: IdentifierSettings) -> tuple[np.ndarray, np.ndarray]:
    """Mean (13,) and covariance (13, 13) of the unknowns before anything is measured, from a nominal plant.

    Args:
        plant: the plant.
        settings: with deviations, and how far plants lie from the nominal one.
    """
    mean, covariance = np.zeros(UNKNOWNS), np.zeros((UNKNOWNS, UNKNOWNS))
    mean[:BASE] = base = base_parameters(plant)
    mean[GAIN] = 1.0
    covariance[:BASE, :BASE] = base_covariance(plant, settings.spread)
    second, first = base[2:4]
    if first == 0 or second == 0:
        raise SwingupError(
            f"a plant with m1 r1 + m2 l1 = {first:g} and m2 r2 = {second:g} kg m gives an identifier nothing to "
            "find the offsets by: give both links a centre of mass off their joint, or leave the identifier out"
        )
    others = settings.offset * first, settings.offset * second, settings.lag, settings.passive_gain
    covariance[range(BASE, UNKNOWNS), range(BASE, UNKNOWNS)] = np.square(others)
    return mean, covariance


def offsets(tilt1: Any, tilt2: Any, theta: Any, clip: Callable[[Any, float, float], Any]) -> tuple[Any, Any]:
    """How much the measured angles are too large (rad). Arithmetic for any kind of number.

    Args:
        tilt1: κ1 (kg m).
        tilt2: κ2.
        theta: the base parameters.
        clip: a number within bounds.
    """
    both = clip(tilt2 / theta[2], -MOST_OFFSET, MOST_OFFSET)
    first = clip(tilt1 / theta[3], -MOST_OFFSET, MOST_OFFSET)
    return first, both - first


def read_identifier(metadata: Mapping[str, Any], estimator: EstimatorSettings | None) -> IdentifierSettings | None:
    """The identifier's settings in a policy file's metadata; None if it has none.

    ``dt`` and ``max_delay_steps`` are the estimator's where the file leaves them out.

    Args:
        metadata: the file's.
        estimator: the file's.
    """
    given = metadata.get(IdentifierSettings.PART)
    if isinstance(given, Mapping) and estimator is not None:
        loop = {"dt": estimator.dt, "max_delay_steps": estimator.max_delay_steps}
        metadata = {IdentifierSettings.PART: {**loop, **given}}
    return read_settings(metadata, IdentifierSettings)


def default_identifier(estimator: EstimatorSettings) -> IdentifierSettings:
    """The defaults, with the loop of an estimator."""
    return replace(IdentifierSettings(), dt=estimator.dt, max_delay_steps=estimator.max_delay_steps)


def check_identifier(settings: IdentifierSettings, estimator: EstimatorSettings | None) -> None:
    """Refuse an identifier without an estimator, or with another period or shorter delays than its estimator's."""
    if estimator is None:
        raise SwingupError("identifier without an estimator: add estimator, {} for its defaults")
    if settings.dt != estimator.dt or settings.max_delay_steps < estimator.max_delay_steps:
        raise SwingupError(
            f"the identifier has dt = {settings.dt:g} s and max_delay_steps = {settings.max_delay_steps}, the "
            f"estimator {estimator.dt:g} s and {estimator.max_delay_steps}: give the identifier the estimator's"
        )
