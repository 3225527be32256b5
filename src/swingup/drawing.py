"""One picture of the double pendulum. Pillow is imported only when something is drawn."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import UInt8

from .common.errors import needing
from .plant.plant import TORQUE_LIMIT

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

Point: TypeAlias = tuple[float, float]
Reals: TypeAlias = Sequence[float] | np.ndarray

SUPERSAMPLING = 4
"""The picture is drawn this many times larger in each direction, then averaged: edges become smooth."""
MARGIN = 1.15  # Half the width of the picture in units of l1 + l2
GOAL_HEIGHT = 0.9  # Height of the goal line above the shoulder in units of l1 + l2
FULL_ARC = 150.0  # Length of the arrow that stands for the torque limit (degrees)
PAPER, GUIDE, BASE, GREEN = "#fbfaf7", "#dedad2", "#8b8780", "#4f9d69"
LINK_1, LINK_2, DRIVEN = "#1f3b57", "#3f7cac", "#e4572e"


def draw_frame(
    x: Reals,
    l1: float,
    l2: float,
    size: int = 400,
    torque: Reals | None = None,
    driven: int | None = None,
    limit: float = TORQUE_LIMIT,
) -> UInt8[np.ndarray, "size size 3"]:
    """Draw one state of the double pendulum and the goal line at 0.9 (l1 + l2) above the shoulder, in RGB.

    Args:
        x: state [q1, q2, dq1, dq2] (rad, rad/s), counter-clockwise from hanging down; the rates are not drawn.
        l1: length of link 1 (m).
        l2: length of link 2 (m).
        size: width and height of the picture (pixels).
        torque: torques [u1, u2] (N m) to show as arrows around their joints, if any.
        driven: joint to mark as driven, if any: 0 is the shoulder, 1 the elbow.
        limit: torque of the longest arrow (N m).

    Raises:
        SwingupError: Pillow is not installed.
    """
    with needing("Pillow", "render", "drawing"):
        from PIL import Image, ImageDraw
    pixels = size * SUPERSAMPLING
    scale = pixels / (2 * MARGIN * (l1 + l2))
    shoulder = (pixels / 2, pixels / 2)
    elbow = _along(shoulder, float(x[0]), l1 * scale)
    tip = _along(elbow, float(x[0]) + float(x[1]), l2 * scale)
    image = Image.new("RGB", (pixels, pixels), PAPER)
    canvas, unit = ImageDraw.Draw(image), pixels / 100
    _draw_scenery(canvas, shoulder, (l1 + l2) * scale, unit)
    canvas.line((shoulder, elbow), fill=LINK_1, width=round(3.4 * unit))
    canvas.line((elbow, tip), fill=LINK_2, width=round(3.4 * unit))
    # Round ends, since Pillow's lines end square.
    canvas.circle(tip, 2.4 * unit, fill=LINK_2)
    for joint, centre in enumerate((shoulder, elbow)):
        canvas.circle(centre, 2.8 * unit, fill=LINK_1)
        canvas.circle(centre, 1.6 * unit, fill=DRIVEN if joint == driven else PAPER)
        if torque is not None:
            _draw_torque(canvas, centre, float(torque[joint]) / limit, unit)
    # Pillow draws lines without smoothing; the average of the finer pixels smooths them.
    return np.array(image.reduce(SUPERSAMPLING))


def _along(start: Point, angle: float, length: float) -> Point:
    """The point at a distance and an angle from hanging down; pixels count downwards."""
    return start[0] + length * math.sin(angle), start[1] + length * math.cos(angle)


def _draw_scenery(canvas: "ImageDraw", shoulder: Point, reach: float, unit: float) -> None:
    (x, y), half, depth = shoulder, 5 * unit, 6 * unit
    canvas.circle(shoulder, reach, outline=GUIDE, width=round(0.4 * unit))
    canvas.polygon(((x, y), (x - half, y + depth), (x + half, y + depth)), fill=GUIDE)
    canvas.line((x - 1.5 * half, y + depth, x + 1.5 * half, y + depth), fill=BASE, width=round(0.9 * unit))
    goal = y - GOAL_HEIGHT * reach
    for dash in range(0, 100, 4):
        canvas.line((dash * unit, goal, (dash + 2.4) * unit, goal), fill=GREEN, width=round(0.7 * unit))


def _draw_torque(canvas: "ImageDraw", centre: Point, share: float, unit: float) -> None:
    """An arrow that turns with the torque, a share of the limit, from above the joint, counter-clockwise if > 0."""
    # Beyond the limit the arrow stays at its full length; pushes may exceed it.
    sweep = math.radians(FULL_ARC) * max(-1.0, min(1.0, share))
    # A smaller torque would show only the arrow's head.
    if abs(sweep) < 0.05:
        return
    radius, head = 6.5 * unit, math.copysign(0.5, sweep)
    box = (centre[0] - radius, centre[1] - radius, centre[0] + radius, centre[1] + radius)
    first, last = sorted((-90.0, -90.0 - math.degrees(sweep)))  # Pillow's angles count clockwise from the right
    canvas.arc(box, first, last, fill=DRIVEN, width=round(1.1 * unit))
    corners = ((sweep, radius - 2 * unit), (sweep, radius + 2 * unit), (sweep + head, radius))
    canvas.polygon([_along(centre, math.pi + angle, distance) for angle, distance in corners], fill=DRIVEN)
