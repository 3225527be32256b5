"""The loop between a controller and the plant as data: sensors, motors and clock, and the values they may have."""

import dataclasses
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import jax

from ..common.checks import LARGEST_NUMBER, one_of
from ..common.settings import Range, notes
from ..common.types import Scalar
from ..plant.units import COMPLIANCE, DAMPING, TORQUE, TORQUE_RATE, VELOCITY

LOOP_DT = 0.002  # Time of a step of loop and plant (s)

LONGEST_PERIOD = 3.0
"""Nominal periods in the longest one. Chosen: longer ones come in some recordings, about once in 1,000 periods."""

VELOCITIES = ("differences", "driver")
"""Sources of measured velocities: backward differences of measured positions over recorded times, or the motors'
own drivers."""


Number: TypeAlias = float | Scalar


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Loop:
    """What stands between a controller and a plant; the defaults are a perfect loop.

    Numbers without a unit in their annotation are angles, shares, or real time, which stays around any pendulum.
    """

    passive_limit: Annotated[Number, Range(0.0, LARGEST_NUMBER), TORQUE] = 0.0
    """Torque limit of the motor of the passive joint, which compensates friction (N m)."""
    delay: Annotated[Number, Range(0.0, 0.2)] = 0.0
    """Age of a measurement (s)."""
    velocity_noise: Annotated[Number, Range(0.0, 10.0), VELOCITY] = 0.0
    """Standard deviation of the noise on measured velocities (rad/s)."""
    torque_noise: Annotated[Number, Range(0.0, 10.0), TORQUE] = 0.0
    """Standard deviation of the noise on a motor's torque (N m)."""
    response: Annotated[Number, Range(0.0, 2.0)] = 1.0
    """Part of a change of torque that a motor makes within a step; 1 is a perfect motor."""
    rate_limit: Annotated[Number, Range(0.0, LARGEST_NUMBER), TORQUE_RATE] = 1e6
    """Fastest change of a motor's torque (N m/s)."""
    ripple: Annotated[Number, Range(0.0, LARGEST_NUMBER), TORQUE] = 0.0
    """Amplitude of the torque ripple (N m)."""
    ripple_periods: Annotated[Number, Range(0.0, LARGEST_NUMBER)] = 36.0
    """Periods of the ripple in a turn of the joint."""
    push: Annotated[Number, Range(0.0, LARGEST_NUMBER), TORQUE] = 0.0
    """Largest peak of the one push on the driven joint (N m)."""
    quantum1: Annotated[Number, Range(0.0, 0.1)] = 0.0
    quantum2: Annotated[Number, Range(0.0, 0.1)] = 0.0
    """Steps of the measured angles of shoulder and elbow (rad)."""
    offset1: Annotated[Number, Range(-1.0, 1.0)] = 0.0
    offset2: Annotated[Number, Range(-1.0, 1.0)] = 0.0
    """Measured angles of shoulder and elbow where the true ones are 0 (rad)."""
    late: Annotated[Number, Range(0.0, 1.0)] = 0.0
    """Share of periods that are longer than the nominal one."""
    lateness: Annotated[Number, Range(0.0, 0.1)] = 0.0
    """Mean excess of the late periods (s)."""
    lag: Annotated[Number, Range(0.0, 0.1)] = 0.0
    """Time constant of the motors' first-order lag (s)."""
    gain1: Annotated[Number, Range(0.0, 10.0)] = 1.0
    gain2: Annotated[Number, Range(0.0, 10.0)] = 1.0
    """Delivered over commanded torque of the motors of shoulder and elbow."""
    passive_push: Annotated[Number, Range(0.0, LARGEST_NUMBER), TORQUE] = 0.0
    """Largest peak of the one push on the passive joint (N m)."""
    spring1: Annotated[Number, Range(0.0, LARGEST_NUMBER), TORQUE] = 0.0
    spring2: Annotated[Number, Range(0.0, LARGEST_NUMBER), TORQUE] = 0.0
    """Stiffness of springs or cables at shoulder and elbow, relaxed at 0 (N m/rad)."""
    load1: Annotated[Number, Range(-LARGEST_NUMBER, LARGEST_NUMBER), TORQUE] = 0.0
    load2: Annotated[Number, Range(-LARGEST_NUMBER, LARGEST_NUMBER), TORQUE] = 0.0
    """Constant torques against positive motion of shoulder and elbow (N m)."""
    stiction1: Annotated[Number, Range(0.0, LARGEST_NUMBER), TORQUE] = 0.0
    stiction2: Annotated[Number, Range(0.0, LARGEST_NUMBER), TORQUE] = 0.0
    """Dry friction that shoulder and elbow have at rest alone, beside the plant's (N m)."""
    compliance2: Annotated[Number, Range(0.0, LARGEST_NUMBER), COMPLIANCE] = 0.0
    """Angle by which the elbow's encoder, on the motor's side, leads the link under torque (rad/(N m))."""
    backlash2: Annotated[Number, Range(0.0, 1.0)] = 0.0
    """Play between the elbow's encoder, on the motor's side, and the link (rad)."""
    sag: Annotated[Number, Range(0.0, LARGEST_NUMBER), DAMPING] = 0.0
    """Torque limit that a driving motor loses for its joint's velocity (N m s/rad): its supply gives way."""
    period: Annotated[Number, Range(0.001, 0.006)] = LOOP_DT
    """Nominal time of a turn of the loop (s). A board's rows are its turns, whatever they last."""
    dropouts: Annotated[Number, Range(0.0, 100.0)] = 0.0
    """Gaps in the measurements (1/s), evenly spaced: the last sample repeats."""
    dropout: Annotated[Number, Range(0.0, 0.2)] = 0.0
    """Length of a gap (s)."""
    spoilt: Annotated[Number, Range(0.0, 1.0)] = 0.0
    """Share of measurements that are NaN."""
    # No number: it decides which program is compiled.
    velocities: str | None = dataclasses.field(default=None, metadata={"static": True})
    """One of :data:`VELOCITIES`; None for differences where an angle has a quantum, and the drivers elsewhere."""

    def __post_init__(self) -> None:
        """Refuse an unknown source of velocities. Numbers may be traced: ``resolve`` checks them."""
        if self.velocities is not None:
            one_of("velocities", self.velocities, VELOCITIES)


VALUES: dict[str, Range] = {each.name: bounds for each in dataclasses.fields(Loop) for bounds in notes(each, Range)}
"""Minimum and maximum of each number of a loop, by name."""

PERFECT_LOOP = Loop()  # No delay, no noise, and motors that deliver their commands
