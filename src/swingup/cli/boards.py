"""The commands around the judge: leaderboard, score and check."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from ..benchmark import leaderboard as boards_of
from ..benchmark.board_rules import BOARD_RULES, BoardRules
from ..benchmark.evaluate import Evaluation, evaluate_recorded
from ..benchmark.plausibility import examine
from ..benchmark.recorded_uptime import RecordedUptime, recorded_uptime
from ..benchmark.rules import UptimeRules
from ..benchmark.trajectory_file import load_trajectory
from ..common.checks import one_of
from ..common.errors import SwingupError
from ..controllers.interface.check import check_controller
from ..controllers.registry import designs_for, get_controller
from ..plant.robots import get_robot
from ..policy.shipped import DEFAULT
from . import tables
from .arguments import (
    NO_PLANT,
    ControllerName,
    ControllerNames,
    EstimatorFlags,
    PlantFlags,
    RobotName,
    RobotOrAll,
    judged_name,
    robots,
    split_commas,
)
from .judging import AS_IT_COMES
from .output import foreign_prints_apart, progress_shown, tell, tell_json
from .results import evaluation_lines, plausibility_lines, recorded_uptime_lines

FOUND = 1
"""Exit status of a check that found something."""


def score_command(
    trajectory: Positional[Annotated[str, arg(metavar="TRAJECTORY")]],
    /,
    robot: str,
    plant: PlantFlags = NO_PLANT,
    rules: str = "v2",
    json: bool = False,
) -> int:
    """Score a trajectory file in RealAIGym's CSV format, from this program, another or a real robot.

    Warnings name what cannot be the physics of this pendulum; they do not change the score.

    Args:
        trajectory: the CSV file.
        robot: acrobot or pendubot.
        plant: the pendulum of the recording: its lengths score, its equations warn.
        rules: v2 (simulation), hardware, hardware-perturbed, iros-real or v2-real; v3 or icra-real (uptime of a
            minute).
        json: print one JSON object.
    """
    chosen = get_robot(robot)
    known = {name: each.for_recordings for name, each in BOARD_RULES.items()}
    by = known[one_of("rules of recordings", rules, [name for name, each in known.items() if each])]
    rows, name, of = load_trajectory(trajectory), Path(trajectory).stem, plant.make()
    result: Evaluation | RecordedUptime
    if isinstance(by, UptimeRules):
        result = recorded_uptime(rows, chosen, name, by, of)
        lines = recorded_uptime_lines(result)
    else:
        assert by is not None
        result = evaluate_recorded(rows, chosen, name, by, of)
        lines = evaluation_lines(result, name, rules)
    found = examine(rows, chosen, by, of)
    if json:
        tell_json(result.as_dict() | found.as_dict())
    else:
        tell(*lines, *plausibility_lines(found))
    return 0


def check_command(
    robot: RobotName,
    /,
    controller: ControllerName = DEFAULT,
    estimator: EstimatorFlags = AS_IT_COMES,
    plant: PlantFlags = NO_PLANT,
) -> int:
    """Try a controller on a few dozen states and name its faults, before it is judged.

    The exit status is 1 if there is one.

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
    tell(*(f"{judged_name(controller, found)}: {each}" for each in findings or ["nothing wrong was found"]))
    return FOUND if findings else 0


@dataclass(frozen=True)
class BoardCommands:
    """The command ``leaderboard``, with rules and entrants as data: a test may cut them down."""

    rules: Mapping[str, BoardRules] = field(default_factory=lambda: BOARD_RULES)
    entrants: Sequence[str] | None = None
    """Built-in controllers that enter; None for those of the rules."""

    def leaderboard(
        self,
        robot: RobotOrAll = "all",
        /,
        controller: ControllerNames = (),
        plant: PlantFlags = NO_PLANT,
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
            controller: controllers of yours that enter as well.
            plant: what all are judged on, without published rows, and what baselines are designed for.
            rules: v2 (performance and robustness), hardware or hardware-perturbed (performance), v3 (uptime under
                throws), or runs on simulated robots: iros-real (with pushes), v2-real (without), icra-real (uptime
                under throws) or cloudpendulum (uptime in four cells).
            seed: seed of noise, pushes and throws.
            recompute: also compute the robustness of ilqr-mpc, which takes minutes and whose row is shipped.
            json: print one JSON list of rows.
            csv: print one CSV table.
            markdown: print Markdown tables.
        """
        asked = [name for name, wanted in {"json": json, "csv": csv, "markdown": markdown}.items() if wanted]
        if len(asked) > 1:
            raise SwingupError(f"--{' and --'.join(asked)} exclude each other: choose one")
        version, made, on = self.rules[one_of("rules", rules, self.rules)], [], plant.make()
        with foreign_prints_apart(), progress_shown() as progress:
            for each in robots(robot):
                mine = {
                    name: get_controller(name, each, plant=designs_for(name, on))
                    for name in split_commas(controller)
                }
                made += boards_of.leaderboard(each, mine, version, seed, recompute, self.entrants, progress, on)
        if asked:
            # Not tell(), which would escape the line ends of the table.
            print(tables.TABLE_FORMATS[asked[0]](made))
        else:
            tables.show_boards(made)
        return 0
