"""The command ``demo``: from nothing to a policy, its score beside known ones, and a page of its swing-up."""

import itertools
import shlex
import sys
import time
from pathlib import Path

from ..benchmark.leaderboard import paper_score
from ..common.errors import SwingupError, duration
from ..common.files import write_atomically
from ..controllers.stack.policy import policy_alone
from ..learner.progress import TrainingReport
from ..learner.run import Run
from ..learner.run_folder import BEST, FIRST
from ..plant.plant import ROBOTS, Robot
from ..policy.shipped import load_policy
from ..report.log_report import curves_part
from ..report.page import page_template, render_page, trained_section
from .arguments import RobotName
from .output import Progress, program_typed, tell
from .results import comparison_lines
from .training import start_training, train_shown

TRAINED_NAME, FIRST_NAME = "your policy", "your policy at first"


def demo_command(
    robot: RobotName = ROBOTS["acrobot"], /, seed: int = 0, frames: int | None = None, out: str | None = None
) -> int:
    """Train a policy, show its progress, score it beside known controllers, and write a page of its swing-up.

    The training is that of train --preset fast, which has more options and continues an interrupted run.

    Args:
        robot: acrobot or pendubot.
        seed: seed of the training.
        frames: frames to train for; default: the preset's.
        out: folder of the run, which does not exist yet; default runs/demo-ROBOT, with a number where that exists.
    """
    start = time.monotonic()
    page_template()  # before the training: without its libraries there is no page
    folder, paper = _new_folder(robot, out), paper_score(robot)
    run = start_training(robot.name, frames, str(folder), preset="fast", seed=seed)
    tell(
        f"AR-EAPO learns to swing up the {robot.name} from nothing, by trial and error.",
        f"A score of 1 is perfect, 0 is no swing-up; the paper's policy has {paper:.3f}.",
    )
    sys.stdout.flush()  # before the progress, which goes to the other stream
    passed: float | None = None

    def note(report: TrainingReport) -> str:
        """The paper's score, and the time at which the run passed it."""
        nonlocal passed
        if passed is None and (report.best_score or 0.0) >= paper:
            passed = time.monotonic() - start
        return f"paper's {paper:.3f}" + ("" if passed is None else f" at {passed:.0f} s")

    return train_shown(run, note) or _show_result(robot, run, passed, start)


def _new_folder(robot: Robot, out: str | None) -> Path:
    """The folder of the run: the one that was asked for, or the first that does not exist."""
    if out is not None:
        if Path(out).exists():
            raise SwingupError(f"{out} exists: choose another --out")
        return Path(out)
    base = Path("runs") / f"demo-{robot.name}"
    numbered = (base.with_name(f"{base.name}-{number}") for number in itertools.count(2))
    return next(folder for folder in itertools.chain([base], numbered) if not folder.exists())


def _show_result(robot: Robot, run: Run, passed: float | None, start: float) -> int:
    """Score the best policy, write the page, and name commands to go on with."""
    policy, page = run.folder / BEST, run.folder / "page.html"
    files = {TRAINED_NAME: policy, FIRST_NAME: run.folder / FIRST}
    policies = {name: policy_alone(load_policy(file, robot)) for name, file in files.items()}
    with Progress() as progress:
        section = trained_section(robot, policies, progress)
    title = f"{robot.name.capitalize()}: your policy after {run.frames / 1e6:.3g} million frames"
    write_atomically(page, render_page([section], title, [curves_part([run.folder])]).encode())
    verdict = "The best score stayed below the paper's: try more --frames, or another --seed."
    if passed is not None:
        verdict = f"Training passed the paper's score after {passed:.0f} s."
    program, (other,) = program_typed(), {*ROBOTS} - {robot.name}
    tell(
        "",
        *comparison_lines(section.tables[0], TRAINED_NAME),
        "",
        verdict,
        f"All of it took {duration(time.monotonic() - start)}.",
        "",
        f"Policy  {policy}",
        f"Page    {page}: open it in a browser, and push the pendulum",
        "",
        "Next:",
        "# 722 simulations of your policy, with noise, delay and pushes",
        f"{program} evaluate {robot.name} --board robustness --controller {shlex.quote(str(policy))}",
        "# the other robot",
        f"{program} demo {other}",
        "# every controller on the long boards",
        f"{program} leaderboard {robot.name}",
    )
    return 0
