"""The commands about pendulums and their logs: plant, excite, identify, compare and diagnose."""

import os
import time
from collections.abc import Iterable, Sequence
from shlex import quote
from typing import Annotated, Any

from tyro.conf import arg

from ..benchmark.diagnosis import diagnose
from ..benchmark.excitation_rehearsal import rehearse_identification
from ..benchmark.log_comparison import compare
from ..common.checks import positive_number
from ..common.errors import SwingupError, command_line, one_line, quoted
from ..common.files import check_writable
from ..controllers.baselines.baselines import BASELINES
from ..controllers.swingups.least_torque import least_torque
from ..identification.excitation import excite
from ..identification.identify import identify
from ..loop.resolve import resolve
from ..plant.chain import READINGS
from ..plant.files import MODEL_FILES, PARAMETER_FILES, is_model_file, save_plant
from ..plant.measured import measured_plant
from ..plant.plant import ROBOTS, torque_over_gravity
from ..plant.upright import Upright, upright_needs
from ..policy.shipped import DEFAULT, is_policy
from ..rehearsal.process import find_folder
from ..report.log_report import (
    diagnosis_tables,
    identification_tables,
    report_comparison,
    report_diagnosis,
    report_identification,
)
from ..report.page import PAGE_FORMATS, save_log_report
from .arguments import NAMES, PLANTS, DomainName, FileName, Names, RobotName, check_outputs, refuse_ignored, word_of
from .output import Progress, foreign_prints_apart, tell, tell_json, tell_table
from .results import show_parts

PLANT_FORMATS = (*PARAMETER_FILES, *MODEL_FILES)
PlantOutputs = Annotated[tuple[str, ...], NAMES, arg(metavar="FILE...")]
Logs = Annotated[tuple[str, ...], arg(metavar="LOG...")]
ROWS = {
    "m": "mass (kg)",
    "l": "length (m)",
    "r": "centre of mass from the joint (m)",
    "I": "inertia about the joint (kg m²)",
    "b": "damping (N m s/rad)",
    "cf": "Coulomb friction (N m)",
    "tl": "torque limit (N m)",
}
"""Numbers that both links or both joints have."""


def plant_command(
    source: Annotated[str | None, arg(metavar="PLANT", help=f"{PLANTS}; without it the values say all.")] = None,
    /,
    set: Annotated[tuple[str, ...], arg(metavar="NAME=VALUE...")] = (),
    inertia: Annotated[str | None, word_of("inertia", *READINGS)] = None,
    out: PlantOutputs = (),
    within: float | None = None,
    json: bool = False,
) -> None:
    """Read a plant from a URDF, an MJCF or measured values, show it, and write it as YAML, URDF or MJCF.

    From a ruler and a scale: --set m1=0.5 l1=0.2 m2=0.6 l2=0.3 motor=1 gr=6. Without more, links are rods.

    Args:
        source: the plant.
        set: values in SI units, which replace the plant's: m1, l1, r1, I1, b1, cf1, tl1, those of link 2, Ir, gr
            and g, as in a parameter file; Ic1 and Ic2, inertias about the centres of mass; motor, the torque of
            both motors before the gears; base parameters, m1r1+m2l1, m2r2, I1+m2l1^2 and I2, or Spong's theta1 to
            theta5, in the place of masses, with l1.
        inertia: what the inertias of a URDF or an MJCF are about: the centre of mass, or the joint, as in
            RealAIGym's files.
        out: files to write, .yml, .urdf or .xml.
        within: also search the least torque with which each robot's motor swings up within this time (s); takes a
            minute for each.
        json: print one JSON object.
    """
    check_outputs(PLANT_FORMATS, *out)
    if within is not None:
        positive_number("within", within, 60.0, "s")
    found = measured_plant(source, named_values("--set", set, "m1=0.5"), inertia)
    plant = found.plant
    for each in sorted(out, key=is_model_file, reverse=True):  # which may not hold every plant
        save_plant(each, plant, ["SI units, inertias about the joints.", *found.notes])
    driven = {name: robot for name, robot in ROBOTS.items() if plant.limit(robot.joint) > 0}
    least = {} if within is None else {name: least_torque(plant, robot, within) for name, robot in driven.items()}
    if json:
        searched = {} if within is None else {"least_torque": {"within": within, **least}}
        tell_json({"plant": plant.name, **plant.values(), "notes": found.notes, **searched})
        return
    numbers = {name: [f"{getattr(plant, f'{name}{link}'):.4g}" for link in (1, 2)] for name in ROWS}
    rows = [[text, f"{name}1, {name}2", *numbers[name]] for name, text in ROWS.items()]
    tell_table(["", "names", "link 1", "link 2"], rows, texts=2, title=str(plant))
    ratios = ", ".join(f"{name} {torque_over_gravity(plant.driven(robot)):.3g}" for name, robot in ROBOTS.items())
    needs = {name: upright_needs(plant, robot) for name, robot in driven.items()}
    tell(
        f"rotors Ir = {plant.Ir:.4g} kg m², gear ratio gr = {plant.gr:.4g}, gravity g = {plant.g:.4g} m/s²",
        f"torque over gravity: {ratios}",
        *found.notes,
        *(_upright_line(name, need) for name, need in needs.items() if need is not None),
        *(
            _torque_line(name, torque, float(plant.limit(driven[name].joint)), within)
            for name, torque in least.items()
        ),
        *(f"wrote {each}: use it with --plant {quote(each)}" for each in out),
    )


def _torque_line(robot: str, least: float | None, motor: float, within: float | None) -> str:
    """Whether the motor is strong enough."""
    if least is None:
        return f"swing-up as {robot} within {within:g} s: no torque was found that does it: allow more time"
    verdict = f"the motor's {motor:.3g} N m is {motor / least:.2g} times that"
    return (
        f"swing-up as {robot} within {within:g} s: {least:.3g} N m are enough; {verdict}"
        f"{'' if motor >= least else ': it is too weak'}"
    )


def _upright_line(robot: str, need: Upright) -> str:
    low, high = need.poles
    return (
        f"upright as {robot}: poles {low:.3g} and {high:.3g}/s; the motor catches a lean of at most "
        f"{need.tilt:.2g} rad; rules of thumb: {need.rate:.0f} Hz or faster, delay, lag and half a period below "
        f"{1e3 * need.dead_time:.2g} ms together, encoders of {need.counts} counts or more"
    )


def named_values(option: str, words: Iterable[str], example: str) -> dict[str, float]:
    """NAME=VALUE words of an option as a map."""
    found: dict[str, float] = {}
    for word in words:
        name, _, value = word.rpartition("=")
        try:
            number = float(value)
        except ValueError:
            name = ""
        if not name:
            raise SwingupError(
                f"{option} {quoted(word)}: write NAME=NUMBER without a unit, which is SI's, as in {example}"
            )
        if name in found:
            raise SwingupError(f"{option} gives {one_line(name, 60)} twice: give it once")
        found[name] = number
    return found


def excite_command(
    out: Annotated[str, arg(metavar="FILE.csv")],
    plant: Annotated[
        str | None, arg(metavar="PLANT", help=f"the robot's approximate parameters: {PLANTS}; default: C.1.")
    ] = None,
    domain: DomainName | None = None,
    joint: Annotated[str, word_of("joint", "both", "shoulder", "elbow")] = "both",
    duration: float = 10.0,
    torque: float | None = None,
    speed: float | None = None,
    angle: float = 3.0,
    alone: bool = False,
    seed: int = 0,
    json: bool = False,
) -> None:
    """Write an excitation for identification, within limits that are checked on plants drawn from a prior.

    The file has time, motion (pos, vel, acc), torques (tau) and feedback gains (K), 500 rows a second. Play
    u = tau + K (x - [pos, vel]) from hanging at rest, and give the robot's log to swingup identify.

    Args:
        out: the excitation's file.
        plant: the robot.
        domain: without --plant, ranges of what the robot may be: a domain's name or file; with it, the loop around
            the plant, which has the ranges of its file or those of specimens of one design.
        joint: which motors act.
        duration: length (s).
        torque: largest torque (N m). Default: that of the motors.
        speed: largest speed of a joint (rad/s). Default: 20 on design C.1, other plants in their own units.
        angle: largest angle of a joint from hanging (rad).
        alone: for loops without feedback: the torques are played alone.
        seed: seed of the plants that are drawn.
        json: print one JSON object.
    """
    check_writable(out)
    again = command_line("identify", "--rehearse", plant or ("C.1" if domain is None else "PLANT"), out)
    found = excite(plant, domain, duration, joint, torque, speed, angle, seed, alone)
    found.save(out)
    if json:
        tell_json({"joint": joint, "seed": seed, **found.as_dict()})
        return
    torques = zip(abs(found.torque).max(axis=0), found.limits.torque, strict=True)
    tell(
        f"{found.time[-1]:.3g} s, checked on {found.plants} plants ({found.prior})",
        "  largest torque " + ", ".join(f"{u:.3g} of {limit:.3g} N m" for u, limit in torques),
        f"  largest speed {found.speed:.3g} of {found.limits.speed:.3g} rad/s, "
        f"angle {found.angle:.3g} of {found.limits.angle:.3g} rad",
        f"wrote {out}; would its log tell the parameters? {again}",
    )


def identify_command(
    logs: Logs,
    /,
    test: Logs = (),
    start: Annotated[str, arg(metavar="NAME|FILE")] = "C.1",
    out: PlantOutputs = (),
    known: Annotated[tuple[str, ...], arg(metavar="NAME=VALUE...")] = (),
    sessions: Annotated[tuple[str, ...], arg(metavar="LABEL...")] = (),
    columns: Names = (),
    force: bool = False,
    seed: int = 0,
    page: Annotated[str | None, arg(metavar="FILE.html")] = None,
    rehearse: Annotated[str | None, arg(metavar="PLANT")] = None,
    json: bool = False,
) -> int:
    """Fit a pendulum's parameters and its loop to logs; takes a minute or less for five logs of 10 s.

    Errors are those of held-out motion: the test logs, or without them a part of the logs.

    Args:
        logs: logs to fit.
        test: logs to report errors on; not fitted.
        start: plant to start from, which knows the lengths: a shipped plant's name or a file.
        out: files for the plant, .yml, .urdf or .xml; its ranges go to FILE-domain.yml beside the first.
        known: values that you know, as m2r2=0.16, Ir=6e-5 or gain=0.85.
        sessions: a session's label for each log, test logs last.
        columns: names and units of the logs' columns, as time=t:ms q1=theta1:deg u1=current1:A*0.7 q2=b-a
            u2=8*goal-8*b, or names in order, with _ for a column that is not read.
        force: take logs as they are that look wrong.
        seed: seed of the intervals' bootstrap.
        page: page (.html) or figure (.png, .svg, .pdf): windows, residuals, friction curves and held-out errors.
        rehearse: the log is a file of swingup excite: play it on a specimen of this plant, in its loop, and say
            what the run's log would tell. Of the other options it takes seed and json.
        json: print one JSON object.
    """
    if not logs:
        raise SwingupError("swingup identify needs LOG...: see swingup identify --help")
    if rehearse is not None:
        others: dict[str, Any] = {"test": test, "out": out, "known": known, "sessions": sessions}
        others |= {"columns": columns, "start": None if start == "C.1" else start, "force": force, "page": page}
        refuse_ignored(others, "does not go with --rehearse")
        return _rehearse(rehearse, logs, seed, json)
    check_outputs(PLANT_FORMATS, *out)
    check_outputs(PAGE_FORMATS, page)
    begun, log = time.monotonic(), Progress().log
    facts = named_values("--known", known, "m2r2=0.16")
    found = identify(logs, test, start, facts, sessions or None, seed, columns, force)
    log(f"fitted in {time.monotonic() - begun:.0f} s")
    if json:
        # Standard output holds one object; what logs showed is said beside it.
        for warning in (text for recording in found.recordings for text in recording.warnings):
            log(warning)
        tell_json(found.as_dict())
    else:
        show_parts(identification_tables(found), found.notes)
    if page is not None:
        save_log_report(report_identification(found), page)
    if out:
        domain = found.save(*out)
        if not json:
            command = f"swingup evaluate ROBOT --board sim2real --plant {quote(str(domain))} --domain recorded"
            tell("", f"wrote {', '.join(out)} and {domain}: try a controller with {command}")
    return 0


def _rehearse(plant: str, files: Sequence[str], seed: int, json: bool) -> int:
    """Say what the log of an excitation would tell of a plant; the exit status is 1 where it would not tell all."""
    if len(files) != 1:
        raise SwingupError("--rehearse plays one excitation: name one file of swingup excite")
    with foreign_prints_apart():
        found = rehearse_identification(plant, files[0], seed=seed)
    if json:
        tell_json([{**vars(each), "passes": each.passes} for each in found])
    else:
        rows = []
        for each in found:
            interval, verdict = "{:.4g} to {:.4g}".format(*each.interval), "pass" if each.passes else "fail"
            rows.append([each.name, f"{each.truth:.4g}", f"{each.value:.4g}", interval, verdict])
        tell_table(["", "truth", "found", "95 % interval", ""], rows, title=f"a specimen of {plant}")
        if failed := [each.name for each in found if not each.passes]:
            remedy = "a longer or stronger excitation, or another log, may"
            tell(f"its log would not tell {', '.join(failed)}: {remedy}")
    return int(not all(each.passes for each in found))


def compare_command(
    log: Annotated[str, arg(metavar="LOG")],
    /,
    plant: Annotated[tuple[str, ...], arg(metavar="PLANT...", help=f"plants to compare: {PLANTS}.")] = ("C.1",),
    controller: str | None = None,
    domain: DomainName | None = None,
    robot: RobotName | None = None,
    seed: int | None = None,
    columns: Names = (),
    out: FileName | None = None,
    json: bool = False,
) -> None:
    """Compare a log with what plants predict of it, and with a controller's simulated run.

    Errors are those of predictions after 0.1, 0.25, 0.5 and 1 s, and by speed. Where a plant's file has no delay
    and lag, those that predict the log best are taken.

    Args:
        log: a recording, as swingup identify reads it.
        plant: plants to compare.
        controller: a controller whose run on each plant stands beside the log.
        domain: loop of the controller's runs: a domain's name or file. Default: a perfect loop, or what the plant's
            file has.
        robot: acrobot or pendubot, where the log's torques do not show which one the controller drives.
        seed: seed of what is drawn from the domain. Default: 0.
        columns: names and units of the log's columns, as in swingup identify.
        out: page (.html) or figure (.png, .svg, .pdf) to write.
        json: print one JSON object.
    """
    for option, value in {"--domain": domain, "--robot": robot and robot.name, "--seed": seed}.items():
        if controller is None and value is not None:
            raise SwingupError(f"{option} {one_line(value)} goes with a controller's runs: add --controller")
    check_outputs(PAGE_FORMATS, out)
    plants = {name: resolve(name) for name in plant}
    with foreign_prints_apart():
        found = compare(log, plants, controller, domain, robot, seed or 0, columns)
    report = report_comparison(found)
    if out is not None:
        save_log_report(report, out)
    if json:
        tell_json(found.as_dict())
    else:
        show_parts(report.parts, [*report.notes, *([f"wrote {out}"] if out else [])])


def diagnose_command(
    log: Annotated[str, arg(metavar="LOG")],
    /,
    policy: Annotated[str, arg(metavar="POLICY")] = DEFAULT,
    plant: Annotated[
        str | None, arg(metavar="PLANT", help=f"plant that the policy is meant for: {PLANTS}.")
    ] = None,
    domain: DomainName | None = None,
    robot: RobotName | None = None,
    columns: Names = (),
    quick: bool = False,
    out: FileName | None = None,
    json: bool = False,
) -> int:
    """Say why a policy's run failed on the robot, from its log: the likeliest causes, with evidence and remedy.

    The exit status is 1 where the log shows the cause of a failure, and 0 where nothing is wrong that it shows.

    Args:
        log: what the controller saw and commanded, as swingup identify reads it.
        policy: a folder of swingup export, the file of a policy or feedback law (.safetensors), or a shipped
            policy's name.
        plant: the plant. Default: that of the policy's file.
        domain: loop that the plant's file lacks: a domain's name or file. What lies in its ranges is no cause.
        robot: acrobot or pendubot, where neither the policy nor the log's torques say it.
        columns: names and units of the log's columns, as in swingup identify.
        quick: leave out the simulations of the policy with the cause and without it.
        out: page (.html) or figure (.png, .svg, .pdf) to write.
        json: print one JSON object.
    """
    check_outputs(PAGE_FORMATS, out)
    if policy in BASELINES and not os.path.isdir(policy):
        raise SwingupError(
            f"{policy} is designed anew for each plant: give what ran, the folder of swingup export or the "
            "feedback law of swingup make-controller (.safetensors)"
        )
    folder = None if is_policy(policy) else find_folder(policy)
    source = policy if folder is None else folder.policy
    if source is None:
        raise SwingupError(f"{one_line(policy)} has no policy file: give the one that it runs (.safetensors)")
    found = diagnose(log, source, plant, domain, robot, columns, not quick)
    if out is not None:
        save_log_report(report_diagnosis(found), out)
    if json:
        tell_json(found.as_dict())
    else:
        show_parts(diagnosis_tables(found), [*found.lines, *([f"wrote {out}"] if out else [])])
    return int(found.named is not None)
