import functools

import numpy as np
import pytest
from PIL import Image, ImageSequence

from swingup.report.film import animate

from . import test_plot

swing = functools.partial(test_plot.swing, dt=0.002)


def read(path):
    """Frames and how long each is shown (ms)."""
    with Image.open(path) as film:
        shown = [(np.array(each.convert("RGB")), each.info["duration"]) for each in ImageSequence.Iterator(film)]
        assert film.info["loop"] == 0  # again and again
    pictures, delays = map(list, zip(*shown, strict=True))
    return pictures, delays


@pytest.mark.parametrize(("fps", "speed", "count"), [(30, 1.0, 60), (20, 2.0, 20), (25, 0.5, 100), (12.5, 1.0, 25)])
def test_gif_has_the_right_pictures_and_duration(tmp_path, fps, speed, count):
    animate([(swing(), "acrobot")], tmp_path / "film.gif", fps=fps, size=48, speed=speed)
    pictures, delays = read(tmp_path / "film.gif")
    assert len(pictures) == count
    # Delays are whole hundredths of a second, 3 and 4 at 30 pictures a second, and do not drift.
    assert sum(delays) == pytest.approx(1000 * 2.0 / speed, abs=5)
    assert max(delays) - min(delays) <= 10
    assert not np.array_equal(pictures[0], pictures[-1])


def test_two_pendulums_move_side_by_side_also_as_webp(tmp_path):
    animate([(swing(), "acrobot"), (swing(turns=-0.5), "pendubot")], tmp_path / "film.webp", fps=10, size=48)
    with Image.open(tmp_path / "film.webp") as film:
        assert (film.size, film.n_frames) == ((96, 48), 20)
        first = np.array(film.convert("RGB"))
    assert not np.array_equal(first[:, :48], first[:, 48:])  # another joint is driven
