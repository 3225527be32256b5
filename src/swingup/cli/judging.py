"""The commands that judge: evaluate, leaderboard, score and check."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from ..benchmark.board import AbstractBoard
from ..benchmark.boards import BOARDS
from ..benchmark.grid import change_grid
from ..benchmark.judge import judge, make_setting
from ..benchmark.leaderboard import DEFAULT_BOARDS, leaderboard
from ..benchmark.robustness_board import RobustnessBoard
from ..benchmark.score import score
from ..benchmark.trajectory_file import load_trajectory, save_trajectory
from ..common.checks import one_of
from ..common.errors import SwingupError
from ..common.files import check_writable
from ..controllers.interface.call_time import call_time, slow_call
from ..controllers.interface.check import check_controller
from ..controllers.registry import designs_for, get_controller
from ..loop.loop import LOOP_DT
from ..plant.robots import get_robot
from ..policy.shipped import DEFAULT
from . import tables
from .arguments import (
    NO_PLANT,
    ControllerName,
    ControllerNames,
    DisturbanceOptions,
    DomainOrNone,
    EstimatorFlags,
    EstimatorOptions,
    PlantFlags,
    RobotName,
    RobotOrAll,
    judged_name,
    robots,
    split_commas,
)
from .output import foreign_prints_apart, progress_shown, tell, tell_json
from .results import result_lines

NO_DISTURBANCE = DisturbanceOptions()
AS_IT_COMES = EstimatorOptions()

FOUND = 1
"""Exit status of a check that found something."""

BoardNames = Annotated[tuple[str, ...], arg(metavar="BOARD...")]


@dataclass(frozen=True)
class JudgingCommands:
    """The commands that judge by boards, with the boards as data: a test may shorten them."""

    boards: Mapping[str, AbstractBoard] = field(default_factory=lambda: BOARDS)
    entrants: Sequence[str] | None = None
    """Built-in controllers on the leaderboards; None for those of each board."""

    def evaluate(
        self,
        robot: RobotName,
        /,
        controller: ControllerName = DEFAULT,
        board: BoardNames = ("performance",),
        estimator: EstimatorFlags = AS_IT_COMES,
        plant: PlantFlags = NO_PLANT,
        domain: DomainOrNone = None,
        seed: int = 0,
        seeds: int | None = None,
        criteria: tuple[str, ...] = (),
        grid: tuple[str, ...] = (),
        json: bool = False,
        save: str | None = None,
        disturbance: OmitArgPrefixes[DisturbanceOptions] = NO_DISTURBANCE,
    ) -> int:
        """Judge a controller on one board or several: simulate its runs and score them.

        Args:
            robot: the robot.
            controller: the controller.
            board: performance (one swing-up; hardware and hardware-perturbed have the real robot's normalisers),
                robustness (722 simulations), uptime (a minute with 15 throws), sim2real (100 swing-ups in a loop
                like the robot's), iros-real, v2-real and icra-real (the real robots' boards, simulated) or
                cloudpendulum.
            estimator: whether a state estimator stands before the controller.
            plant: what is simulated, and baselines are designed for; disturbances are in its own units.
            domain: plants and loops of the boards on simulated robots: identified, randomised, recorded, cells, a
                session of the robot, as session-acrobot, or a YAML file.
            seed: first seed of noise, pushes, throws, plants and loops.
            seeds: seeds in a row; with two or more there are 95 % intervals; by default as many as a board has.
            criteria: for robustness, some of model, velocity_noise, torque_noise, torque_response, delay and
                perturbations.
            grid: for robustness, other values: NAME=LOW:HIGH:COUNT[:REPETITIONS] for a criterion or a parameter of
                the model, or perturbations=PROFILES.
            json: print one JSON object, with every single run; a list for several boards.
            save: also write the first run's trajectory to this CSV file.
            disturbance: disturbances of a swing-up on performance and hardware; the boards' runs have none.
        """
        chosen, names, on, disturbed = get_robot(robot), split_commas(board), plant.given(), disturbance.make()
        criteria, grid = split_commas(criteria), split_commas(grid)
        boards, results = self.changed(names, criteria, grid), []
        if save is not None:
            if len(boards) > 1 or not boards[0].keeps_rows:
                raise SwingupError(f"--save writes a trajectory: {', '.join(names)} have none or several")
            check_writable(save)  # before the judging, which may take minutes
        for each in boards:
            designed_for = designs_for(controller, make_setting(chosen, each, on, domain, disturbed).plant)
            with foreign_prints_apart(), progress_shown() as shown:
                found = get_controller(controller, chosen, estimator.wanted, designed_for)
                result = judge(
                    found,
                    chosen,
                    each,
                    seeds,
                    seed=seed,
                    name=controller,
                    plant=on,
                    domain=domain,
                    disturbance=disturbed,
                    progress=partial(shown, each.name),
                )
            results.append(result)
            if not json:
                tell(*result_lines(result, judged_name(controller, found)))
        if save is not None and results[0].trajectory is not None:
            save_trajectory(save, results[0].trajectory)
        if json:
            # The result names the command that repeats it; the leaderboard shows it beside shipped rows.
            words = [f"--controller={controller}", f"--seed={seed}", *estimator.flags, *plant.flags]
            words += [
                f"--{name}={value}" for name, value in (("seeds", seeds), ("domain", domain)) if value is not None
            ]
            words += [*disturbance.flags, *(("--criteria", *criteria) if criteria else ())]
            words += ["--grid", *grid] if grid else []
            objects = [
                {"command": shlex.join(["swingup", "evaluate", robot, f"--board={name}", *words]), **each.as_dict()}
                for name, each in zip(names, results, strict=True)
            ]
            tell_json(objects[0] if len(objects) == 1 else objects, indent=1)
        return 0

    def changed(self, names: Sequence[str], criteria: Sequence[str], grid: Sequence[str]) -> list[AbstractBoard]:
        """Boards by name, with other criteria and another grid for robustness.

        Raises:
            SwingupError: there is no such board, or criteria or grid go with none of them.
        """
        boards = []
        for name in names:
            board = self.boards[one_of("board", name, self.boards)]
            if isinstance(board, RobustnessBoard):
                for text in grid:
                    board = change_grid(board, text)
                board = replace(board, criteria=tuple(criteria) or board.criteria)
            boards.append(board)
        if (criteria or grid) and not any(isinstance(board, RobustnessBoard) for board in boards):
            raise SwingupError("--criteria and --grid are those of --board robustness: leave them out")
        return boards

    def leaderboard(
        self,
        robot: RobotOrAll = "all",
        /,
        controller: ControllerNames = (),
        board: BoardNames = DEFAULT_BOARDS,
        plant: PlantFlags = NO_PLANT,
        seed: int = 0,
        recompute: bool = False,
        json: bool = False,
        csv: bool = False,
        markdown: bool = False,
    ) -> int:
        """Print the tables of boards: the shipped controllers, judged now, beside the published rows.

        Args:
            robot: the robot.
            controller: controllers of yours that enter as well.
            board: boards, as of evaluate.
            plant: what all are judged on, without published rows, and what baselines are designed for.
            seed: seed of noise, pushes, throws, plants and loops.
            recompute: also compute the robustness of ilqr-mpc, which takes minutes and whose row is shipped.
            json: print one JSON list of rows.
            csv: print one CSV table.
            markdown: print Markdown tables.
        """
        asked = [name for name, wanted in {"json": json, "csv": csv, "markdown": markdown}.items() if wanted]
        if len(asked) > 1:
            raise SwingupError(f"--{' and --'.join(asked)} exclude each other: choose one")
        chosen, made, on = self.changed(split_commas(board), (), ()), [], plant.make()
        with foreign_prints_apart(), progress_shown() as progress:
            for each in robots(robot):
                mine = {
                    name: get_controller(name, each, plant=designs_for(name, on))
                    for name in split_commas(controller)
                }
                made += leaderboard(each, mine, chosen, seed, recompute, self.entrants, progress, on)
        if asked:
            # Not tell(), which would escape the line ends of the table.
            print(tables.TABLE_FORMATS[asked[0]](made))
        else:
            tables.show_tables(made)
        return 0


def score_command(
    trajectory: Positional[Annotated[str, arg(metavar="TRAJECTORY")]],
    /,
    robot: str,
    board: str = "performance",
    plant: PlantFlags = NO_PLANT,
    json: bool = False,
) -> int:
    """Score a trajectory file in RealAIGym's CSV format, from this program, another or a real robot.

    Warnings name what cannot be the physics of this pendulum; they do not change the score.

    Args:
        trajectory: the CSV file.
        robot: acrobot or pendubot.
        board: performance, hardware, hardware-perturbed, sim2real, iros-real or v2-real; uptime, icra-real or
            cloudpendulum for a minute.
        plant: the pendulum of the recording: its lengths score, its equations warn.
        json: print one JSON object.
    """
    rows, name = load_trajectory(trajectory), Path(trajectory).stem
    result = score(rows, robot, board, name=name, plant=plant.make())
    if json:
        tell_json(result.as_dict(), indent=1)
    else:
        tell(*result_lines(result, name))
    return 0


def check_command(
    robot: RobotName,
    /,
    controller: ControllerName = DEFAULT,
    estimator: EstimatorFlags = AS_IT_COMES,
    plant: PlantFlags = NO_PLANT,
) -> int:
    """Try a controller on a few dozen states and name its faults, before it is judged.

    The exit status is 1 if there is one. A controller that is too slow for its loop gets a line that says so.

    Args:
        robot: the robot.
        controller: the controller.
        estimator: whether a state estimator stands before it.
        plant: what baselines are designed for.
    """
    chosen = get_robot(robot)
    with foreign_prints_apart():
        found = get_controller(controller, chosen, estimator.wanted, designs_for(controller, plant.make()))
        findings = check_controller(found, chosen)
        slow = None if findings else slow_call(call_time(found, LOOP_DT), LOOP_DT)
    lines = [*(findings or ["nothing wrong was found"]), *([] if slow is None else [f"warning: {slow}"])]
    tell(*(f"{judged_name(controller, found)}: {each}" for each in lines))
    return FOUND if findings else 0
