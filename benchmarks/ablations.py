"""Ablations on the acrobot: one change at a time from the default preset, several seeds each.

Usage: python benchmarks/ablations.py [--frames 8000000] [--seeds 3] [--out runs/ablations] [NAME ...]

Each run is a folder that `swingup train` would write; what is there already is not repeated, and what was cut
off resumes. Prints a table in Markdown: the interquartile mean over the seeds of the last tenth's median score and
of the best score, with 95 % bootstrap intervals.
"""

import argparse
import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from statistics import median

from swingup.areapo.config import Config
from swingup.benchmark.interval import bootstrap_interval, interquartile_mean
from swingup.learner.metrics import read_metrics
from swingup.learner.presets import get_preset
from swingup.learner.run import Run
from swingup.learner.settings import PENDULUM_INTERVALS, Settings
from swingup.physics.parameters import ROBOTS
from swingup.tasks.observation import PendulumObservation
from swingup.tasks.pendulum import PendulumTask
from swingup.tasks.presets import smooth_task

Change = Callable[[Config, PendulumTask], tuple[Config, PendulumTask]]


def hyperparameter(**changes: object) -> Change:
    """Change the algorithm."""
    return lambda config, task: (Config(**(vars(config) | changes)), task)


def task_setting(**changes: object) -> Change:
    """Change the task."""
    return lambda config, task: (config, dataclasses.replace(task, **changes))  # type: ignore[arg-type]


CHANGES: dict[str, Change] = {
    "default": hyperparameter(),
    "paper-observation": task_setting(observation=PendulumObservation()),
    "no-offset-repair": hyperparameter(centre_values=False),
    "popart": hyperparameter(centre_values=False, popart=True),
    "temperature-0": hyperparameter(temperature=0.0),
    "temperature-0.5": hyperparameter(temperature=0.5),
    "no-random-truncation": task_setting(truncation_probability=0.0),
}
"""What the paper claims matters, each taken away alone."""


def train(name: str, seed: int, frames: int, out: Path) -> list[float]:
    """One run, or what is left of it; the scores of its evaluations."""
    config, task = CHANGES[name](get_preset("default").config, smooth_task(ROBOTS["acrobot"]))
    folder = out / name / f"seed-{seed}"
    if (folder / "config.json").exists():
        run = Run.resume(folder, env=task)
    else:
        every = PENDULUM_INTERVALS["evaluate_every"], PENDULUM_INTERVALS["checkpoint_every"]
        settings = Settings("acrobot", "default", seed, 1, *every, config)
        run = Run(settings, folder, frames, task)
    for report in run.advance():
        print(f"{name} seed {seed}: {report.frames:,} frames, best score {report.best_score:.3f}", flush=True)
    return [row["score"] for row in read_metrics(folder / "metrics.jsonl")]


def cell(values: list[float]) -> str:
    """Interquartile mean and interval."""
    low, high = bootstrap_interval(values)
    return f"{interquartile_mean(values):.3f} ({low:.3f} to {high:.3f})"


def main() -> None:
    """Train what was asked for and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(CHANGES), metavar="NAME", help=", ".join(CHANGES))
    parser.add_argument("--frames", type=int, default=8_000_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("runs/ablations"))
    options = parser.parse_args()
    results = {
        name: [train(name, seed, options.frames, options.out) for seed in range(options.seeds)]
        for name in options.names
    }
    (options.out / "ablations.json").write_text(json.dumps(results))
    print(f"\n| change ({options.seeds} seeds, {options.frames:,} frames) | last tenth | best |\n|---|---|---|")
    for name, curves in results.items():
        last = [median(scores[-max(1, len(scores) // 10) :]) for scores in curves]
        print(f"| {name} | {cell(last)} | {cell([max(scores) for scores in curves])} |")


if __name__ == "__main__":
    main()
