"""Judge a controller: simulate one swing-up by the rules and score it."""

from dataclasses import asdict, dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..control.controller import AbstractController
from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot, leaderboard_parameters
from .criteria import Criteria, judge
from .rollout import Trajectory, simulate
from .rules import DEFAULT_RULES, PerformanceRules, get_performance_rules

_simulate = jax.jit(simulate, static_argnames=("dt", "steps"))


@dataclass(frozen=True)
class Evaluation:
    """A controller's performance on a robot."""

    robot: str
    controller: str
    criteria: Criteria
    trajectory: Trajectory
    """NumPy arrays in float64."""

    def as_dict(self) -> dict[str, Any]:
        """Flat and ready for JSON: robot, controller, success, the criteria and the score."""
        return {"robot": self.robot, "controller": self.controller, **asdict(self.criteria)}


def evaluate(
    controller: AbstractController[Any],
    robot: Robot | str,
    name: str = "controller",
    rules: PerformanceRules | str = DEFAULT_RULES,
) -> Evaluation:
    """Simulate one swing-up from hanging at rest on the leaderboard's plant, in float64, and score it.

    Args:
        controller: the controller; called at every step, whatever rate it was trained at.
        robot: which joint is driven.
        name: what to call the controller in the result.
        rules: rules of the performance board, or their name.

    Raises:
        SwingupError: there is no such robot, there are no such rules, the controller is for the other robot, or
            its torque is not finite.
    """
    robot, rules = get_robot(robot), get_performance_rules(rules)
    meant = getattr(controller, "robot", robot)
    if meant != robot:
        raise SwingupError(f"controller {name!r} is for the {meant.name}, not the {robot.name}: judge it there")
    parameters = leaderboard_parameters(robot)
    with jax.enable_x64(True):
        trajectory = _simulate(parameters, controller, jnp.zeros(4), dt=rules.dt, steps=rules.steps)
        trajectory = jax.tree.map(np.asarray, trajectory)
    faulty = ~np.isfinite(trajectory.u).all(axis=1)
    if faulty.any():
        time = trajectory.time[int(np.argmax(faulty))]
        raise SwingupError(f"controller {name!r} gave a torque that is not finite at t = {time:g} s: mend it there")
    return Evaluation(robot.name, name, score(trajectory, robot, rules), trajectory)


def score(trajectory: Trajectory, robot: Robot | str, rules: PerformanceRules | str = DEFAULT_RULES) -> Criteria:
    """Score a trajectory from any source by the rules of the performance board.

    Args:
        trajectory: NumPy arrays in float64.
        robot: which joint is driven; gives the lengths of the links.
        rules: rules of the performance board, or their name.

    Raises:
        SwingupError: there is no such robot, there are no such rules, or the trajectory has fewer than 3 rows, rows
            of other shapes, or values that are not finite.
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
    return judge(time, x, u, *lengths, get_performance_rules(rules))
