"""Judge a controller: simulate one swing-up by the rules and score it."""

from dataclasses import asdict, dataclass
from typing import Any

from ..common.errors import SwingupError
from ..controllers.registry import has_estimator
from ..dynamics.integrate import stable_substeps
from ..loop.disturbance import Disturbance, disturbance_as_dict
from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from .criteria import SHARE, Criteria, TipHistory, failed, follow_tip, judge
from .recording import checked_rows
from .rollout import Scenario, Trajectory
from .rules import DEFAULT_RULES, PerformanceRules, get_performance_rules
from .runner import prepare, run_one


@dataclass(frozen=True)
class Evaluation:
    """A controller's performance on a robot."""

    robot: str
    controller: str
    criteria: Criteria
    tip: TipHistory
    """How high the tip came, and why the run failed if it did."""
    trajectory: Trajectory
    """NumPy arrays in float64."""
    disturbance: Disturbance | None = None
    """None on the boards, whose runs are undisturbed."""
    estimator: bool | None = None
    """Whether a state estimator stood before the controller; None for a recorded trajectory."""
    plant: Plant = LEADERBOARD
    """None is the leaderboards' plant."""

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: the names, success, the criteria, the score, the tip, and the disturbance, if any."""
        head: dict[str, Any] = {"robot": self.robot, "controller": self.controller}
        if self.estimator is not None:
            head["estimator"] = self.estimator
        disturbed = {} if self.disturbance is None else {"disturbance": disturbance_as_dict(self.disturbance)}
        head |= self.plant.summary(self.robot)
        return head | asdict(self.criteria) | self.tip.as_dict() | disturbed


def evaluate(
    controller: Any,
    robot: Robot | str,
    name: str = "controller",
    rules: PerformanceRules | str = DEFAULT_RULES,
    disturbance: Disturbance | None = None,
    plant: PlantLike = LEADERBOARD,
) -> Evaluation:
    """Simulate one swing-up from hanging at rest, in float64, and score it.

    Args:
        controller: a controller in JAX, an object with ``get_control_output(x, t)`` or a function of (x, t);
            called at every step, whatever rate it was trained at.
        robot: which joint is driven.
        name: name of the controller in the result.
        rules: rules of the performance board, or their name.
        disturbance: noise, delay, motor response and pushes of the simulation; None for the board's.
        plant: what is simulated: a plant, its name or its file.

    Raises:
        SwingupError: there is no such robot or plant, there are no such rules, the controller is for the other
            robot, or it failed: it raised an error, or its torque is not two finite numbers.
    """
    robot, found = get_robot(robot), load_plant(plant)
    rules = get_performance_rules(rules).of(robot)
    parameters = found.driven(robot)
    estimator, controller = has_estimator(controller), prepare(controller, robot, name, parameters)
    scenario = Scenario(parameters, disturbance, substeps=stable_substeps(parameters, rules.dt))
    # Room for the present state and the delayed ones.
    depth = 1 if disturbance is None else int(disturbance.delay_steps) + 1
    try:
        trajectory = run_one(controller, scenario, rules.dt, rules.steps, depth)
    except SwingupError as error:
        raise SwingupError(f"controller {name!r}: {error}") from error
    judged = _judged(trajectory, parameters, rules)
    return Evaluation(robot.name, name, *judged, trajectory, disturbance, estimator, found)


def evaluate_recorded(
    trajectory: Trajectory,
    robot: Robot | str,
    name: str,
    rules: PerformanceRules | str = DEFAULT_RULES,
    plant: PlantLike = LEADERBOARD,
) -> Evaluation:
    """Score a trajectory from any source, such as a recording of a real robot.

    Args:
        trajectory: NumPy arrays in float64.
        robot: which joint is driven.
        name: name of the trajectory in the result.
        rules: rules of the performance board, or their name.
        plant: gives the lengths of the links.

    Raises:
        SwingupError: as :func:`score`.
    """
    robot, found = get_robot(robot), load_plant(plant)
    rules = get_performance_rules(rules).of(robot)
    judged = _judged(trajectory, found.driven(robot), rules)
    return Evaluation(robot.name, name, *judged, trajectory, plant=found)


def score(
    trajectory: Trajectory,
    robot: Robot | str,
    rules: PerformanceRules | str = DEFAULT_RULES,
    plant: PlantLike = LEADERBOARD,
) -> Criteria:
    """Score a trajectory from any source by the rules of the performance board.

    Times count from 0, or from the first row where that is earlier. A span below 99 % of the duration scores 0.

    Args:
        trajectory: NumPy arrays in float64.
        robot: which joint is driven.
        rules: rules of the performance board, or their name.
        plant: gives the lengths of the links.

    Raises:
        SwingupError: there is no such robot or plant, there are no such rules, or the trajectory has fewer than 3
            rows, rows of other shapes, values that are not finite, or times that do not increase or start far
            from 0.
    """
    rules = get_performance_rules(rules).of(get_robot(robot))
    return _judged(trajectory, load_plant(plant).driven(robot), rules)[0]


def _judged(trajectory: Trajectory, parameters: Plant, rules: PerformanceRules) -> tuple[Criteria, TipHistory]:
    lengths = float(parameters.l1), float(parameters.l2)
    time, x, u = checked_rows(trajectory)
    criteria = judge(time - min(0.0, time[0]), x, u, *lengths, rules)  # no negative swing-up times
    long_enough = time[-1] - time[0] >= SHARE * rules.duration
    return criteria if long_enough else failed(criteria), follow_tip(time, x, *lengths, rules)
