"""The commands ``compare`` and ``plot``: pages and figures of logs, trajectories, results and runs."""

from typing import Annotated

from tyro.conf import Positional, arg

from ..benchmark.log_comparison import compare
from ..benchmark.recording import driven_robot
from ..benchmark.trajectory_file import load_trajectory
from ..common.checks import one_of
from ..common.errors import SwingupError
from ..common.files import check_suffix, check_writable, write_atomically
from ..common.text import one_line
from ..learner.metrics import read_metrics
from ..loop.on_plant import plant_as_domain
from ..report.draw import FIGURE_FORMATS, draw, render
from ..report.figures import curves_figure, phase_figure, robustness_figure, trajectory_figure
from ..report.film import FILM_FORMATS, FPS, SIZE, animate
from ..report.inputs import make_labels, read_robustness
from ..report.log_report import report_comparison
from ..report.page import PAGE_FORMATS, save_log_report
from .arguments import (
    NO_OPTIONS,
    PLANTS,
    Names,
    OptionalDomain,
    OptionalFile,
    OptionalRobot,
    PlantOptions,
    check_outputs,
    plant_of,
)
from .output import foreign_prints_apart, tell, tell_json
from .tables import show_parts

PLOT_KINDS = ("trajectory", "phase", "animation", "robustness", "curve")
PlantNames = Annotated[tuple[str, ...], arg(metavar="PLANT...", help=f"plants to compare: {PLANTS}.")]


def compare_command(
    log: Positional[Annotated[str, arg(metavar="LOG")]],
    /,
    plant: PlantNames = ("C.1",),
    controller: str | None = None,
    domain: OptionalDomain = None,
    robot: OptionalRobot = None,
    seed: int | None = None,
    columns: Names = (),
    out: OptionalFile = None,
    json: bool = False,
) -> int:
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
        columns: names and units of the log's columns, as of swingup identify.
        out: page (.html) or figure (.png, .svg, .pdf) to write.
        json: print one JSON object.
    """
    for option, value in {"--domain": domain, "--robot": robot and robot.name, "--seed": seed}.items():
        if controller is None and value is not None:
            raise SwingupError(f"{option} {one_line(value)} goes with a controller's runs: add --controller")
    check_outputs(PAGE_FORMATS, out)
    plants = {name: plant_as_domain(name) for name in plant}
    with foreign_prints_apart():
        found = compare(log, plants, controller, domain, robot, seed or 0, columns)
    report = report_comparison(found)
    if out is not None:
        save_log_report(report, out)
    if json:
        tell_json(found.as_dict())
    else:
        show_parts(report.parts, [*report.notes, *([f"wrote {out}"] if out else [])])
    return 0


def plot_command(
    kind: Positional[Annotated[str, arg(metavar="KIND")]],
    files: Positional[Annotated[tuple[str, ...], arg(metavar="FILE...")]],
    /,
    out: str,
    robot: OptionalRobot = None,
    plant: PlantOptions = NO_OPTIONS,
    columns: Names = (),
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
) -> int:
    """Draw figures from files: .png, .svg or .pdf; animations: .gif or .webp.

    Args:
        kind: trajectory, phase or animation, from CSV files; robustness, from the JSON of evaluate --board
            robustness --json; or curve, from metrics.jsonl.
        files: the files to draw.
        out: the picture's file.
        robot: the robot of the trajectories; by default the one whose driven joint alone has torque.
        plant: the trajectories' pendulum: its lengths and its torque limit.
        columns: names and units of the trajectories' columns, as of score.
        fps: frames a second of an animation.
        size: height of an animation (pixels).
        speed: speed of an animation; 1 is real time.
    """
    check_writable(out)
    one_of("kind of plot", kind, PLOT_KINDS)
    if not files:
        raise SwingupError("nothing to draw: give at least one file")
    suffix, found = check_suffix(out, FILM_FORMATS if kind == "animation" else FIGURE_FORMATS), plant_of(plant)
    labels = make_labels(files)
    if kind == "robustness":
        figure = robustness_figure(dict(zip(labels, map(read_robustness, files), strict=True)))
    elif kind == "curve":
        figure = curves_figure(dict(zip(labels, map(read_metrics, files), strict=True)))
    else:
        trajectories = [load_trajectory(file, columns) for file in files]
        robots = [robot or driven_robot(file, rows.u) for file, rows in zip(files, trajectories, strict=True)]
        if kind == "animation":
            animate(list(zip(trajectories, robots, strict=True)), out, fps, size, speed, found)
            tell(out)
            return 0
        for file, other in zip(files, robots, strict=True):
            if other != robots[0]:
                of = f"{files[0]} is of the {robots[0].name}, {file} of the {other.name}"
                raise SwingupError(f"{of}: draw two pictures")
        named = dict(zip(labels, trajectories, strict=True))
        figure = phase_figure(named, robots[0]) if kind == "phase" else trajectory_figure(named, robots[0], found)
    write_atomically(out, render(draw(figure), suffix))
    tell(out)
    return 0
