"""Learning on Gymnasium's MuJoCo tasks beside Stable-Baselines3's PPO: same budget, same machine, same evaluation.

Usage: python benchmarks/mujoco_learning.py [ID ...] [--frames 1000000] [--seeds 3] [--first-seed 0]
[--learners areapo sb3-ppo sb3-zoo] [--study FILE] [--plot FILE]

Needs swingup[mujoco], and stable-baselines3 for the peers. sb3-ppo has the peer's own defaults, but its 2,048
frames of a rollout come from 8 environments of 256 steps. sb3-zoo has RL Baselines3 Zoo's settings
(`peer_settings.py`). Both have VecNormalize, since ours normalises observations as well.

Finished runs are lines of the study's file and are not repeated: frames, seconds, and of ten deterministic episodes
of the plain environment the mean return, the reward rate and the resets per 1,000 steps. A reset is a termination
of the task, such as a fall; the time limit is none. `--seeds 0` trains nothing and shows what is finished.

Prints a table in Markdown: for each task the interquartile mean over the seeds of the last of these, with 95 %
bootstrap intervals, and a dash where runs of an older version did not record it. Then, for each other learner, the
probability that a run of the first learner returns more.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from peer_settings import WIDE, ZOO
from study import MISSING, Study, cell, draw, improvement, measured

from swingup import AREAPO
from swingup.learner.progress import TrainingReport

TASKS = ["HalfCheetah-v5", "Hopper-v5", "Swimmer-v5"]
EPISODES = 10
POINTS = 20
"""Evaluations of a run; ours may have one more, at its end."""
ENVS, STEPS = 8, 256
"""Environments and steps of a rollout, for the peer with its defaults."""

Point = tuple[int, float, float, float, float]
"""Frames, mean return, seconds so far, reward of a step, resets per 1,000 steps."""

MEASURES = {
    "scores": ("mean return (sum of rewards)", 0),
    "reward_rates": ("reward rate (per step)", 3),
    "resets": ("resets per 1,000 steps", 2),
}
"""What the table and the picture show of a run, by column of the study: its label, and digits in the table."""


def areapo(task: str, seed: int, frames: int) -> Iterator[Point]:
    """Ours, with the preset for such tasks."""
    yield from trained_areapo(task, seed, frames, "continuing")


def trained_areapo(task: str, seed: int, frames: int, preset: str, **settings: Any) -> Iterator[Point]:
    """Ours, with some preset and settings."""
    points: list[Point] = []
    start = time.perf_counter()

    def note(model: AREAPO, report: TrainingReport) -> None:
        row, seconds = report.best.as_dict(), time.perf_counter() - start
        points.append((report.frames, row["score"], seconds, row["reward_rate"], row["resets_per_1000_steps"]))

    every = frames // POINTS
    model = AREAPO(
        task, preset, seed, evaluate_every=every, checkpoint_every=frames, evaluation_episodes=EPISODES,
        **settings,
    )  # fmt: skip
    model.learn(frames, note)
    model.close()
    yield from points


def sb3_ppo(task: str, seed: int, frames: int) -> Iterator[Point]:
    """Stable-Baselines3's PPO with its defaults, on normalised observations and rewards."""
    yield from trained_sb3(task, seed, frames, ENVS, {"n_steps": STEPS})


def sb3_zoo(task: str, seed: int, frames: int) -> Iterator[Point]:
    """The same with RL Baselines3 Zoo's settings for the task."""
    from torch.nn import ReLU

    name = task.partition("-")[0]
    wide = {"log_std_init": -2.0, "ortho_init": False, "activation_fn": ReLU, "net_arch": [256, 256]}
    yield from trained_sb3(task, seed, frames, 1, {"policy_kwargs": wide if name in WIDE else {}} | ZOO[name])


def trained_sb3(
    task: str, seed: int, frames: int, envs: int, settings: Mapping[str, Any], scale_rewards: bool = True,
) -> Iterator[Point]:  # fmt: skip
    """Stable-Baselines3's PPO with some settings, on normalised observations and, unless told, rewards."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import VecNormalize

    env = make_vec_env(task, envs, seed=seed)
    env = VecNormalize(env, norm_reward=scale_rewards, gamma=settings.get("gamma", 0.99))
    judge = make_vec_env(task, 1, seed=seed + 1000)
    judge = VecNormalize(judge, training=False, norm_reward=False)
    judge.obs_rms = env.obs_rms
    model = PPO("MlpPolicy", env, **settings, seed=seed, device="cpu")
    start = time.perf_counter()
    for point in range(1, POINTS + 1):
        # A call rounds up to whole rollouts: it gets what is left, so that the total is rounded once.
        model.learn(max(1, point * frames // POINTS - model.num_timesteps), reset_num_timesteps=False)
        falls: list[bool] = []
        returns, lengths = evaluate_policy(
            model, judge, EPISODES, deterministic=True, return_episode_rewards=True, callback=watching(falls)
        )
        steps = sum(lengths)
        seconds = time.perf_counter() - start
        yield model.num_timesteps, sum(returns) / EPISODES, seconds, sum(returns) / steps, 1000 * sum(falls) / steps


def watching(falls: list[bool]) -> Callable[[dict[str, Any], dict[str, Any]], None]:
    """A callback of the peer's evaluation, which notes of each episode whether the task ended it, not a limit."""

    def note(local: dict[str, Any], _: dict[str, Any]) -> None:
        if local["done"]:
            falls.append(not local["info"].get("TimeLimit.truncated", False))

    return note


LEARNERS = {"areapo": areapo, "sb3-ppo": sb3_ppo, "sb3-zoo": sb3_zoo}
USUAL = ("areapo", "sb3-ppo")
LABELS = {"areapo": "AR-EAPO (swingup)", "sb3-ppo": "PPO (Stable-Baselines3)", "sb3-zoo": "PPO (RL Baselines3 Zoo)"}
"""Labels of the picture's lines, by learner."""


def run(learner: str, task: str, seed: int, frames: int) -> list[Point]:
    """One run's points."""
    points = []
    for count, score, seconds, rate, resets in LEARNERS[learner](task, seed, frames):
        points.append((count, round(score, 2), round(seconds, 1), round(rate, 4), round(resets, 3)))
        print(
            f"{learner} {task} seed {seed}: {count:,} frames, return {score:.1f}, reward rate {rate:.3f}, "
            f"resets per 1,000 steps {resets:.2f}, {seconds:.0f} s",
            flush=True,
        )
    return points


def rows_of(study: Study, task: str, learners: Sequence[str]) -> Iterator[str]:
    """The table's lines of one task: returns, then the other measures."""
    for name, (label, digits) in MEASURES.items():
        last = [[curve["scores"][-1] for curve in measured(study.of(task, each), name)] for each in learners]
        title = task if name == "scores" else f"{task}, {label}"
        cells = [
            cell(values, digits) if values or not study.of(task, each) else MISSING
            for each, values in zip(learners, last, strict=True)
        ]
        yield f"| {title} | {' | '.join(cells)} |"


def plot(path: Path, study: Study, tasks: Sequence[str], learners: Sequence[str]) -> None:
    """Draw the returns of all tasks, then their other measures where a run recorded one that is not 0."""
    panels, labels = {}, []
    for name, (label, _) in MEASURES.items():
        for task in tasks:
            lines = {LABELS[each]: measured(study.of(task, each), name) for each in learners}
            if name == "scores" or any(any(curve["scores"]) for curves in lines.values() for curve in curves):
                # Short: a panel is narrow, and its axis has the whole label.
                panels[task if name == "scores" else f"{task}: {name.replace('_', ' ')}"] = lines
                labels.append(label)
    draw(path, panels, labels, columns=min(3, len(tasks)))


def main() -> None:
    """Train the missing runs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", default=TASKS, metavar="ID")
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0, help="seeds are this one and those that follow")
    parser.add_argument("--learners", nargs="+", choices=list(LEARNERS), default=USUAL)
    parser.add_argument("--study", type=Path, default=Path("benchmarks/runs/mujoco.jsonl"))
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for task in options.tasks:
            for learner in options.learners:
                if not Study(options.study).has([task, learner], seed, options.frames):
                    points = run(learner, task, seed, options.frames)
                    Study(options.study).add([task, learner], seed, points)  # another process may have added to it
    study = Study(options.study)  # the table has all finished runs
    print(f"\n| {options.frames:,} frames | {' | '.join(options.learners)} |")
    print("|---" * (1 + len(options.learners)) + "|")
    last = {
        learner: [[curve["scores"][-1] for curve in study.of(task, learner)] for task in options.tasks]
        for learner in options.learners
    }
    for task in options.tasks:
        print("\n".join(rows_of(study, task, options.learners)))
    first, *others = options.learners
    for other in others:
        print(f"\nProbability that {first} improves on {other}: {improvement(last[first], last[other])}")
    if options.plot:
        plot(options.plot, study, options.tasks, options.learners)


if __name__ == "__main__":
    main()
