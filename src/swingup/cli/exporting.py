"""The commands ``plot``, ``export`` and ``rehearse``: pictures, controllers for other programs, and rehearsals."""

import dataclasses
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, get_args

from tyro.conf import arg

from ..benchmark.boards import SIM2REAL, swing_up_board
from ..benchmark.recording import driven_robot, load_trajectory, save_trajectory
from ..common.arrays import SUFFIX
from ..common.checks import check_seeds, one_of, positive_number
from ..common.errors import SwingupError, command_line, quoted
from ..common.files import check_suffix, check_writable, has_suffix, write_atomically
from ..controllers.baselines.baselines import (
    BASELINES,
    DESIGN_SEED,
    EXPORTED,
    PROBLEMS,
    design_of,
    feedback_policy,
    in_real_units,
    reaches_upright,
    shipped_reference,
)
from ..controllers.check import spread
from ..controllers.swingups.reference import save_reference, save_reference_csv
from ..export.c_header import c_header
from ..export.c_text import Precision
from ..export.folder import FORMS as FOLDERS
from ..export.folder import (
    NAME,
    ROBOT_FORMS,
    USERNAME,
    check_export_name,
    check_new,
    check_username,
    cloudpendulum_guard,
    cloudpendulum_notes,
    export_folder,
)
from ..export.onnx_graph import onnx_model
from ..plant.plant import LEADERBOARD, Robot, validated
from ..policy.feedback import FeedbackPolicy, RobotPolicy, is_law, load_robot_policy
from ..policy.guard import GuardSettings, choose_guard
from ..policy.pendulum import write_plant
from ..policy.policy import TaskPolicy
from ..policy.shipped import DEFAULT, SHIPPED_POLICIES, load_policy
from ..rehearsal.process import CALLING_TIME
from ..rehearsal.rehearse import Rehearsal, rehearse
from ..report.draw import FIGURE_FORMATS, draw, render
from ..report.figures import make_labels, phase_figure, read_robustness, robustness_figure, trajectory_figure
from ..report.film import FILM_FORMATS, FPS, SIZE, animate
from ..report.log_report import learning_curves, report_runs
from ..report.page import PAGE_FORMATS, save_log_report
from .arguments import (
    NO_OPTIONS,
    DomainName,
    FileName,
    Names,
    PlantOptions,
    RobotName,
    facts_of,
    refuse_ignored,
    word_of,
)
from .output import Progress, tell, tell_json
from .results import aligned, result_lines

TRAJECTORY = "trajectory"
FORMS = (*FOLDERS, "onnx", "c", TRAJECTORY)

POLICIES = (
    f"{', '.join(SHIPPED_POLICIES)}, a policy file (.safetensors), or a baseline: {', '.join(EXPORTED)}, or for "
    f"trajectory {', '.join(PROBLEMS)}."
)


def export_command(
    policy: Annotated[str, arg(metavar="POLICY", help=POLICIES)] = DEFAULT,
    /,
    *,
    to: Annotated[str, word_of("format", *FORMS)],
    out: Annotated[str, arg(metavar="PATH")],
    robot: RobotName | None = None,
    username: str = USERNAME,
    name: str = NAME,
    precision: Annotated[Precision, word_of("precision", *get_args(Precision))] = "double",
    guard: bool = True,
    velocity_limit: float | None = None,
    braking: float | None = None,
    zero1: float | None = None,
    zero2: float | None = None,
    estimator: bool | None = None,
    plant: PlantOptions = NO_OPTIONS,
    seed: int | None = None,
) -> None:
    """Write a policy of any task for NumPy, ONNX Runtime or C, or a pendulum's for RealAIGym or CloudPendulum.

    The baselines lqr, tvlqr and tvlqr-score are written for c and both robots; RealAIGymController runs the others.

    Args:
        policy: the policy.
        to: numpy, a folder that needs NumPy alone, or for pendulums realaigym or cloudpendulum; onnx, a graph, of a
            pendulum's network alone; c, a header in C99 and C++11; or trajectory, a baseline's swing-up with its
            gains, in RealAIGym's format where the file ends in .csv.
        out: the folder, new or empty; or the file.
        robot: acrobot or pendubot. Required for shipped policies; a file must match it.
        username: your name on RealAIGym's leaderboard.
        name: of the entry (con_NAME.py, controller_NAME.py), and what all names in a C header begin with, so that
            several go side by side; ONNX has none.
        precision: of a C header: double, or single for processors that compute in 32 bits.
        guard: put a safety guard around a pendulum's controller in the folders and in c: it stops the controller at
            a limit or a broken measurement. Turn it off for simulations. An onnx graph has none.
        velocity_limit: of both joints (rad/s), beyond which the guard stops the controller; by default the policy
            file's, or 20 on design C.1, other plants in their own units, and 50 for cloudpendulum.
        braking: damping (N m s/rad) with which the guard brakes both joints of a stopped controller, each within
            its torque limit, where the measurement is sound; by default the policy file's, or none.
        zero1: what the shoulder's encoder shows where the pendulum hangs (rad), which the controller subtracts; by
            default the plant's.
        zero2: the same of the elbow.
        estimator: put a state estimator before a baseline; a policy's file says whether it has one.
        plant: what adaptive begins with, in that plant's units, where that is within what it was taught; or what a
            baseline is designed for. A swing-up for another plant than the leaderboards' takes minutes.
        seed: compute the trajectory, shipped or not, from first torques of this seed.
    """
    check_destination(to, out, name, username)
    if estimator is not None and (to == TRAJECTORY or policy not in BASELINES):
        raise SwingupError("--estimator goes with a baseline's controller: leave it out")
    if precision != "double" and to != "c":
        raise SwingupError(f"--precision {precision} goes with --to c: leave it out")
    zeros = {name: value for name, value in {"zero1": zero1, "zero2": zero2}.items() if value is not None}
    changes = {"velocity_limit": velocity_limit, "braking": braking}
    if to == TRAJECTORY:
        refuse_ignored({**zeros, **changes, "no-guard": not guard}, "is of a controller, not of a trajectory")
        _export_trajectory(policy, _needed(robot, policy), out, plant, seed)
        return
    refuse_ignored({"seed": seed}, "goes with --to trajectory")
    found: TaskPolicy | RobotPolicy
    if policy in BASELINES:
        _check_law_form("baseline", to)
        found = feedback_policy(policy, _needed(robot, policy), facts_of(plant) or LEADERBOARD, bool(estimator))
    elif ":" in policy and not has_suffix(policy, SUFFIX):
        raise SwingupError(
            f"{policy} is a controller of your own: its code runs in a loop as it is, without export"
        )
    elif is_law(policy):
        refuse_ignored({"plant": facts_of(plant)}, "is of policies and baselines, and a law is of its own plant")
        _check_law_form("feedback law", to)
        found = load_robot_policy(policy, robot)
    else:
        found = load_policy(policy, robot, facts_of(plant))
    if not isinstance(found, TaskPolicy):
        found = dataclasses.replace(found, plant=validated(found.plant.changed(**zeros)))
        found = dataclasses.replace(found, guard=choose_export_guard(found, to, guard, changes))
    else:
        of_pendulums = {**zeros, **changes, "no-guard": not guard}
        refuse_ignored(of_pendulums, f"is of pendulums, and {policy} of {quoted(found.task)}")
    write_export(found, to, out, name, username, precision)


def _check_law_form(kind: str, to: str) -> None:
    if to not in (*ROBOT_FORMS, "c"):
        raise SwingupError(f"a {kind} is not written for {to}: use --to c, {' or '.join(ROBOT_FORMS)}")


def _needed(robot: Robot | None, policy: str) -> Robot:
    if robot is None:
        raise SwingupError(f"{policy} needs a robot: add --robot acrobot or --robot pendubot")
    return robot


def check_destination(to: str, out: str, name: str, username: str = USERNAME) -> None:
    """Refuse, before work of minutes, what could not be written after it."""
    check_export_name(name)
    check_username(username)
    if username != USERNAME and to != "realaigym":
        raise SwingupError(f"--username {quoted(username)} is for RealAIGym's leaderboard: leave it out")
    if name != NAME and to in ("onnx", TRAJECTORY):
        raise SwingupError(f"--name {name} is of folders and C headers, and --to {to} has none: leave it out")
    if to in FOLDERS:
        check_new(out)
    else:
        check_writable(out)


def write_export(
    found: TaskPolicy | RobotPolicy,
    to: str,
    out: str,
    name: str = NAME,
    username: str = USERNAME,
    precision: Precision = "double",
) -> None:
    """Write a policy with its guard in one of the forms, and say so."""
    notes = [] if isinstance(found, TaskPolicy) else _pendulum_notes(found, to)
    if to in FOLDERS:
        out = str(export_folder(found, out, to, name, username))
    elif to == "onnx" and not isinstance(found, FeedbackPolicy):
        write_atomically(out, onnx_model(found))
    else:
        write_atomically(out, c_header(found, name, precision).encode())
    tell(out, *notes)


def _pendulum_notes(policy: RobotPolicy, to: str) -> list[str]:
    """What a form lacks of a pendulum's policy."""
    if to == "cloudpendulum":
        return cloudpendulum_notes(policy)
    if to != "onnx" or isinstance(policy, FeedbackPolicy):
        return []
    left_out = [part for part in policy.parts if part != GuardSettings.PART]
    missing = f"{', '.join(left_out)} and a safety guard" if left_out else "a safety guard"
    return [f"this is the network for the plant {policy.plant.name} alone, without {missing}"]


def _export_trajectory(name: str, robot: Robot, out: str, plant: PlantOptions, seed: int | None) -> None:
    """Write the swing-up that a baseline follows: the shipped one, or one that iterative LQR computes."""
    problem = PROBLEMS[one_of("baseline that follows a swing-up", name, PROBLEMS)]
    on = facts_of(plant) or LEADERBOARD
    design = design_of(robot, on)
    check_seeds(seed or 0, 1)
    if design.shipped and seed is None:
        reference, provenance = shipped_reference(robot, problem)
    else:
        seed = DESIGN_SEED if seed is None else seed
        reference, provenance = design.compute(problem, seed)
        if not reaches_upright(reference, design.model):
            raise SwingupError(
                f"no swing-up of the {robot.name} was found with seed {seed}: use another --seed, or a stronger "
                "motor"
            )
        reference = reference if design.shipped else in_real_units(reference, design.scales)
        command = command_line("export", name, robot=robot.name, to=TRAJECTORY, **plant, seed=seed, out=out)
        provenance |= {"plant": write_plant(on.driven(robot)), "command": command}
    if has_suffix(out, ".csv"):
        save_reference_csv(out, reference, on.zeros)
    else:
        save_reference(out, reference, provenance)
    tell(out, *(f"{name:<20}{value}" for name, value in (provenance | on.summary(robot)).items()))


def choose_export_guard(
    policy: RobotPolicy, to: str, wanted: bool, changes: Mapping[str, float | None]
) -> GuardSettings | None:
    """The policy file's guard, or that of the robot that a form is for, with what the user changed of it."""
    own = policy.guard or (cloudpendulum_guard(policy.period) if to == "cloudpendulum" else None)
    given: dict[str, Any] = {name: value for name, value in changes.items() if value is not None}
    if wanted and to != "onnx":
        return choose_guard(given or True, own, policy.period, policy.plant)
    if given:
        flag = next(iter(given)).replace("_", "-")
        raise SwingupError(f"--{flag} is a setting of the safety guard: leave --no-guard out; onnx has no guard")
    return None


def rehearse_command(
    folder: Annotated[str, arg(metavar="FOLDER")],
    /,
    plant: Annotated[str | None, arg(metavar="PLANT")] = None,
    domain: DomainName | None = None,
    robot: RobotName | None = None,
    board: str = SIM2REAL.name,
    duration: float | None = None,
    seed: int = 0,
    seeds: int | None = None,
    real_time: bool = False,
    timeout: float = CALLING_TIME,
    json: bool = False,
    save: FileName | None = None,
) -> None:
    """Run an exported folder in processes of its own, against simulated robots, before the real one.

    The folder is one of swingup export --to realaigym or cloudpendulum, and is called as there. A folder that
    cannot be imported, crashes, hangs, prints, or gives no two finite torques ends it in one line and status 2.

    Args:
        folder: the folder, or its con_NAME.py or controller_NAME.py.
        plant: a plant's name or its file, with the loop that the file has.
        domain: the loop, and the plant if none is given: a domain's name or file, or none for a perfect loop;
            default: that of the board sim2real, recorded.
        robot: acrobot or pendubot, where the folder does not say it.
        board: how the runs are scored: sim2real, performance, hardware or hardware-perturbed.
        duration: length of a run (s); default: that of the board, 10 s.
        seed: first seed of plants, loops and noise, as in swingup evaluate.
        seeds: seeds in a row; by default 10, or 1 in real time or in a perfect loop.
        real_time: one step every 2 ms, with periods and missed deadlines measured.
        timeout: maximum time of a call (s).
        json: print one JSON object.
        save: also write the first run's trajectory to this CSV file.
    """
    scored = swing_up_board(board)
    longest = positive_number("timeout", timeout, 600.0, "s")
    if save is not None:
        check_writable(save)
    with Progress() as bar:
        progress = partial(bar, "runs")
        found = rehearse(folder, plant, domain, robot, scored, duration, seeds, seed, real_time, longest, progress)
    if save is not None and found.result.trajectory is not None:
        save_trajectory(save, found.result.trajectory, found.result.runs[0].case.scenario.parameters.zeros)
    tell_json(found.as_dict()) if json else tell(*rehearsal_lines(found))


def rehearsal_lines(found: Rehearsal) -> list[str]:
    """How the runs went, what the guard did, and what was measured of the calls."""
    stopped, runs = sum(stop is not None for stop in found.stops), len(found.stops)
    guard = "none" if not found.facts["guard"] else f"stopped {stopped} of {runs}" if stopped else "quiet"
    limits = "" if found.limits is None else "limits {:.4g} rad, {:.4g} rad/s".format(*found.limits)
    lines = result_lines(found.result, f"{found.folder.entry.name}, {found.folder.form}")
    lines.append(aligned("Guard", guard, limits))
    timing = found.timing
    for title, times in {"Call [ms]": timing.calls, "Period [ms]": timing.periods}.items():
        if times:
            median, percentile, maximum = (f"{1e3 * each:.3f}" for each in spread(times))
            lines.append(aligned(title, median, f"99 % {percentile}, maximum {maximum}"))
    if found.real_time:
        missed = timing.missed_deadlines
        lines.append(aligned("Missed deadlines", str(missed), f"of {len(timing.calls) + missed} periods"))
    if late := timing.late_periods:
        lines.append(f"  The simulation was late {late} times: close other programs and repeat.")
    return lines if found.difference is None else [*lines, f"  {found.difference}"]


PLOT_KINDS = ("trajectory", "phase", "animation", "robustness", "curve")


def plot_command(
    kind: Annotated[str, arg(metavar="KIND")],
    files: Annotated[tuple[str, ...], arg(metavar="FILE...")],
    /,
    out: str,
    robot: RobotName | None = None,
    plant: PlantOptions = NO_OPTIONS,
    columns: Names = (),
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
) -> None:
    """Draw figures from files: .png, .svg or .pdf; animations: .gif or .webp; learning curves also a page: .html.

    Args:
        kind: trajectory, phase or animation, from CSV files; robustness, from the JSON of evaluate --board
            robustness --json; or curve, from runs' folders or their metrics.jsonl.
        files: the files to draw.
        out: the picture's file.
        robot: the robot of the trajectories; by default the one whose driven joint alone has torque.
        plant: the trajectories' pendulum: its lengths and its torque limit.
        columns: names and units of the trajectories' columns, as in swingup score.
        fps: frames a second of an animation.
        size: height of an animation (pixels).
        speed: speed of an animation; 1 is real time.
    """
    check_writable(out)
    one_of("kind of plot", kind, PLOT_KINDS)
    if not files:
        raise SwingupError("nothing to draw: give at least one file")
    if kind != "animation" and (fps, size, speed) != (FPS, SIZE, 1.0):
        raise SwingupError("--fps, --size and --speed go with animation: leave them out")
    if kind in ("robustness", "curve"):
        refuse_ignored({"robot": robot, **plant, "columns": columns}, "goes with trajectories")
    formats = {"animation": FILM_FORMATS, "curve": PAGE_FORMATS}
    suffix = check_suffix(out, formats.get(kind, FIGURE_FORMATS))
    found = facts_of(plant) or LEADERBOARD
    labels = make_labels(files)
    if kind == "robustness":
        figure = robustness_figure(dict(zip(labels, map(read_robustness, files), strict=True)))
    elif kind == "curve":
        if suffix == ".html":
            save_log_report(report_runs(files), out)
            tell(out)
            return
        figure = learning_curves(files)
    else:
        trajectories = [load_trajectory(file, columns, found.zeros) for file in files]
        robots = [robot or driven_robot(file, rows.u) for file, rows in zip(files, trajectories, strict=True)]
        if kind == "animation":
            animate(list(zip(trajectories, robots, strict=True)), out, fps, size, speed, found)
            tell(out)
            return
        for file, other in zip(files, robots, strict=True):
            if other != robots[0]:
                of = f"{files[0]} is of the {robots[0].name}, {file} of the {other.name}"
                raise SwingupError(f"{of}: draw two pictures")
        named = dict(zip(labels, trajectories, strict=True))
        figure = phase_figure(named, robots[0]) if kind == "phase" else trajectory_figure(named, robots[0], found)
    write_atomically(out, render(draw(figure), suffix))
    tell(out)
