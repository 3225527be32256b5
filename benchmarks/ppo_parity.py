"""Our preset ppo beside Stable-Baselines3's PPO with the same hyperparameters, on two cheap tasks.

Usage: python benchmarks/ppo_parity.py [--frames 122880] [--seeds 10] [--study FILE]

Needs swingup[mujoco] and stable-baselines3. Both have the peer's defaults with 8 environments of 256 steps,
normalised observations and plain rewards. Finished runs are lines of the study's file and are not repeated.

Prints, for each task, the mean returns of the last of 20 evaluations and of all of them: the interquartile means
over the seeds, and the ratio of ours to the peer's, with a 95 % bootstrap interval.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from mujoco_learning import ENVS, STEPS, Point, trained_areapo, trained_sb3
from numpy.typing import ArrayLike
from scipy.stats import bootstrap
from study import Study, cell

from swingup.benchmark.values import interquartile_mean


def ours(task: str, seed: int, frames: int) -> Iterator[Point]:
    """Our preset, in rollouts of the peer's form."""
    yield from trained_areapo(task, seed, frames, "ppo", num_envs=ENVS, num_steps=STEPS, normalise_rewards=False)


def peers(task: str, seed: int, frames: int) -> Iterator[Point]:
    """The peer's defaults."""
    yield from trained_sb3(task, seed, frames, ENVS, {"n_steps": STEPS}, scale_rewards=False)


LEARNERS: dict[str, Callable[[str, int, int], Iterator[Point]]] = {"swingup-ppo": ours, "sb3-ppo": peers}
TASKS = ("CartPole-v1", "InvertedDoublePendulum-v5")
RETURNS = {"last evaluation": lambda scores: scores[-1], "all evaluations": fmean}
"""What stands for a run, of the returns of its evaluations."""


def ratio(mine: Sequence[float], theirs: Sequence[float]) -> str:
    """The ratio of the interquartile means and its interval."""

    def ratio_of_means(first: ArrayLike, second: ArrayLike, axis: int | None = None) -> Any:
        return interquartile_mean(first, axis) / interquartile_mean(second, axis)

    low, high = bootstrap((mine, theirs), ratio_of_means, method="percentile", rng=0).confidence_interval
    return f"{ratio_of_means(mine, theirs):.2f} ({low:.2f} to {high:.2f})"


def main() -> None:
    """Train the missing runs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=122_880)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--study", type=Path, default=Path("benchmarks/runs/ppo-parity.jsonl"))
    options = parser.parse_args()
    for seed in range(options.seeds):
        for task in TASKS:
            for name in LEARNERS:
                if not Study(options.study).has([task, name], seed, options.frames):
                    points = list(LEARNERS[name](task, seed, options.frames))
                    Study(options.study).add([task, name], seed, points)
                    print(
                        f"{name} {task} seed {seed}: return {points[-1][1]:.1f}, {points[-1][2]:.0f} s", flush=True
                    )
    study = Study(options.study)
    print(f"\n| {options.frames:,} frames, {options.seeds} seeds | swingup-ppo | peer | ratio |\n|---|---|---|---|")
    for task in TASKS:
        for what, summary in RETURNS.items():
            mine, theirs = ([summary(curve["scores"]) for curve in study.of(task, name)] for name in LEARNERS)
            print(f"| {task}, {what} | {cell(mine, 0)} | {cell(theirs, 0)} | {ratio(mine, theirs)} |")


if __name__ == "__main__":
    main()
