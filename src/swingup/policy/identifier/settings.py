"""What the identifier expects of the plant, the measurement and the torques; all is chosen, not identified."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from ...common.errors import SwingupError
from ...common.settings import Range, Settings
from ...plant.base_parameters import BASE, base_covariance, base_parameters
from ...plant.plant import Plant
from ...plant.units import TORQUE

UNKNOWNS = BASE + 4
"""The base parameters, and behind them what the constants below are the places of."""
TILT1, TILT2 = BASE, BASE + 1
"""κ1 = k o1 and κ2 = m2 r2 (o1 + o2) (kg m), for measured angles that are o1 and o2 (rad) too large."""
LAG = BASE + 2
"""The torque's lag (s) behind the delay that the identifier is told."""
GAIN = BASE + 3
"""Part of its command that the undriven joint's motor delivers."""
LOADS = UNKNOWNS + 4
"""Behind them, where loads are expected: constant torques against both joints (N m) and springs (N m/rad)."""

SPAN_TIME = 0.008
"""Time between the three angles of a row (s): rates resolve the encoder's step over it."""
BANDWIDTH = 60.0
"""Bandwidth of each pole of the low-pass on both sides of the equation (rad/s). Rows in the time that it takes have
errors that are alike and count as one."""
POLES = 3
"""First-order low-passes in a row: second differences of an encoder's steps need three."""
PASSIVE_DEVIATION, PASSIVE_FLOOR = 0.012, 0.005
"""First and least standard deviation of what an undriven joint's low-passed row leaves unexplained (N m)."""
DRIVEN_DEVIATION, DRIVEN_FLOOR = 0.04, 0.01
"""The same for the driven joint, whose motor is noisy and is pushed."""
RELATIVE_FLOOR = 0.002
"""Part of a floor that grows with the size of a row's terms: errors of the discretisation."""
MOST_DEVIATION = 10.0
"""Largest deviation that the residuals of a row raise its own to, in first ones."""
RISE_TIME, FALL_TIME = 0.02, 0.1
"""Times in which the deviation follows larger residuals and smaller ones (s)."""
GATE_SIGMAS = 3.0
"""Residuals of more than this many of their standard deviations are pushes."""
GATE_HOLD = 0.1
"""Time after a push in which its row is not used (s)."""
STUDENT = 4.0
"""ν: degrees of freedom of the errors' distribution."""
LAG_DEVIATION = 0.01
"""Standard deviation of the torque's lag (s)."""
OFFSET_DEVIATION = 0.03
"""Standard deviation of the angles' offsets (rad)."""
GAIN_DEVIATION = 0.5
"""Standard deviation of the part of its command that the undriven joint's motor delivers; its mean is 1."""
DRIFT = 0.01
"""Drift of the unknowns, in prior standard deviations after 1 s."""
LEAST_MASS_SHARE = 0.2
"""The identified mass matrix is at least this share of the nominal one, in every configuration."""
MOST_OFFSET = 0.1
"""Largest offset of an angle that is believed (rad)."""
LARGEST_ANGLE = 1e6
"""An angle beyond this is not a measurement (rad): its digits do not tell the turn."""
UNEVEN_STEP = 1e-3
"""Angle (rad) by which a call's motion may miss what the time since the last call explains."""
UNEVEN_FADING = 0.9995
"""Factor on what was missed, at each call."""
NOISE_TIME = 0.05
"""Time in which the noise of the angles is followed (s)."""
MOST_NOISE = 1e-3
"""Largest standard deviation of an angle's noise (rad)."""
EVEN_STEPS = 0.1
"""Steps that differ by less, in periods, are even: the noise shows in them."""
AGE_CAUTION = 4.0
"""Evidence that it takes to believe that angles are a call old, or that they are not."""
LONGEST_STEP = 4.0
"""A call that comes more than this many periods after the last one restarts estimator and identifier."""
SHORTEST_STEP = 0.6
"""A call that comes sooner, in periods, keeps the torques: rates would have nothing but the encoder's step."""


@dataclass(frozen=True)
class IdentifierSettings(Settings):
    """What a robot's owner may choose of the identifier; period and delays are the estimator's."""

    PART: ClassVar[str] = "identifier"
    passive_limit: Annotated[float, Range(0.0, 1e3), TORQUE] = 0.5
    """Largest torque that compensates the undriven joint's friction and load (N m); 0 for none."""
    load_deviation: Annotated[float, Range(0.0, 1e3), TORQUE] = 0.0
    """Standard deviation of a constant torque against each joint (N m)."""
    spring_deviation: Annotated[float, Range(0.0, 1e3), TORQUE] = 0.0
    """Standard deviation of the stiffness of a spring or cable at each joint, relaxed at 0 (N m/rad)."""


def span(period: float) -> int:
    """Steps between the three angles of a row, at a period between calls (s)."""
    return max(2, round(SPAN_TIME / period))


def commands(period: float, max_delay_steps: int) -> int:
    """Commands to remember. Angles may be a call old whatever the longest delay is."""
    return 2 * span(period) + max(max_delay_steps, 1)


def noise_gain(period: float) -> float:
    """Variance (1/s⁴) of a low-passed row's accelerations, for angles with white noise of variance 1."""
    half, keep = span(period), np.exp(-BANDWIDTH * period)
    low_pass = (1.0 - keep) * keep ** np.arange(round(20.0 / (BANDWIDTH * period)))
    response = np.zeros(2 * half + 1)
    response[[0, half, 2 * half]] = np.array([1.0, -2.0, 1.0]) / (half * period) ** 2
    for _ in range(POLES):
        response = np.convolve(response, low_pass)
    return float(response @ response)


def prior(plant: Plant, settings: IdentifierSettings | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n,) and covariance (n, n) of the unknowns before any measurement; n is 17 with loads, else 13."""
    s = settings or IdentifierSettings()
    deviations = s.load_deviation, s.load_deviation, s.spring_deviation, s.spring_deviation
    # Without loads each call is cheaper.
    loads = deviations if any(deviations) else ()
    size = UNKNOWNS + len(loads)
    mean, covariance = np.zeros(size), np.zeros((size, size))
    mean[:BASE] = base = base_parameters(plant)
    mean[GAIN] = 1.0
    covariance[:BASE, :BASE] = base_covariance(plant)
    second, first = base[2:4]
    if first == 0 or second == 0:
        raise SwingupError(
            f"a plant with m1 r1 + m2 l1 = {first:g} and m2 r2 = {second:g} kg m gives an identifier nothing to "
            "find the offsets by: give both links a centre of mass off their joint, or leave the identifier out"
        )
    # The unknowns are offsets times moments, in which the rows are linear.
    others = OFFSET_DEVIATION * first, OFFSET_DEVIATION * second, LAG_DEVIATION, GAIN_DEVIATION, *loads
    covariance[range(BASE, size), range(BASE, size)] = np.square(others)
    return mean, covariance


def offsets(tilt1: Any, tilt2: Any, theta: Any, clip: Callable[[Any, float, float], Any]) -> tuple[Any, Any]:
    """How much the measured angles are too large (rad), for tilts κ1 and κ2 (kg m) of any kind of number."""
    # κ2 belongs to the angle of link 2 in space, which both offsets spoil.
    both = clip(tilt2 / theta[2], -MOST_OFFSET, MOST_OFFSET)
    first = clip(tilt1 / theta[3], -MOST_OFFSET, MOST_OFFSET)
    return first, both - first
