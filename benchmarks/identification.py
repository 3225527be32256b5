"""Do the intervals of `swingup identify` hold the truth? Simulated logs of pendulums drawn from the robot's ranges.

Each pendulum is simulated with its loop: a multisine on both joints, commands that act late and through a lag,
encoders with a quantum and offsets, velocities as differences, uneven periods. The report has, for each parameter,
the share of 95 % intervals that hold the truth, their median width, and how often they count as determined.

    python benchmarks/identification.py --plants 40

Takes about ten CPU-seconds a plant.
"""

import argparse
import dataclasses
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import swingup
from swingup.common.table import write_columns
from swingup.dynamics.integrate import rk4_step
from swingup.plant.plant import Plant

FINE = 2.5e-4
"""Step of the simulation (s): RK4, which is stable there with the steepest friction."""
QUANTUM = 3.81e-4
"""Of the robot's encoders (rad)."""
PEAKS = (2.0, 1.2)
"""Of the torques (N m)."""
Truth = dict[str, float]


def draw_plant(random: np.random.Generator) -> tuple[Plant, Truth]:
    """A pendulum and its loop from the ranges that recordings of the robot gave."""
    p = swingup.load_plant("C.1")
    first = (p.m1 * p.r1 + p.m2 * p.l1) * (1 + random.uniform(-0.13, 0.02))
    second = p.m2 * p.r2 * (1 + random.uniform(-0.05, 0.05))
    shoulder = (p.I1 + p.m2 * p.l1**2) * (1 + random.uniform(-0.12, 0.0))
    plant = dataclasses.replace(
        p, r1=(first - p.m2 * p.l1) / p.m1, r2=second / p.m2, I1=shoulder - p.m2 * p.l1**2,
        I2=p.I2 * (1 + random.uniform(-0.05, 0.05)), Ir=random.uniform(6e-5, 1.4e-4), b1=random.uniform(0.0, 0.012),
        b2=random.uniform(0.0, 0.012), cf1=random.uniform(0.07, 0.16), cf2=random.uniform(0.06, 0.125),
    )  # fmt: skip
    delay, lag = FINE * random.integers(4, 13), random.uniform(0.0008, 0.0034)
    truth = {"m1 r1 + m2 l1": first, "m2 r2": second, "I1 + m2 l1^2": shoulder, "delay": delay, "lag": lag}
    truth |= {name: getattr(plant, name) for name in ("I2", "Ir", "b1", "b2", "cf1", "cf2")}
    truth |= {
        "delay + lag": delay + lag,
        "offset1": random.uniform(-0.03, 0.03),
        "offset2": random.uniform(-0.03, 0.03),
    }
    return plant, {name: float(value) for name, value in truth.items()}


def write_log(path: Path, random: np.random.Generator, plant: Plant, truth: Truth, seconds: float) -> Path:
    """Simulate one log and write it as the robot does."""
    count = round(seconds / FINE)
    time_ = FINE * np.arange(count)
    # Periods of 2 ms, now and then 2.25 or 2.5 ms.
    rows = np.concatenate([[0], np.cumsum(random.choice([8] * 9 + [9, 10], count // 8))])
    rows = rows[rows < count]
    commands = _multisine(random, time_)[rows]
    held = commands[np.searchsorted(rows, np.arange(count), "right") - 1]
    late = round(truth["delay"] / FINE)
    acting = _lagged(np.concatenate([np.zeros((late, 2)), held])[:count], truth["lag"])
    with jax.enable_x64(True):
        states = np.asarray(_simulate(plant, jnp.array(acting)))[rows]
    offsets = np.array([truth["offset1"], truth["offset2"]])
    q = QUANTUM * np.round((states[:, :2] + offsets) / QUANTUM)
    dq = np.diff(q, axis=0, prepend=q[:1]) / np.diff(time_[rows], prepend=-0.002)[:, None]
    names = ("pos_meas1", "pos_meas2", "vel_meas1", "vel_meas2", "tau_con1", "tau_con2")
    write_columns(path, {"time": time_[rows], **dict(zip(names, np.hstack([q, dq, commands]).T, strict=True))})
    return path


def _multisine(random: np.random.Generator, time_: np.ndarray) -> np.ndarray:
    torques = np.zeros((len(time_), 2))
    for joint, peak in enumerate(PEAKS):
        frequency, phase = random.uniform(0.2, 2.5, 6), random.uniform(0.0, 2.0 * np.pi, 6)
        share = 2.0 * random.dirichlet(np.ones(6))
        torques[:, joint] = peak * share @ np.sin(2.0 * np.pi * frequency[:, None] * time_ + phase[:, None])
    return torques


def _lagged(torques: np.ndarray, lag: float) -> np.ndarray:
    """Mean torque of each fine step behind a first-order lag."""
    stay, level, means = np.exp(-FINE / lag), np.zeros(2), np.empty_like(torques)
    for row, torque in enumerate(torques):
        means[row] = torque + (level - torque) * (1.0 - stay) * lag / FINE
        level = torque + (level - torque) * stay
    return means


@jax.jit
def _simulate(plant: Plant, torques: jax.Array) -> jax.Array:
    def step(x: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
        return rk4_step(plant, x, u, FINE), x

    return jax.lax.scan(step, jnp.zeros(4), torques)[1]


def study_plant(seed: int, logs: int, seconds: float) -> dict[str, dict[str, float]]:
    """Fit the logs of one drawn pendulum: each parameter's interval beside the truth."""
    random = np.random.default_rng([2027, seed])
    plant, truth = draw_plant(random)
    with tempfile.TemporaryDirectory() as folder:
        paths = [write_log(Path(folder) / f"{k}.csv", random, plant, truth, seconds) for k in range(logs + 1)]
        found = swingup.identify(paths[:-1], test=paths[-1:]).estimates
    rows = {}
    for name, value in truth.items():
        low, high = found.intervals[name]
        row = {"truth": value, "estimate": found.values[name], "low": low, "high": high}
        rows[name] = row | {"determined": float(found.determined[name])}
    return rows


def main() -> None:
    """Study the plants and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plants", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="number of the first plant")
    parser.add_argument("--logs", type=int, default=2, help="logs of each plant, and one more for the errors")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--save", type=Path, help="a JSON file for all rows")
    arguments = parser.parse_args()
    studied: list[dict[str, dict[str, float]]] = []
    for seed in range(arguments.first, arguments.first + arguments.plants):
        begun = time.monotonic()
        studied.append(study_plant(seed, arguments.logs, arguments.seconds))
        held = np.mean([row["low"] <= row["truth"] <= row["high"] for row in studied[-1].values()])
        print(
            f"plant {seed}: {held:.0%} of the intervals hold the truth, {time.monotonic() - begun:.0f} s",
            flush=True,
        )
        if arguments.save is not None:
            arguments.save.write_text(json.dumps(studied))
    print_table(studied)


def print_table(studied: list[dict[str, dict[str, float]]]) -> None:
    """Coverage, widths and shares of what counts as determined."""
    pooled: list[Any] = []
    print(f"{'parameter':<16}{'holds':>8}{'width':>9}{'determined':>12}")
    for name in studied[0]:
        rows = [plant[name] for plant in studied]
        holds = [row["low"] <= row["truth"] <= row["high"] for row in rows]
        widths = [(row["high"] - row["low"]) / abs(row["truth"]) for row in rows]
        sure = [row["determined"] for row in rows]
        pooled += list(zip(holds, widths, sure, strict=True))
        print(f"{name:<16}{np.mean(holds):>8.1%}{np.median(widths):>9.2%}{np.mean(sure):>12.0%}")
    determined = [width for _, width, sure in pooled if sure]
    print(
        f"{'pooled':<16}{np.mean([hold for hold, _, _ in pooled]):>8.1%}{np.median(determined):>9.2%} (determined)"
    )


if __name__ == "__main__":
    main()
