import json
import math
import re
import subprocess
import sys
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest

from swingup.benchmark.rollout import Trajectory
from swingup.benchmark.rules import CRITERIA
from swingup.benchmark.trajectory_file import save_trajectory
from swingup.common.errors import SwingupError
from swingup.report import figures
from swingup.report.draw import draw, render
from swingup.report.figures import unwrapped, upright_near
from swingup.report.inputs import make_labels
from swingup.report.save import PLOT_KINDS, save_plot


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
    scores = [0.0, 0.4 + offset, 0.2 + offset]
    return [
        {"seed": seed, "frames": 1_000_000 * (k + 1), "reward": -0.5 + 0.1 * k + offset, "score": score}
        for k, score in enumerate(scores)
    ]


def plot_trajectories(*arguments):
    return draw(figures.trajectory_figure(*arguments))


def plot_phase(*arguments):
    return draw(figures.phase_figure(*arguments))


def plot_robustness(results):
    return draw(figures.robustness_figure(results))


def plot_curves(runs):
    return draw(figures.curves_figure(runs))


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines() if not line.get_label().startswith("_")}


def legend_texts(legend):
    return [text.get_text() for text in legend.get_texts()]


def assert_data(line, across, up):
    np.testing.assert_array_equal(line.get_xdata(), across)
    np.testing.assert_array_equal(line.get_ydata(), up)


# Time series


def test_time_series_show_the_columns_of_every_trajectory():
    given = {"clean": swing(), "noisy": swing(turns=1.5)}
    axes = np.array(plot_trajectories(given, "acrobot").axes).reshape(3, 2)
    for column, (name, trajectory) in enumerate(given.items()):
        positions, velocities, torques = (lines(each) for each in axes[:, column])
        for joint in (0, 1):
            assert_data(positions[f"q{joint + 1}"], trajectory.time, trajectory.x[:, joint])
            assert_data(velocities[f"dq{joint + 1}"], trajectory.time, trajectory.x[:, 2 + joint])
        assert_data(torques["u2"], trajectory.time, trajectory.u[:, 1])
        assert torques["u2"].get_drawstyle() == "steps-post"  # held over each step
        assert "u1" not in torques
        assert axes[0, column].get_title().startswith(f"{name}, up at ")
        assert axes[2, column].get_xlabel() == "time (s)"
    assert [each.get_ylabel() for each in axes[:, 0]] == ["position (rad)", "velocity (rad/s)", "torque (N m)"]
    assert axes[0, 0].get_ylim() == axes[0, 1].get_ylim()


def test_time_series_mark_goal_limit_and_swing_up_time():
    (positions, velocities, torques) = plot_trajectories({"run": swing()}, "acrobot").axes
    goal = [line.get_ydata()[0] for line in positions.get_lines() if line.get_label() == "goal"]
    assert goal == [math.pi, 0.0]
    limits = [line.get_ydata()[0] for line in torques.get_lines() if line.get_label() == "limit"]
    assert limits == [6.0, -6.0]
    # l1 = 0.2, l2 = 0.3: -0.2 cos q1 - 0.3 cos(q1 + q2) > 0.45 first holds with both angles near the goal.
    x, time = swing().x, swing().time
    up = time[-0.2 * np.cos(x[:, 0]) - 0.3 * np.cos(x[:, 0] + x[:, 1]) > 0.45][0]
    for axes in (positions, velocities, torques):
        (mark,) = [line for line in axes.get_lines() if line.get_label() == "up"]
        assert mark.get_xdata()[0] == pytest.approx(up)
    assert positions.get_title() == f"run, up at {up:.2f} s"


def test_run_that_never_gets_up_has_no_swing_up_time():
    figure = plot_trajectories({"run": swing(turns=0.25)}, "acrobot")
    assert figure.axes[0].get_title() == "run"


def test_torque_of_the_passive_joint_shows_only_where_there_is_some():
    both = swing()
    both.u[:, 0] = 0.1
    figure = plot_trajectories({"simulated": both, "plain": swing()}, "acrobot")
    with_both, plain = figure.axes[4:]
    assert set(lines(with_both)) == {"u1", "u2", "limit", "up"}
    assert set(lines(plain)) == {"u2", "limit", "up"}


def test_angles_are_unwrapped_and_start_near_hanging():
    q1 = np.linspace(0, 3 * np.pi, 50) + 4 * np.pi
    x = np.column_stack([(q1 + np.pi) % (2 * np.pi) - np.pi, 2 * np.pi + 0 * q1, q1, q1])
    q = unwrapped(x)
    np.testing.assert_allclose(q[:, 0], np.linspace(0, 3 * np.pi, 50), atol=1e-12)
    np.testing.assert_allclose(q[:, 1], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("end", "goal"),
    [
        ((3.0, 0.1), (math.pi, 0.0)),
        ((-3.0, -6.0), (-math.pi, -2 * math.pi)),
        ((9.0, 13.0), (3 * math.pi, 4 * math.pi)),
    ],
)
def test_goal_is_the_upright_angle_nearest_to_the_end(end, goal):
    np.testing.assert_allclose(upright_near(np.array(end)), goal)


# Phase portraits


def test_phase_portraits_show_each_joint_from_start_to_goal():
    given = {"one": swing(joint=0), "other": swing(turns=-0.5, joint=0)}
    figure = plot_phase(given, "pendubot")
    for joint, axes in enumerate(figure.axes):
        for name, trajectory in given.items():
            assert_data(lines(axes)[name], trajectory.x[:, joint], trajectory.x[:, 2 + joint])
        marks = {mark: [] for mark in ("start", "goal")}
        for line in axes.get_lines():
            if line.get_label() in marks:
                marks[line.get_label()].append((line.get_xdata()[0], line.get_ydata()[0]))
        assert marks["start"] == [tuple(each.x[0, [joint, 2 + joint]]) for each in given.values()]
        assert marks["goal"] == ([(math.pi, 0.0), (-math.pi, 0.0)] if joint == 0 else [(0.0, 0.0)] * 2)
    assert [axes.get_xlabel() for axes in figure.axes] == ["q1 (rad)", "q2 (rad)"]
    assert [axes.get_ylabel() for axes in figure.axes] == ["dq1 (rad/s)", "dq2 (rad/s)"]
    assert [axes.get_title() for axes in figure.axes] == ["shoulder (driven)", "elbow (passive)"]
    assert legend_texts(figure.legends[0]) == ["one", "other", "start", "goal"]


@pytest.mark.parametrize(
    ("turns", "names"), [(0.5, {"0", "π/2", "π"}), (-0.75, {"−π", "−π/2", "0"}), (3.0, {"0", "2π", "4π", "6π"})]
)
def test_angles_are_ticked_in_multiples_of_pi(turns, names):
    figure = plot_phase({"run": swing(turns)}, "acrobot")
    axis = figure.axes[0].xaxis
    assert names <= set(axis.get_major_formatter().format_ticks(axis.get_majorticklocs()))


# Robustness


def test_bars_are_as_high_as_the_percentages():
    given = {"ours": result(**{name: 10.0 * (k + 1) for k, name in enumerate(CRITERIA)}), "theirs": result(90.0)}
    figure = plot_robustness(given)
    axes = figure.axes[0]
    for bars, each in zip(axes.containers, given.values(), strict=True):
        assert [bar.get_height() for bar in bars] == [each[name] for name in CRITERIA]
    names = [label.get_text().replace("\n", " ") for label in axes.get_xticklabels()]
    assert names == [
        "Model",
        "Velocity noise",
        "Torque noise",
        "Torque step response",
        "Time delay",
        "Perturbations",
    ]
    # Two groups of bars, one on each side of the tick.
    assert axes.containers[0][0].get_x() < -0.1
    assert axes.containers[1][0].get_x() >= 0.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("criterion", "success (%)")
    assert legend_texts(figure.legends[0]) == ["ours, 0.500", "theirs, 0.900"]


def test_intervals_become_error_bars():
    intervals = {"velocity_noise": [40.0, 70.0], "torque_noise": [50.0, 50.0], "score": [0.45, 0.55]}
    figure = plot_robustness({"ours": result(intervals=intervals)})
    ends = {tuple(path.vertices[:, 1]) for lines in figure.axes[0].collections for path in lines.get_paths()}
    assert ends == {(40.0, 70.0)}  # an interval without width is no bar
    assert legend_texts(figure.legends[0]) == ["ours, 0.500 (0.450–0.550)"]


def test_only_measured_criteria_are_drawn():
    figure = plot_robustness({"a": {"delay": 30.0, "score": None}, "b": {"model": 20.0, "delay": 40.0}})
    axes = figure.axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["Model", "Time\ndelay"]
    assert [[bar.get_height() for bar in bars] for bars in axes.containers] == [[30.0], [20.0, 40.0]]
    assert legend_texts(figure.legends[0]) == ["a", "b"]


def test_many_controllers_look_different():
    bars = plot_robustness({f"c{k}": result() for k in range(9)}).axes[0].containers
    assert len({(each[0].get_facecolor(), each[0].get_hatch()) for each in bars}) == 9


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ([1, 2], "holds no robustness score"),
        ({}, "holds no robustness score"),
        ({"robot": "acrobot", "score": 0.6}, "holds no robustness score"),
        (dict.fromkeys(CRITERIA), "holds no robustness score"),
        (result(model="high"), "model = 'high': use a number from 0 to 100"),
        (result(delay=101.0), "delay = 101.0: use a number from 0 to 100"),
        (result(delay=math.nan), "delay = nan: use"),
        (result(model=True), "model = True: use"),
        (result(score=71.0), "score = 71.0: use a number from 0 to 1"),
        (result(intervals=[1, 2]), r"intervals = \[1, 2\] is not an object"),
        (result(intervals={"model": 3}), "interval of model = 3 is not a pair"),
        (result(intervals={"model": [1, None]}), "interval of model = None: use a number from 0 to 100"),
        (result(intervals={"model": [1, 101]}), "interval of model = 101: use a number from 0 to 100"),
    ],
)
def test_other_shapes_are_no_robustness(given, reason):
    with pytest.raises(SwingupError, match=f"^ours:? .*{reason}|^ours {reason}"):
        plot_robustness({"ours": given})


# Learning curves


def test_curves_show_reward_and_score_of_every_seed():
    figure = plot_curves({"a": curve(0) + curve(1, offset=0.05), "b": curve(3, offset=0.1)})
    rewards, scores = figure.axes
    assert [line.get_label() for line in rewards.get_lines()] == ["a (2 seeds)", "a (2 seeds)", "b"]
    for line, offset in zip(rewards.get_lines(), (0.0, 0.05, 0.1), strict=True):
        np.testing.assert_allclose(line.get_xdata(), [1.0, 2.0, 3.0])  # millions
        np.testing.assert_allclose(line.get_ydata(), np.array([-0.5, -0.4, -0.3]) + offset)
    dots = [line for line in scores.get_lines() if line.get_marker() == "." and len(line.get_xdata())]
    best = [line for line in scores.get_lines() if line.get_marker() == "None"]
    np.testing.assert_allclose([line.get_ydata() for line in dots], [[0, 0.4, 0.2], [0, 0.45, 0.25], [0, 0.5, 0.3]])
    np.testing.assert_allclose([line.get_ydata() for line in best], [[0, 0.4, 0.4], [0, 0.45, 0.45], [0, 0.5, 0.5]])
    assert scores.get_xlabel() == "frames (millions)"
    assert (rewards.get_ylabel(), scores.get_ylabel()) == ("reward rate per step (–)", "best RealAI score (0 to 1)")
    assert legend_texts(figure.legends[0]) == ["a (2 seeds)", "b", "one evaluation"]


def test_the_curves_of_a_task_judged_by_episodes_show_returns():
    rows = [{**row, "score": -100.0 + k, "mean_length": 200.0} for k, row in enumerate(curve())]
    scores = plot_curves({"a": rows}).axes[1]
    assert scores.get_ylabel() == "best mean return (–)"
    assert scores.get_ylim()[0] < -99.0


def test_curves_have_gaps_where_nothing_was_measured():
    rows = curve()
    rows[0]["score"], rows[1]["reward"] = None, math.nan
    del rows[2]["score"]
    rewards, scores = plot_curves({"a": rows}).axes
    np.testing.assert_allclose(rewards.get_lines()[0].get_ydata(), [-0.5, np.nan, -0.3])
    np.testing.assert_allclose(scores.get_lines()[0].get_ydata(), [np.nan, 0.4, np.nan])


def test_a_third_panel_shows_resets_where_there_were_some():
    rows = [{**row, "termination_rate": rate} for row, rate in zip(curve(), (0.02, None, 0.0), strict=True)]
    figure = plot_curves({"new": rows, "old": curve(1) + curve(2)})
    _, resets, _ = figure.axes
    assert resets.get_ylabel() == "resets per 1,000 steps (–)"
    new, *old = [line.get_ydata() for line in resets.get_lines()]
    np.testing.assert_allclose(new, [20.0, np.nan, 0.0])
    # A run of a version that did not count them is not drawn as one without resets.
    assert all(np.isnan(line).all() for line in old)
    assert legend_texts(figure.legends[0]) == ["new", "old (2 seeds, resets –)", "one evaluation"]


def test_a_task_without_resets_has_no_panel_of_them():
    assert len(plot_curves({"a": [{**row, "termination_rate": 0.0} for row in curve()]}).axes) == 2


@pytest.mark.parametrize(
    ("rows", "reason"),
    [
        ([], "has no rows of metrics"),
        ([{"seed": 0, "frames": 1}], "has neither reward nor score"),
        ([{"seed": 0, "frames": "many", "score": 0.5}], "frames = 'many': use a number from 0"),
        ([{"seed": 0, "score": 0.5}], "frames = None: use a number"),
        ([{"seed": 0, "frames": 1, "score": [0.5]}], r"score = \[0.5\]: use a number"),
        ([{"seed": 0, "frames": 1, "score": math.inf}], "score = inf: use a number"),
        ([{"seed": 0, "frames": 1, "score": 0.5, "termination_rate": "x"}], "termination_rate = 'x': use a number"),
        ([{"seed": [0], "frames": 1, "score": 0.5}], r"seed = \[0\]: use a whole number"),
    ],
)
def test_rows_without_a_curve_are_refused(rows, reason):
    with pytest.raises(SwingupError, match=f"^run:? {reason}"):
        plot_curves({"run": rows})


# All figures

QUANTITY = r".+ \((rad|rad/s|s|N m|%|millions|0 to 1|–)\)"
"""A label and its unit; the dash stands for quantities without one."""


def axis_label(axes, direction):
    """The label of an axis, or of the panel that shows the shared axis."""
    group = getattr(axes, f"get_shared_{direction}_axes")().get_siblings(axes)
    labels = {getattr(each, f"get_{direction}label")() for each in group} - {""}
    assert len(labels) == 1
    return labels.pop()


@pytest.mark.parametrize(
    "figure",
    [
        pytest.param(lambda: plot_trajectories({"a": swing(), "b": swing()}, "acrobot"), id="trajectory"),
        pytest.param(lambda: plot_phase({"a": swing()}, "pendubot"), id="phase"),
        pytest.param(lambda: plot_robustness({"a": result()}), id="robustness"),
        pytest.param(lambda: plot_curves({"a": curve()}), id="curve"),
        pytest.param(lambda: plot_curves({"a": [{**row, "mean_length": 9.0} for row in curve()]}), id="returns"),
        pytest.param(
            lambda: plot_curves({"a": [{**row, "termination_rate": 1e-3} for row in curve()]}), id="resets"
        ),
    ],
)
def test_every_axis_has_a_label_and_a_unit(figure):
    labels = {axis_label(axes, direction) for axes in figure().axes for direction in ("x", "y")}
    assert all(re.fullmatch(QUANTITY, label) for label in labels - {"criterion"})  # criteria are names


@pytest.mark.parametrize(
    "draw",
    [
        lambda: plot_trajectories({}, "acrobot"),
        lambda: plot_phase({}, "acrobot"),
        lambda: plot_robustness({}),
        lambda: plot_curves({}),
    ],
)
def test_nothing_to_draw_is_told(draw):
    with pytest.raises(SwingupError, match="nothing to draw: give at least one"):
        draw()


@pytest.mark.parametrize("draw", [plot_trajectories, plot_phase])
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"x": np.zeros((5, 3))}, r"run: time, x and u have shapes \(5,\), \(5, 3\) and \(5, 2\)"),
        ({"u": np.full((5, 2), np.nan)}, "run holds values that are not finite"),
        ({"time": np.zeros(5)}, "run: its time does not increase"),
    ],
)
def test_malformed_trajectories_are_refused(draw, change, reason):
    parts = {"time": np.arange(5.0), "x": np.zeros((5, 4)), "u": np.zeros((5, 2)), **change}
    with pytest.raises(SwingupError, match=reason):
        draw({"run": Trajectory(**parts)}, "acrobot")


@pytest.mark.slow
def test_figures_do_not_depend_on_names():
    names = ("_hidden", "cost in $", "$x_1", "x" * 300, "a_b", "--></svg>\x1b\n\udcff")
    for figure in (
        plot_trajectories({name: swing() for name in names}, "acrobot"),
        plot_phase({name: swing() for name in names}, "acrobot"),
        plot_robustness({name: result() for name in names}),
        plot_curves({name: curve() for name in names}),
    ):
        assert render(figure, ".png")
        ElementTree.fromstring(render(figure, ".svg"))  # no name leaves its comment, no control character stays
        if figure.legends:
            assert len(legend_texts(figure.legends[0])) >= len(names)


@pytest.mark.parametrize(("suffix", "start"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_a_figure_is_rendered_the_same_every_time(suffix, start):
    first, second = (render(plot_robustness({"a": result()}), suffix) for _ in range(2))
    assert first.startswith(start)
    assert first == second


def test_global_settings_are_neither_read_nor_changed():
    expected = render(plot_robustness({"a": result()}), ".png")
    with matplotlib.rc_context({"axes.facecolor": "black", "font.size": 30, "figure.dpi": 30}):
        before = dict(matplotlib.rcParams)
        assert render(plot_robustness({"a": result()}), ".png") == expected
        assert dict(matplotlib.rcParams) == before


@pytest.mark.slow
def test_pyplot_is_not_needed():
    code = (
        "import sys; from swingup.report.draw import draw, render;"
        "from swingup.report.figures import robustness_figure;"
        "assert 'matplotlib' not in sys.modules;"
        "render(draw(robustness_figure({'a': {'model': 5.0}})), '.png'); print('matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_missing_matplotlib_names_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(SwingupError, match=r"pip install swingup\[plot\]"):
        plot_robustness({"a": result()})


# From files


@pytest.fixture
def inputs(tmp_path):
    """One good file for each kind of plot."""
    folder = tmp_path / "in"
    folder.mkdir()
    save_trajectory(folder / "run.csv", swing(rows=30))
    (folder / "score.json").write_text(json.dumps(result()), encoding="utf-8")
    (folder / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in curve()), encoding="utf-8")
    trajectory, score, metrics = (folder / name for name in ("run.csv", "score.json", "metrics.jsonl"))
    same = dict.fromkeys(("trajectory", "phase", "animation"), trajectory)
    return {**same, "robustness": score, "curve": metrics}


@pytest.mark.parametrize(
    ("kind", "out", "start"),
    [
        ("trajectory", "out.png", b"\x89PNG"),
        ("phase", "out.svg", b"<?xml"),
        ("robustness", "out.pdf", b"%PDF"),
        ("curve", "out.PNG", b"\x89PNG"),
        ("animation", "out.gif", b"GIF89a"),
    ],
)
def test_every_kind_is_saved(tmp_path, inputs, kind, out, start):
    save_plot(kind, [inputs[kind]], tmp_path / out)
    assert (tmp_path / out).read_bytes().startswith(start)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", out]


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        ("trajectory", "no,header\n1,2\n"),
        ("animation", ""),
        ("robustness", "{"),
        ("robustness", "[1, 2]"),
        ("robustness", "[" * 100_000),
        ("curve", ""),
        ("curve", "nonsense\nnonsense\n"),
        ("curve", '{"seed": 0, "frames": 1}\n'),
    ],
)
def test_bad_files_are_named_and_nothing_is_written(tmp_path, kind, content):
    bad, out = tmp_path / "bad", tmp_path / ("out.gif" if kind == "animation" else "out.png")
    bad.write_text(content, encoding="utf-8")
    with pytest.raises(SwingupError) as error:
        save_plot(kind, [bad], out)
    assert str(bad) in str(error.value)
    assert "\n" not in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["bad"]


@pytest.mark.parametrize("kind", PLOT_KINDS)
@pytest.mark.parametrize("file", ["missing", "."])
def test_files_that_cannot_be_read_are_named(tmp_path, kind, file):
    with pytest.raises(SwingupError, match=r"cannot read|no such file"):
        save_plot(kind, [tmp_path / file], tmp_path / ("out.gif" if kind == "animation" else "out.png"))


@pytest.mark.parametrize(
    ("kind", "out", "reason"),
    [
        ("histogram", "out.png", "unknown kind of plot 'histogram': use one of trajectory, phase, animation"),
        ("phase", "out.gif", "its name must end in .png or .svg or .pdf"),
        ("phase", "out", "its name must end in .png"),
        ("animation", "out.png", "its name must end in .gif or .webp"),
        ("curve", "missing/out.png", "choose a folder that exists"),
    ],
)
def test_bad_requests_are_told(tmp_path, inputs, kind, out, reason):
    with pytest.raises(SwingupError, match=reason):
        save_plot(kind, [inputs.get(kind, "x")], tmp_path / out)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_an_existing_figure_survives_a_failure(tmp_path, inputs):
    out = tmp_path / "out.png"
    out.write_bytes(b"old")
    with pytest.raises(SwingupError):
        save_plot("curve", [inputs["robustness"]], out)
    assert out.read_bytes() == b"old"


def test_files_are_needed(tmp_path):
    with pytest.raises(SwingupError, match="give at least one file"):
        save_plot("phase", [], tmp_path / "out.png")


def test_the_driven_joint_tells_the_robot(tmp_path):
    acrobot, pendubot, passive = tmp_path / "a.csv", tmp_path / "p.csv", tmp_path / "0.csv"
    save_trajectory(acrobot, swing(joint=1))
    save_trajectory(pendubot, swing(joint=0))
    still = swing()
    save_trajectory(passive, Trajectory(time=still.time, x=still.x, u=0 * still.u))
    save_plot("phase", [pendubot, pendubot], tmp_path / "out.svg")
    with pytest.raises(SwingupError, match=r"a.csv is of the acrobot, .*p.csv of the pendubot: draw two pictures"):
        save_plot("phase", [acrobot, pendubot], tmp_path / "out.svg")
    with pytest.raises(SwingupError, match="has torque on neither joint: name the robot, acrobot or pendubot"):
        save_plot("phase", [passive], tmp_path / "out.svg")
    save_plot("phase", [passive, pendubot], tmp_path / "out.svg", robot="pendubot")
    with pytest.raises(SwingupError, match="unknown robot 'cartpole'"):
        save_plot("phase", [acrobot], tmp_path / "out.svg", robot="cartpole")


def test_an_animation_shows_several_side_by_side(tmp_path, inputs):
    save_plot("animation", [inputs["animation"]] * 2, tmp_path / "out.gif", size=48)
    assert (tmp_path / "out.gif").read_bytes()[6:10] == b"\x60\0\x30\0"  # 96 by 48 pixels


@pytest.mark.parametrize(
    ("files", "labels"),
    [
        (["a.csv", "b.csv"], ["a", "b"]),
        (["x/a.csv", "y/a.csv", "b.csv"], ["x/a", "y/a", "b"]),
        (["1/x/a.csv", "2/x/a.csv"], ["1/x/a", "2/x/a"]),
        (["runs/one/metrics.jsonl", "runs/two/metrics.jsonl"], ["one", "two"]),
        (["p/one/metrics.jsonl", "q/one/metrics.jsonl"], ["p/one", "q/one"]),
        (["a.csv", "a.csv"], ["a", "a (2)"]),
    ],
)
def test_labels_are_short_and_different(files, labels):
    assert make_labels(files) == labels
