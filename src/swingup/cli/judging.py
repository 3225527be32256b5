"""The commands that judge: evaluate, score, robustness, uptime, sim2real, check and leaderboard."""

import contextlib
import json as json_format
import shlex
import sys
from pathlib import Path
from statistics import median
from typing import Annotated, Any

from tyro.conf import OmitArgPrefixes, Positional, arg

from ..benchmark import evaluate as performance_of
from ..benchmark import leaderboard as boards_of
from ..benchmark import robustness as robustness_of
from ..benchmark import sim2real as sim2real_of
from ..benchmark import uptime as uptime_of
from ..benchmark.columns import COLUMNS, PERFORMANCE
from ..benchmark.evaluate import Evaluation
from ..benchmark.grid import change_grid
from ..benchmark.plausibility import examine
from ..benchmark.rules import CRITERIA, get_robustness_rules
from ..benchmark.trajectory_file import load_trajectory, save_trajectory
from ..control.check import check_controller
from ..control.registry import get_controller, has_estimator
from ..errors import SwingupError
from ..files import check_writable
from ..physics.parameters import get_robot
from ..policy.shipped import REFINED, ROBOT
from ..tasks.domain import Domain, load_domain
from ..text import one_line
from . import tables
from .arguments import (
    ControllerName,
    ControllerNames,
    DisturbanceOptions,
    DomainName,
    EstimatorFlags,
    EstimatorOptions,
    RobotName,
    RobotOrAll,
    describe,
    robots,
)

FOUND = 1
"""Exit status of a check that found something."""

NO_DISTURBANCE = DisturbanceOptions()
AS_IT_COMES = EstimatorOptions()


def evaluate(
    robot: RobotName,
    /,
    controller: ControllerName = REFINED,
    estimator: EstimatorFlags = AS_IT_COMES,
    rules: str = "v2",
    json: bool = False,
    save: str | None = None,
    disturbance: OmitArgPrefixes[DisturbanceOptions] = NO_DISTURBANCE,
) -> int:
    """Simulate one swing-up by the benchmark's rules and score it.

    Args:
        robot: the robot.
        controller: the controller.
        estimator: whether a state estimator goes before it.
        rules: v2 (simulation) or hardware.
        json: print one JSON object.
        save: also write the trajectory to this CSV file.
        disturbance: what disturbs the run; the boards' runs have nothing.
    """
    chosen = get_robot(robot)
    if save is not None:
        check_writable(save)
    with foreign_prints_apart():
        found = get_controller(controller, chosen, estimator.wanted)
        result = performance_of.evaluate(found, chosen, controller, rules, disturbance.make())
    if save is not None:
        save_trajectory(save, result.trajectory)
    if json:
        _print_json(result.as_dict(), found)
    else:
        _print_evaluation(result, rules, describe(controller, found))
    return 0


def score(
    trajectory: Positional[Annotated[str, arg(metavar="TRAJECTORY")]],
    /,
    robot: str,
    rules: str = "v2",
    json: bool = False,
) -> int:
    """Score a trajectory file in RealAIGym's CSV format, from this program, another or a real robot.

    Warnings name what cannot be the physics of this pendulum; they do not change the score.

    Args:
        trajectory: the CSV file.
        robot: acrobot or pendubot.
        rules: v2 (simulation) or hardware.
        json: print one JSON object.
    """
    chosen = get_robot(robot)
    rows = load_trajectory(trajectory)
    criteria = performance_of.score(rows, chosen, rules)
    result = Evaluation(chosen.name, Path(trajectory).stem, criteria, rows)
    found = examine(rows, chosen, rules)
    if json:
        print(json_format.dumps(result.as_dict() | found.as_dict()))
    else:
        _print_evaluation(result, rules, one_line(result.controller))
        print(f"  {'Rate of the log [Hz]':<24}{found.rate:>10.4g}")
        for warning in found.warnings:
            print(f"  warning: {warning.name}: {warning.text}")
    return 0


def robustness(
    robot: RobotName,
    /,
    controller: ControllerName = REFINED,
    estimator: EstimatorFlags = AS_IT_COMES,
    rules: str = "v2",
    seed: int = 0,
    seeds: int = 1,
    criteria: tuple[str, ...] = CRITERIA,
    grid: tuple[str, ...] = (),
    json: bool = False,
) -> int:
    """Run the robustness benchmark, all its 722 simulations, and score it.

    Args:
        robot: the robot.
        controller: the controller.
        estimator: whether a state estimator goes before it.
        rules: v2.
        seed: seed of the noise and the pushes.
        seeds: seeds in a row; with two or more the random criteria get 95 % intervals.
        criteria: measure only some of model, velocity_noise, torque_noise, torque_response, delay, perturbations.
        grid: other values: NAME=LOW:HIGH:COUNT[:REPETITIONS] for a criterion or a parameter of the model, or
            perturbations=PROFILES.
        json: print one JSON object, with every single simulation.
    """
    chosen, changed = get_robot(robot), get_robustness_rules(rules)
    for text in grid:
        changed = change_grid(changed, text)
    with foreign_prints_apart():
        found = get_controller(controller, chosen, estimator.wanted)
        result = robustness_of.robustness(found, chosen, controller, changed, seed, seeds, criteria)
    if json:
        options = {"controller": controller, "rules": rules, "seed": seed, "seeds": seeds}
        command = ["swingup", "robustness", robot, *(f"--{name}={value}" for name, value in options.items())]
        command += estimator.flags
        command += ["--criteria", *criteria] if criteria != CRITERIA else []
        command += ["--grid", *grid] if grid else []
        _print_json({"command": shlex.join(command), **result.as_dict()}, found, indent=1)
        return 0
    judged, last = describe(controller, found), _to_last(seed, seeds)
    print(f"{result.robot}, {judged} (rules {result.rules}, seed {seed}{last})")
    values = {**result.percent, "overall": result.overall}
    for name, value in values.items():
        low_high = result.intervals.get(name)
        extra = f"   ({' to '.join(COLUMNS[name].show(end) for end in low_high)})" if low_high else ""
        print(f"  {COLUMNS[name].title:<26}{COLUMNS[name].show(value):>8}{extra}")
    print(f"  {'Simulations':<26}{len(result.results):>8}")
    if result.faults:
        print(f"  {len(result.faults)} simulations without an answer; the first: {result.faults[0].fault}")
    return 0


def uptime(
    robot: RobotName,
    /,
    controller: ControllerName = REFINED,
    estimator: EstimatorFlags = AS_IT_COMES,
    rules: str = "v3",
    seed: int = 0,
    seeds: int = 1,
    json: bool = False,
    save: str | None = None,
) -> int:
    """Run a minute of the global-policy benchmark, in which the pendulum is thrown fifteen times, and score it.

    Args:
        robot: the robot.
        controller: the controller.
        estimator: whether a state estimator goes before it.
        rules: v3.
        seed: seed of the throws.
        seeds: seeds in a row; the score is their mean.
        json: print one JSON object.
        save: also write the first seed's trajectory to this CSV file.
    """
    chosen = get_robot(robot)
    if save is not None:
        check_writable(save)
    with foreign_prints_apart():
        found = get_controller(controller, chosen, estimator.wanted)
        result = uptime_of.uptime(found, chosen, controller, rules, seed, seeds)
    if save is not None:
        save_trajectory(save, result.trajectory)
    if json:
        _print_json(result.as_dict(), found)
        return 0
    print(f"{result.robot}, {describe(controller, found)} (rules {rules}, seed {seed}{_to_last(seed, seeds)})")
    extra = f"   ({result.interval[0]:.3f} to {result.interval[1]:.3f})" if result.interval else ""
    print(f"  {'Uptime score':<26}{result.uptime:>8.3f}{extra}")
    for number, fault in zip(result.seeds, result.faults, strict=True):
        if fault:
            print(f"  seed {number}: {fault}")
    return 0


def sim2real(
    robot: RobotName,
    /,
    controller: ControllerName = ROBOT,
    estimator: EstimatorFlags = AS_IT_COMES,
    domain: DomainName = "identified",
    seed: int = 0,
    seeds: int = 100,
    json: bool = False,
    save: str | None = None,
) -> int:
    """Swing up on a plant and in a loop like the real robot's, with friction, delay and noise, many times.

    Success is to be up for the last 2 s of 10 without ever reaching 20 rad/s or 4π, where the robot stops.

    Args:
        robot: the robot.
        controller: the controller.
        estimator: whether a state estimator goes before it.
        domain: plant and loop: identified, randomised (another plant for each seed), or a YAML file.
        seed: seed of noise and plants.
        seeds: seeds in a row.
        json: print one JSON object, with every run.
        save: also write the first seed's trajectory to this CSV file.
    """
    return judge_on(load_domain(domain), robot, controller, estimator, seed, seeds, json, save)


def judge_on(
    domain: Domain,
    robot: str,
    controller: str,
    estimator: EstimatorOptions = AS_IT_COMES,
    seed: int = 0,
    seeds: int = 100,
    json: bool = False,
    save: str | None = None,
) -> int:
    """What ``sim2real`` does, on a domain that was read before."""
    chosen = get_robot(robot)
    if save is not None:
        check_writable(save)
    with foreign_prints_apart():
        found = get_controller(controller, chosen, estimator.wanted)
        result = sim2real_of.sim2real(found, chosen, controller, domain, seed, seeds)
    if save is not None:
        save_trajectory(save, result.trajectory)
    if json:
        _print_json(result.as_dict(), found)
        return 0
    print(
        f"{result.robot}, {describe(controller, found)} (domain {domain.name}, seed {seed}{_to_last(seed, seeds)})"
    )
    low, high = result.interval
    print(f"  {'Success':<26}{f'{result.successes} of {seeds}':>12}   ({low:.0%} to {high:.0%})")
    print(f"  {'Score (rules hardware)':<26}{result.score:>12.3f}")
    times = [run.criteria.swingup_time or 0.0 for run in result.runs if run.success]
    usual = COLUMNS["swingup_time"].show(median(times) if times else None)
    print(f"  {'Swing-up time [s]':<26}{usual:>12}   (median of the successes)")
    print(f"  {'Largest speed [rad/s]':<26}{max(run.speed for run in result.runs):>12.1f}")
    print(f"  {'Largest angle [rad]':<26}{max(run.angle for run in result.runs):>12.1f}")
    for run in result.runs:
        if run.fault:
            print(f"  seed {run.seed}: {run.fault}")
    return 0


def check(robot: RobotName, /, controller: ControllerName, estimator: EstimatorFlags = AS_IT_COMES) -> int:
    """Try a controller on a few dozen states and say what is wrong with it, before it is judged.

    The exit status is 1 if something is.

    Args:
        robot: the robot.
        controller: the controller.
        estimator: whether a state estimator goes before it.
    """
    chosen = get_robot(robot)
    with foreign_prints_apart():
        found = get_controller(controller, chosen, estimator.wanted)
        findings = check_controller(found, chosen)
    for finding in findings:
        print(f"{describe(controller, found)}: {finding}")
    if not findings:
        print(f"{describe(controller, found)}: nothing wrong was found")
    return FOUND if findings else 0


def leaderboard(
    robot: RobotOrAll = "all",
    /,
    controller: ControllerNames = (),
    rules: str = "v2",
    seed: int = 0,
    recompute: bool = False,
    json: bool = False,
    csv: bool = False,
    markdown: bool = False,
) -> int:
    """Print the paper's tables: the shipped controllers, judged now, beside the published rows.

    Args:
        robot: the robot.
        controller: a controller of yours that enters as well.
        rules: v2 (performance and robustness), hardware (performance) or v3 (uptime under throws).
        seed: seed of noise, pushes and throws.
        recompute: also compute the robustness of ilqr-mpc, which takes minutes and whose row is shipped.
        json: print one JSON list of rows.
        csv: print one CSV table.
        markdown: print Markdown tables.
    """
    asked = [name for name, wanted in {"json": json, "csv": csv, "markdown": markdown}.items() if wanted]
    if len(asked) > 1:
        raise SwingupError(f"--{' and --'.join(asked)} exclude each other: choose one")
    boards = []
    with foreign_prints_apart():
        for each in robots(robot):
            mine = {name: get_controller(name, each) for name in controller}
            boards += boards_of.leaderboard(each, mine, rules, seed, recompute)
    if asked:
        print(tables.FORMATS[asked[0]](boards))
    else:
        tables.show(boards)
    return 0


def foreign_prints_apart() -> contextlib.AbstractContextManager[object]:
    """What others' controllers print goes to standard error, so that it does not mix with results."""
    return contextlib.redirect_stdout(sys.stderr)


def _to_last(seed: int, seeds: int) -> str:
    return f" to {seed + seeds - 1}" if seeds > 1 else ""


def _print_json(result: dict[str, Any], controller: object, indent: int | None = None) -> None:
    """Print a result as one object that says, after the controller's name, whether an estimator was before it."""
    places = list(result)
    after = places.index("controller") + 1
    rows = [*places[:after], "estimator", *places[after:]]
    told = result | {"estimator": has_estimator(controller)}
    print(json_format.dumps({name: told[name] for name in rows}, indent=indent))


def _print_evaluation(result: Evaluation, rules: str, judged: str) -> None:
    disturbed = "" if result.disturbance is None else ", disturbed"
    print(f"{result.robot}, {judged} (rules {rules}{disturbed})")
    print(f"  {'Swing-up':<24}{'success' if result.criteria.success else 'failure':>10}")
    for name in PERFORMANCE:
        print(f"  {COLUMNS[name].title:<24}{COLUMNS[name].show(getattr(result.criteria, name)):>10}")
