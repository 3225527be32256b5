"""Films of a trajectory: GIF through Pillow alone, MP4 through ffmpeg where there is one."""

import contextlib
import importlib
import itertools
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..benchmark.rollout import Trajectory
from ..common.checks import finite_number, positive_number, whole_number
from ..common.errors import SwingupError
from ..common.files import write_atomically
from ..common.text import one_line
from ..drawing import draw_frame
from ..plant.plant import LEADERBOARD, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from .files import check_suffix, check_trajectory
from .gif import RgbFrames, encode_gif

FPS = 25.0
SIZE = 320
FASTEST = {".gif": 50, ".mp4": 120}
"""Most frames a second: viewers slow down GIFs whose frames last less than 20 ms."""
SIZES = (32, 2048)
"""Least and largest width (pixels)."""
MOST_FRAMES = 10_000
"""More frames come from a wrong time or speed."""
MOST_PIXELS = 2_000_000_000
"""Most pixels of all frames together: they take minutes to draw, and a GIF of them some 100 MB of memory."""


def animate(
    trajectory: Trajectory,
    robot: Robot | str,
    path: str | Path,
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
    plant: PlantLike = LEADERBOARD,
) -> None:
    """Write a film of a trajectory, as long as the trajectory divided by the speed.

    Args:
        trajectory: the motion; each row is shown until the next.
        robot: which joint is driven.
        path: the film's file, ending in ``.gif`` or ``.mp4``.
        fps: frames a second, from 1 to 50 (GIF) or 120 (MP4).
        size: width and height (pixels); MP4 rounds it up to an even number.
        speed: 1 is real time, 0.5 is half as fast.
        plant: gives the lengths of the links.

    Raises:
        SwingupError: a value is out of range, the film has too many frames or pixels, the suffix is unknown, there
            is no encoder for MP4, Pillow is not installed, or the file cannot be written; nothing is half-written.
    """
    suffix, robot = check_suffix(path, list(FASTEST)), get_robot(robot)
    time, x, u = check_trajectory("the trajectory", trajectory)
    fps = finite_number("fps", fps, 1, FASTEST[suffix], "frames a second")
    size, speed = whole_number("size (pixels)", size, *SIZES), positive_number("speed", speed)
    if suffix == ".mp4":
        size += size % 2  # the encoder stores colours for squares of two by two pixels
    count = _count_frames(float(time[-1] - time[0]) / speed, fps, size)
    encode: Callable[[RgbFrames, float], bytes] = encode_gif if suffix == ".gif" else _encode_mp4
    # Each row's torque acts from its time on. The small number absorbs the rounding of the division.
    shown = np.searchsorted(time, time[0] + np.arange(count) * (speed / fps) + 1e-9, side="right") - 1
    parameters = load_plant(plant).driven(robot)
    lengths = float(parameters.l1), float(parameters.l2)
    limit = float(max(parameters.tl1, parameters.tl2))
    # A generator: the encoders take one frame at a time, so that no film is whole in memory.
    frames = (draw_frame(x[k], *lengths, size, u[k], robot.joint, limit) for k in shown)
    write_atomically(path, encode(frames, fps))


def _count_frames(duration: float, fps: float, size: int) -> int:
    """Number of frames of a film of a given duration (s), at least one; absurd numbers are refused."""
    count = duration * fps
    if count > MOST_FRAMES:
        raise SwingupError(
            f"a film of {duration:g} s has more than {MOST_FRAMES} frames: raise the speed or lower fps"
        )
    if count * size**2 > MOST_PIXELS:
        raise SwingupError(
            f"a film of {count:.0f} frames of {size} x {size} pixels is too large "
            f"(at most {MOST_PIXELS:,} pixels in all): lower size or fps, or raise the speed"
        )
    return max(1, round(count))


def _encode_mp4(frames: RgbFrames, fps: float) -> bytes:
    """Raw frames through a pipe into ffmpeg, which chooses its best encoder for MP4."""
    program = find_ffmpeg()
    first = next(frames)
    shape = f"{first.shape[1]}x{first.shape[0]}"
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as log:
        target = Path(folder) / "film.mp4"  # ffmpeg cannot pipe MP4s out that every player reads
        given = f"-f rawvideo -pix_fmt rgb24 -video_size {shape} -framerate {fps!r} -i -".split()
        wanted = ("-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(target))
        command = (program, "-loglevel", "error", "-y", *given, *wanted)
        try:
            with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=log, stderr=log) as process:
                _feed(process, itertools.chain([first], frames))
        except OSError as error:
            raise SwingupError(
                f"cannot run {program}: {error.strerror or error}; repair it or write a .gif"
            ) from error
        if process.returncode != 0 or not target.is_file():
            log.seek(0)
            last = log.read().decode(errors="replace").strip().splitlines()[-1:]
            reason = last[0] if last else f"exit status {process.returncode}"
            raise SwingupError(f"{program} failed ({one_line(reason, 200)}): repair it or write a .gif")
        return target.read_bytes()


def _feed(process: subprocess.Popen[bytes], frames: RgbFrames) -> None:
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
