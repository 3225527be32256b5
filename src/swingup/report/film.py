"""Films: of trajectories, or of any frames. GIF and WebP through Pillow, MP4 through ffmpeg."""

import functools
import io
import itertools
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..benchmark.recording import checked_rows
from ..benchmark.rollout import Trajectory
from ..common.checks import finite_number, positive_number, whole_number
from ..common.errors import SwingupError, needing, one_line
from ..common.files import check_suffix, write_atomically
from ..drawing import draw_frame
from ..loop.resolve import resolve
from ..plant.plant import LEADERBOARD, PlantLike, Robot, get_robot

FPS = 25.0
SIZE = 320
FILM_FORMATS = (".gif", ".webp", ".mp4")
MAX_FPS = 50  # Maximum frames a second: viewers slow down films whose frames last less than 20 ms
SIZE_RANGE = (32, 2048)  # Minimum and maximum height (pixels)
MAX_DURATION = 600.0  # Maximum duration (s): a longer film comes from a wrong time or speed
MAX_PIXELS = 300_000_000  # Maximum pixels of all frames together: Pillow holds a byte of each while it writes


def animate(
    motions: Sequence[tuple[Trajectory, Robot | str]],
    path: str | Path,
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
    plant: PlantLike = LEADERBOARD,
) -> None:
    """Write a film, ``.gif``, ``.webp`` or ``.mp4``, of trajectories side by side, whole or not at all.

    The film lasts as long as the longest trajectory divided by the speed (1 is real time), and has 1 to 50 frames a
    second of ``size`` x ``size`` pixels for each trajectory. Each row is shown until the next. The plant gives the
    lengths of the links.
    """
    check_suffix(path, FILM_FORMATS)
    if not motions:
        raise SwingupError("nothing to draw: give at least one trajectory")
    shown = [(checked_rows(rows), get_robot(robot)) for rows, robot in motions]
    fps = finite_number("fps", fps, 1, MAX_FPS, "frames a second")
    size, speed = whole_number("size (pixels)", size, *SIZE_RANGE), positive_number("speed", speed)
    duration = max(float(rows.time[-1] - rows.time[0]) for rows, _ in shown) / speed
    if duration > MAX_DURATION:
        raise SwingupError(f"a film of {duration:g} s is longer than {MAX_DURATION:g} s: raise the speed")
    count, pixels = max(1, round(duration * fps)), size * size * len(shown)
    if count * pixels > MAX_PIXELS:
        raise SwingupError(
            f"a film of {count} frames of {pixels} pixels is too large "
            f"(at most {MAX_PIXELS:,} pixels in all): lower size or fps, or raise the speed"
        )
    found = resolve(plant).facts
    for _, robot in shown:
        found.needs_motor(robot)

    def frame(k: int) -> np.ndarray:
        pictures = []
        for rows, robot in shown:
            # Each row's torque acts from its time on. The small number absorbs the rounding of the division.
            row = np.searchsorted(rows.time, rows.time[0] + k * (speed / fps) + 1e-9, side="right") - 1
            x, u, limit = rows.x[row], rows.u[row], found.limit(robot.joint)
            pictures.append(draw_frame(x, found.l1, found.l2, size, u, robot.joint, limit))
        return np.concatenate(pictures, axis=1)

    # The drawing's colours and mixtures at its edges, the commonest of every 16: Pillow confuses closer ones.
    whole = draw_frame((0.8, 0.9), found.l1, found.l2, 256, (1.0, -1.0), 0, 1.0)
    colours, counts = np.unique(whole.reshape(-1, 3), axis=0, return_counts=True)
    colours = colours[np.argsort(-counts)]
    palette = colours[np.unique(colours // 16, axis=0, return_index=True)[1][:256]]
    write_film(path, map(frame, range(count)), fps, palette)


def write_film(
    path: str | Path, frames: Iterable[np.ndarray], fps: float, colours: np.ndarray | None = None
) -> None:
    """Write frames (rows, columns, 3) as a film that repeats forever: ``.gif`` or ``.webp``, or ``.mp4`` by ffmpeg.

    Colours (256, 3) are the palette of all frames; None for one of each frame's own.

    Raises:
        SwingupError: ffmpeg or Pillow is missing, or the file cannot be written.
    """
    suffix = check_suffix(path, FILM_FORMATS)
    encode = _mp4 if suffix == ".mp4" else functools.partial(_pillow, colours=colours, form=suffix[1:].upper())
    write_atomically(path, encode(frames, fps))


def _pillow(frames: Iterable[np.ndarray], fps: float, colours: np.ndarray | None, form: str) -> bytes:
    """An animation, whose delays are whole hundredths of a second whose sum does not drift."""
    with needing("Pillow", "render", "a film"):
        from PIL import Image

    palette = Image.new("P", (1, 1))
    if colours is not None:
        palette.putpalette(colours.ravel().tolist())

    def quantised(frame: np.ndarray) -> Any:
        picture = Image.fromarray(frame)
        return picture.quantize(palette=palette, dither=Image.Dither.NONE) if colours is not None else picture

    first, *rest = map(quantised, frames)
    ends = [round(100 * k / fps) for k in range(len(rest) + 2)]
    delays = [10 * (end - start) for start, end in itertools.pairwise(ends)]  # in milliseconds
    file = io.BytesIO()
    options = {"lossless": True} if form == "WEBP" else {"optimize": False}
    first.save(file, form, save_all=True, append_images=rest, duration=delays, loop=0, **options)
    return file.getvalue()


def _mp4(frames: Iterable[np.ndarray], fps: float) -> bytes:
    """H.264, which browsers show, with an even number of rows and columns."""
    program = shutil.which("ffmpeg")
    if program is None:
        raise SwingupError("a film in .mp4 needs ffmpeg, which is missing: install it, or write .gif or .webp")
    kept = [frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2] for frame in frames]
    rows, columns = kept[0].shape[:2]
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "film.mp4")
        given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}", "-r", str(fps), "-i", "-"]
        command = [program, "-loglevel", "error", *given, "-pix_fmt", "yuv420p", "-movflags", "faststart", out]
        done = subprocess.run(
            command, input=b"".join(map(np.ndarray.tobytes, kept)), capture_output=True, check=False
        )
        if done.returncode:
            raise SwingupError(
                f"ffmpeg cannot write the film: {one_line(done.stderr.decode(errors='replace'), 200)}"
            )
        return Path(out).read_bytes()
