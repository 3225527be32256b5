"""The continuing MuJoCo tasks: reward rates while training, beside published ones of PPO.

Usage: python benchmarks/continuing.py [TASK ...] [--frames 1000000] [--seeds 1] [--first-seed 2] [--study FILE]
[--reset-cost 10] [--stream] [--claims] [--plot FILE]

TASK is a name of `swingup.continuing.CONTINUING`, such as Ant; default: all ten. Needs swingup[mujoco].

Finished runs are lines of the study's file and are not repeated: the reward rate of each 10,000 steps while
training, with the exploring policy and the costs of resets, seconds and resets per 1,000 steps; of the last policy
the deterministic rate over 10,000 steps. `--seeds 0` trains nothing and shows what is finished.

Prints a table in Markdown. "Ours" is the mean rate over all steps, as in the table of reward centring in arXiv
2501.06937, which has the figures of PPO; the share of the way has Student's 95 % interval over the seeds.

`--stream` trains on one environment that is never reset (`AREAPO(..., resets="never")`) instead of on eight, and
also prints each run's share of the way, and the mean share of the runs with eight streams.

With another cost of a reset the published figures do not compare. `--claims` also trains every change of `CHANGES`
with the same seeds, and prints a verdict on each claim: how much of the way from random actions to centred PPO a
run loses with the change. `--plot` draws these tasks with average reward and discounted, beside the acrobot of
`ablations.py`.
"""

import argparse
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from scipy.stats import ttest_1samp
from study import Curve, Study, draw, smooth, verdict

from swingup import AREAPO
from swingup.continuing import CONTINUING
from swingup.learner.presets import CONTINUING_PRESET
from swingup.learner.progress import TrainingReport

COLUMNS = ("frames", "scores", "seconds", "resets")
"""Of a report, in the order of a point."""
EVERY = 10_000
"""Steps of a reported rate."""
DETERMINISTIC_STREAMS = 5
"""Streams of 2,000 steps each for the deterministic rate."""

PUBLISHED = {
    "Swimmer": (0.0006, 0.082, 0.104), "HumanoidStandup": (35.7, 62.7, 71.1), "Reacher": (-0.840, -0.168, -0.163),
    "Pusher": (-1.596, -0.503, -0.468), "SpecialAnt": (-0.537, 0.56, 0.67), "HalfCheetah": (-0.30, 2.28, 2.72),
    "Ant": (-0.45, 1.38, 1.41), "Hopper": (0.38, 3.29, 3.40), "Humanoid": (4.61, 6.11, 6.30),
    "Walker2d": (-0.34, 3.03, 3.35),
}  # fmt: skip
"""Random actions; PPO; PPO with TD reward centring: means over the first million steps."""


class Change(NamedTuple):
    """What a run lacks or has instead, to test a claim."""

    claim: str
    hyperparameters: Mapping[str, Any]
    env: Mapping[str, Any] = {}
    """Arguments of the environment. Rates are less its offset."""


CHANGES = {
    "temperature-0": Change("entropy decides", {"temperature": 0.0}),
    "discounted": Change(
        "average reward decides", {"gain": "none", "discount": (0.99, 0.99), "centre_values": False}
    ),
    "offset-1000": Change("a constant of 1,000 in the rewards matters", {}, {"reward_offset": 1000.0}),
}
FAILED = 0.6
"""A seed fails if its last 100,000 steps are less than this share of the median seed's way from random actions."""
RELEVANT = 0.1
"""A difference that matters, of the way from random actions to centred PPO."""


def train(task: str, seed: int, frames: int, change: Change, stream: bool) -> tuple[list[tuple[float, ...]], float]:
    """A run's points, and the deterministic rate of its last policy."""
    points: list[tuple[float, ...]] = []
    offset = change.env.get("reward_offset", 0.0)
    start = time.perf_counter()

    def note(_: AREAPO, report: TrainingReport) -> None:
        row = report.best
        seconds, resets = time.perf_counter() - start, row.resets_per_1000_steps
        points.append((report.frames, round(row.reward - offset, 4), round(seconds, 1), round(resets, 2)))
        if report.frames % (10 * EVERY) == 0:
            rate = np.mean([point[1] for point in points[-10:]])
            print(
                f"{task} seed {seed}: {report.frames:,} frames, reward rate {rate:.3f}, {seconds:.0f} s", flush=True
            )

    # A checkpoint would reset eight environments, and evaluations while training are not needed.
    model = AREAPO(
        lambda: gymnasium.make(f"swingup/Continuing{task}-v0", **change.env),
        CONTINUING_PRESET,  # which the id would have by itself
        seed,
        evaluate_every=EVERY,
        checkpoint_every=frames,
        evaluation_episodes=0,
        resets="never" if stream else None,
        **change.hyperparameters,
    )
    model.learn(frames, note)
    judged = gymnasium.make_vec(
        f"swingup/Continuing{task}-v0", DETERMINISTIC_STREAMS, vectorization_mode="sync", **change.env
    )
    deterministic = model.evaluate(env=judged)["reward_rate"] - offset
    judged.close()
    model.close()
    return points, deterministic


def shares(task: str, curves: Sequence[Curve]) -> list[float]:
    """Mean rate of each run, of the way from random actions (0) to centred PPO (1)."""
    random, _, centred = PUBLISHED[task]
    return [(float(np.mean(curve["scores"])) - random) / (centred - random) for curve in curves]


def row_of(task: str, curves: Sequence[Curve]) -> str:
    """A line of the table."""
    random, ppo, centred = PUBLISHED[task]
    if not curves:
        return f"| {task} | {random} | {ppo} | {centred} | not run | | | | | |"
    means = [float(np.mean(curve["scores"])) for curve in curves]
    last = [float(np.mean(curve["scores"][-10:])) for curve in curves]
    failed = sum(each - random < FAILED * (np.median(last) - random) for each in last)
    found = 100 * np.array(shares(task, curves))
    share = f"{np.mean(found):.0f} %"
    if len(found) > 1:
        share += " ({:.0f} to {:.0f})".format(*ttest_1samp(found, 0.0).confidence_interval())
    numbers = [
        f"**{np.mean(means):.3f}**" if np.mean(found) > 100 else f"{np.mean(means):.3f}", share,
        f"{np.mean(last):.3f}", f"{np.mean([curve['deterministic'] for curve in curves]):.3f}",
        f"{np.mean([np.mean(curve['resets'][-10:]) for curve in curves]):.2f}",
        f"{failed} of {len(curves)}",
    ]  # fmt: skip
    return f"| {task} | {random} | {ppo} | {centred} | {' | '.join(numbers)} |"


def main() -> None:
    """Train the missing runs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", default=list(CONTINUING), metavar="TASK")
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=1)
    # Seeds 0 and 1 were seen while settings were chosen.
    parser.add_argument("--first-seed", type=int, default=2, help="seeds are this one and those that follow")
    parser.add_argument("--study", type=Path, default=Path("benchmarks/runs/continuing.jsonl"))
    parser.add_argument("--reset-cost", type=float, default=10.0)
    parser.add_argument("--stream", action="store_true")
    parser.add_argument("--claims", action="store_true")
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    usual = options.reset_cost == 10.0
    cost = {} if usual else {"reset_cost": options.reset_cost}
    base = [] if usual else [f"cost {options.reset_cost:g}"]
    base += ["stream"] if options.stream else []
    changes = CHANGES if options.claims else {}
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for task in options.tasks:
            for name, change in {"": Change("", {}), **changes}.items():
                run = [task, *base, *([name] if name else [])]
                if not Study(options.study).has(run, seed, options.frames):
                    change = change._replace(env={**cost, **change.env})
                    points, deterministic = train(task, seed, options.frames, change, options.stream)
                    Study(options.study).add(run, seed, points, COLUMNS, deterministic=round(deterministic, 4))
    study = Study(options.study)
    heads = [
        "task",
        "random",
        "PPO",
        "PPO, centred",
        "ours",
        "of the way from random",
        "last 100,000",
        "deterministic",
    ]
    print(f"\n| {' | '.join([*heads, 'resets', 'seeds that fail'])} |")
    print("|---" + "|---:" * (len(heads) + 1) + "|")
    for task in options.tasks:
        print(row_of(task, study.of(task, *base)))
    if options.stream:
        print("\n| task, % of the way from random | each stream | eight streams, mean |\n|---|---:|---:|")
        for task in options.tasks:
            streams, eight = (shares(task, study.of(task, *kind)) for kind in (base, base[:-1]))
            each = ", ".join(f"{100 * share:.0f}" for share in streams)
            print(f"| {task} | {each} | {100 * np.mean(eight) if eight else np.nan:.0f} |")
    for name, change in changes.items():
        print(f"\n| {change.claim} (less `{name}`) | difference (95 %) | verdict |\n|---|---|---|")
        for task in options.tasks:
            with_it, without = shares(task, study.of(task, *base)), shares(task, study.of(task, *base, name))
            print(f"| {task} | {verdict(with_it, without, RELEVANT)} |")
    if options.plot:
        acrobot = Study(options.study.with_name("ablations.jsonl"))
        runs = {"swing-up of the acrobot": (acrobot.of("default"), acrobot.of("discounted"))}
        runs |= {task: (study.of(task, *base), study.of(task, *base, "discounted")) for task in options.tasks}
        names = "average reward", "discounted (γ = 0.99)"
        panels = {
            title: {name: smooth(of, 9) for name, of in zip(names, both, strict=True)}
            for title, both in runs.items()
        }
        draw(options.plot, panels, ["RealAI score", *["reward rate while training"] * len(options.tasks)])


if __name__ == "__main__":
    main()
