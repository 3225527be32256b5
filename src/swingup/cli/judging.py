"""Steps of the commands that judge a controller: find it, judge it, and print and save the result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..benchmark import evaluate as performance_of
from ..benchmark import sim2real as sim2real_of
from ..benchmark import trials as trials_of
from ..benchmark.evaluate import Evaluation
from ..benchmark.robot_rules import TrialRules
from ..benchmark.rules import DEFAULT_RULES, PERFORMANCE_RULES, PerformanceRules
from ..benchmark.runner import Progress
from ..benchmark.sim2real import Sim2Real
from ..benchmark.trajectory_file import save_trajectory
from ..benchmark.trials import Trials
from ..common.files import check_writable
from ..controllers.registry import Controller, designs_for, get_controller
from ..loop.domain import Domain
from ..plant.plant import LEADERBOARD, Plant
from ..plant.robots import Robot, get_robot
from .arguments import DisturbanceOptions, EstimatorOptions, judged_name
from .output import foreign_prints_apart, progress_shown, tell, tell_json
from .results import evaluation_lines, sim2real_lines, trials_lines

NO_DISTURBANCE = DisturbanceOptions()
AS_IT_COMES = EstimatorOptions()

Judge = Callable[[Controller, Robot, Progress], Any]
"""Judges a controller on a robot; the result has ``as_dict()``, and a ``trajectory`` where one can be saved."""
Lines = Callable[[Any, str], list[str]]
"""A result as text, with the name of what was judged."""


@dataclass(frozen=True)
class Output:
    """How a result is printed and saved."""

    json: bool = False
    save: str | None = None
    """A CSV file for the trajectory."""
    head: Mapping[str, Any] = field(default_factory=dict)
    """Entries of the JSON object before the result's own."""
    indent: int | None = None


def judge_and_tell(
    robot: str,
    controller: str,
    estimator: EstimatorOptions,
    judge: Judge,
    lines: Lines,
    output: Output,
    plant: Plant = LEADERBOARD,
) -> int:
    """Find a controller, judge it, and save and print the result: the steps of every judging command."""
    chosen = get_robot(robot)
    if output.save is not None:
        # Before the judging, which may take minutes.
        check_writable(output.save)
    with foreign_prints_apart(), progress_shown() as shown:
        found = get_controller(controller, chosen, estimator.wanted, designs_for(controller, plant))
        result = judge(found, chosen, lambda done, total: shown("simulations", done, total))
    if output.save is not None:
        save_trajectory(output.save, result.trajectory)
    if output.json:
        tell_json({**output.head, **result.as_dict()}, output.indent)
    else:
        tell(*lines(result, judged_name(controller, found)))
    return 0


def judge_performance(
    robot: str,
    controller: str,
    plant: Plant,
    estimator: EstimatorOptions = AS_IT_COMES,
    rules: PerformanceRules = PERFORMANCE_RULES[DEFAULT_RULES],
    disturbance: DisturbanceOptions = NO_DISTURBANCE,
    output: Output = Output(),
) -> int:
    """The command ``evaluate``, on a plant that was read before."""

    def judge(found: Controller, chosen: Robot, progress: Progress) -> Evaluation:
        return performance_of.evaluate(found, chosen, controller, rules, disturbance.make(rules), plant)

    def lines(result: Evaluation, judged: str) -> list[str]:
        return evaluation_lines(result, judged, rules.name)

    return judge_and_tell(robot, controller, estimator, judge, lines, output, plant)


def judge_sim2real(
    domain: Domain,
    robot: str,
    controller: str,
    estimator: EstimatorOptions = AS_IT_COMES,
    seed: int = 0,
    seeds: int = 100,
    output: Output = Output(),
) -> int:
    """The command ``sim2real``, on a domain that was read before; baselines are designed for its plant."""

    def judge(found: Controller, chosen: Robot, progress: Progress) -> Sim2Real:
        return sim2real_of.sim2real(found, chosen, controller, domain, seed, seeds, progress=progress)

    return judge_and_tell(robot, controller, estimator, judge, sim2real_lines, output, domain.design_plant)


def judge_trials(
    rules: TrialRules,
    domain: Domain,
    robot: str,
    controller: str,
    estimator: EstimatorOptions,
    seed: int,
    seeds: int | None,
    output: Output,
) -> int:
    """The command ``sim2real``, by the rules of a real robot's board; baselines are designed as above."""

    def judge(found: Controller, chosen: Robot, progress: Progress) -> Trials:
        return trials_of.trials(found, chosen, controller, rules, domain, seed, seeds, progress)

    return judge_and_tell(robot, controller, estimator, judge, trials_lines, output, domain.design_plant)
