"""The commands ``compare`` and ``plot``: pages and figures of logs, trajectories, results and runs."""

from typing import Annotated

from tyro.conf import Positional, arg

from ..common.errors import SwingupError
from ..common.files import check_writable
from ..common.text import one_line
from ..loop.on_plant import plant_as_domain
from ..report.compare import compare
from ..report.film import FPS, SIZE
from ..report.log_report import report_comparison
from ..report.save import PAGE_FORMATS, save_log_report, save_plot
from .arguments import (
    NO_PLANT,
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
    if not plant:
        raise SwingupError("--plant needs at least one plant: a shipped name or a file")
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
    plant: PlantOptions = NO_PLANT,
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
    save_plot(kind, files, out, robot, fps, size, speed, plant_of(plant), columns)
    tell(out)
    return 0
