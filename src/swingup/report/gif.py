"""Animated GIFs, written frame by frame: Pillow's own writer would hold every frame in memory.

All frames share one palette. A frame stores only the rectangle that changed, and its unchanged pixels are
transparent, which compresses well. A frame equal to the one before it lengthens that frame's delay.
"""

import io
import struct
from collections.abc import Iterable, Iterator
from typing import IO, TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import UInt8

from ..common.errors import SwingupError
from ..drawing import BASE, DRIVEN, GREEN, GUIDE, LINK_1, LINK_2, PAPER

if TYPE_CHECKING:
    from PIL.Image import Image

RgbFrames: TypeAlias = Iterator[UInt8[np.ndarray, "size size 3"]]

SHADE_STEP = 14
"""Step from shade to shade at the edges of shapes, of 255: Pillow confuses colours that are much closer."""
LONGEST_GIF_DELAY = 65_535
"""Largest delay that the format can store (hundredths of a second)."""

_Indices: TypeAlias = UInt8[np.ndarray, "height width"]


def encode_gif(frames: RgbFrames, fps: float) -> bytes:
    """Encode frames as an animation that repeats forever; one frame at a time is in memory.

    Delays are whole hundredths of a second whose sum does not drift.

    Args:
        frames: RGB pictures of one size, at least one.
        fps: frames a second, at most 50.

    Raises:
        SwingupError: Pillow is not installed.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise SwingupError("drawing needs Pillow, which is missing: pip install swingup[render]") from error
    colours = film_palette()
    palette = Image.new("P", (1, 1))
    palette.putpalette(colours.ravel().tolist())
    indices = (_quantize(Image.fromarray(frame), palette) for frame in frames)
    file = io.BytesIO()
    before: _Indices | None = None
    for now, delay in _merge(indices, fps):
        if before is None:
            file.write(_header(now.shape[1], now.shape[0], colours))
        _write_frame(file, before, now, delay, transparent=len(colours))
        before = now
    file.write(b";")
    return file.getvalue()


def film_palette() -> UInt8[np.ndarray, "colours 3"]:
    """The drawing's colours, and their mixtures with the colours behind them at smoothed edges."""
    pairs = [(PAPER, colour) for colour in (GUIDE, BASE, GREEN, DRIVEN, LINK_1, LINK_2)]
    pairs += [(LINK_1, LINK_2), (LINK_1, DRIVEN), (GUIDE, LINK_1), (GUIDE, LINK_2)]
    ends = [(_rgb(first), _rgb(second)) for first, second in pairs]
    mixtures = [np.linspace(*pair, 1 + round(np.abs(pair[1] - pair[0]).max() / SHADE_STEP)) for pair in ends]
    return np.unique(np.concatenate(mixtures).round().astype(np.uint8), axis=0)


def _rgb(colour: str) -> np.ndarray:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], float)


def _quantize(frame: "Image", palette: "Image") -> _Indices:
    from PIL.Image import Dither

    return np.array(frame.quantize(palette=palette, dither=Dither.NONE))


def _merge(indices: Iterable[_Indices], fps: float) -> Iterator[tuple[_Indices, int]]:
    """Different frames and their delays (hundredths of a second)."""
    before: _Indices | None = None
    start = end = 0
    for k, now in enumerate(indices, start=1):
        if before is not None and not np.array_equal(before, now):
            yield before, end - start
            start = end
        before, end = now, round(100 * k / fps)
    if before is not None:
        yield before, end - start


def _header(width: int, height: int, colours: UInt8[np.ndarray, "colours 3"]) -> bytes:
    """Signature, screen, the palette filled up to 256 colours, and the extension for endless repetition."""
    screen = struct.pack("<6s2H3B", b"GIF89a", width, height, 0x80 | 7, 0, 0)
    repeat = struct.pack("<3B11s2BHB", 0x21, 0xFF, 11, b"NETSCAPE2.0", 3, 1, 0, 0)
    return screen + colours.tobytes().ljust(3 * 256, b"\0") + repeat


def _write_frame(file: IO[bytes], before: _Indices | None, now: _Indices, delay: int, transparent: int) -> None:
    from PIL import GifImagePlugin, Image

    corner, pixels = (0, 0), now
    if before is not None:
        changed = now != before
        rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
        box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        corner, pixels = (int(columns[0]), int(rows[0])), np.where(changed, now, np.uint8(transparent))[box]
    while True:
        shown = min(delay, LONGEST_GIF_DELAY)
        options = {"duration": 10 * shown, "transparency": transparent}  # in milliseconds
        file.writelines(GifImagePlugin.getdata(Image.fromarray(pixels), corner, **options))
        delay -= shown
        if delay == 0:
            return
        # A transparent pixel carries the rest of a delay that is too long for one frame.
        corner, pixels = (0, 0), np.full((1, 1), transparent, np.uint8)
