"""Films of trajectories: animated GIF and WebP, through Pillow."""

import io
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..benchmark.recording import checked_rows
from ..benchmark.rollout import Trajectory
from ..common.checks import finite_number, positive_number, whole_number
from ..common.errors import SwingupError
from ..common.files import write_atomically
from ..drawing import BASE, DRIVEN, GREEN, GUIDE, LINK_1, LINK_2, PAPER, draw_frame
from ..plant.plant import LEADERBOARD, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from .inputs import check_suffix

FPS = 25.0
SIZE = 320
FILM_FORMATS = (".gif", ".webp")
FASTEST = 50
"""Most frames a second: viewers slow down films whose frames last less than 20 ms."""
SIZES = (32, 2048)
"""Least and largest height (pixels)."""
LONGEST = 600.0
"""A longer film comes from a wrong time or speed (s)."""
MOST_PIXELS = 300_000_000
"""Most pixels of all frames together: Pillow holds a byte of each while it writes."""
SHADE_STEP = 14
"""Step from shade to shade at the edges of shapes, of 255: Pillow confuses colours that are much closer."""


def animate(
    motions: Sequence[tuple[Trajectory, Robot | str]],
    path: str | Path,
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
    plant: PlantLike = LEADERBOARD,
) -> None:
    """Write a film of trajectories side by side, as long as the longest divided by the speed.

    Args:
        motions: trajectories and their robots, from left to right; each row is shown until the next.
        path: the film's file, ending in ``.gif`` or ``.webp``.
        fps: frames a second, from 1 to 50.
        size: height, and width of each pendulum's picture (pixels).
        speed: 1 is real time, 0.5 is half as fast.
        plant: gives the lengths of the links.

    Raises:
        SwingupError: a value is out of range, the film is too long or has too many pixels, the suffix is unknown,
            Pillow is not installed, or the file cannot be written; nothing is half-written.
    """
    suffix = check_suffix(path, FILM_FORMATS)
    if not motions:
        raise SwingupError("nothing to draw: give at least one trajectory")
    shown = [(checked_rows(rows), get_robot(robot)) for rows, robot in motions]
    fps = finite_number("fps", fps, 1, FASTEST, "frames a second")
    size, speed = whole_number("size (pixels)", size, *SIZES), positive_number("speed", speed)
    duration = max(float(rows.time[-1] - rows.time[0]) for rows, _ in shown) / speed
    count = _count_frames(duration, fps, size * size * len(shown))
    found = load_plant(plant)

    def frame(k: int) -> np.ndarray:
        pictures = []
        for rows, robot in shown:
            # Each row's torque acts from its time on. The small number absorbs the rounding of the division.
            row = np.searchsorted(rows.time, rows.time[0] + k * (speed / fps) + 1e-9, side="right") - 1
            look: dict[str, Any] = {
                "size": size,
                "torque": rows.u[row],
                "driven": robot.joint,
                "limit": found.limit(robot.joint),
            }
            pictures.append(draw_frame(rows.x[row], found.l1, found.l2, **look))
        return np.concatenate(pictures, axis=1)

    write_atomically(path, _encode((frame(k) for k in range(count)), count, fps, suffix[1:].upper()))


def _count_frames(duration: float, fps: float, pixels: int) -> int:
    """Number of frames of a film of a given duration (s), at least one; absurd numbers are refused."""
    if duration > LONGEST:
        raise SwingupError(f"a film of {duration:g} s is longer than {LONGEST:g} s: raise the speed")
    count = max(1, round(duration * fps))
    if count * pixels > MOST_PIXELS:
        raise SwingupError(
            f"a film of {count} frames of {pixels} pixels is too large "
            f"(at most {MOST_PIXELS:,} pixels in all): lower size or fps, or raise the speed"
        )
    return count


def _encode(frames: Iterator[np.ndarray], count: int, fps: float, form: str) -> bytes:
    """An animation that repeats forever; its delays are whole hundredths of a second whose sum does not drift."""
    picture = next(frames)  # first: drawing says whether Pillow is missing
    from PIL import Image

    palette = Image.new("P", (1, 1))
    palette.putpalette(film_palette().ravel().tolist())

    def quantised(frame: np.ndarray) -> Any:
        return Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)

    first, ends = quantised(picture), [round(100 * k / fps) for k in range(count + 1)]
    delays = [10 * (end - start) for start, end in itertools.pairwise(ends)]  # in milliseconds
    file, rest = io.BytesIO(), (quantised(frame) for frame in frames)
    options = {"lossless": True} if form == "WEBP" else {"optimize": False}
    first.save(file, form, save_all=True, append_images=rest, duration=delays, loop=0, **options)
    return file.getvalue()


def film_palette() -> np.ndarray:
    """The drawing's colours, and their mixtures with the colours behind them at smoothed edges, in RGB."""
    pairs = [(PAPER, colour) for colour in (GUIDE, BASE, GREEN, DRIVEN, LINK_1, LINK_2)]
    pairs += [(LINK_1, LINK_2), (LINK_1, DRIVEN), (GUIDE, LINK_1), (GUIDE, LINK_2)]
    ends = [[np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], float) for colour in pair] for pair in pairs]
    mixtures = [np.linspace(a, b, 1 + round(np.abs(b - a).max() / SHADE_STEP)) for a, b in ends]
    return np.unique(np.concatenate(mixtures).round().astype(np.uint8), axis=0)
