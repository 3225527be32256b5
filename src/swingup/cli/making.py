"""The command ``make-controller``: from a pendulum's logs or its file to a controller for its computer."""

import dataclasses
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from ..benchmark.board import Result
from ..benchmark.boards import SIM2REAL
from ..benchmark.judge import judge
from ..common import __version__
from ..common.arrays import SUFFIX
from ..common.checks import check_seeds, whole_number
from ..common.errors import SwingupError, command_line
from ..common.files import check_suffix
from ..controllers.baselines.baselines import feedback_policy
from ..controllers.registry import get_controller
from ..controllers.stack.policy import make_controller
from ..export.folder import NAME, ROBOT_FORMS, cloudpendulum_guard
from ..identification.identify import Identification, identify
from ..learner.run import start_or_resume_run
from ..learner.run_folder import BEST
from ..learner.run_settings import make_run_settings
from ..loop.domain import Domain
from ..loop.loop import LOOP_DT
from ..loop.resolve import NO_LOOP, resolve
from ..plant.files import is_plant_name
from ..plant.measured import measured_plant
from ..plant.plant import ROBOTS, Plant, Robot
from ..policy.estimator import default_estimator
from ..policy.feedback import FeedbackPolicy, RobotPolicy, write_feedback
from ..policy.guard import choose_guard
from ..policy.pendulum import PendulumPolicy, write_pendulum_policy
from ..policy.shipped import load_pendulum_policy
from ..refine.adapt import CHOICE_SEED, JUDGED_SEED
from ..refine.transfer import find_policies
from ..report.log_report import identification_tables, report_identification
from ..report.page import PAGE_FORMATS, save_log_report
from .arguments import DomainName, FileName, Names, RobotName, check_outputs, refuse_ignored, word_of
from .exporting import check_destination, choose_export_guard, write_export
from .output import Progress, tell
from .pendulums import named_values
from .results import result_lines, show_parts
from .training import train_shown

TRACKING = "tvlqr"  # The baseline that is tried where the shipped policy does not swing the plant up
PRESET, FRAMES = "small", 2_500_000
"""What is trained where that fails as well; pendubots hold after a million frames."""
TRIES = 12  # Policies of no training that are judged before one is trained
DRAWS = 20  # Simulated pendulums that choose the policy, and others that judge it
ENOUGH = 0.95  # Share of them below which the command names what to do
START = "C.1"
HEADERS = (".h", ".hpp")


def make_controller_command(
    sources: Annotated[tuple[str, ...], arg(metavar="LOG...|PLANT")],
    /,
    out: Annotated[str, arg(metavar="PATH")],
    to: Annotated[str, word_of("format", *ROBOT_FORMS, "c")] = "c",
    robot: RobotName | None = None,
    start: Annotated[str | None, arg(metavar="NAME|FILE")] = None,
    set: Annotated[tuple[str, ...], arg(metavar="NAME=VALUE...")] = (),
    known: Annotated[tuple[str, ...], arg(metavar="NAME=VALUE...")] = (),
    columns: Names = (),
    force: bool = False,
    domain: DomainName | None = None,
    frames: int = FRAMES,
    seed: int = 0,
    seeds: int = DRAWS,
    name: str = NAME,
    page: FileName | None = None,
) -> int:
    """Make a controller for your pendulum from its logs: identify, find or train a policy, judge and export.

    The shipped policy swings many pendulums up if it is told another plant than the true one: the command searches
    for one in simulation. If none succeeds on 95 % of the drawn pendulums, the command tries TVLQR along a swing-up
    of the plant behind a state estimator, and then trains a policy. The best controller is judged on other draws.
    Beside OUT the command writes OUT.safetensors, the policy or TVLQR's feedback law, and for logs OUT-plant.yml
    with the plant and OUT-plant-domain.yml with its ranges. An interrupted training goes on in OUT-run.

    Args:
        sources: logs as of swingup identify; or the file of a plant, perhaps with ranges and a loop.
        out: the C header (.h or .hpp), or the folder, new or empty.
        to: c, a C99 header; realaigym or cloudpendulum, a folder that needs NumPy alone.
        robot: acrobot or pendubot, where the plant has two motors.
        start: the plant to start the identification from; default: C.1, or rods with --set.
        set: what a ruler and a scale say of the pendulum, as of swingup plant; replaces the start's.
        known: values that you know, as of swingup identify.
        columns: names and units of the logs' columns, as of swingup identify.
        force: take logs as they are that look wrong.
        domain: the loop of the simulation that judges: a domain's name or file; what the source says of it counts.
        frames: frames to train where that is needed.
        seed: seed of the search and the training.
        seeds: simulated pendulums by which the policy is chosen, and as many others that judge it.
        name: of the entry (con_NAME.py, controller_NAME.py), and what all names in a C header begin with.
        page: page (.html) or figure (.png, .svg, .pdf) of the logs, as of swingup identify.
    """
    if not sources:
        raise SwingupError("swingup make-controller needs LOG... or PLANT: see swingup make-controller --help")
    if to == "c":
        check_suffix(out, HEADERS)
    check_destination(to, out, name)
    check_outputs(PAGE_FORMATS, page)
    check_seeds(0, seeds)
    check_seeds(seed, 1)
    whole_number("frames", frames, 1)
    if domain is not None:
        resolve(domain=domain)
    # The current folder has no name of its own.
    path = Path(out).with_suffix("") if to == "c" else Path(out) if Path(out).name else Path(out).absolute()
    if is_plant_name(sources[0]):
        if len(sources) > 1:
            raise SwingupError(f"{len(sources)} files, the first of a plant: give one plant, or logs alone")
        for_logs = {"start": start, "set": set, "known": known, "columns": columns, "force": force, "page": page}
        refuse_ignored(for_logs, f"is for logs, and {sources[0]} is a plant")
        source = sources[0]
    else:
        measured = named_values("--set", set, "m1=0.5")
        begin = measured_plant(start, measured).plant if measured else (start or START)
        _the_robot(resolve(begin).nominal_plant, robot)  # Before the minute that a fit takes; it keeps the motors
        found = _identified(sources, begin, known, columns, force)
        source = str(found.save(path.with_name(f"{path.name}-plant.yml")))
        if page is not None:
            save_log_report(report_identification(found), page)
    around = resolve(source, domain)
    robot = _the_robot(around.nominal_plant, robot)
    file = f"{path}{SUFFIX}"

    def tried(policy: RobotPolicy) -> tuple[int, RobotPolicy]:
        guarded = dataclasses.replace(policy, guard=choose_export_guard(policy, to, True, {}))
        return _judged(guarded, around, seeds, file, CHOICE_SEED).successes, guarded

    best: tuple[int, RobotPolicy | None] = -1, None
    for candidate in _transferred(around.nominal_plant, robot, to, seed):
        best = max(best, tried(candidate), key=itemgetter(0))
        if best[0] == seeds:
            break
    if best[0] < ENOUGH * seeds and (law := _tracking(around.nominal_plant, robot)) is not None:
        best = max(best, tried(law), key=itemgetter(0))
    if best[0] < ENOUGH * seeds:
        trained, status = _trained(around.nominal_plant, robot, path, frames, seed)
        if trained is None:
            return status
        best = max(best, tried(trained), key=itemgetter(0))
    policy = best[1]
    assert policy is not None  # The trained one is there where nothing was found
    options: dict[str, Any] = {"to": to, "out": out, "robot": robot.name, "start": start}
    options |= {"set": set, "known": known, "columns": columns, "force": force or None}
    options |= {"domain": domain, "frames": frames, "seed": seed, "seeds": seeds, "name": name}
    provenance = {"command": command_line("make-controller", *sources, **options), "version": __version__}
    if isinstance(policy, FeedbackPolicy):
        policy = dataclasses.replace(policy, metadata=provenance)
        write_feedback(file, policy)
    else:
        write_pendulum_policy(file, policy, {**policy.metadata, **provenance})
    # By draws on which nothing was chosen.
    result = _judged(policy, around, seeds, file, JUDGED_SEED)
    tell(*result_lines(result, file))
    write_export(policy, to, out, name)
    on = {"plant": source, "domain": domain or NO_LOOP}
    again = command_line("evaluate", robot.name, board=SIM2REAL.name, controller=file, **on)
    tell(f"judge it on other draws with {again}")
    if result.successes < ENOUGH * len(result.runs):
        again = command_line("refine", robot.name, recipe="adapt", **on, out=f"{path}-adapted{SUFFIX}")
        tell(f"it fails on {len(result.runs) - result.successes} of {len(result.runs)}: an hour of {again}")
    return 0


def _identified(
    logs: tuple[str, ...], begin: Plant | str, known: tuple[str, ...], columns: Any, force: bool
) -> Identification:
    """The pendulum of the logs, shown."""
    facts = named_values("--known", known, "m2r2=0.16")
    Progress().log("identifying the pendulum")
    found = identify(logs, (), begin, facts, columns=columns, force=force)
    show_parts(identification_tables(found), found.notes)
    return found


def _the_robot(plant: Plant, given: Robot | None) -> Robot:
    """The robot that a plant with one motor is, or the one that was named."""
    if given is not None:
        plant.needs_motor(given)
        return given
    able = [each for each in ROBOTS.values() if plant.limit(each.joint) > 0]
    if len(able) != 1:
        what = "two motors" if able else "no motor"
        raise SwingupError(
            f"{plant} has {what}: " + ("name --robot acrobot or pendubot" if able else "raise tl1 or tl2")
        )
    return able[0]


def _transferred(plant: Plant, robot: Robot, to: str, seed: int) -> list[PendulumPolicy]:
    """The first few policies that swing the plant up without training."""
    own = cloudpendulum_guard(LOOP_DT) if to == "cloudpendulum" else None
    guard = choose_guard(True, own, LOOP_DT, plant)
    assert guard is not None  # It was asked for
    with Progress() as bar:
        bar.log("telling the shipped policy other plants, to swing this one up")
        found = find_policies(plant, robot, guard, seed, progress=partial(bar, "rounds of the search"))
        bar.log(f"{len(found)} candidates come up and stay up")
    return found[:TRIES]


def _tracking(plant: Plant, robot: Robot) -> FeedbackPolicy | None:
    """TVLQR along a swing-up of the plant, behind an estimator; None where no swing-up comes up."""
    with Progress() as bar:
        bar.log(f"designing {TRACKING} for this plant")
        try:
            return feedback_policy(TRACKING, robot, plant, estimator=True)
        except SwingupError as error:
            bar.log(str(error))
            return None


def _trained(plant: Plant, robot: Robot, path: Path, frames: int, seed: int) -> tuple[PendulumPolicy | None, int]:
    """The best policy of a run on the plant with its friction, behind an estimator; None where it was stopped."""
    folder = path.with_name(f"{path.name}-run")
    run = start_or_resume_run(make_run_settings(robot.name, PRESET, plant=plant, seed=seed), folder, frames)
    if status := train_shown(run):
        return None, status
    found = load_pendulum_policy(str(folder / BEST), robot)
    return dataclasses.replace(found, estimator=default_estimator(found.plant)), 0


def _judged(policy: RobotPolicy, around: Domain, seeds: int, file: str, seed: int) -> Result:
    """How the controller does on pendulums drawn from the ranges that the logs leave."""
    with Progress() as bar:
        judged: Any
        if isinstance(policy, FeedbackPolicy):
            named = policy.name
            judged = get_controller(named, policy.robot, True, around.nominal_plant)
        else:
            judged, named = make_controller(policy), file
        return judge(
            judged, policy.robot, SIM2REAL, seeds, seed=seed, name=named, domain=around,
            progress=lambda done, total: bar("simulated pendulums", done, total),
        )  # fmt: skip
