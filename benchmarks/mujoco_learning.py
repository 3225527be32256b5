"""Learning on Gymnasium's MuJoCo tasks beside Stable-Baselines3's PPO: same budget, same machine, same evaluation.

Usage: python benchmarks/mujoco_learning.py [ID ...] [--frames 1000000] [--seeds 3] [--learners areapo sb3-ppo]
[--study FILE] [--plot FILE]

Needs swingup[mujoco], and stable-baselines3 for the peer. The peer has its own defaults, but its 2,048 frames of a
rollout come from 8 environments of 256 steps, as ours do. It has its VecNormalize, since ours normalises
observations as well. Finished runs are lines of the study's file and are not repeated: frames, the mean return of
ten deterministic episodes of the plain environment, seconds. Prints a table in Markdown: the interquartile mean
over the seeds of the last return, with 95 % bootstrap intervals. Then, for each other learner, the probability that
a run of the first learner returns more.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

from study import Study, cell, draw, improvement

from swingup import AREAPO
from swingup.learner.report import TrainingReport

TASKS = ["HalfCheetah-v5", "Hopper-v5", "Swimmer-v5"]
EPISODES = 10
POINTS = 20
"""Evaluations of a run."""
ENVS, STEPS = 8, 256
"""Environments and steps of a rollout, for both learners."""

Point = tuple[int, float, float]
"""Frames, mean return, seconds so far."""


def areapo(task: str, seed: int, frames: int) -> Iterator[Point]:
    """Ours, with the preset for such tasks."""
    points: list[Point] = []
    start = time.perf_counter()

    def note(model: AREAPO, report: TrainingReport) -> None:
        points.append((report.frames, report.rows[0]["score"], time.perf_counter() - start))

    every = frames // POINTS
    model = AREAPO(
        task, "mujoco", seed, evaluate_every=every, checkpoint_every=5 * every, evaluation_episodes=EPISODES,
        num_envs=ENVS, num_steps=STEPS,
    )  # fmt: skip
    model.learn(frames, note)
    model.close()
    yield from points


def sb3_ppo(task: str, seed: int, frames: int) -> Iterator[Point]:
    """Stable-Baselines3's PPO with its defaults, on normalised observations and rewards."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import VecNormalize

    env = VecNormalize(make_vec_env(task, ENVS, seed=seed))
    judge = VecNormalize(make_vec_env(task, 1, seed=seed + 1000), training=False, norm_reward=False)
    judge.obs_rms = env.obs_rms
    model = PPO("MlpPolicy", env, n_steps=STEPS, seed=seed, device="cpu")
    start = time.perf_counter()
    for _ in range(POINTS):
        model.learn(frames // POINTS, reset_num_timesteps=False)
        mean, _ = evaluate_policy(model, judge, EPISODES, deterministic=True)
        yield model.num_timesteps, float(mean), time.perf_counter() - start


LEARNERS = {"areapo": areapo, "sb3-ppo": sb3_ppo}
LABELS = {"areapo": "AR-EAPO (swingup)", "sb3-ppo": "PPO (Stable-Baselines3)"}
"""Labels of the picture's lines, by learner."""


def run(learner: str, task: str, seed: int, frames: int) -> list[Point]:
    """One run's points."""
    points = []
    for count, score, seconds in LEARNERS[learner](task, seed, frames):
        points.append((count, round(score, 2), round(seconds, 1)))
        print(f"{learner} {task} seed {seed}: {count:,} frames, return {score:.1f}, {seconds:.0f} s", flush=True)
    return points


def main() -> None:
    """Train the missing runs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", default=TASKS, metavar="ID")
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--learners", nargs="+", choices=list(LEARNERS), default=list(LEARNERS))
    parser.add_argument("--study", type=Path, default=Path("benchmarks/runs/mujoco.jsonl"))
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    for seed in range(options.seeds):
        for task in options.tasks:
            for learner in options.learners:
                if not Study(options.study).has([task, learner], seed):
                    points = run(learner, task, seed, options.frames)
                    Study(options.study).add([task, learner], seed, points)  # another process may have added to it
    study = Study(options.study)
    print(f"\n| {options.frames:,} frames, {options.seeds} seeds | {' | '.join(options.learners)} |")
    print("|---" * (1 + len(options.learners)) + "|")
    last = {
        learner: [[curve["scores"][-1] for curve in study.of(task, learner)] for task in options.tasks]
        for learner in options.learners
    }
    for k, task in enumerate(options.tasks):
        print(f"| {task} | {' | '.join(cell(scores[k], digits=0) for scores in last.values())} |")
    first, *others = options.learners
    for other in others:
        print(f"\nProbability that {first} improves on {other}: {improvement(last[first], last[other])}")
    if options.plot:
        panels = {task: {LABELS[each]: study.of(task, each) for each in options.learners} for task in options.tasks}
        draw(options.plot, panels, "mean return (sum of rewards)")


if __name__ == "__main__":
    main()
