"""Figures of results: bars of the robustness score, and learning curves."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmark.rules import CRITERIA
from .files import CURVE_KEYS, RESETS_KEY, check_curve, check_robustness, require_some
from .style import bar_look, legend_below, line_look, new_figure, plain, styled

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CRITERION_NAMES = dict(
    zip(
        CRITERIA,
        ("Model", "Velocity\nnoise", "Torque\nnoise", "Torque\nresponse", "Time\ndelay", "Perturbations"),
        strict=True,
    )
)
MOST_NUMBERED = 3
"""With more controllers, the bars are too narrow for their numbers."""
DOTS: Any = {"markersize": 2, "alpha": 0.4, "label": "_evaluations"}
ABOVE: Any = {"xytext": (0, 1.5), "textcoords": "offset points", "ha": "center", "fontsize": 7}


def plot_robustness(results: Mapping[str, Mapping[str, Any]]) -> "Figure":
    """Draw the success (%) of several controllers in each criterion of the robustness score as bars.

    Args:
        results: outputs of ``Robustness.as_dict``, by name, as in the legend. The legend also shows the overall
            scores; 95 % intervals become error bars.

    Raises:
        SwingupError: there is no result, one has another form, or matplotlib is not installed.
    """
    require_some(results, "robustness score")
    for name, result in results.items():
        check_robustness(name, result)
    criteria = [name for name in CRITERIA if any(result.get(name) is not None for result in results.values())]
    numbered, group = len(results) <= MOST_NUMBERED, min(0.8, 0.35 + 0.15 * len(results))
    with styled():
        figure = new_figure(max(5.6, 1.2 + 0.2 * len(results) * len(criteria)), 3.3)
        axes = figure.subplots()
        entries: list[tuple[Artist, str]] = []
        for k, (name, result) in enumerate(results.items()):
            width = group / len(results)
            places = {key: p + (k + 0.5) * width - group / 2 for p, key in enumerate(criteria)}
            measured = {key: float(result[key]) for key in criteria if result.get(key) is not None}
            look = {"width": 0.92 * width, "label": plain(name), **bar_look(k)}
            bars = axes.bar([places[key] for key in measured], list(measured.values()), **look)
            entries.append((bars[0], plain(name) + _overall(result)))
            for key, value in measured.items():
                top = _draw_interval(axes, places[key], value, result.get("intervals", {}).get(key))
                if numbered:
                    axes.annotate(f"{value:.0f}", (places[key], top), **ABOVE)
        axes.set_xticks(range(len(criteria)), [CRITERION_NAMES[key] for key in criteria])
        axes.set(xlabel="criterion", ylabel="success (%)", ylim=(0, 105 if numbered else 101))
        axes.tick_params(axis="x", length=0)
        axes.grid(visible=False, axis="x")
        legend_below(figure, entries)
    return figure


def plot_curves(runs: Mapping[str, Sequence[Mapping[str, Any]]]) -> "Figure":
    """Draw reward rate and score over frames (millions), one line for each seed of each run.

    Dots are single evaluations; the line through them is the best so far. The score is the RealAI score of a double
    pendulum, and the mean return of other tasks. Rewards, returns and scores have no unit.

    Reward rate and resets are those of training, with the exploring policy. Where a run had resets, a third panel
    shows them. It has no line of a run that did not record them; the legend then has a dash.

    Args:
        runs: rows of ``metrics.jsonl``, by name, as in the legend.

    Raises:
        SwingupError: there is no run, one has no rows or a value that is no number, or matplotlib is missing.
    """
    require_some(runs, "run")
    for name, rows in runs.items():
        check_curve(name, rows)
    recorded = {name for name, rows in runs.items() if any(row.get(RESETS_KEY) is not None for row in rows)}
    with_resets = any((row.get(RESETS_KEY) or 0.0) > 0.0 for rows in runs.values() for row in rows)
    with styled():
        figure = new_figure(5.6, 6.2 if with_resets else 4.6)
        top, *middle, bottom = panels = figure.subplots(3 if with_resets else 2, 1, sharex=True)
        entries: list[tuple[Artist, str]] = []
        for k, (name, rows) in enumerate(runs.items()):
            line, seeds = _draw_run(panels, name, rows, line_look(k))
            facts = [f"{seeds} seeds"] if seeds > 1 else []
            facts += ["resets –"] if with_resets and name not in recorded else []
            entries.append((line, plain(name) + (f" ({', '.join(facts)})" if facts else "")))
        top.set(ylabel="reward rate per step (–)")
        for axes in middle:
            axes.set(ylabel="resets per 1,000 steps (–)", ylim=(0, None))
        (dot,) = bottom.plot([], [], ".", color="black", **DOTS)
        bottom.set(xlabel="frames (millions)", xlim=(0, None))
        if any("mean_length" in row for rows in runs.values() for row in rows):
            bottom.set(ylabel="best mean return (–)")
        else:
            bottom.set(ylabel="best RealAI score (0 to 1)", ylim=(-0.02, None))
        figure.align_ylabels(panels)
        legend_below(figure, [*entries, (dot, "one evaluation")])
    return figure


def _draw_run(
    panels: Sequence["Axes"], name: str, rows: Sequence[Mapping[str, Any]], looks: Mapping[str, Any]
) -> tuple["Artist", int]:
    """Draw the lines of a run's seeds; returns one of them, and the number of seeds."""
    top, *middle, bottom = panels
    seeds = list(dict.fromkeys(row.get("seed") for row in rows))
    look = {**looks, "alpha": 1.0 if len(seeds) == 1 else 0.6, "label": plain(name)}
    for seed in seeds:
        frames, reward, points, terminations = _columns([row for row in rows if row.get("seed") == seed])
        (line,) = top.plot(frames, reward, **look)
        for axes in middle:
            axes.plot(frames, 1000.0 * terminations, **look)
        bottom.plot(frames, points, ".", color=look["color"], **DOTS)
        bottom.plot(frames, np.fmax.accumulate(points), drawstyle="steps-post", **look)
    return line, len(seeds)


def _draw_interval(axes: "Axes", place: float, value: float, interval: Sequence[float] | None) -> float:
    """Draw an error bar unless the interval is a point or missing; returns its upper end (%)."""
    low, high = interval or (value, value)
    if high > low:
        reach = [[max(0.0, value - low)], [max(0.0, high - value)]]
        for colour, line, cap in (("white", 2.2, 2.8), ("black", 0.8, 2.0)):
            look: dict[str, Any] = {"ecolor": colour, "elinewidth": line, "capthick": line, "capsize": cap}
            axes.errorbar(place, value, reach, fmt="none", **look)
    return max(value, high)


def _overall(result: Mapping[str, Any]) -> str:
    overall, interval = result.get("overall"), result.get("intervals", {}).get("overall")
    if overall is None:
        return ""
    return f", {overall:.3f}" + (f" ({interval[0]:.3f}–{interval[1]:.3f})" if interval else "")


def _columns(rows: Sequence[Mapping[str, Any]]) -> list[np.ndarray]:
    """Frames (millions), rewards, scores and terminations a step; NaN where a row has none."""
    frames = np.array([row["frames"] / 1e6 for row in rows])
    return [frames, *(np.array([row.get(key, np.nan) for row in rows], float) for key in (*CURVE_KEYS, RESETS_KEY))]
