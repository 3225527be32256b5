"""What an identifier knows of its loop, and what it remembers from call to call."""

from typing import Any, NamedTuple

from ...plant.base_parameters import Geometry, geometry_of
from ...plant.equations import Number, Pair
from ...plant.plant import Plant
from . import settings as chosen

Array = Any
"""An array of NumPy or JAX; shapes are in the comments."""


class Loop(NamedTuple):
    """What an identifier knows of its loop."""

    joint: int
    """Index of the driven joint."""
    period: float
    """Nominal time between calls (s)."""
    max_delay_steps: int
    """Longest delay that the identifier is told (steps)."""
    passive_limit: float
    """Largest torque that compensates the undriven joint's friction (N m); 0 for none."""
    geometry: Geometry
    """What is known of the plant's lengths and gears."""
    mean: Array
    """θ of the nominal plant, no offsets, no lag, a gain of 1, and no loads where they are expected (n,)."""
    covariance: Array
    """Prior covariance (n, n)."""
    noise_gain: float
    """Variance of a low-passed row's accelerations over that of the angles' noise (1/s⁴)."""


def make_loop(
    plant: Plant, joint: int, period: float, max_delay_steps: int, settings: chosen.IdentifierSettings
) -> Loop:
    """What an identifier knows of a plant's loop, whose period (s) and longest delay (steps) are an estimator's."""
    passive_limit = settings.passive_limit
    known = geometry_of(plant), *chosen.prior(plant, settings), chosen.noise_gain(period)
    return Loop(joint, period, max_delay_steps, passive_limit, *known)


class IdentifierState(NamedTuple):
    """What is remembered from call to call."""

    angles: Array
    """Measured angles (depth, 2) without jumps of full turns, newest first (rad)."""
    torques: Array
    """Commanded torques (past, 2), newest first (N m)."""
    steps: Array
    """Time for which each torque was held (past,) (s)."""
    calls: Number
    """Measurements since the last restart."""
    delay_steps: Number
    """The delay told last (steps), or ``age`` where that is more."""
    missed: Array
    """What the motion misses if angles have each age, from 0 on (ages,)."""
    age: Number
    """The angles' age (calls)."""
    filtered: tuple[Array, ...]
    """States of the low-passes: rows (2, n + 1) of both joints, a column for each unknown and last u."""
    unknowns: Array
    """θ, κ1 and κ2 (kg m), the lag (s), the gain of the undriven joint's motor, and loads (n,)."""
    covariance: Array
    """(n, n)"""
    variance: Pair
    """Variance of what each joint's row leaves unexplained (N² m²)."""
    held: Pair
    """Time for which each joint's row is still not used (s)."""
    noise: Pair
    """Variance of the noise of both angles (rad²)."""
