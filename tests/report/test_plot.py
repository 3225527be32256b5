"""Figures of all kinds: what they show of what was given, what is refused, how they are saved; and films."""

import dataclasses
import functools
import json
import math
import shutil
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from PIL import Image, ImageSequence

from refusals import refusal
from swingup.benchmark.recording import save_trajectory
from swingup.benchmark.robustness_board import CRITERIA
from swingup.benchmark.rollout import Trajectory
from swingup.cli.exporting import plot_command
from swingup.plant.plant import ROBOTS
from swingup.report import figures
from swingup.report.draw import draw, render
from swingup.report.figures import unwrapped
from swingup.report.film import animate


def swing(turns=0.5, joint=1, rows=1001, dt=0.01):
    """Shoulder from hanging to ``turns`` turns within five seconds, at rest from then on; torque on one joint."""
    time = dt * np.arange(rows)
    phase = np.clip(time / 5.0, 0.0, 1.0)
    q1 = 2 * np.pi * turns * phase
    x = np.column_stack([q1, np.sin(np.pi * phase), np.gradient(q1, dt), np.cos(time)])
    u = np.zeros((rows, 2))
    u[:, joint] = 3 * np.sin(time)
    return Trajectory(time=time, x=x, u=u)


def result(value=50.0, **changes):
    return {**dict.fromkeys(CRITERIA, value), "score": value / 100, **changes}


def curve(seed=0, offset=0.0):
    values = [(1e6, -0.5 + offset, 0.0), (2e6, -0.4 + offset, 0.4 + offset), (3e6, -0.3 + offset, 0.2 + offset)]
    return [dict(zip(("seed", "frames", "reward", "score"), (seed, *each), strict=True)) for each in values]


def plotted(kind, *given):
    return draw(getattr(figures, f"{kind}_figure")(*given))


def plot(kind, files, out, **options):
    plot_command(kind, files, out=str(out), **options)


def legend_texts(legend):
    return [text.get_text() for text in legend.get_texts()]


def lines(axes, label):
    """The points of the lines of a label."""
    return [np.array(line.get_data()) for line in axes.get_lines() if line.get_label() == label]


def test_curves_are_the_numbers_that_were_given():
    both = {"one": swing(), "other": swing(turns=-0.5)}
    positions, velocities, torques = np.array(plotted("trajectory", both, "acrobot").axes).reshape(3, 2)
    portraits = plotted("phase", both, "acrobot").axes
    for column, (name, run) in enumerate(both.items()):
        for axes, label, up in (
            (positions, "q1", run.x[:, 0]), (positions, "q2", run.x[:, 1]), (velocities, "dq1", run.x[:, 2]),
            (velocities, "dq2", run.x[:, 3]), (torques, "u2", run.u[:, 1]),
        ):  # fmt: skip
            np.testing.assert_array_equal(lines(axes[column], label), [[run.time, up]])
        for joint, axes in enumerate(portraits):
            np.testing.assert_array_equal(lines(axes, name), [[run.x[:, joint], run.x[:, 2 + joint]]])
    # l1 = 0.2, l2 = 0.3: -0.2 cos q1 - 0.3 cos(q1 + q2) > 0.45 first holds with both angles near the goal.
    run = both["one"]
    up = run.time[-0.2 * np.cos(run.x[:, 0]) - 0.3 * np.cos(run.x[:, 0] + run.x[:, 1]) > 0.45][0]
    assert positions[0].get_title() == f"one, up at {up:.2f} s"


def test_bars_are_the_percentages_and_their_intervals():
    intervals = {"velocity_noise": [40.0, 70.0], "torque_noise": [50.0, 50.0], "score": [0.45, 0.55]}
    given = {"ours": result(intervals=intervals), "few": {"model": 20.0, "delay": 40.0}}
    axes = plotted("robustness", given).axes[0]
    found = [[bar.get_height() for bar in bars] for bars in axes.containers if hasattr(bars, "patches")]
    assert found == [[50.0] * len(CRITERIA), [20.0, 40.0]]
    ends = {tuple(path.vertices[:, 1]) for lines in axes.collections for path in lines.get_paths()}
    assert ends == {(40.0, 70.0)}  # an interval without width is no bar


def test_learning_curves_have_a_line_a_seed_and_gaps_where_nothing_was_measured():
    rows = [{**row, "termination_rate": rate} for row, rate in zip(curve(), (0.02, None, 0.0), strict=True)]
    rows[0]["score"], rows[1]["reward"] = None, math.nan
    rewards, resets, scores = plotted("curves", {"a": rows, "b": curve(1) + curve(2, offset=0.05)}).axes
    for axes, expected in (
        (rewards, [[-0.5, np.nan, -0.3], [-0.5, -0.4, -0.3], [-0.45, -0.35, -0.25]]),
        (resets, [[20.0, np.nan, 0.0], [np.nan] * 3, [np.nan] * 3]),  # of 1,000 steps; b did not count them
    ):
        np.testing.assert_allclose([line.get_ydata() for line in axes.get_lines()], expected)
        np.testing.assert_allclose(axes.get_lines()[0].get_xdata(), [1.0, 2.0, 3.0])  # millions
    dots, best = ([line.get_ydata() for line in scores.get_lines() if line.get_marker() == m and
                   len(line.get_xdata())] for m in (".", "None"))  # fmt: skip
    np.testing.assert_allclose(dots, [[np.nan, 0.4, 0.2], [0, 0.4, 0.2], [0, 0.45, 0.25]])
    np.testing.assert_allclose(best[1:], [[0, 0.4, 0.4], [0, 0.45, 0.45]])


def test_long_names_keep_their_legends_apart():
    names = [f"learning_rate=0.0003,policy_layers=64x64/seed-{seed}" for seed in range(3)]
    one = figures.Curve("", np.arange(2.0), np.arange(2.0))
    panel = figures.Panel("x", "y", [dataclasses.replace(one, name=name) for name in names])
    [legend] = draw(figures.Figure([panel])).legends
    assert [text.get_text() for text in legend.get_texts()] == names


def test_a_short_run_also_says_when_it_is_up():
    figure = figures.trajectory_figure({"short": swing(rows=601)}, "pendubot")
    assert "short, up at" in figure.panels[0].title


def test_angles_are_unwrapped_and_start_near_hanging():
    q1 = np.linspace(0, 3 * np.pi, 50) + 4 * np.pi
    x = np.column_stack([(q1 + np.pi) % (2 * np.pi) - np.pi, 2 * np.pi + 0 * q1, q1, q1])
    q = unwrapped(x)
    np.testing.assert_allclose(q[:, 0], np.linspace(0, 3 * np.pi, 50), atol=1e-12)
    np.testing.assert_allclose(q[:, 1], 0.0, atol=1e-12)


NO_RESULTS = [
    [1, 2], {}, dict.fromkeys(CRITERIA), result(model="high"), result(delay=math.nan), result(score=71.0),
    result(intervals=[1, 2]), result(intervals=[]),
    result(intervals={"model": [1, None]}), result(intervals={"model": [1, 101]}),
]  # fmt: skip
ROW = {"seed": 0, "frames": 1, "score": 0.5}
NO_CURVES = [[], [{"seed": 0, "frames": 1}], [ROW | {"frames": "many"}], [ROW | {"score": math.inf}]]
NO_TRAJECTORIES = [
    Trajectory(np.arange(5.0), np.zeros((5, 3)), np.zeros((5, 2))),
    Trajectory(np.zeros(5), np.zeros((5, 4)), np.full((5, 2), np.nan)),
]


def test_what_cannot_be_drawn_is_named():
    for kind, wrong, *robot in (
        ("robustness", NO_RESULTS), ("curves", NO_CURVES),
        ("trajectory", NO_TRAJECTORIES, "acrobot"), ("phase", NO_TRAJECTORIES, "acrobot"),
    ):  # fmt: skip
        for given in wrong:
            assert refusal(plotted, kind, {"ours": given}, *robot).startswith("ours")
        assert "nothing to draw" in refusal(plotted, kind, {}, *robot)


@pytest.mark.slow
def test_figures_do_not_depend_on_names():
    names = ("_hidden", "cost in $", "$x_1", "x" * 300, "a_b", "--></svg>\x1b\n\udcff")
    for kind, given, *robot in (
        ("trajectory", swing(), "acrobot"), ("phase", swing(), "acrobot"),
        ("robustness", result()), ("curves", curve()),
    ):  # fmt: skip
        figure = plotted(kind, dict.fromkeys(names, given), *robot)
        assert render(figure, ".png")
        ElementTree.fromstring(render(figure, ".svg"))  # no name leaves its comment, no control character stays
        if figure.legends:
            assert len(legend_texts(figure.legends[0])) >= len(names)


def test_a_figure_is_the_same_every_time_whatever_the_global_settings():
    first = {suffix: render(plotted("robustness", {"a": result()}), suffix) for suffix in (".png", ".svg", ".pdf")}
    with matplotlib.rc_context({"axes.facecolor": "black", "font.size": 30, "figure.dpi": 30}):
        before = dict(matplotlib.rcParams)
        for suffix, content in first.items():
            assert render(plotted("robustness", {"a": result()}), suffix) == content
        assert dict(matplotlib.rcParams) == before


def test_every_kind_is_saved(tmp_path):
    run, score, metrics = (tmp_path / name for name in ("run.csv", "score.json", "metrics.jsonl"))
    save_trajectory(run, swing(rows=30))
    score.write_text(json.dumps(result()), encoding="utf-8")
    metrics.write_text("".join(json.dumps(row) + "\n" for row in curve()), encoding="utf-8")
    for kind, file, out, start in (
        ("trajectory", run, "a.png", b"\x89PNG"), ("phase", run, "a.svg", b"<?xml"),
        ("robustness", score, "a.pdf", b"%PDF"), ("curve", metrics, "a.PNG", b"\x89PNG"),
        ("animation", run, "a.gif", b"GIF89a"),
    ):  # fmt: skip
        plot(kind, [file], tmp_path / out)
        assert (tmp_path / out).read_bytes().startswith(start)
    assert len(list(tmp_path.iterdir())) == 3 + 5


def test_bad_files_are_named_and_what_is_there_survives(tmp_path):
    """Other contents: ``NO_RESULTS``, ``NO_CURVES``, and tests/test_spoilt_files.py."""
    (tmp_path / "bad").write_text("{")
    for kind, file in (
        ("trajectory", "out.png"),
        ("animation", "out.gif"),
        ("robustness", "out.png"),
        ("curve", "out.svg"),
    ):
        (tmp_path / file).write_bytes(b"old")
        assert "bad" in refusal(plot, kind, [tmp_path / "bad"], tmp_path / file)
        assert (tmp_path / file).read_bytes() == b"old"
    assert len([*tmp_path.iterdir()]) == 4


def test_the_driven_joint_tells_the_robot(tmp_path):
    acrobot, pendubot, passive = files = [tmp_path / name for name in ("a.csv", "p.csv", "0.csv")]
    swings = [swing(joint=1), swing(joint=0), swing()]
    swings[2].u[:] = 0.0
    for file, each in zip(files, swings, strict=True):
        save_trajectory(file, each)
    plot("phase", [pendubot, pendubot], tmp_path / "out.svg")
    assert "draw two pictures" in refusal(plot, "phase", [acrobot, pendubot], tmp_path / "out.svg")
    assert "has no torque" in refusal(plot, "phase", [passive], tmp_path / "out.svg")
    plot("phase", [passive, pendubot], tmp_path / "out.svg", robot=ROBOTS["pendubot"])


at_500_hz = functools.partial(swing, dt=0.002)


def read(path):
    """Frames and how long each is shown (ms)."""
    with Image.open(path) as film:
        shown = [(np.array(each.convert("RGB")), each.info["duration"]) for each in ImageSequence.Iterator(film)]
        assert film.info["loop"] == 0  # again and again
    pictures, delays = map(list, zip(*shown, strict=True))
    return pictures, delays


@pytest.mark.parametrize(("fps", "speed", "count"), [(30, 1.0, 60), (20, 2.0, 20), (25, 0.5, 100), (12.5, 1.0, 25)])
def test_gif_has_the_right_pictures_and_duration(tmp_path, fps, speed, count):
    animate([(at_500_hz(), "acrobot")], tmp_path / "film.gif", fps=fps, size=48, speed=speed)
    pictures, delays = read(tmp_path / "film.gif")
    assert len(pictures) == count
    # Delays are whole hundredths of a second, 3 and 4 at 30 pictures a second, and do not drift.
    assert sum(delays) == pytest.approx(1000 * 2.0 / speed, abs=5)
    assert max(delays) - min(delays) <= 10
    assert not np.array_equal(pictures[0], pictures[-1])


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_mp4_has_an_even_number_of_rows(tmp_path):
    animate([(at_500_hz(), "acrobot")], tmp_path / "film.mp4", fps=10, size=49)
    assert (tmp_path / "film.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_film_in_mp4_needs_ffmpeg(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    found = refusal(animate, [(at_500_hz(), "acrobot")], tmp_path / "film.mp4", fps=10, size=48)
    assert "needs ffmpeg, which is missing" in found


def test_two_pendulums_move_side_by_side_also_as_webp(tmp_path):
    animate(
        [(at_500_hz(), "acrobot"), (at_500_hz(turns=-0.5), "pendubot")], tmp_path / "film.webp", fps=10, size=48
    )
    with Image.open(tmp_path / "film.webp") as film:
        assert (film.size, film.n_frames) == ((96, 48), 20)
        first = np.array(film.convert("RGB"))
    assert not np.array_equal(first[:, :48], first[:, 48:])  # another joint is driven
