import io
import json
import math
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from PIL import Image, ImageSequence

from swingup.benchmark.rollout import Trajectory
from swingup.common.errors import SwingupError
from swingup.drawing import draw_frame
from swingup.report import animate as films
from swingup.report.animate import animate
from swingup.report.gif import encode_gif

FAKE = """#!{python}
import json, pathlib, sys
pathlib.Path({seen!r}).write_text(json.dumps(sys.argv))
content = sys.stdin.buffer.read()
pathlib.Path(sys.argv[-1]).write_bytes(b"film" + content)
"""
BROKEN = """#!{python}
import sys
sys.stdin.close()
print("Unknown encoder", file=sys.stderr)
sys.exit(1)
"""


def swing(duration=2.0, dt=0.002, turns=0.5):
    time = dt * np.arange(round(duration / dt) + 1)
    x = np.zeros((time.size, 4))
    x[:, 0] = 2 * np.pi * turns * time / duration
    u = np.column_stack([0 * time, 4 * np.cos(time)])
    return Trajectory(time=time, x=x, u=u)


def read(path):
    """Frames and how long each is shown (ms)."""
    with Image.open(path) as film:
        pictures = [
            (np.array(frame.convert("RGB")), frame.info["duration"]) for frame in ImageSequence.Iterator(film)
        ]
        assert film.info["loop"] == 0  # again and again
    return [picture for picture, _ in pictures], [delay for _, delay in pictures]


@pytest.fixture
def program(tmp_path, monkeypatch):
    """Puts a stand-in for ffmpeg on the PATH; returns the file with what it was called with."""

    def install(code):
        folder, seen = tmp_path / "bin", tmp_path / "seen.json"
        folder.mkdir()
        (folder / "ffmpeg").write_text(code.format(python=sys.executable, seen=str(seen)), encoding="utf-8")
        (folder / "ffmpeg").chmod(0o755)
        monkeypatch.setenv("PATH", str(folder))
        return seen

    return install


@pytest.mark.parametrize(
    ("fps", "speed", "count"),
    [(25, 1.0, 50), (30, 1.0, 60), (50, 1.0, 100), (20, 2.0, 20), (25, 0.5, 100), (12.5, 1.0, 25)],
)
def test_gif_has_the_right_pictures_and_duration(tmp_path, fps, speed, count):
    animate(swing(), "acrobot", tmp_path / "film.gif", fps=fps, size=48, speed=speed)
    pictures, delays = read(tmp_path / "film.gif")
    assert len(pictures) == count
    # Delays are whole hundredths of a second, 3 and 4 at 30 pictures a second, and do not drift.
    assert sum(delays) == pytest.approx(1000 * 2.0 / speed, abs=5)
    assert max(delays) - min(delays) <= 10
    assert not np.array_equal(pictures[0], pictures[-1])


def test_gif_pictures_are_the_drawings(tmp_path):
    trajectory = swing()
    animate(trajectory, "acrobot", tmp_path / "film.gif", fps=10, size=120)
    pictures, _ = read(tmp_path / "film.gif")
    for k in (0, 7, 19):
        row = 50 * k  # 10 pictures a second of 500 rows a second
        drawn = draw_frame(trajectory.x[row], 0.2, 0.3, size=120, torque=trajectory.u[row], driven=1)
        error = np.abs(pictures[k].astype(int) - drawn)
        # The palette holds the drawing's colours exactly; only smoothed edges may differ a little.
        assert np.mean(error == 0) > 0.85
        assert error.max() < 64


def test_gif_holds_few_frames_at_once():
    def frames():
        for k in range(500):
            frame = np.full((128, 128, 3), 251, np.uint8)
            frame[k % 128, :8] = 0
            yield frame

    encode_gif(frames(), 25)  # imports
    tracemalloc.start()
    content = encode_gif(frames(), 25)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3e6  # 500 frames are 25 MB in RGB and 8 MB as indices of colours
    with Image.open(io.BytesIO(content)) as film:
        assert film.n_frames == 500


def test_a_delay_beyond_the_formats_largest_is_divided(tmp_path):
    frame = np.full((32, 32, 3), 251, np.uint8)
    (tmp_path / "film.gif").write_bytes(encode_gif(iter([frame] * 1000), 1))
    # The largest delay is 65,535 hundredths of a second.
    assert read(tmp_path / "film.gif")[1] == [655_350, 344_650]


def test_gif_of_ten_seconds_is_small(tmp_path):
    animate(swing(duration=10.0, turns=5), "acrobot", tmp_path / "film.gif")
    assert (tmp_path / "film.gif").stat().st_size < 2_000_000
    with Image.open(tmp_path / "film.gif") as film:
        assert film.size == (320, 320)


def test_pictures_without_motion_still_take_their_time(tmp_path):
    time = 0.01 * np.arange(201)
    animate(Trajectory(time, np.zeros((201, 4)), np.zeros((201, 2))), "acrobot", tmp_path / "film.gif", size=48)
    assert sum(read(tmp_path / "film.gif")[1]) == 2000


def test_time_may_start_anywhere_and_be_uneven(tmp_path):
    # Two rows only: hanging for 1.5 s, then upright for half a second.
    x = np.zeros((3, 4))
    x[1:, 0] = math.pi
    animate(Trajectory(np.array([5.0, 6.5, 7.0]), x, np.zeros((3, 2))), "pendubot", tmp_path / "film.gif", size=48)
    pictures, delays = read(tmp_path / "film.gif")
    assert delays == [1520, 480]  # the first picture at or after 1.5 s is that at 1.52 s
    assert len(pictures) == 2


def test_three_rows_make_a_picture(tmp_path):
    animate(swing(duration=0.004), "acrobot", tmp_path / "film.gif", size=48)
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 1


def test_mp4_pipes_every_picture_into_ffmpeg(tmp_path, program):
    seen = program(FAKE)
    trajectory = swing()
    animate(trajectory, "acrobot", tmp_path / "film.mp4", fps=60, size=47)
    content = (tmp_path / "film.mp4").read_bytes()
    # Two seconds of 60 pictures of 48 by 48 pixels: an odd size is rounded up.
    assert content.startswith(b"film")
    assert len(content) == 4 + 120 * 48 * 48 * 3
    first = draw_frame(trajectory.x[0], 0.2, 0.3, size=48, torque=trajectory.u[0], driven=1)
    assert content[4 : 4 + first.size] == first.tobytes()
    command = json.loads(seen.read_text(encoding="utf-8"))
    assert command[command.index("-video_size") + 1] == "48x48"
    assert float(command[command.index("-framerate") + 1]) == 60
    assert command.index("-framerate") < command.index("-i") < command.index("yuv420p")


def test_ffmpeg_that_fails_is_reported(tmp_path, program):
    program(BROKEN)
    with pytest.raises(SwingupError, match=r"failed \(Unknown encoder\): repair it or write a .gif"):
        animate(swing(), "acrobot", tmp_path / "film.mp4", size=320)
    assert not (tmp_path / "film.mp4").exists()


def test_program_that_cannot_run_is_reported(tmp_path, program):
    program("#!/nowhere/python\n")
    with pytest.raises(SwingupError, match=r"cannot run .*ffmpeg: .*write a .gif"):
        animate(swing(), "acrobot", tmp_path / "film.mp4", size=48)


def test_missing_encoder_names_the_remedies(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(SwingupError, match=r"no encoder for MP4: .*or write a .gif, which needs none"):
        animate(swing(), "acrobot", tmp_path / "film.mp4")
    assert list(tmp_path.iterdir()) == []


def test_mp4_by_a_real_encoder(tmp_path):
    try:
        encoder = films.find_ffmpeg()
    except SwingupError as error:
        pytest.skip(str(error))
    animate(swing(), "acrobot", tmp_path / "film.mp4", size=64)
    assert (tmp_path / "film.mp4").read_bytes()[4:8] == b"ftyp"
    told = subprocess.run([encoder, "-i", str(tmp_path / "film.mp4")], capture_output=True, text=True, check=False)
    assert "Duration: 00:00:02.00" in told.stderr
    assert "64x64" in told.stderr


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"fps": 0}, "fps = 0: use a number from 1 to 50 frames a second"),
        ({"fps": 60}, "fps = 60: use a number from 1 to 50"),
        ({"fps": math.nan}, "fps = nan: use a number from 1 to 50"),
        ({"fps": "fast\n"}, r"fps = 'fast\\n': use a number"),
        ({"size": 8}, r"size \(pixels\) = 8: use a whole number from 32 to 2048"),
        ({"size": 100_000}, r"size \(pixels\) = 100000: use a whole number from 32"),
        ({"speed": 0.0}, "speed = 0.0: use a positive number"),
        ({"speed": -1.0}, "speed = -1.0: use a positive number"),
        ({"speed": math.inf}, "speed = inf: use a positive number"),
        ({"speed": 1e-5}, "more than 10000 frames: raise the speed or lower fps"),
        ({"speed": 1e-320}, "a film of inf s has more than 10000 frames"),
        # 2 s / 0.01 * 25 = 5000 frames of 2048 * 2048 = 4.2 million pixels.
        ({"speed": 0.01, "size": 2048}, "5000 frames of 2048 x 2048 pixels is too large"),
        ({"robot": "cartpole"}, "unknown robot 'cartpole'"),
    ],
)
def test_values_out_of_range_are_refused(tmp_path, arguments, reason):
    with pytest.raises(SwingupError, match=reason):
        animate(**{"trajectory": swing(), "robot": "acrobot", "path": tmp_path / "film.gif", **arguments})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["film", "film.avi", "film.png", "gif"])
def test_unknown_suffix_names_the_known_ones(tmp_path, name):
    with pytest.raises(SwingupError, match=r"its name must end in .gif or .mp4"):
        animate(swing(), "acrobot", tmp_path / name)


def test_trajectory_with_a_hole_is_refused(tmp_path):
    trajectory = swing()
    trajectory.x[5, 0] = math.nan
    with pytest.raises(SwingupError, match="the trajectory holds values that are not finite"):
        animate(trajectory, "acrobot", tmp_path / "film.gif")


def test_folder_must_exist(tmp_path):
    with pytest.raises(SwingupError, match="choose a folder that exists"):
        animate(swing(0.2), "acrobot", tmp_path / "missing" / "film.gif", size=48)


def test_missing_pillow_names_the_remedy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(SwingupError, match=r"pip install swingup\[render\]"):
        animate(swing(0.2), "acrobot", tmp_path / "film.gif")


@pytest.mark.slow
def test_pillow_is_loaded_only_when_something_is_drawn():
    code = "import sys, swingup.report.animate, swingup.report.save; print('PIL' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
