"""Draw a swing-up of each robot as a film strip: the README's picture.

Usage: python examples/04_film_strip.py [PNG]. The default is film-strip.png in the current folder. Needs
swingup[render].
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

import swingup
from swingup.drawing import draw_frame
from swingup.physics.parameters import get_robot, leaderboard_parameters

TIMES = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 4.0)
"""Seconds."""


def main(path: Path) -> None:
    """Draw one row for each robot and one frame for each time."""
    rows = []
    for name in ("acrobot", "pendubot"):
        robot = get_robot(name)
        parameters = leaderboard_parameters(robot)
        lengths = float(parameters.l1), float(parameters.l2)
        trajectory = swingup.evaluate(swingup.shipped_policy(robot)[0], robot).trajectory
        x, u = np.asarray(trajectory.x), np.asarray(trajectory.u)
        indices = [int(np.searchsorted(trajectory.time, time)) for time in TIMES]
        frames = [draw_frame(x[i], *lengths, size=160, torque=u[i], driven=robot.joint) for i in indices]
        rows.append(np.concatenate(frames, axis=1))
    Image.fromarray(np.concatenate(rows)).save(path)
    print(f"saved {path}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "film-strip.png"))
