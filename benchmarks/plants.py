"""One preset on every shipped plant without friction: which robots swing up and hold.

Usage: python benchmarks/plants.py [PLANT ...] [--robots acrobot pendubot] [--preset small] [--frames N] [--seeds 2]
[--first-seed 0] [--results FILE] [--runs FOLDER]

Nothing but the plant changes between the runs of a robot: its task is in the plant's own units. A policy swings up
and holds if, simulated at 500 Hz from hanging at rest, it is up after 8 s at most and stays up until 10 s: a
performance board's success alone could be a pendulum that spins and happens to be up at the end. Finished runs are
lines of the results' file and are not repeated; an interrupted run resumes from its folder. Prints a table in
Markdown, with the result of each run's best policy.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from study import code_version

from swingup.benchmark.judge import judge
from swingup.common.files import write_atomically
from swingup.controllers.registry import get_controller
from swingup.dynamics.dynamics import UPRIGHT, linearise
from swingup.learner.metrics import read_metrics
from swingup.learner.presets import get_preset
from swingup.learner.run import resume_run, start_run
from swingup.learner.run_settings import make_run_settings
from swingup.plant.files import load_plant
from swingup.plant.plant import ROBOTS, Plant, get_robot, torque_over_gravity
from swingup.plant.units import REFERENCE, scales_of
from swingup.tasks.presets import get_task

PLANTS = ("A.0", "B.0", "C.0", "C.1", "cloudpendulum")
"""RealAIGym's designs and CloudPendulum."""

LATEST = 8.0
"""Latest time at which a pendulum that is said to hold comes up to stay (s)."""


def train(preset: str, plant: str, robot: str, seed: int, frames: int, folder: Path) -> dict[str, Any]:
    """Train one run, or the rest of it, and judge its best policy."""
    ideal = load_plant(plant).frictionless()
    if (folder / "config.json").exists():
        run = resume_run(folder, frames)
    else:
        run = start_run(make_run_settings(robot, preset, plant=ideal, seed=seed, seeds=1), folder, frames)
    for _ in run.advance():
        pass
    run.close()
    rows = read_metrics(folder / "metrics.jsonl")
    found = judge(get_controller(str(folder / "best.safetensors"), robot), robot, plant=ideal).criteria
    return {
        "preset": preset, "plant": plant, "robot": robot, "seed": seed, "frames": run.frames,
        "seconds": rows[-1]["seconds"], "score": found.score, "swingup_time": found.swingup_time,
        "first_hold": next((row["frames"] for row in rows if holds(row["swingup_time"])), None),
        "evaluations": [[row["frames"], round(row["score"], 3), row["swingup_time"]] for row in rows],
        "code": code_version(),
    }  # fmt: skip


def holds(swingup_time: float | None) -> bool:
    """Whether a pendulum was up early enough, and stayed up to the end."""
    return swingup_time is not None and swingup_time <= LATEST


def fall_rate(plant: Plant) -> float:
    """The faster of the two rates at which the pendulum falls from upright, in its own unit 1/T."""
    A, _ = linearise(plant, jnp.asarray(UPRIGHT), jnp.zeros(2))
    return float(np.linalg.eigvals(np.asarray(A, float)).real.max()) * REFERENCE[0] * scales_of(plant).time


def cell(results: list[dict[str, Any]]) -> str:
    """Score and swing-up time of each seed's best policy, and the frames until a policy held."""
    texts = []
    for row in results:
        if holds(row["swingup_time"]):
            texts.append(f"{row['score']:.2f}, {row['swingup_time']:.1f} s ({row['first_hold'] / 1e6:.1f} M)")
        else:
            texts.append("does not hold")
    return "; ".join(texts) or "not run"


def table(results: list[dict[str, Any]], plants: list[str], robots: list[str]) -> str:
    """The plants' ratios, and a column for each robot."""
    lines = ["| plant | torque / gravity | fall rate × T | action (ms) | " + " | ".join(robots) + " |"]
    lines.append("|---|---|---|---|" + "---|" * len(robots))
    for plant in plants:
        ideal = load_plant(plant).frictionless()
        dt = get_task("smooth", get_robot("acrobot"), ideal).dt
        cells = [f"{torque_over_gravity(ideal):.2f}", f"{fall_rate(ideal):.2f}", f"{1000 * dt:.1f}"]
        cells += [
            cell([row for row in results if (row["plant"], row["robot"]) == (plant, name)]) for name in robots
        ]
        lines.append(f"| {plant} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Train the missing runs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plants", nargs="*", default=list(PLANTS), metavar="PLANT")
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--preset", default="small")
    parser.add_argument("--frames", type=int)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--results", type=Path, default=Path("benchmarks/runs/plants.jsonl"))
    parser.add_argument("--runs", type=Path, default=Path("runs/plants"))
    options = parser.parse_args()
    frames = options.frames or get_preset(options.preset).frames
    text = options.results.read_text() if options.results.exists() else ""
    results = [json.loads(line) for line in text.splitlines()]
    others = [row for row in results if row["preset"] != options.preset]
    results = [row for row in results if row["preset"] == options.preset]
    done = {(row["preset"], row["plant"], row["robot"], row["seed"]) for row in results}
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for plant in options.plants:
            for robot in options.robots:
                kind = (options.preset, plant, robot, seed)
                if kind in done:
                    continue
                results.append(train(*kind, frames, options.runs / "-".join(map(str, kind))))
                lines = "".join(json.dumps(row) + "\n" for row in others + results)
                write_atomically(options.results, lines.encode())
                print(f"{robot} on {plant}, seed {seed}: {cell(results[-1:])}", flush=True)
    print("\n" + table(results, options.plants, options.robots))


if __name__ == "__main__":
    main()
