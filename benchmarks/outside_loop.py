"""Robots that are not perfect, around the exported header: successes of 30 for each effect.

Usage: python benchmarks/outside_loop.py [ROBOT ...] [--policy FILE_OR_NAME] [--seed N] [--case WORD ...]
[--seconds 10]
Needs gcc. ``outside_loop.c`` has physics, sensors, motors and clock of its own. A case is five draws around each of
the six plants fitted to recordings: a lag of 2 to 7 ms, a start within 0.02 rad of hanging, and the moment of the
faults. Encoders have steps of 3.81e-4 rad and the session's offsets; velocities are differences; the controller
sees the turn before. A success has the tip above 0.9 (l1 + l2) throughout the last 2 of 10 s.

Beside it the LQR of the true plant, which knows spring, friction and offsets and sees raw differences, holds the
same loop from upright: where it falls, a linear regulator without memory cannot hold the case.
"""

import argparse
import ctypes
import dataclasses
import subprocess
import tempfile
import uuid
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from swingup.export.c_header import c_header
from swingup.loop.resolve import SESSIONS, resolve
from swingup.plant.plant import get_robot
from swingup.policy.guard import Reason, choose_guard
from swingup.policy.shipped import load_policy

SECONDS = 10.0
NAMES = (
    *("m1", "m2", "l1", "l2", "r1", "r2", "I1", "I2", "Ir", "gr", "g", "b1", "b2", "cf1", "cf2"),
    *("limit1", "limit2", "gain1", "gain2", "lag", "dead", "period", "step", "quantum", "offset1", "offset2"),
    *("spring1", "spring2", "bias1", "bias2", "stiffness", "contact", "backlash", "stiction", "sag"),
    *("dropout", "missing", "spoilt", "q1", "q2", "phase"),
    *("lqr", "k1", "k2", "k3", "k4", "e1", "e2", "u1", "u2"),
    *("turned1", "turned2", "wired1", "wired2", "crossed", "exchanged"),
)
"""The C struct's fields, in order."""

Numbers = dict[str, float]


def times(**factors: float) -> Callable[[Numbers], Numbers]:
    """Numbers that are multiplied."""
    return lambda p: {name: factor * p[name] for name, factor in factors.items()}


def elastic(stiffness: float, degrees: float = 0.0) -> Callable[[Numbers], Numbers]:
    """An elbow with a stiffness (N m/rad) behind a backlash."""
    return lambda p: {
        "stiffness": stiffness,
        "backlash": np.deg2rad(degrees),
        # A twentieth of the critical damping, against the rotor.
        "contact": 0.1 * (stiffness * p["gr"] ** 2 * p["Ir"]) ** 0.5,
        "step": 5e-5,
    }


def passive(limit: float) -> Callable[[Numbers], Numbers]:
    """A motor of the passive joint with a limit (N m)."""
    return lambda p: {"limit1" if p["limit1"] < p["limit2"] else "limit2": limit}


CASES: dict[str, Callable[[Numbers], Numbers]] = {
    "nothing": lambda p: {},
    "masses +10 %": times(m1=1.1, m2=1.1, I1=1.1, I2=1.1),
    "masses -10 %": times(m1=0.9, m2=0.9, I1=0.9, I2=0.9),
    "4 N m": lambda p: {name: min(p[name], 4.0) for name in ("limit1", "limit2")},
    "8 ms later": lambda p: {"dead": 0.008},
    "friction x2": times(b1=2, b2=2, cf1=2, cf2=2),
    "rotors x2": times(Ir=2),
    "link 1 +10 %": times(l1=1.1),
    "link 1 -10 %": times(l1=0.9),
    "shoulder's spring 0.02": lambda p: {"spring1": 0.02},
    "shoulder's spring 0.03": lambda p: {"spring1": 0.03},
    "shoulder's spring 0.05": lambda p: {"spring1": 0.05},
    "elbow's spring 0.03": lambda p: {"spring2": 0.03},
    "constant 0.1 N m": lambda p: {"bias1": 0.1, "bias2": -0.1},
    "backlash 0.1 deg": elastic(800.0, 0.1),
    "backlash 0.5 deg": elastic(800.0, 0.5),
    "800 N m/rad": elastic(800.0),
    "300 N m/rad": elastic(300.0),
    "passive motor absent": passive(0.0),
    "passive motor 0.1 N m": passive(0.1),
    "quantum x4": times(quantum=4),
    "1 kHz": lambda p: {"period": 0.001},
    "400 Hz": lambda p: {"period": 0.0025},
    "250 Hz": lambda p: {"period": 0.004},
    "200 Hz": lambda p: {"period": 0.005},
    "samples held 16 ms": lambda p: {"dropout": 0.016},
    "samples held 20 ms": lambda p: {"dropout": 0.020},
    "samples held 40 ms": lambda p: {"dropout": 0.040},
    "calls missed 20 ms": lambda p: {"missing": 0.020},
    "one NaN a second": lambda p: {"spoilt": 1.0},
    "stiction +50 %": lambda p: {"stiction": 0.5},
    "supply sags": lambda p: {"sag": 0.1},
}
"""What each case changes of a robot. Faults of samples and calls come once a second."""

WIRINGS: dict[str, Callable[[Numbers], Numbers]] = {
    "shoulder's encoder reversed": lambda p: {"turned1": 1.0},
    "elbow's encoder reversed": lambda p: {"turned2": 1.0},
    "motors reversed": lambda p: {"wired1": 1.0, "wired2": 1.0},
    "encoders swapped": lambda p: {"crossed": 1.0},
    "motors swapped": lambda p: {"exchanged": 1.0},
    "joints swapped": lambda p: {"crossed": 1.0, "exchanged": 1.0},
}
"""Robots that are wired wrongly, which the guard should stop in its first second."""


def robots(joint: int, seed: int, each: int = 5) -> list[Numbers]:
    """The robots of all cases, without their effects."""
    random = np.random.default_rng(seed)
    found = []
    for session in SESSIONS:
        plant, loop = resolve(domain=f"session-{session}").nominal
        numbers = dict.fromkeys(NAMES, 0.0) | plant.values()
        for _ in range(each):
            drawn = {
                "lag": random.uniform(0.002, 0.007),
                "q1": random.uniform(-0.02, 0.02),
                "q2": random.uniform(-0.02, 0.02),
                "phase": random.uniform(0.0, 1.0),
            }
            limits = {"limit1": 6.0, "limit2": 0.5} if joint == 0 else {"limit1": 0.5, "limit2": 6.0}
            sensors = {"quantum": 3.81e-4, "offset1": float(loop.offset1), "offset2": float(loop.offset2)}
            clock = {"period": 0.002, "step": 5e-4, "gain1": 1.0, "gain2": 1.0}
            found.append({name: (numbers | drawn | limits | sensors | clock)[name] for name in NAMES})
    return found


def held(p: Numbers, joint: int) -> Numbers:
    """The LQR of the true plant about the position where the springs let it stand, and a start there."""
    first, second = (p["m1"] * p["r1"] + p["m2"] * p["l1"]) * p["g"], p["m2"] * p["r2"] * p["g"]
    other = 1 - joint
    most = p[f"limit{other + 1}"]
    q = np.array([np.pi, 0.0])
    u = np.zeros(2)
    # Newton's method: the passive joint's motor takes what it can, the rest is a lean with link 2 in line.
    for _ in range(50):
        pull = np.array([first * np.sin(q[0]) + second * np.sin(q.sum()), second * np.sin(q.sum())])
        need = pull + np.array([p["spring1"] * q[0] + p["bias1"], p["spring2"] * q[1] + p["bias2"]])
        u = need.copy()
        u[other] = np.clip(need[other], -most, most)
        rest = need[other] - u[other]
        if joint == 1:
            q[0] -= rest / (first * np.cos(q[0]) + second * np.cos(q.sum()) + p["spring1"])
            q[1] = np.pi - q[0]
        else:
            q[1] -= rest / (second * np.cos(q.sum()) + p["spring2"])
    coupling, reflected = p["m2"] * p["l1"] * p["r2"] * np.cos(q[1]), p["gr"] ** 2 * p["Ir"]
    m12 = p["I2"] + coupling - p["gr"] * p["Ir"]
    m11 = p["I1"] + p["I2"] + p["m2"] * p["l1"] ** 2 + 2 * coupling + reflected + p["Ir"]
    M = np.array([[m11, m12], [m12, p["I2"] + reflected]])
    down = second * np.cos(q.sum())
    G = -np.array([[first * np.cos(q[0]) + down + p["spring1"], down], [down, down + p["spring2"]]])
    A, b = np.zeros((4, 4)), np.zeros((4, 1))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = np.linalg.solve(M, G)
    b[2:, 0] = np.linalg.inv(M)[:, joint]
    whole = expm(np.block([[A, b], [np.zeros((1, 5))]]) * p["period"])
    Ad, bd = whole[:4, :4], whole[:4, 4:]
    P = solve_discrete_are(Ad, bd, np.diag([1.0, 1.0, 0.1, 0.1]), np.eye(1))
    K = np.linalg.solve(1.0 + bd.T @ P @ bd, bd.T @ P @ Ad)[0]
    at = {"e1": q[0] + p["offset1"], "e2": q[1] + p["offset2"], "u1": u[0], "u2": u[1]}
    start = {"q1": q[0] + p["q1"], "q2": q[1] + p["q2"]}
    return p | at | start | dict(zip(("k1", "k2", "k3", "k4"), K, strict=True)) | {"lqr": 1.0}


def compiled(folder: Path, policy: Any) -> ctypes.CDLL:
    """The loop around a policy's header."""
    (folder / "policy.h").write_text(c_header(policy), encoding="utf-8")
    return load(folder / "policy.h")


def load(header: Path) -> ctypes.CDLL:
    """The loop around a header, which is named policy.h."""
    # A new file for each: a library that is loaded stays.
    source, library = Path(__file__).with_suffix(".c"), header.with_name(f"{uuid.uuid4().hex}.so")
    command = [
        "gcc",
        "-std=c99",
        "-O2",
        "-shared",
        "-fPIC",
        f"-I{header.parent}",
        str(source),
        "-o",
        str(library),
        "-lm",
    ]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(library))


def run(
    library: ctypes.CDLL, p: Numbers, trace: np.ndarray | None = None, seconds: float = SECONDS
) -> tuple[bool, int]:
    """Whether a run succeeds, and the guard's reason."""
    values, reason = (ctypes.c_double * len(NAMES))(*p.values()), ctypes.c_int()
    rows = None if trace is None else trace.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
    return bool(library.simulate(values, ctypes.c_double(seconds), ctypes.byref(reason), rows)), reason.value


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("robots", nargs="*", default=["acrobot", "pendubot"])
    options.add_argument("--policy", default="adaptive")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--case", nargs="*", default=[""])
    options.add_argument("--seconds", type=float, default=SECONDS, help="1.6 are enough for the wiring")
    chosen = options.parse_args()
    wanted = [name for name in CASES | WIRINGS if any(word in name for word in chosen.case)]
    print(f"{'of 30: policy (stopped by the guard), LQR':42s}" + "".join(f"{name:>20s}" for name in chosen.robots))
    rows: dict[str, list[str]] = {name: [] for name in wanted}
    reasons: tuple[Counter[str], Counter[str]] = Counter(), Counter()
    with tempfile.TemporaryDirectory() as folder:
        for name in chosen.robots:
            joint = get_robot(name).joint
            policy = load_policy(chosen.policy, name)
            guarded = dataclasses.replace(
                policy, guard=choose_guard(True, policy.guard, policy.period, policy.plant)
            )
            library = compiled(Path(folder), guarded)
            for case in wanted:
                numbers = [p | (CASES | WIRINGS)[case](p) for p in robots(joint, chosen.seed)]
                found = [run(library, p, seconds=chosen.seconds) for p in numbers]
                reasons[case in WIRINGS].update(Reason(reason).name.lower() for _, reason in found)
                standing = sum(run(library, held(p, joint), seconds=chosen.seconds)[0] for p in numbers)
                good, stopped = sum(up for up, _ in found), sum(reason > 0 for _, reason in found)
                rows[case].append(f"{f'{good} ({stopped}), {standing}':>20s}")
    for case, row in rows.items():
        print(f"{case:42s}{''.join(row)}")
    for title, counts in zip(("wired rightly", "wired wrongly"), reasons, strict=True):
        print(f"why the guard stopped, {title}: {dict(counts.most_common())}")


if __name__ == "__main__":
    main()
