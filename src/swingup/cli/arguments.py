"""Arguments that several commands share."""

import dataclasses
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from tyro.conf import Positional, UseAppendAction, arg

from ..benchmark.grid import delay_steps, draw_pushes
from ..benchmark.rules import RobustnessRules
from ..errors import SwingupError
from ..physics.parameters import ROBOTS, Robot, get_robot
from ..tasks.disturbance import Disturbance, undisturbed

RobotName = Positional[Annotated[str, arg(metavar="ROBOT", help="acrobot or pendubot.")]]
RobotOrAll = Positional[Annotated[str, arg(metavar="[ROBOT]", help="acrobot, pendubot or all.")]]
ControllerName = Annotated[
    str,
    arg(metavar="NAME", help="ar-eapo, tvlqr, ilqr-riccati, ilqr-mpc, lqr, a policy file, or module:object."),
]
ControllerNames = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(metavar="NAME", help="a controller of yours, a policy file or module:object; may be repeated."),
]


@dataclass(frozen=True)
class DisturbanceOptions:
    """What disturbs a single run."""

    velocity_noise: float = 0.0
    """Standard deviation of the noise on measured velocities (rad/s)."""
    torque_noise: float = 0.0
    """Standard deviation of the noise on the torque (N m)."""
    torque_response: float = 1.0
    """Motor response: 1 is a perfect motor."""
    delay: float = 0.0
    """Age of what the controller measures (s)."""
    pushes: bool = False
    """Push the driven joint three times, as the robustness benchmark does."""
    seed: int = 0
    """Seed of the noise and the pushes."""

    def make(self, rules: RobustnessRules) -> Disturbance | None:
        """The disturbance, or None if nothing disturbs.

        Raises:
            SwingupError: a value is out of range.
        """
        for name in ("velocity_noise", "torque_noise", "delay"):
            value = getattr(self, name)
            if not 0 <= value < 1000:
                raise SwingupError(f"{name} = {value:g} is out of range: use a value of 0 or a little more")
        if not abs(self.torque_response) < 1000:
            raise SwingupError(f"torque_response = {self.torque_response:g} is out of range: 1 is a perfect motor")
        if not 0 <= self.seed < 2**31:
            raise SwingupError(f"seed = {self.seed} is out of range: use 0 to 2³¹ - 1")
        if self == DisturbanceOptions(seed=self.seed):
            return None
        calm = undisturbed(rules.perturbations.pushes)
        random = np.random.default_rng(self.seed)
        return dataclasses.replace(
            calm,
            velocity_noise=self.velocity_noise,
            torque_noise=self.torque_noise,
            response=self.torque_response,
            delay=delay_steps(self.delay, rules.dt),
            pushes=draw_pushes(random, rules.perturbations, rules.duration) if self.pushes else calm.pushes,
            noise=np.array([self.seed, 0], np.uint32),
        )


def robots(name: str) -> list[Robot]:
    """The robot of that name, or all of them.

    Raises:
        SwingupError: there is no such robot.
    """
    return list(ROBOTS.values()) if name == "all" else [get_robot(name)]
