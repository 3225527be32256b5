"""The recorded runs of the preset `paper`: scores, times to scores, and what choosing a checkpoint brings.

Usage: python benchmarks/paper_runs.py [FILE ...] [--plot FILE]

Each FILE is the metrics.jsonl of `swingup train ROBOT --preset paper`, under a name that starts with the robot;
the default is all runs in benchmarks/runs. Prints two tables in Markdown. The first has a row for each seed: its
best score, its end (the median score of the last tenth of its evaluations), its last score, and the frames and
seconds until an evaluation first reached a level. The second compares, for each robot, the authors' selection (the
best checkpoint of all runs) with none (the median over the seeds of their ends). Seconds are time in training, over
all sittings of a run.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

from study import Curve, draw, ends, smooth

from swingup.benchmark.leaderboard import published_rows
from swingup.common.errors import SwingupError
from swingup.learner.metrics import read_metrics
from swingup.learner.presets import get_preset
from swingup.plant.plant import ROBOTS

FRAMES = get_preset("paper").frames
"""Of a complete run."""

LEVELS = (0.5, 0.55, 0.6)
"""Scores whose first evaluation is reported, beside the paper's."""

SMOOTHED = 9
"""Evaluations whose median is a point of the picture: 0.6 million frames. A policy that falls scores 0."""


def read_runs(path: Path) -> list[Curve]:
    """The evaluations of a run, a curve for each of its seeds.

    Raises:
        SwingupError: the file cannot be read, its name has no robot, or it has no evaluation.
    """
    robot = path.name.split("-")[0]
    if robot not in ROBOTS:
        raise SwingupError(f"{path}: start the file's name with its robot, {' or '.join(ROBOTS)}")
    rows = [row for row in read_metrics(path) if row.get("score") is not None]
    if not rows:
        raise SwingupError(f"{path} has no evaluation: give the metrics.jsonl of a run that was evaluated")
    curves = []
    for seed in sorted({row["seed"] for row in rows}):
        frames, scores, seconds = (
            [row[name] for row in rows if row["seed"] == seed] for name in ("frames", "score", "seconds")
        )
        curves.append(Curve(run=[robot], seed=seed, frames=frames, scores=scores, seconds=seconds))
    return curves


def papers_score(robot: str) -> float:
    """AR-EAPO's published score."""
    rows = published_rows(ROBOTS[robot], "performance")
    (row,) = (row for row in rows if (row.controller, row.source) == ("AR-EAPO", "paper"))
    score = row.values["score"]
    assert score is not None  # every published row has a score
    return score


def complete(curve: Curve) -> bool:
    """Whether a run has the preset's frames."""
    return curve["frames"][-1] >= FRAMES


def reached(curve: Curve, level: float) -> str:
    """Frames and time until an evaluation first scored this level."""
    for frames, score, seconds in zip(curve["frames"], curve["scores"], curve["seconds"], strict=True):
        if score >= level:
            return f"{frames / 1e6:.1f} M ({seconds:,.0f} s)"
    return "not reached"


def constant(score: float) -> Curve:
    """A level of the picture."""
    return Curve(run=["constant"], seed=0, frames=[0, FRAMES], scores=[score, score], seconds=[0.0, 0.0])


def seed_row(curve: Curve) -> str:
    """A seed's row of the first table."""
    best = max(curve["scores"])
    at = curve["frames"][curve["scores"].index(best)]
    short = "" if complete(curve) else f" of {FRAMES / 1e6:.0f} M, incomplete"
    cells = [
        f"{curve['run'][0]}, seed {curve['seed']}",
        f"{curve['frames'][-1] / 1e6:.1f} M{short}",
        f"{best:.3f} ({at / 1e6:.1f} M)",
        f"{ends([curve])[0]:.3f}",
        f"{curve['scores'][-1]:.3f}",
        *(reached(curve, level) for level in (*LEVELS, papers_score(curve["run"][0]))),
    ]
    return f"| {' | '.join(cells)} |"


def robot_row(robot: str, curves: Sequence[Curve]) -> str:
    """A robot's row of the second table."""
    missing = sum(not complete(curve) for curve in curves)
    cells = [
        robot,
        f"{len(curves)}" + (f" ({missing} incomplete)" if missing else ""),
        f"{max(max(curve['scores']) for curve in curves):.3f}",
        f"{median(ends(curves)):.3f}",
        f"{papers_score(robot):.3f}",
    ]
    return f"| {' | '.join(cells)} |"


def tables(runs: Mapping[str, Sequence[Curve]]) -> str:
    """Both tables in Markdown, for the curves of each robot."""
    levels = " | ".join(f"first {level}" for level in LEVELS)
    seeds = [seed_row(curve) for curves in runs.values() for curve in curves]
    robots = [robot_row(robot, curves) for robot, curves in runs.items()]
    return "\n".join([
        f"| run | frames | best (at) | end | last | {levels} | the paper's score |",
        "|---" * (6 + len(LEVELS)) + "|",
        *seeds,
        "",
        "| robot | seeds | best checkpoint of all runs | end, median of the seeds | paper |",
        "|---" * 5 + "|",
        *robots,
    ])  # fmt: skip


def main() -> None:
    """Print the tables and draw the curves."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    stored = sorted((Path(__file__).parent / "runs").glob("*-paper-*.jsonl"))
    parser.add_argument("files", nargs="*", type=Path, default=stored, metavar="FILE")
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    curves = [curve for path in options.files for curve in read_runs(path)]
    runs = {robot: [curve for curve in curves if curve["run"] == [robot]] for robot in ROBOTS}
    runs = {robot: found for robot, found in runs.items() if found}
    print(tables(runs))
    if options.plot:
        panels = {
            robot: {"preset paper": smooth(found, SMOOTHED), "the paper's score": [constant(papers_score(robot))]}
            for robot, found in runs.items()
        }
        draw(options.plot, panels, "RealAI score (0 to 1)", sharey=True)


if __name__ == "__main__":
    main()
