"""Judge a controller: simulate one swing-up by the rules and score it."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot, leaderboard_parameters
from ..tasks.disturbance import Disturbance, describe
from .criteria import SHARE, Criteria, failed, judge
from .rollout import Scenario, Trajectory
from .rules import DEFAULT_RULES, PerformanceRules, get_performance_rules
from .runner import prepare, run_one

START = 0.2
"""A run's first time is within this of 0 (s): six periods of the slowest recordings, which have 33 Hz."""


@dataclass(frozen=True)
class Evaluation:
    """A controller's performance on a robot."""

    robot: str
    controller: str
    criteria: Criteria
    trajectory: Trajectory
    """NumPy arrays in float64."""
    disturbance: Disturbance | None = None
    """What disturbed the run; None on the boards."""

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: robot, controller, success, the criteria, the score, and what disturbed, if anything."""
        disturbed = {} if self.disturbance is None else {"disturbance": describe(self.disturbance)}
        return {"robot": self.robot, "controller": self.controller, **asdict(self.criteria), **disturbed}


def evaluate(
    controller: Any,
    robot: Robot | str,
    name: str = "controller",
    rules: PerformanceRules | str = DEFAULT_RULES,
    disturbance: Disturbance | None = None,
) -> Evaluation:
    """Simulate one swing-up from hanging at rest on the leaderboard's plant, in float64, and score it.

    Args:
        controller: a controller in JAX, an object with ``get_control_output(x, t)`` or a function of (x, t);
            called at every step, whatever rate it was trained at.
        robot: which joint is driven.
        name: what to call the controller in the result.
        rules: rules of the performance board, or their name.
        disturbance: what disturbs the simulation; the board's has nothing.

    Raises:
        SwingupError: there is no such robot, there are no such rules, the controller is for the other robot, or
            it failed: it raised an error, or its torque is not two finite numbers.
    """
    robot, rules = get_robot(robot), get_performance_rules(rules)
    controller = prepare(controller, robot, name)
    scenario = Scenario(leaderboard_parameters(robot), disturbance)
    depth = 1 if disturbance is None else int(disturbance.delay) + 1
    try:
        trajectory = run_one(controller, scenario, rules.dt, rules.steps, depth)
    except SwingupError as error:
        raise SwingupError(f"controller {name!r}: {error}") from error
    return Evaluation(robot.name, name, score(trajectory, robot, rules), trajectory, disturbance)


def score(trajectory: Trajectory, robot: Robot | str, rules: PerformanceRules | str = DEFAULT_RULES) -> Criteria:
    """Score a trajectory from any source by the rules of the performance board.

    Times count from 0, or from the first row where that is earlier. A span below 99 % of the duration scores 0.

    Args:
        trajectory: NumPy arrays in float64.
        robot: which joint is driven; gives the lengths of the links.
        rules: rules of the performance board, or their name.

    Raises:
        SwingupError: there is no such robot, there are no such rules, or the trajectory has fewer than 3 rows, rows
            of other shapes, values that are not finite, or times that do not increase or start far from 0.
    """
    parameters = leaderboard_parameters(get_robot(robot))
    lengths = float(parameters.l1), float(parameters.l2)
    time, x, u = (np.asarray(rows, np.float64) for rows in (trajectory.time, trajectory.x, trajectory.u))
    rows = time.size
    if rows < 3 or time.shape != (rows,) or x.shape != (rows, 4) or u.shape != (rows, 2):
        shapes = f"{time.shape}, {x.shape} and {u.shape}"
        raise SwingupError(f"time, x and u have shapes {shapes}: pass (N,), (N, 4) and (N, 2) with N of 3 or more")
    if not (np.isfinite(time).all() and np.isfinite(x).all() and np.isfinite(u).all()):
        raise SwingupError("the trajectory holds values that are not finite: end it before them")
    if not np.all(np.diff(time) > 0):
        raise SwingupError("the trajectory's times do not increase: keep one run, in order")
    if abs(time[0]) > START:
        raise SwingupError(f"the trajectory starts at t = {time[0]:g} s: give its times as seconds since its start")
    rules = get_performance_rules(rules)
    criteria = judge(time - min(0.0, time[0]), x, u, *lengths, rules)  # no swing-up takes less than no time
    return criteria if time[-1] - time[0] >= SHARE * rules.duration else failed(criteria)
