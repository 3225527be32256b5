"""From two logs of an unseen pendulum to a C header: `swingup make-controller`, judged in an outside loop.

Usage: python benchmarks/unseen_pendulums.py [--first SEED] [--number N] [--starts N] [--keep FOLDER]
Needs gcc. A seed draws a pendulum with one motor, of even seeds at the shoulder; dry friction of 0.3 to 1.5 % of
gravity's torque at the motor and of 0.08 to 0.4 % at the other joint; encoders of 8,192 counts whose zeros are 40
and -30 mrad; a lag and a delay. Its logs are simulated here with NumPy alone, the controller runs in
``outside_loop.c``. The identification starts from what a ruler and a scale say: rods, masses within 5 %. It prints
the starts within 0.05 rad of hanging after which the tip is above 0.9 (l1 + l2) throughout the last 2 of 10 s, how
many the guard stopped, and the CPU time of the one command.
"""

import argparse
import math
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from outside_loop import NAMES, Numbers, load, run

ZEROS, COUNTS, PERIOD = (0.040, -0.030), 8192, 0.002
EXCITATION = 12.0  # Length of a log (s)


def drawn(seed: int) -> tuple[Numbers, str]:
    """A pendulum and its robot."""
    random = np.random.default_rng(seed)
    robot = ("pendubot", "acrobot")[seed % 2]
    p = dict.fromkeys(NAMES, 0.0) | {
        "g": 9.81,
        "gr": 1.0,
        "gain1": 1.0,
        "gain2": 1.0,
        "period": PERIOD,
        "step": 5e-4,
    }
    for link in "12":
        mass, length, centre = random.uniform(0.2, 0.6), random.uniform(0.15, 0.35), random.uniform(0.45, 0.7)
        r = centre * length
        p |= {f"m{link}": mass, f"l{link}": length, f"r{link}": r}
        p[f"I{link}"] = mass * r**2 + random.uniform(0.06, 0.1) * mass * length**2
    gravity = (p["m1"] * p["r1"] + p["m2"] * p["l1"] + p["m2"] * p["r2"]) * p["g"]
    driven, passive = "12" if robot == "pendubot" else "21"
    for joint, dry in ((driven, 0.015), (passive, 0.004)):
        p |= {
            f"cf{joint}": random.uniform(0.2, 1.0) * dry * gravity,
            f"b{joint}": random.uniform(0.0, 0.003) * gravity,
        }
    p |= {f"limit{driven}": random.uniform(1.0, 2.0) * gravity, "Ir": random.uniform(0.0, 0.05) * p["I2"]}
    p |= {"lag": random.uniform(0.001, 0.004), "dead": float(random.choice([0.001, 0.002, 0.004]))}
    p |= {"quantum": 2 * math.pi / COUNTS, "offset1": ZEROS[0], "offset2": ZEROS[1]}
    return p, robot


def acceleration(p: Numbers, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Lagrange's equations of two links with friction and the elbow's rotor; runs side by side in the last axis."""
    (q1, q2, v1, v2), c = x, p["m2"] * p["l1"] * p["r2"]
    m22 = p["I2"] + p["Ir"]
    m12 = p["I2"] + c * np.cos(q2) - p["Ir"]
    m11 = p["I1"] + p["I2"] + p["m2"] * p["l1"] ** 2 + 2 * c * np.cos(q2) + 2 * p["Ir"]
    far = p["m2"] * p["r2"] * p["g"] * np.sin(q1 + q2)
    f1 = u[0] - p["b1"] * v1 - p["cf1"] * np.arctan(100 * v1) + c * np.sin(q2) * v2 * (2 * v1 + v2) - far
    f1 -= (p["m1"] * p["r1"] + p["m2"] * p["l1"]) * p["g"] * np.sin(q1)
    f2 = u[1] - p["b2"] * v2 - p["cf2"] * np.arctan(100 * v2) - c * np.sin(q2) * v1 * v1 - far
    determinant = m11 * m22 - m12 * m12
    return np.stack([v1, v2, (m22 * f1 - m12 * f2) / determinant, (m11 * f2 - m12 * f1) / determinant])


def write_log(p: Numbers, path: Path, seed: int) -> None:
    """A log of an excitation of the one motor by sines, in counts, milliseconds and percents of its torque.

    Of several strengths it is the largest that turns no joint by more than 3 rad.
    """
    random, driven, strengths = np.random.default_rng(seed), int(p["limit2"] > 0), 0.3 * 0.75 ** np.arange(14)
    waves = random.uniform(0.3, 2.5, 5), random.uniform(0, 2 * math.pi, 5)
    limit, h, time = p[f"limit{driven + 1}"], 5e-4, PERIOD * np.arange(round(EXCITATION / PERIOD))
    shape = sum(np.sin(2 * math.pi * f * time + phase) for f, phase in zip(*waves, strict=True))
    duty = np.round(100 * np.clip(np.outer(shape * np.minimum(1.0, time), strengths), -1, 1)) / 100
    x, states, torque = np.zeros((4, len(strengths))), [], np.zeros(len(strengths))
    for k in range(len(time)):
        states.append(x)
        wanted = limit * duty[max(0, k - round(p["dead"] / PERIOD))]
        for _ in range(round(PERIOD / h)):
            torque = torque + (wanted - torque) * (1 - math.exp(-h / p["lag"]))
            u = np.stack([0 * torque, torque] if driven else [torque, 0 * torque])
            k1 = acceleration(p, x, u)
            k2 = acceleration(p, x + 0.5 * h * k1, u)
            k3 = acceleration(p, x + 0.5 * h * k2, u)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + acceleration(p, x + h * k3, u))
    angles = np.array(states)[:, :2]
    run = int(np.flatnonzero((np.abs(angles) < 3.0).all((0, 1)))[0])
    counts = np.round((angles[..., run] + ZEROS) * COUNTS / (2 * math.pi)).astype(int)
    rows = zip(1000 * time, *counts.T, 100 * duty[:, run], strict=True)
    path.write_text("ms,enc1,enc2,duty\n" + "".join(f"{t:.3f},{one},{two},{u:.0f}\n" for t, one, two, u in rows))


def made(p: Numbers, robot: str, folder: Path, seed: int) -> tuple[Path, float]:
    """The header that one command makes of two logs, and its CPU time (s)."""
    random, logs = np.random.default_rng(seed + 1000), [folder / "one.csv", folder / "two.csv"]
    for index, log in enumerate(logs):
        write_log(p, log, 10 * seed + index)
    driven = 2 if robot == "acrobot" else 1
    known = [f"l{i}={p[f'l{i}']:.3f}" for i in (1, 2)]
    known += [f"m{i}={p[f'm{i}'] * random.uniform(0.95, 1.05):.3f}" for i in (1, 2)]
    known += [f"tl{driven}={p[f'limit{driven}']:.4f}", f"tl{3 - driven}=0"]
    turn, unit = 2 * math.pi / COUNTS, p[f"limit{driven}"] / 100
    columns = ["time=ms:ms", f"q1=enc1*{turn!r}", f"q2=enc2*{turn!r}", f"u{driven}=duty*{unit!r}"]
    header = folder / "policy.h"
    command = [sys.executable, "-m", "swingup", "make-controller", *map(str, logs), "--set", *known]
    command += ["--columns", *columns, "--to", "c", "--out", str(header), "--page", str(folder / "log.html")]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with (folder / "made.txt").open("w") as output:
        subprocess.run(command, check=True, stdout=output, stderr=subprocess.STDOUT)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return header, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print a line for each pendulum."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--first", type=int, default=100)
    options.add_argument("--number", type=int, default=5)
    options.add_argument("--starts", type=int, default=20)
    options.add_argument("--keep", type=Path)
    chosen, total = options.parse_args(), 0
    for seed in range(chosen.first, chosen.first + chosen.number):
        p, robot = drawn(seed)
        with tempfile.TemporaryDirectory() as temporary:
            folder = (chosen.keep or Path(temporary)) / f"seed-{seed}"
            folder.mkdir(parents=True, exist_ok=True)
            header, seconds = made(p, robot, folder, seed)
            library, random = load(header), np.random.default_rng(seed + 2000)
            starts = [
                p | dict(zip(("q1", "q2"), random.uniform(-0.05, 0.05, 2), strict=True))
                for _ in range(chosen.starts)
            ]
            found = [run(library, each) for each in starts]
        good, stopped = sum(up for up, _ in found), sum(reason > 0 for _, reason in found)
        total += good
        print(
            f"seed {seed}, {robot}: {good} of {len(found)} ({stopped} stopped by the guard), {seconds:.0f} CPU-s",
            flush=True,
        )
    print(f"up and held: {total} of {chosen.number * chosen.starts}")


if __name__ == "__main__":
    main()
