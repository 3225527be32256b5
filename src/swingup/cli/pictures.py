"""The commands that draw: ``plot`` and ``report``."""

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from ..common.files import check_writable, write_atomically
from ..controllers.registry import designs_for, get_controller
from ..report.film import FPS, SIZE
from ..report.make import make_section
from ..report.page import render_page
from ..report.save import save_plot
from .arguments import NO_PLANT, ControllerNames, PlantFlags, RobotOrAll, robots, split_commas
from .output import foreign_prints_apart, progress_shown, tell


def plot(
    kind: Positional[Annotated[str, arg(metavar="KIND")]],
    files: Positional[Annotated[tuple[str, ...], arg(metavar="FILE...")]],
    /,
    out: str,
    robot: str | None = None,
    plant: PlantFlags = NO_PLANT,
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
) -> int:
    """Draw figures from files: .png, .svg or .pdf; animations: .gif or .webp.

    Args:
        kind: trajectory, phase or animation, from CSV files; robustness, from the output of robustness --json; or
            curve, from metrics.jsonl.
        files: the files to draw.
        out: the picture's file.
        robot: the robot of the trajectories; by default the one whose driven joint alone has torque.
        plant: the trajectories' pendulum: its lengths and its torque limit.
        fps: frames a second of an animation.
        size: height of an animation (pixels).
        speed: speed of an animation; 1 is real time.
    """
    check_writable(out)
    save_plot(kind, files, out, robot, fps, size, speed, plant.make())
    tell(out)
    return 0


def report(
    robot: RobotOrAll = "all",
    /,
    controller: ControllerNames = (),
    plant: PlantFlags = NO_PLANT,
    out: str = "report.html",
    seed: int = 0,
) -> int:
    """Write one page that needs no network: tables, plots, animations, and a live pendulum that you can push.

    Args:
        robot: the robot.
        controller: further controllers of yours.
        plant: what all are judged on, without published rows, and what baselines are designed for.
        out: the page's file.
        seed: seed of noise and pushes.
    """
    check_writable(out)
    names, on = split_commas(controller), plant.make()
    entrants = {
        each: {name: get_controller(name, each, plant=designs_for(name, on)) for name in names}
        for each in robots(robot)
    }
    with foreign_prints_apart(), progress_shown() as progress:
        sections = [make_section(each, given, seed, progress, plant=on) for each, given in entrants.items()]
    write_atomically(out, render_page(sections).encode())
    tell(f"{out} ({Path(out).stat().st_size / 1e6:.1f} MB)")
    return 0
