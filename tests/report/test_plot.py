import json
import math
import re
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest

from refusals import refusal
from swingup.benchmark.recording import save_trajectory
from swingup.benchmark.robustness_board import CRITERIA
from swingup.benchmark.rollout import Trajectory
from swingup.cli.exporting import plot_command
from swingup.plant.plant import ROBOTS
from swingup.report import figures
from swingup.report.draw import draw, render
from swingup.report.figures import make_labels, unwrapped


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


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines() if not line.get_label().startswith("_")}


def legend_texts(legend):
    return [text.get_text() for text in legend.get_texts()]


def assert_data(line, across, up):
    np.testing.assert_array_equal(line.get_xdata(), across)
    np.testing.assert_array_equal(line.get_ydata(), up)


def test_time_series_show_the_columns_of_every_trajectory():
    given = {"clean": swing(), "noisy": swing(turns=1.5)}
    axes = np.array(plotted("trajectory", given, "acrobot").axes).reshape(3, 2)
    for column, (name, trajectory) in enumerate(given.items()):
        positions, velocities, torques = (lines(each) for each in axes[:, column])
        drawn = positions["q1"], positions["q2"], velocities["dq1"], velocities["dq2"], torques["u2"]
        for line, values in zip(drawn, [*trajectory.x.T, trajectory.u[:, 1]], strict=True):
            assert_data(line, trajectory.time, values)
        assert torques["u2"].get_drawstyle() == "steps-post"  # held over each step
        assert "u1" not in torques  # a passive joint shows only where it has torque
        assert axes[0, column].get_title().startswith(f"{name}, up at ")
    assert axes[0, 0].get_ylim() == axes[0, 1].get_ylim()


def test_time_series_mark_goal_limit_and_swing_up_time():
    both = swing()
    both.u[:, 0] = 0.1
    (positions, velocities, torques) = plotted("trajectory", {"run": both}, "acrobot").axes
    for axes, label, places in ((positions, "goal", [math.pi, 0.0]), (torques, "limit", [6.0, -6.0])):
        assert [line.get_ydata()[0] for line in axes.get_lines() if line.get_label() == label] == places
    assert set(lines(torques)) == {"u1", "u2", "limit", "up"}
    # l1 = 0.2, l2 = 0.3: -0.2 cos q1 - 0.3 cos(q1 + q2) > 0.45 first holds with both angles near the goal.
    x, time = both.x, both.time
    up = time[-0.2 * np.cos(x[:, 0]) - 0.3 * np.cos(x[:, 0] + x[:, 1]) > 0.45][0]
    for axes in (positions, velocities, torques):
        (mark,) = [line for line in axes.get_lines() if line.get_label() == "up"]
        assert mark.get_xdata()[0] == pytest.approx(up)
    assert positions.get_title() == f"run, up at {up:.2f} s"
    assert plotted("trajectory", {"run": swing(turns=0.25)}, "acrobot").axes[0].get_title() == "run"


def test_angles_are_unwrapped_and_start_near_hanging():
    q1 = np.linspace(0, 3 * np.pi, 50) + 4 * np.pi
    x = np.column_stack([(q1 + np.pi) % (2 * np.pi) - np.pi, 2 * np.pi + 0 * q1, q1, q1])
    q = unwrapped(x)
    np.testing.assert_allclose(q[:, 0], np.linspace(0, 3 * np.pi, 50), atol=1e-12)
    np.testing.assert_allclose(q[:, 1], 0.0, atol=1e-12)


def test_phase_portraits_show_each_joint_from_start_to_goal():
    given = {"one": swing(joint=0), "other": swing(turns=-0.5, joint=0)}
    figure = plotted("phase", given, "pendubot")
    for joint, axes in enumerate(figure.axes):
        for name, trajectory in given.items():
            assert_data(lines(axes)[name], trajectory.x[:, joint], trajectory.x[:, 2 + joint])
        start, goal = (
            [(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.get_lines() if line.get_label() == mark]
            for mark in ("start", "goal")
        )
        assert start == [tuple(each.x[0, [joint, 2 + joint]]) for each in given.values()]
        assert goal == ([(math.pi, 0.0), (-math.pi, 0.0)] if joint == 0 else [(0.0, 0.0)] * 2)
    assert [axes.get_title() for axes in figure.axes] == ["shoulder (driven)", "elbow (passive)"]
    assert legend_texts(figure.legends[0]) == ["one", "other", "start", "goal"]


def test_angles_are_ticked_in_multiples_of_pi():
    for turns, names in ((0.5, {"0", "π/2", "π"}), (-0.75, {"−π", "−π/2", "0"}), (3.0, {"0", "2π", "4π", "6π"})):
        axis = plotted("phase", {"run": swing(turns)}, "acrobot").axes[0].xaxis
        assert names <= set(axis.get_major_formatter().format_ticks(axis.get_majorticklocs()))


def test_bars_are_as_high_as_the_percentages():
    given = {f"c{k}": {name: 10.0 * i + k for i, name in enumerate(CRITERIA)} for k in range(9)}
    bars = plotted("robustness", given).axes[0].containers
    for found, each in zip(bars, given.values(), strict=True):
        assert [bar.get_height() for bar in found] == [each[name] for name in CRITERIA]
    # Many controllers look different.
    assert len({(each[0].get_facecolor(), each[0].get_hatch()) for each in bars}) == 9


def test_intervals_are_error_bars_and_only_measured_criteria_are_drawn():
    intervals = {"velocity_noise": [40.0, 70.0], "torque_noise": [50.0, 50.0], "score": [0.45, 0.55]}
    figure = plotted("robustness", {"ours": result(intervals=intervals)})
    ends = {tuple(path.vertices[:, 1]) for lines in figure.axes[0].collections for path in lines.get_paths()}
    assert ends == {(40.0, 70.0)}  # an interval without width is no bar
    assert legend_texts(figure.legends[0]) == ["ours, 0.500 (0.450–0.550)"]
    axes = plotted("robustness", {"a": {"delay": 30.0, "score": None}, "b": {"model": 20.0, "delay": 40.0}}).axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["Model", "Time\ndelay"]
    assert [[bar.get_height() for bar in bars] for bars in axes.containers] == [[30.0], [20.0, 40.0]]


def test_curves_show_reward_and_score_of_every_seed():
    figure = plotted("curves", {"a": curve(0) + curve(1, offset=0.05), "b": curve(3, offset=0.1)})
    rewards, scores = figure.axes
    assert [line.get_label() for line in rewards.get_lines()] == ["a (2 seeds)", "a (2 seeds)", "b"]
    for line, offset in zip(rewards.get_lines(), (0.0, 0.05, 0.1), strict=True):
        np.testing.assert_allclose(line.get_xdata(), [1.0, 2.0, 3.0])  # millions
        np.testing.assert_allclose(line.get_ydata(), np.array([-0.5, -0.4, -0.3]) + offset)
    dots = [line for line in scores.get_lines() if line.get_marker() == "." and len(line.get_xdata())]
    best = [line for line in scores.get_lines() if line.get_marker() == "None"]
    np.testing.assert_allclose([line.get_ydata() for line in dots], [[0, 0.4, 0.2], [0, 0.45, 0.25], [0, 0.5, 0.3]])
    np.testing.assert_allclose([line.get_ydata() for line in best], [[0, 0.4, 0.4], [0, 0.45, 0.45], [0, 0.5, 0.5]])


def test_curves_have_gaps_where_nothing_was_measured():
    rows = curve()
    rows[0]["score"], rows[1]["reward"] = None, math.nan
    del rows[2]["score"]
    rewards, scores = plotted("curves", {"a": rows}).axes
    np.testing.assert_allclose(rewards.get_lines()[0].get_ydata(), [-0.5, np.nan, -0.3])
    np.testing.assert_allclose(scores.get_lines()[0].get_ydata(), [np.nan, 0.4, np.nan])


def test_a_third_panel_shows_resets_where_there_were_some():
    rows = [{**row, "termination_rate": rate} for row, rate in zip(curve(), (0.02, None, 0.0), strict=True)]
    figure = plotted("curves", {"new": rows, "old": curve(1) + curve(2)})
    _, resets, _ = figure.axes
    new, *old = [line.get_ydata() for line in resets.get_lines()]
    np.testing.assert_allclose(new, [20.0, np.nan, 0.0])
    # A run of a version that did not count them is not drawn as one without resets.
    assert all(np.isnan(line).all() for line in old)
    assert legend_texts(figure.legends[0]) == ["new", "old (2 seeds, resets –)", "one evaluation"]
    assert len(plotted("curves", {"a": [{**row, "termination_rate": 0.0} for row in curve()]}).axes) == 2


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


QUANTITY = r".+ \((rad|rad/s|s|N m|%|millions|0 to 1|–)\)"
"""A label and its unit; the dash stands for quantities without one."""


def test_every_axis_has_a_label_and_a_unit():
    """Or the panel that shows an axis that several share: of two columns the left one, of three rows the last."""
    tasks = [{**row, "termination_rate": 1e-3, "mean_length": 9.0} for row in curve()]
    for figure, across, up in (
        (plotted("trajectory", {"a": swing(), "b": swing()}, "acrobot"), 2, 3),
        (plotted("phase", {"a": swing()}, "pendubot"), 2, 2),
        (plotted("robustness", {"a": result()}), 0, 1),  # criteria are names
        (plotted("curves", {"a": tasks}), 1, 3),
    ):
        labels = [[axes.get_xlabel(), axes.get_ylabel()] for axes in figure.axes]
        found = [sum(bool(re.fullmatch(QUANTITY, label)) for label in each) for each in zip(*labels, strict=True)]
        assert found == [across, up]


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


def test_labels_are_short_and_different():
    for files, labels in (
        (["x/a.csv", "y/a.csv", "b.csv"], ["x/a", "y/a", "b"]),
        (["1/x/a.csv", "2/x/a.csv"], ["1/x/a", "2/x/a"]),
        (["p/one/metrics.jsonl", "q/one/metrics.jsonl", "p/two/metrics.jsonl"], ["p/one", "q/one", "two"]),
        (["a.csv", "a.csv"], ["a", "a (2)"]),
    ):
        assert make_labels(files) == labels
