"""Draw a swing-up of each robot as a film strip: the README's picture.

Usage: python examples/04_film_strip.py [PNG]. The default is film-strip.png in the current folder. Needs
swingup[render].
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import swingup
from swingup.drawing import LINK_1, PAPER, draw_frame
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import Robot, get_robot

TIMES = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 4.0)
"""Seconds."""
SIZE, LEFT, TOP = 160, 210, 44
"""Width of a frame and of the margins for names and times (pixels)."""
LARGE, SMALL = 30, 24
"""Sizes of the letters (pixels); a README shows the picture at half its size."""


def draw_row(robot: Robot) -> np.ndarray:
    """The shipped policy's swing-up of one robot, a frame for each time, side by side."""
    parameters = LEADERBOARD.driven(robot)
    lengths = float(parameters.l1), float(parameters.l2)
    trajectory = swingup.evaluate(swingup.get_controller("ar-eapo", robot), robot).trajectory
    x, u = np.asarray(trajectory.x), np.asarray(trajectory.u)
    indices = [int(np.searchsorted(trajectory.time, time)) for time in TIMES]
    frames = [draw_frame(x[i], *lengths, size=SIZE, torque=u[i], driven=robot.joint) for i in indices]
    return np.concatenate(frames, axis=1)


def main(path: Path) -> None:
    """Draw a row for each robot with its name, and a column for each time."""
    robots = [get_robot(name) for name in ("acrobot", "pendubot")]
    strip = Image.new("RGB", (LEFT + SIZE * len(TIMES), TOP + SIZE * len(robots)), PAPER)
    for row, robot in enumerate(robots):
        strip.paste(Image.fromarray(draw_row(robot)), (LEFT, TOP + row * SIZE))
    pen, large, small = ImageDraw.Draw(strip), ImageFont.load_default(LARGE), ImageFont.load_default(SMALL)
    for column, time in enumerate(TIMES):
        pen.text((LEFT + (column + 0.5) * SIZE, TOP / 2 + 2), f"{time:g} s", LINK_1, small, "mm")
    for row, robot in enumerate(robots):
        middle, joint = TOP + (row + 0.5) * SIZE, ("shoulder", "elbow")[robot.joint]
        pen.text((16, middle - 16), robot.name, LINK_1, large, "lm")
        pen.text((16, middle + 16), f"{joint} driven", LINK_1, small, "lm")
    strip.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"saved {path}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "film-strip.png"))
