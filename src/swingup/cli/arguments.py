"""Arguments that several commands share."""

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

from ..benchmark.disturbances import make_disturbance
from ..benchmark.rules import PushRules
from ..physics.parameters import ROBOTS, Robot, get_robot
from ..tasks.disturbance import Disturbance

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

    def make(self) -> Disturbance | None:
        """The disturbance, or None if nothing disturbs.

        Raises:
            SwingupError: a value is out of range.
        """
        numbers = {name: value for name, value in vars(self).items() if name != "pushes"}
        made = make_disturbance(**numbers, pushes=PushRules() if self.pushes else None)
        return None if self == DisturbanceOptions(seed=self.seed) else made


def robots(name: str) -> list[Robot]:
    """The robot of that name, or all of them.

    Raises:
        SwingupError: there is no such robot.
    """
    return list(ROBOTS.values()) if name == "all" else [get_robot(name)]
