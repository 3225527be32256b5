"""Disturbances of a loop that the robustness board tries one at a time: noise, delay, motor response and pushes."""

import dataclasses
from typing import Annotated

import numpy as np

from ..common.checks import finite_number
from ..common.errors import SwingupError
from ..loop.disturbance import Disturbance, Pushes, undisturbed
from ..plant.units import TIME, TORQUE, VELOCITY

MAX_DISTURBANCE = 999.0  # No disturbance of a pendulum comes near this, in SI units
MAX_DELAY_STEPS = 1000  # Steps; more past than this is refused


@dataclasses.dataclass(frozen=True)
class PushRules:
    """Random profiles of Gaussian pushes, as many on each joint.

    The time between them is real for every pendulum, as the length of a run is.
    """

    profiles: int = 50
    pushes: int = 3
    """Pushes on each joint."""
    spacing: float = 1.0
    """Minimum time between the centres of two pushes (s)."""
    width: Annotated[tuple[float, float], TIME] = (0.05, 0.1)
    """Range of the standard deviations (s)."""
    amplitude: Annotated[tuple[float, float], TORQUE] = (0.5, 5.0)
    """Range of the absolute amplitudes (N m)."""


@dataclasses.dataclass(frozen=True)
class DisturbanceSettings:
    """What disturbs the runs of :func:`swingup.judge` in a perfect loop; the defaults disturb nothing."""

    velocity_noise: Annotated[float, VELOCITY] = 0.0
    """Standard deviation of the noise on measured velocities (rad/s)."""
    torque_noise: Annotated[float, TORQUE] = 0.0
    """Standard deviation of the noise on the driven joint's torque (N m)."""
    torque_response: float = 1.0
    """Motor response; 1 is a perfect motor."""
    delay: float = 0.0
    """Age of what the controller measures (s)."""
    pushes: PushRules | None = None
    """Random pushes, as ``PushRules()`` of the robustness board or others; None for none."""

    def __post_init__(self) -> None:
        """Refuse values that are out of range."""
        pushes: object = self.pushes
        if isinstance(pushes, bool):
            raise SwingupError(f"pushes = {pushes} are not rules: use PushRules() for the robustness board's")
        for name in ("velocity_noise", "torque_noise", "delay"):
            finite_number(name, getattr(self, name), 0.0, MAX_DISTURBANCE)
        finite_number("torque_response", self.torque_response, -MAX_DISTURBANCE, MAX_DISTURBANCE)

    def draw(self, dt: float, duration: float, seed: int) -> Disturbance:
        """The disturbance of one run of a duration (s) in steps of dt (s), with the noise and pushes of a seed."""
        calm = undisturbed() if self.pushes is None else undisturbed(self.pushes.pushes)
        random = np.random.default_rng(seed)
        noises = {name: float(getattr(self, name)) for name in ("velocity_noise", "torque_noise")}
        return dataclasses.replace(
            calm.changed(**noises, response=float(self.torque_response)),
            delay_steps=floored_delay_steps(self.delay, dt),
            pushes=calm.pushes if self.pushes is None else draw_pushes(random, self.pushes, duration),
            # The second word counts the simulations of a grid; a single run is its first.
            noise=np.array([seed, 0], np.uint32),
        )


def floored_delay_steps(delay: float, dt: float) -> int:
    """A delay (s) in steps of dt (s), rounded down in floating point as in the public benchmark."""
    steps = int(delay / dt)
    if steps > MAX_DELAY_STEPS:
        raise SwingupError(f"delay = {delay:g} s is above {MAX_DELAY_STEPS * dt:g} s: make it shorter")
    return steps


def draw_pushes(random: np.random.Generator, rules: PushRules, duration: float) -> Pushes:
    """A random profile: peaks shuffled over both joints, ``spacing`` or more from each other and both ends."""
    number = 2 * rules.pushes
    if number < 1 or duration < (number + 1) * rules.spacing:
        raise SwingupError(
            f"{rules.pushes} pushes a joint {rules.spacing:g} s apart do not fit into {duration:g} s"
        )
    # number + 1 gaps: between the peaks and at both ends.
    slack = (duration - (number + 1) * rules.spacing) / number
    centres = np.cumsum(rules.spacing + slack * random.uniform(size=number))
    # Pushes on the passive joint are drawn although they have no effect: the published scores contain them.
    shape = (2, rules.pushes)
    low, high = rules.amplitude
    # Drawn about 0 and moved outward by `low` below, as in the benchmark: no push is weaker.
    amplitude = random.uniform(low - high, high - low, shape)
    return Pushes(
        centre=random.permutation(centres).reshape(shape),
        width=random.uniform(*rules.width, shape),
        amplitude=amplitude + np.copysign(low, amplitude),
    )
