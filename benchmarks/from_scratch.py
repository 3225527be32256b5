"""From random weights to the scores of the shipped policies, seed by seed: train, refine, judge.

Usage: python benchmarks/from_scratch.py ROBOT FOLDER [FRAMES [SEEDS]]. The defaults are 6,000,000 frames and 5
seeds. Each stage is a command of swingup, timed as a whole with its compilation: leave the machine idle for the
times. FOLDER receives the runs and results.jsonl, a line for each seed. Seeds in that file are not repeated.
"""

import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import swingup
from swingup.benchmark.interval import mean_interval

NOISE_SEEDS = 3
"""Number of seeds of the noise and pushes, and of the throws, for every policy: 0, 1, 2."""

PUBLISHED = {"acrobot": 0.633, "pendubot": 0.659}
"""AR-EAPO's performance scores in the paper."""


def command(*words: str | int | Path) -> float:
    """Run a command of swingup; returns its time (s)."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "swingup", *map(str, words)], check=True)
    return round(time.perf_counter() - start, 1)


def one_seed(robot: str, folder: Path, frames: int, seed: int) -> dict[str, Any]:
    """Train, refine and judge one seed; returns its row."""
    run, file = folder / f"{robot}-{seed}", folder / f"{robot}-{seed}.npz"
    new = (robot, "--preset", "global", "--seed", seed, "--out", run, "--frames", frames)
    row: dict[str, Any] = {"robot": robot, "seed": seed, "frames": frames}
    row["train_seconds"] = command("train", *(("--resume", run) if run.exists() else new))
    start = run / "best.npz"
    row["refine_seconds"] = command("refine", robot, "--policy", start, "--seed", seed, "--out", file)
    row["trained_score"] = swingup.evaluate(swingup.get_controller(str(start), robot), robot).criteria.score
    controller = swingup.get_controller(str(file), robot)
    alone = swingup.get_controller(str(file), robot, estimator=False)
    row["score"] = swingup.evaluate(controller, robot).criteria.score
    row["robustness"] = swingup.robustness(controller, robot, seeds=NOISE_SEEDS).overall
    row["robustness_alone"] = swingup.robustness(alone, robot, seeds=NOISE_SEEDS).overall
    row["uptime"] = swingup.uptime(alone, robot, seeds=NOISE_SEEDS).uptime
    return row


def main(robot: str, folder: Path, frames: int, seeds: int) -> None:
    """Add the missing rows and print the table with its means."""
    folder.mkdir(parents=True, exist_ok=True)
    results = folder / "results.jsonl"
    rows = [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    for seed in range(seeds):
        if not any((row["robot"], row["seed"], row["frames"]) == (robot, seed, frames) for row in rows):
            rows.append(one_seed(robot, folder, frames, seed))
            results.write_text("".join(json.dumps(row) + "\n" for row in rows))
    rows = [row for row in rows if (row["robot"], row["frames"]) == (robot, frames)]
    names = [name for name in rows[0] if name not in ("robot", "frames")]
    print(f"{robot}, {frames:,} frames; AR-EAPO's published score: {PUBLISHED[robot]}")
    print(" | ".join(names))
    for row in rows:
        print(" | ".join(f"{row[name]:.3f}" if name != "seed" else str(row[name]) for name in names))
    for name in names[1:]:
        values = [row[name] for row in rows]
        interval = mean_interval(values, -1e9, 1e9) if len(values) > 1 else None
        print(f"{name}: mean {statistics.fmean(values):.3f}, 95 % interval {interval}")


if __name__ == "__main__":
    main(
        sys.argv[1],
        Path(sys.argv[2]),
        int(sys.argv[3]) if len(sys.argv) > 3 else 6_000_000,
        int(sys.argv[4]) if len(sys.argv) > 4 else 5,
    )
