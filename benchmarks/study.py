"""Shared parts of the learning studies: a file of finished runs, a cell of a table, a picture of the curves."""

import io
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NotRequired, TypedDict

import numpy as np
from scipy.stats import bootstrap, ttest_ind

import swingup
from swingup.benchmark.values import interquartile_interval, interquartile_mean
from swingup.common.files import write_atomically

TAIL = 0.1
"""Share of a curve, at its end, whose median stands for the end."""

THIN: dict[str, Any] = {"alpha": 0.35, "linewidth": 0.6}
"""Look of one seed's line, beside the mean's."""


class Curve(TypedDict):
    """One finished run, a line of the file."""

    run: list[str]
    """Identifies the run, such as task and learner."""
    seed: int
    frames: list[int]
    """Of each evaluation."""
    scores: list[float]
    seconds: list[float]
    """Since the run's start."""
    reward_rates: NotRequired[list[float]]
    """Reward of a step in each evaluation; runs of older versions lack it."""
    resets: NotRequired[list[float]]
    """Terminations per 1,000 steps in each evaluation; runs of older versions lack it."""
    deterministic: NotRequired[float]
    """Reward rate of the last policy without noise, of a continuing task."""
    code: NotRequired[str]
    """The package's commit; runs before 2026-12 lack it."""


COLUMNS = ("frames", "scores", "seconds", "reward_rates", "resets")
"""Of an evaluation, in the order of a point; a study may leave out the last two."""

MISSING = "–"
"""In a table, for what was not recorded."""


def code_version() -> str:
    """The commit of the package that runs, with a + if its files differ from it; or its version outside of git."""
    git = ["git", "-C", str(Path(swingup.__file__).parent)]
    commit = subprocess.run([*git, "rev-parse", "--short=8", "HEAD"], check=False, capture_output=True, text=True)
    if commit.returncode:
        return swingup.__version__
    changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", "."], check=False).returncode
    return commit.stdout.strip() + "+" * bool(changed)


class Study:
    """Finished runs in a file of JSON lines, which are not repeated."""

    def __init__(self, path: Path) -> None:
        """Read the file if it exists."""
        self._path = path
        self.curves: list[Curve] = []
        if path.exists():
            self.curves = [json.loads(line) for line in path.read_text().splitlines()]

    def has(self, run: Sequence[str], seed: int, frames: int) -> bool:
        """Whether such a run is finished; exits if it is finished with another length, which no mean may mix."""
        for curve in self.curves:
            if (curve["run"], curve["seed"]) == (list(run), seed):
                # Whole rollouts.
                if not 0.95 * frames < curve["frames"][-1] < 1.05 * frames:
                    sys.exit(
                        f"{self._path} has {' '.join(run)} seed {seed} of {curve['frames'][-1]:,} frames, not "
                        f"{frames:,}: name another --study"
                    )
                return True
        return False

    def add(
        self,
        run: Sequence[str],
        seed: int,
        points: Sequence[tuple[float, ...]],
        names: Sequence[str] = COLUMNS,
        **figures: float,
    ) -> None:
        """Append a run of points: frames, score, seconds, and where measured reward rate and resets.

        Args:
            run: identifies it.
            seed: its seed.
            points: rows of the columns.
            names: of the columns; a point may leave out the last ones.
            figures: numbers of the whole run.
        """
        columns = dict(zip(names, map(list, zip(*points, strict=True)), strict=False))
        curve = {"run": list(run), "seed": seed, **columns, **figures, "code": code_version()}
        self.curves.append(Curve(**curve))  # type: ignore[typeddict-item]
        self._path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self._path, "".join(json.dumps(each) + "\n" for each in self.curves).encode())

    def of(self, *run: str) -> list[Curve]:
        """The finished runs of a kind, by seed."""
        return sorted((each for each in self.curves if each["run"] == list(run)), key=lambda each: each["seed"])


def ends(curves: Sequence[Curve]) -> list[float]:
    """The median score of the last tenth of each curve."""
    return [median(curve["scores"][-max(1, round(TAIL * len(curve["scores"]))) :]) for curve in curves]


def measured(curves: Sequence[Curve], name: str) -> list[Curve]:
    """Curves with another column in the place of their scores, without those that lack it."""
    return [Curve(**{**curve, "scores": curve[name]}) for curve in curves if name in curve]  # type: ignore[literal-required]


def cell(values: Sequence[float], digits: int = 3) -> str:
    """Interquartile mean and interval, and the number of seeds if there are fewer than three."""
    if not values:
        return "not run"
    if (interval := interquartile_interval(values)) is None:
        return f"{values[0]:.{digits}f} (1 seed only)"
    few = f", {len(values)} seeds only" if len(values) < 3 else ""
    return f"{interquartile_mean(values):.{digits}f} ({interval[0]:.{digits}f} to {interval[1]:.{digits}f}{few})"


def share_of_wins(*tasks: np.ndarray, axis: int = -1) -> Any:
    """Share of pairs of runs in which ours scores higher, a tie as half: the mean over the tasks.

    ``tasks`` are the scores of ours, task by task, then those of theirs. Source: Agarwal et al. (arXiv 2108.13264).
    """
    pairs = zip(tasks[: len(tasks) // 2], tasks[len(tasks) // 2 :], strict=True)
    gaps = [np.asarray(ours)[..., :, None] - np.asarray(theirs)[..., None, :] for ours, theirs in pairs]
    return np.mean([np.mean((np.sign(gap) + 1) / 2, (axis - 1, axis)) for gap in gaps], axis=0)


def improvement(ours: Sequence[Sequence[float]], theirs: Sequence[Sequence[float]]) -> str:
    """Probability of improvement over the tasks that both learners ran, its interval, and the fewest runs.

    Args:
        ours: the runs' scores, task by task.
        theirs: likewise, the same tasks.
    """
    both = [pair for pair in zip(ours, theirs, strict=True) if all(pair)]
    if not both:
        return "not run"
    mine, peers = zip(*both, strict=True)
    tasks = *mine, *peers
    low, high = bootstrap(tasks, share_of_wins, method="percentile", rng=0).confidence_interval
    fewest = [min(map(len, side)) for side in (mine, peers)]
    runs = f"at least {fewest[0]} and {fewest[1]} runs of {len(both)} tasks"
    return f"{share_of_wins(*tasks):.2f} ({low:.2f} to {high:.2f}; {runs})"


def verdict(whole: Sequence[float], without: Sequence[float], relevant: float) -> str:
    """Cells of a claim that something helps: the difference of means with Welch's 95 % interval, and the verdict.

    Args:
        whole: scores of the runs that have it.
        without: scores of the runs that lack it.
        relevant: a difference that matters.
    """
    if min(len(whole), len(without)) < 2:
        return "not run | not enough power"
    found = ttest_ind(whole, without, equal_var=False).confidence_interval()
    low, high = float(found.low), float(found.high)
    if -relevant < low and high < relevant:
        word = "no effect"
    else:
        word = "holds" if low > 0 else "refuted" if high < 0 else "not enough power"
    return f"{np.mean(whole) - np.mean(without):.3f} ({low:.3f} to {high:.3f}) | {word}"


def smooth(curves: Sequence[Curve], evaluations: int) -> list[Curve]:
    """Curves whose scores are the medians of the last few evaluations."""

    def medians(scores: Sequence[float]) -> list[float]:
        return [median(scores[max(0, end - evaluations) : end]) for end in range(1, len(scores) + 1)]

    return [Curve(**{**curve, "scores": medians(curve["scores"])}) for curve in curves]


def draw(
    path: Path,
    panels: Mapping[str, Mapping[str, Sequence[Curve]]],
    ylabel: str | Sequence[str],
    sharey: bool = False,
    columns: int = 3,
) -> None:
    """Draw a panel for each title: for each label a thick line for the mean of the seeds, a thin one for each.

    Args:
        path: the picture's file.
        panels: curves by title and label.
        ylabel: what the scores are, with their unit; of all panels, or of each.
        sharey: whether scores of all panels have one scale.
        columns: most panels side by side.
    """
    from matplotlib.lines import Line2D

    from swingup.report.draw import legend_below, new_figure, render, styled

    labels = [ylabel] * len(panels) if isinstance(ylabel, str) else ylabel
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    with styled():
        figure = new_figure(max(5.6, 2.6 * columns), 0.9 + 2.1 * rows)
        grid = figure.subplots(rows, columns, sharey=sharey, squeeze=False)
        for axes in np.ravel(grid)[len(panels) :]:
            axes.remove()
        entries: dict[str, Any] = {}
        for place, (axes, (title, lines)) in enumerate(zip(np.ravel(grid), panels.items(), strict=False)):
            entries |= _draw_panel(axes, lines)
            axes.set(title=title, xlim=(0, None), xlabel="frames (millions)")
            # Panels with a common scale have its numbers on the left only.
            if not sharey or place % columns == 0:
                axes.set_ylabel(labels[place])
        entries["thick: mean of the seeds"] = Line2D([], [], color="black")
        entries["thin: one seed"] = Line2D([], [], color="black", **THIN)
        legend_below(figure, [(line, label) for label, line in entries.items()])
        picture = render(figure, path.suffix)
    write_atomically(path, _small(picture) if path.suffix == ".png" else picture)


def _draw_panel(axes: Any, lines: Mapping[str, Sequence[Curve]]) -> dict[str, Any]:
    """The curves of one panel; returns the line of each label's mean."""
    from swingup.report.draw import line_look

    entries = {}
    for k, (label, curves) in enumerate(lines.items()):
        for curve in curves:
            axes.plot(np.array(curve["frames"]) / 1e6, curve["scores"], **line_look(k), **THIN)
        if curves:
            # A run that was stopped ends the mean.
            shortest = min(len(curve["scores"]) for curve in curves)
            mean = np.mean([curve["scores"][:shortest] for curve in curves], axis=0)
            (entries[label],) = axes.plot(np.array(curves[0]["frames"][:shortest]) / 1e6, mean, **line_look(k))
    return entries


def _small(png: bytes) -> bytes:
    """The picture with a palette of 48 colours, a quarter of the size: these figures have few colours."""
    from PIL import Image

    file = io.BytesIO()
    image = Image.open(io.BytesIO(png)).convert("RGB")
    image.quantize(48, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return file.getvalue()
