"""The command ``plot``: figures from files."""

from typing import Annotated

from tyro.conf import Positional, arg

from ..common.files import check_writable
from ..report.film import FPS, SIZE
from ..report.save import save_plot
from .arguments import NO_PLANT, OptionalNames, OptionalRobot, PlantOptions, plant_of
from .output import tell


def plot_command(
    kind: Positional[Annotated[str, arg(metavar="KIND")]],
    files: Positional[Annotated[tuple[str, ...], arg(metavar="FILE...")]],
    /,
    out: str,
    robot: OptionalRobot = None,
    plant: PlantOptions = NO_PLANT,
    columns: OptionalNames = (),
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
