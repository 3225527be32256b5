"""The uptime of a recording by the rules of the global-policy boards: the share of a minute that the tip is up."""

from dataclasses import dataclass
from typing import Any

from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from .criteria import time_up, tip_heights
from .recording import checked_rows
from .rollout import Trajectory
from .rules import DEFAULT_UPTIME_RULES, UptimeRules, get_uptime_rules


@dataclass(frozen=True)
class RecordedUptime:
    """The uptime of one recorded run."""

    robot: str
    controller: str
    rules: str
    uptime: float
    """Time up, divided by the length of a run by the rules."""
    time_up: float
    """Σ Δt_k of the rows that are up, Δt_k = t_k - t_{k-1} and Δt_0 = 0 (s)."""
    span: float
    """Time from the first row to the last (s)."""
    highest_tip: float
    """Largest height above the shoulder (m)."""
    highest_tip_percent: float
    """The same in percent of l1 + l2."""
    plant: Plant = LEADERBOARD

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        values = {name: value for name, value in vars(self).items() if name != "plant"}
        return values | self.plant.summary(self.robot)


def recorded_uptime(
    trajectory: Trajectory,
    robot: Robot | str,
    name: str = "recording",
    rules: UptimeRules | str = DEFAULT_UPTIME_RULES,
    plant: PlantLike = LEADERBOARD,
) -> RecordedUptime:
    """Score a recorded minute, whoever threw the pendulum and when.

    Args:
        trajectory: NumPy arrays in float64.
        robot: which joint the controller drives.
        name: name of the recording in the result.
        rules: rules of a global-policy board, or their name.
        plant: gives the lengths of the links.

    Raises:
        SwingupError: there is no such robot or plant, there are no such rules, or the trajectory has fewer than 3
            rows, rows of other shapes, values that are not finite, or times that do not increase or start far from
            0.
    """
    robot, rules = get_robot(robot), get_uptime_rules(rules)
    time, x, _ = checked_rows(trajectory)
    found = load_plant(plant)
    parameters = found.driven(robot)
    lengths = float(parameters.l1), float(parameters.l2)
    up = time_up(time, x, *lengths, rules.height)
    highest = float(tip_heights(x, *lengths).max())
    return RecordedUptime(
        robot=robot.name,
        controller=name,
        rules=rules.name,
        uptime=up / rules.duration,
        time_up=up,
        span=float(time[-1] - time[0]),
        highest_tip=highest,
        highest_tip_percent=100.0 * highest / sum(lengths),
        plant=found,
    )
