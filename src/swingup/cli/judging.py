"""The commands that judge: evaluate, leaderboard and score."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypedDict

from tyro.conf import arg

from ..benchmark.board import AbstractBoard, Setting
from ..benchmark.boards import BOARDS, get_board
from ..benchmark.disturbances import DisturbanceSettings, PushRules
from ..benchmark.judge import judge, make_setting, score
from ..benchmark.leaderboard import DEFAULT_BOARDS, leaderboard
from ..benchmark.recording import NO_ZEROS, load_trajectory, save_trajectory
from ..benchmark.robustness_board import RobustnessBoard, change_grid
from ..common.errors import SwingupError, command_line
from ..common.files import check_writable, write_atomically
from ..controllers.baselines.baselines import BASELINES
from ..controllers.check import call_time, call_words, check_controller, slow_call, upright_law
from ..controllers.registry import BUILT_IN, controller_on
from ..loop.loop import LOOP_DT
from ..plant.plant import LEADERBOARD, ROBOTS, Plant, Robot, get_robot
from ..plant.units import scaled, scales_of
from ..policy.shipped import DEFAULT
from ..report.page import make_section, render_page
from .arguments import (
    NO_OPTIONS,
    DomainName,
    FileName,
    Names,
    PlantOptions,
    RobotName,
    check_outputs,
    facts_of,
    optional,
    plant_of,
    refuse_ignored,
    value_of,
)
from .output import Progress, foreign_prints_apart, tell, tell_json
from .playing import EpisodeOptions, play_episodes
from .results import TABLE_FORMATS, judged_name, result_lines, show_tables

EVERY_ROBOT = tuple(ROBOTS.values())
SCORING_BOARDS = ", ".join(name for name, each in BOARDS.items() if each.keeps_rows)

RobotOrAll = Annotated[
    Sequence[Robot],
    value_of(lambda name: EVERY_ROBOT if name == "all" else (get_robot(name),), "ROBOT"),
    arg(help_behavior_hint="(default: all)"),
]
ControllerName = Annotated[
    str, arg(metavar="NAME", help=f"{', '.join(BUILT_IN)}, a policy's or a law's file, or module:object.")
]


class DisturbanceOptions(TypedDict, total=False):
    """Disturbances of a swing-up; none without an option."""

    velocity_noise: Annotated[float, optional("standard deviation of the measured velocities' noise (rad/s).")]
    torque_noise: Annotated[float, optional("standard deviation of the torque's noise (N m).")]
    torque_response: Annotated[float, optional("motor response; 1 is a perfect motor.")]
    delay: Annotated[float, optional("age of what the controller measures (s).")]
    pushes: Annotated[bool, optional("push the driven joint three times, as the robustness board does.")]


class EstimatorOptions(TypedDict, total=False):
    """Whether a state estimator stands before the controller; by default where the policy file has one."""

    estimator: Annotated[bool, optional("put a state estimator before the controller, or judge it without.")]


def evaluate_command(
    robot: RobotName | None = None,
    /,
    controller: ControllerName = DEFAULT,
    task: EpisodeOptions = NO_OPTIONS,
    board: Names = ("performance",),
    check: bool = False,
    estimator: EstimatorOptions = NO_OPTIONS,
    plant: PlantOptions = NO_OPTIONS,
    domain: DomainName | None = None,
    seed: int = 0,
    seeds: int | None = None,
    criteria: Names = (),
    grid: Names = (),
    json: bool = False,
    save: FileName | None = None,
    disturbance: DisturbanceOptions = NO_OPTIONS,
) -> int:
    """Judge a controller on one board or several: simulate its runs and score them.

    Args:
        robot: acrobot or pendubot; without it the policy of another task plays episodes.
        controller: the controller.
        task: episodes in an environment of Gymnasium.
        board: performance (one swing-up; hardware and hardware-perturbed have the real robot's normalisers),
            robustness (722 simulations), uptime (a minute with 15 throws), sim2real (100 swing-ups in a loop
            like the robot's), iros-real, v2-real and icra-real (the real robots' boards, simulated),
            cloudpendulum, or balance (20 starts near the top).
        check: only try the controller on a few dozen states, and name its faults; the exit status is 1 if there is
            one.
        estimator: whether a state estimator stands before the controller.
        plant: what is simulated, baselines are designed for, and adaptive begins with, as exported for it;
            disturbances are in its own units.
        domain: plants and loops of the boards on simulated robots: identified, randomised, recorded, imperfect,
            cells, a session of the robot, as session-acrobot, or a YAML file.
        seed: first seed of noise, pushes, throws, plants and loops.
        seeds: seeds in a row; with two or more there are 95 % intervals; by default as many as a board has.
        criteria: for robustness, some of model, velocity_noise, torque_noise, torque_response, delay and
            perturbations.
        grid: for robustness, other values: NAME=LOW:HIGH:COUNT for a parameter of the model, or a criterion with
            [:REPETITIONS], or perturbations=PROFILES.
        json: print one JSON object, with every single run; a list for several boards.
        save: also write the first run's trajectory to this CSV file.
        disturbance: disturbances of a swing-up on performance and hardware; the boards' runs have none.
    """
    simulated = {"domain": domain, "save": save, "grid": grid, "criteria": criteria, "seeds": seeds, **disturbance}
    simulated["board"] = board != ("performance",)
    if robot is None:
        refuse_ignored({**simulated, **plant, "estimator": bool(estimator), "check": check}, "goes with a robot")
        return play_episodes(controller, task, seed, json)
    if task:
        raise SwingupError(f"--{next(iter(task))} goes with other tasks: leave it out, or {robot.name}")
    wanted = estimator.get("estimator")
    if check:
        refuse_ignored({**simulated, "json": json, "seed": seed or None}, "does not go with --check")
        return _check(controller, robot, wanted, facts_of(plant))
    on, pushes = plant_of(plant), None
    if disturbance.get("pushes"):
        pushes = scaled(PushRules(), scales_of(LEADERBOARD if on is None else on.facts.driven(robot)))
    given: Any = {**disturbance, "pushes": pushes}
    disturbed = DisturbanceSettings(**given) if disturbance else None
    loop: Any = {"plant": on, "domain": domain, "disturbance": disturbed}
    boards, results = _boards(board, criteria, grid), []
    settings = [make_setting(robot, each, **loop) for each in boards]
    if (seeds or 0) > 1 and not any(each.is_random(on) for each, on in zip(boards, settings, strict=True)):
        raise SwingupError(f"--seeds {seeds}: nothing on {' '.join(board)} is random: leave it out")
    if save is not None:
        if len(boards) > 1 or not boards[0].keeps_rows:
            raise SwingupError(
                f"--save writes the rows of one board, as performance, not those of {' '.join(board)}"
            )
        check_writable(save)  # before the judging, which may take minutes
    for each, setting in zip(boards, settings, strict=True):
        with foreign_prints_apart(), Progress() as progress:
            found = controller_on(controller, robot, setting.plant, wanted, given=bool(plant))
            report_progress = partial(progress, each.name)
            result = judge(found, robot, each, seeds, seed=seed, name=controller, progress=report_progress, **loop)
        results.append(result)
        if not json:
            tell(*result_lines(result, judged_name(controller, found)))
    if save is not None and results[0].trajectory is not None:
        save_trajectory(save, results[0].trajectory, results[0].runs[0].case.scenario.parameters.zeros)
    if json:
        # The result names the command that repeats it; the leaderboard shows it beside shipped rows.
        options = {"controller": controller, "seed": seed, "domain": domain, **estimator, **plant, **disturbance}

        def own(each: AbstractBoard, setting: Setting) -> dict[str, Any]:
            found = {"seeds": seeds} if each.is_random(setting) else {}
            return found | ({"criteria": criteria, "grid": grid} if isinstance(each, RobustnessBoard) else {})

        objects = [
            {
                "command": command_line("evaluate", robot.name, board=name, **options, **own(each, setting)),
                **result.as_dict(),
            }
            for name, each, setting, result in zip(board, boards, settings, results, strict=True)
        ]
        tell_json(objects[0] if len(objects) == 1 else objects, indent=1)
    return 0


def _check(name: str, robot: Robot, estimator: bool | None, given: Plant | None) -> int:
    """Print a controller's faults, and whether it is too slow for its loop; the exit status is 1 with a fault."""
    plant = given or LEADERBOARD
    with foreign_prints_apart():
        found = controller_on(name, robot, plant, estimator, given is not None)
        findings = check_controller(found, robot, float(plant.limit(robot.joint)))
        notes: list[str] = []
        if not findings:
            findings, notes = upright_law(found, robot, plant)
            if (took := call_time(found, LOOP_DT)) is not None:
                notes.append(f"warning: {slow}" if (slow := slow_call(took, LOOP_DT)) else call_words(took))
    lines = [*(findings or ["nothing wrong was found"]), *notes]
    tell(*(f"{judged_name(name, found)}: {each}" for each in lines))
    return 1 if findings else 0


def _boards(names: Sequence[str], criteria: Sequence[str] = (), grid: Sequence[str] = ()) -> list[AbstractBoard]:
    boards = []
    for name in names:
        board = get_board(name)
        if isinstance(board, RobustnessBoard):
            board = replace(board, criteria=tuple(criteria) or board.criteria)
            for text in grid:
                board = change_grid(board, text)
        boards.append(board)
    if (criteria or grid) and not any(isinstance(board, RobustnessBoard) for board in boards):
        raise SwingupError("--criteria and --grid are those of --board robustness: leave them out")
    return boards


def leaderboard_command(
    robot: RobotOrAll = EVERY_ROBOT,
    /,
    controller: Names = (),
    board: Names = DEFAULT_BOARDS,
    plant: PlantOptions = NO_OPTIONS,
    seed: int = 0,
    recompute: bool = False,
    json: bool = False,
    csv: bool = False,
    markdown: bool = False,
    page: FileName | None = None,
) -> None:
    """Print the tables of boards: the shipped controllers, judged now, beside the published rows.

    Args:
        robot: acrobot, pendubot or all.
        controller: controllers of yours: policy files or module:object.
        board: boards, those of evaluate.
        plant: what all are judged on, without published rows, and what baselines are designed for.
        seed: seed of noise, pushes, throws, plants and loops.
        recompute: also compute the robustness of ilqr-mpc, which takes minutes and whose row is shipped.
        json: print one JSON list of rows.
        csv: print one CSV table.
        markdown: print Markdown tables.
        page: also write a page (.html) that needs no network: tables, plots, animations, and a live pendulum that
            you can push.
    """
    asked = [name for name, wanted in {"json": json, "csv": csv, "markdown": markdown}.items() if wanted]
    if len(asked) > 1:
        raise SwingupError(f"--{' and --'.join(asked)} exclude each other: choose one")
    check_outputs([".html"], page)
    boards, on = _boards(board), facts_of(plant)
    drawing = [each.name for each in boards if each.domain is not None]
    if drawing and (designed := [name for name in controller if name in BASELINES]):
        raise SwingupError(
            f"{designed[0]} is designed for a plant, and {drawing[0]} draws plants: swingup evaluate ROBOT --board "
            f"{drawing[0]} --controller {designed[0]}"
        )
    with foreign_prints_apart(), Progress() as progress:
        mine = {
            each: {name: controller_on(name, each, on or LEADERBOARD, given=on is not None) for name in controller}
            for each in robot
        }
        how: Any = {"boards": boards, "seed": seed, "recompute": recompute, "progress": progress, "plant": on}
        if page is None:
            made = [table for each in robot for table in leaderboard(each, mine[each], **how)]
        else:
            sections = [make_section(each, mine[each], **how) for each in robot]
            made = [table for section in sections for table in section.tables]
            write_atomically(page, render_page(sections).encode())
    if asked:
        # Not tell(), which would escape the line ends of the table.
        print(TABLE_FORMATS[asked[0]](made))
    else:
        show_tables(made)
        tell(*([] if page is None else [f"wrote {page} ({Path(page).stat().st_size / 1e6:.1f} MB)"]))


def score_command(
    trajectory: Annotated[str, arg(metavar="TRAJECTORY")],
    /,
    robot: RobotName,
    board: Annotated[str, arg(metavar="BOARD", help=f"{SCORING_BOARDS}.")] = "performance",
    plant: PlantOptions = NO_OPTIONS,
    columns: Names = (),
    force: bool = False,
    json: bool = False,
) -> None:
    """Score a trajectory file in RealAIGym's CSV format, from this program, another or a real robot.

    A recording that cannot be the physics of its pendulum gets an error and no score; warnings do not change it.

    Args:
        trajectory: the CSV file.
        robot: acrobot or pendubot.
        board: board whose rules score.
        plant: the pendulum of the recording, whose lengths score and whose equations check; by default the board's.
        columns: names for a file with others, q1=theta1 or q1=2 for the second column, or without a header, names
            in order, as time q1 q2 dq1 dq2 _ u1 u2, with _ for a column that is not read.
        force: score what cannot be physics as well, and say so.
        json: print one JSON object.
    """
    on, name = facts_of(plant), Path(trajectory).stem
    rows = load_trajectory(trajectory, columns, NO_ZEROS if on is None else on.zeros)
    result = score(rows, robot, board, name=name, plant=on, force=force)
    tell_json(result.as_dict(), indent=1) if json else tell(*result_lines(result, name))
