"""Ablations on the acrobot: one change at a time from the default preset with even steps, several seeds each.

Usage: python benchmarks/ablations.py [NAME ...] [--frames 8000000] [--seeds 3] [--study FILE] [--runs FOLDER]
[--plot FILE]

Finished runs are lines of the study's file and are not repeated. Each run has a folder as `swingup train` writes
it, from which an interrupted run resumes. Prints a table in Markdown: the interquartile mean over the seeds of
the last tenth's median score and of the best score, with 95 % bootstrap intervals, and the smallest and largest
share of scores of 0 in the second half of a run. Then a verdict on each claim of the paper: how much a run loses
without the ingredient, in the median of its last tenth, and what that says.
"""

import argparse
import dataclasses
from collections.abc import Callable
from pathlib import Path

from study import Curve, Study, cell, draw, ends, smooth, verdict

from swingup.areapo.config import Config
from swingup.learner.metrics import read_metrics
from swingup.learner.presets import get_preset
from swingup.learner.run import resume_run, start_run
from swingup.learner.run_settings import make_run_settings
from swingup.plant.plant import ROBOTS
from swingup.tasks.pendulum import AbstractPendulumTask
from swingup.tasks.presets import smooth_task
from swingup.tasks.task import PendulumStage

Change = Callable[[Config, AbstractPendulumTask], tuple[Config, AbstractPendulumTask]]


def hyperparameter(**changes: object) -> Change:
    """Change the algorithm."""
    return lambda config, task: (Config(**(vars(config) | changes)), task)


def task_setting(**changes: object) -> Change:
    """Change the task."""
    return lambda config, task: (config, dataclasses.replace(task, **changes))  # type: ignore[arg-type]


CHANGES: dict[str, Change] = {
    "default": hyperparameter(),
    "paper-observation": task_setting(observation=PendulumStage()),
    "no-offset-repair": hyperparameter(centre_values=False),
    "temperature-0": hyperparameter(temperature=0.0),
    "temperature-0.5": hyperparameter(temperature=0.5),
    "no-random-truncation": task_setting(truncation_probability=0.0),
    "discounted": hyperparameter(gain="none", discount=(0.99, 0.99), centre_values=False),
}
"""The paper's ingredients, each removed alone."""

CLAIMS = {
    "entropy decides": "temperature-0",
    "average reward decides": "discounted",
    "random truncation decorrelates": "no-random-truncation",
}
"""What the paper says of its method, and the change that takes the ingredient away."""

RELEVANT = 0.05
"""A difference of scores that matters."""

TITLES = {
    "paper-observation": "angles as in the paper",
    "no-offset-repair": "values' mean not removed",
    "temperature-0": "no entropy reward (τ = 0)",
    "temperature-0.5": "less entropy reward (τ = 0.5, not 2)",
    "no-random-truncation": "episodes not cut at random",
    "discounted": "discounted rewards (γ = 0.99)",
}
"""Titles of the picture's panels, by change."""

SMOOTHED = 9
"""Evaluations whose median is a point of the picture: 0.6 million frames. A policy that falls scores 0."""


def train(name: str, seed: int, frames: int, folder: Path) -> list[tuple[int, float, float]]:
    """Train one run, or the rest of it; frames, score and seconds of its evaluations."""
    preset = get_preset("pendulum").config
    base = dataclasses.replace(preset, schedule="constant")
    config, task = CHANGES[name](base, smooth_task(ROBOTS["acrobot"]))
    changes = {name: value for name, value in vars(config).items() if value != getattr(preset, name)}
    if (folder / "config.json").exists():
        run = resume_run(folder, env=task)
    else:
        settings = make_run_settings("acrobot", "pendulum", changes, seed=seed)
        run = start_run(dataclasses.replace(settings, problem=settings.problem.on(task)), folder, frames)
    for report in run.advance():
        print(f"{name} seed {seed}: {report.frames:,} frames, best score {report.best_score:.3f}", flush=True)
    return [
        (row["frames"], round(row["score"], 4), row["seconds"]) for row in read_metrics(folder / "metrics.jsonl")
    ]


def failed_share(curve: Curve) -> float:
    """Share of the evaluations in the second half of a run whose policy does not swing up and stay."""
    scores = curve["scores"]
    return sum(score == 0.0 for score in scores[len(scores) // 2 :]) / len(scores[len(scores) // 2 :])


def main() -> None:
    """Train the missing runs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(CHANGES), metavar="NAME", help=", ".join(CHANGES))
    parser.add_argument("--frames", type=int, default=8_000_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--study", type=Path, default=Path("benchmarks/runs/ablations.jsonl"))
    parser.add_argument("--runs", type=Path, default=Path("runs/ablations"))
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    for seed in range(options.seeds):
        for name in options.names:
            if not Study(options.study).has([name], seed, options.frames):
                points = train(name, seed, options.frames, options.runs / name / f"seed-{seed}")
                Study(options.study).add([name], seed, points)  # read again: another process may have added rows
    study = Study(options.study)
    print(f"\n| change ({options.seeds} seeds, {options.frames:,} frames) | last tenth | best | failures |")
    print("|---|---|---|---|")
    for name in filter(study.of, options.names):
        curves = study.of(name)
        best, failures = [max(curve["scores"]) for curve in curves], sorted(map(failed_share, curves))
        print(f"| {name} | {cell(ends(curves))} | {cell(best)} | {failures[0]:.0%} to {failures[-1]:.0%} |")
    print("\n| claim | difference (95 %) | verdict |\n|---|---|---|")
    for claim, change in CLAIMS.items():
        print(f"| {claim} | {verdict(ends(study.of('default')), ends(study.of(change)), RELEVANT)} |")
    if options.plot:
        smoothed = {name: smooth(study.of(name), SMOOTHED) for name in CHANGES}
        changes = [name for name in options.names if name != "default" and smoothed[name]]
        panels = {
            TITLES[name]: {"default preset": smoothed["default"], "with the change": smoothed[name]}
            for name in changes
        }
        draw(options.plot, panels, "RealAI score (0 to 1)", sharey=True)


if __name__ == "__main__":
    main()
