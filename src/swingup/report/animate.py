"""Films of a trajectory: GIF through Pillow alone, MP4 through ffmpeg where there is one."""

import contextlib
import importlib
import io
import itertools
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from ..benchmark.rollout import Trajectory
from ..drawing import BASE, DRIVEN, GREEN, GUIDE, LINK_1, LINK_2, PAPER, draw_frame
from ..errors import SwingupError
from ..files import write_atomically
from ..physics.parameters import Robot, get_robot, leaderboard_parameters
from .files import check_suffix, check_trajectory

Frames = Iterator[UInt8[np.ndarray, "size size 3"]]

FPS = 25.0
SIZE = 320
FASTEST = {".gif": 50, ".mp4": 120}
"""Most frames a second: viewers slow GIFs down whose pictures stand for less than 20 ms."""
SIZES = (32, 2048)
"""Least and largest width (pixels)."""
MOST_FRAMES = 10_000
"""More are taken for a mistake in the time or the speed."""
SHADE = 14
"""Step from shade to shade at the edges of shapes, of 255: Pillow confuses colours that are much closer."""


def animate(
    trajectory: Trajectory,
    robot: Robot | str,
    path: str | Path,
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
) -> None:
    """Write a film of a trajectory, as long as the trajectory divided by the speed.

    Args:
        trajectory: what the pendulum does; each row is shown until the next.
        robot: which joint is driven.
        path: where to write, ending in ``.gif`` or ``.mp4``.
        fps: pictures a second, from 1 to 50 (GIF) or 120 (MP4).
        size: width and height (pixels); MP4 rounds it up to an even number.
        speed: 1 is real time, 0.5 is half as fast.

    Raises:
        SwingupError: a value is out of range, the suffix is unknown, there is no encoder for MP4, Pillow is not
            installed, or the file cannot be written; nothing is half-written.
    """
    suffix, robot = check_suffix(path, list(FASTEST)), get_robot(robot)
    time, x, u = check_trajectory("the trajectory", trajectory)
    count = _count_frames(float(time[-1] - time[0]), fps, size, speed, FASTEST[suffix])
    encode: Callable[[Frames, float], bytes] = _encode_gif if suffix == ".gif" else _encode_mp4
    if suffix == ".mp4":
        size += size % 2  # its pixels share colours in squares of two by two
    # Each row's torque acts from its time on. The small number absorbs the rounding of the division.
    shown = np.searchsorted(time, time[0] + np.arange(count) * (speed / fps) + 1e-9, side="right") - 1
    parameters = leaderboard_parameters(robot)
    lengths = float(parameters.l1), float(parameters.l2)
    frames = (draw_frame(x[k], *lengths, size=size, torque=u[k], driven=robot.joint) for k in shown)
    write_atomically(path, encode(frames, fps))


def _count_frames(duration: float, fps: float, size: int, speed: float, fastest: int) -> int:
    if not 1 <= fps <= fastest:
        raise SwingupError(f"fps = {fps:g}: use 1 to {fastest} pictures a second")
    if not SIZES[0] <= size <= SIZES[1]:
        raise SwingupError(f"size = {size}: use {SIZES[0]} to {SIZES[1]} pixels")
    if not (speed > 0 and math.isfinite(speed)):
        raise SwingupError(f"speed = {speed:g}: use a positive number, 1 for real time")
    pictures = duration / speed * fps
    if pictures > MOST_FRAMES:
        raise SwingupError(
            f"a film of {duration / speed:g} s has more than {MOST_FRAMES} pictures: raise the speed or lower fps"
        )
    return max(1, round(pictures))


def _encode_gif(frames: Frames, fps: float) -> bytes:
    """One palette for all frames; delays are whole hundredths of a second whose sum does not drift."""
    try:
        from PIL import Image
    except ImportError as error:
        raise SwingupError("drawing needs Pillow, which is missing: pip install swingup[render]") from error
    colours = Image.new("P", (1, 1))
    colours.putpalette(_palette())
    no_dither = Image.Dither.NONE
    pictures = [Image.fromarray(frame).quantize(palette=colours, dither=no_dither) for frame in frames]
    ends = [round(100 * (k + 1) / fps) for k in range(len(pictures))]
    delays = [10 * (end - start) for start, end in zip([0, *ends], ends, strict=False)]
    file = io.BytesIO()
    pictures[0].save(file, "GIF", save_all=True, append_images=pictures[1:], duration=delays, loop=0)
    return file.getvalue()


def _palette() -> list[int]:
    """The drawing's colours and what smoothing makes of them: mixtures with what lies behind."""
    pairs = [(PAPER, colour) for colour in (GUIDE, BASE, GREEN, DRIVEN, LINK_1, LINK_2)]
    pairs += [(LINK_1, LINK_2), (LINK_1, DRIVEN), (GUIDE, LINK_1), (GUIDE, LINK_2)]
    ends = [(_rgb(first), _rgb(second)) for first, second in pairs]
    mixtures = [np.linspace(*pair, 1 + round(np.abs(pair[1] - pair[0]).max() / SHADE)) for pair in ends]
    distinct = np.unique(np.concatenate(mixtures).round().astype(int), axis=0)
    return [int(value) for value in distinct.ravel()]


def _rgb(colour: str) -> np.ndarray:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], float)


def _encode_mp4(frames: Frames, fps: float) -> bytes:
    """Raw frames through a pipe into ffmpeg, which chooses its best encoder for MP4."""
    program = find_ffmpeg()
    first = next(frames)
    shape = f"{first.shape[1]}x{first.shape[0]}"
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as log:
        target = Path(folder) / "film.mp4"  # ffmpeg cannot pipe MP4s out that every player reads
        given = (
            "-f",
            "rawvideo",
            "-pix_fmt",
            "rgb24",
            "-video_size",
            shape,
            "-framerate",
            repr(float(fps)),
            "-i",
            "-",
        )
        wanted = ("-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(target))
        command = (program, "-loglevel", "error", "-y", *given, *wanted)
        try:
            with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=log, stderr=log) as process:
                _feed(process, itertools.chain([first], frames))
        except OSError as error:
            raise SwingupError(
                f"cannot run {program}: {error.strerror or error}; mend it or write a .gif"
            ) from error
        if process.returncode != 0 or not target.is_file():
            log.seek(0)
            last = log.read().decode(errors="replace").strip().splitlines()[-1:]
            reason = last[0] if last else f"exit status {process.returncode}"
            raise SwingupError(f"{program} failed ({reason:.200}): mend it or write a .gif")
        return target.read_bytes()


def _feed(process: subprocess.Popen[bytes], frames: Frames) -> None:
    """Write frames to a process that may end early: its status and its log then say why."""
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        for frame in frames:
            process.stdin.write(frame.tobytes())
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()


def find_ffmpeg() -> str:
    """Path of ffmpeg: the one on the PATH, or that of the package imageio-ffmpeg.

    Raises:
        SwingupError: there is neither.
    """
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    try:
        return str(importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        raise SwingupError(
            "no encoder for MP4: install ffmpeg or pip install imageio-ffmpeg, or write a .gif, which needs none"
        ) from error
