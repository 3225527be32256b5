"""Does ``swingup diagnose`` name the cause of a failing run? A table of failures made by an outside loop in C.

Usage: python benchmarks/diagnosis.py [--seed N] [--draws N] [--robot NAME ...] [--cause NAME ...] [--policy NAME]
                                      [--keep FOLDER] [--logs FOLDER]
Needs gcc. Each run is of ``outside_loop.c`` around the exported header: a plant fitted to a session of design C.1
with ordinary deviations (masses and inertias within 3 %, frictions and rotors within 20 %, zeros within 5 mrad, a
lag of 2 to 7 ms), and one cause, whose size is drawn until the run fails. The log has what the controller saw and
commanded. The diagnosis gets it with the session's plant and the policy, without simulations, which do not change
the order of the causes. The rows "nothing" are runs without a cause, 20 of each robot. ``--keep`` keeps logs and
answers; ``--logs`` diagnoses a folder's recordings, which have no cause, with their design's plant.
"""

import argparse
import dataclasses
import json
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from outside_loop import NAMES, SECONDS, Numbers, compiled, elastic, run

from swingup.benchmark.diagnosis import diagnose
from swingup.common.errors import SwingupError
from swingup.loop.resolve import SESSIONS, resolve
from swingup.plant.plant import get_robot
from swingup.policy.guard import choose_guard
from swingup.policy.shipped import load_policy

Random = np.random.Generator
Effect = Callable[[Numbers, Random, float, int], Numbers]
"""What a cause changes of a robot, for a severity from 0 to 1 and the driven joint."""
TORQUE = 6.0  # of both motors; the passive joint's has a lower limit in software alone (N m)
TRIES = 100  # Draws until a run fails
NOTHING = "nothing"


def between(low: float, high: float, severity: float) -> float:
    """A number between two others."""
    return low + severity * (high - low)


def either(random: Random) -> float:
    """A sign."""
    return float(random.choice([-1.0, 1.0]))


def swapped(p: Numbers, random: Random, severity: float, joint: int) -> Numbers:
    """Encoders, motors or both of the other joint."""
    kind = random.integers(3)
    return {"crossed": float(kind != 1), "exchanged": float(kind != 0)}


def gain(p: Numbers, random: Random, severity: float, joint: int) -> Numbers:
    """Another torque constant; drivers limit the current, not the torque."""
    factor = float(np.exp(either(random) * between(0.25, 1.2, severity)))
    most = TORQUE * max(1.0, factor)
    return {"gain1": factor, "gain2": factor, "limit1": most, "limit2": most}


def supply(p: Numbers, random: Random, severity: float, joint: int) -> Numbers:
    """Less torque at speed, or less torque."""
    if random.random() < 0.5:
        return {"sag": between(0.2, 1.5, severity)}
    return dict.fromkeys(("limit1", "limit2"), TORQUE * between(0.7, 0.15, severity))


def rough(p: Numbers, random: Random, severity: float, joint: int) -> Numbers:
    """Stiction at both joints, or more friction at one."""
    if random.random() < 0.5:
        return {"stiction": between(0.5, 5.0, severity)}
    name, factor = random.choice(["1", "2"]), between(2.0, 8.0, severity)
    return {f"b{name}": factor * p[f"b{name}"], f"cf{name}": factor * p[f"cf{name}"]}


def mass(p: Numbers, random: Random, severity: float, joint: int) -> Numbers:
    """One link is heavier or lighter."""
    name, factor = random.choice(["1", "2"]), float(np.exp(either(random) * between(0.15, 0.9, severity)))
    return {f"m{name}": factor * p[f"m{name}"], f"I{name}": factor * p[f"I{name}"]}


CAUSES: dict[str, Effect] = {
    "joints swapped": swapped,
    "encoder 1 reversed": lambda p, random, severity, joint: {"turned1": 1.0},
    "encoder 2 reversed": lambda p, random, severity, joint: {"turned2": 1.0},
    "motor reversed": lambda p, random, severity, joint: {f"wired{joint + 1}": 1.0},
    "zero 1": lambda p, random, severity, joint: {"offset1": either(random) * between(0.04, 0.6, severity)},
    "zero 2": lambda p, random, severity, joint: {"offset2": either(random) * between(0.04, 0.6, severity)},
    "rate": lambda p, random, severity, joint: {"period": 5e-4 * round(between(10, 60, severity))},
    "delay": lambda p, random, severity, joint: {"dead": between(0.008, 0.06, severity)},
    "torque constant": gain,
    "supply": supply,
    "friction": rough,
    "play": lambda p, random, severity, joint: elastic(800.0, between(0.5, 12.0, severity))(p),
    "spring": lambda p, random, severity, joint: {
        f"spring{random.choice(['1', '2'])}": between(0.03, 1.0, severity)
    },
    "mass": mass,
}


def ordinary(session: str, random: Random) -> Numbers:
    """A specimen of the session's robot in a loop without a cause."""
    numbers = dict.fromkeys(NAMES, 0.0) | resolve(domain=f"session-{session}").nominal.plant.values()
    for names, share in ((("m1", "m2", "I1", "I2"), 0.03), (("b1", "b2", "cf1", "cf2", "Ir"), 0.2)):
        numbers |= {name: numbers[name] * random.uniform(1 - share, 1 + share) for name in names}
    numbers |= {name: random.uniform(-0.005, 0.005) for name in ("offset1", "offset2")}
    numbers |= {name: random.uniform(-0.02, 0.02) for name in ("q1", "q2")}
    numbers |= {"lag": random.uniform(0.002, 0.007), "phase": random.uniform(0.0, 1.0)}
    numbers |= {"quantum": 3.81e-4, "period": 0.002, "step": 5e-4, "gain1": 1.0, "gain2": 1.0}
    numbers |= {"limit1": TORQUE, "limit2": TORQUE}
    return {name: numbers[name] for name in NAMES}


def write_log(path: Path, trace: np.ndarray, period: float) -> None:
    """What the controller saw and commanded."""
    table = np.column_stack([np.arange(len(trace)) * period, trace[:, 4:]])
    head = "time,pos_meas1,pos_meas2,vel_meas1,vel_meas2,tau_con1,tau_con2"
    np.savetxt(path, table, "%.9g", ",", header=head, comments="")


def make_logs(folder: Path, robot: str, chosen: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Logs with their truth."""
    joint, policy = get_robot(robot).joint, load_policy(chosen.policy, robot)
    library = compiled(folder, dataclasses.replace(policy, guard=choose_guard(True, policy.guard, policy.period)))
    for cause in chosen.cause:
        for draw in range(2 * chosen.draws if cause == NOTHING else chosen.draws):
            random = np.random.default_rng([chosen.seed, joint, [*CAUSES, NOTHING].index(cause), draw])
            session = SESSIONS[random.integers(len(SESSIONS))]
            base, effect = ordinary(session, random), Numbers()
            for _ in range(TRIES):
                if cause != NOTHING:
                    effect = CAUSES[cause](base, random, random.random(), joint)
                p = base | effect
                trace = np.zeros((int(SECONDS / p["period"]), 10))
                up, reason = run(library, p, trace)
                # Only a run that fails has a cause.
                if cause == NOTHING or not up:
                    break
            else:
                raise SystemExit(f"{robot}: no run with {cause} fails")
            log = folder / f"{robot}-{cause.replace(' ', '')}-{draw}.csv"
            write_log(log, trace, p["period"])
            truth = {"log": str(log), "robot": robot, "cause": cause, "session": session, "effect": effect}
            yield truth | {"up": up, "guard": reason}


def answer(truth: dict[str, Any], policy: str) -> dict[str, Any]:
    """A log's truth with the diagnosis."""
    begun = time.process_time()
    try:
        found = diagnose(truth["log"], policy, domain=truth["session"], robot=truth["robot"], simulate=False)
    except SwingupError as error:
        return truth | {"named": None, "causes": [], "error": str(error)}
    named = None if found.named is None else found.named.name
    causes = [each.name for each in found.causes]
    seconds = time.process_time() - begun
    return truth | {"named": named, "causes": causes, "answer": found.answer, "seconds": seconds}


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--draws", type=int, default=10)
    options.add_argument("--robot", nargs="*", default=["acrobot", "pendubot"])
    options.add_argument("--cause", nargs="*", default=[*CAUSES, NOTHING])
    options.add_argument("--policy", default="adaptive")
    options.add_argument("--keep")
    options.add_argument("--logs")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(chosen.keep or temporary)
        folder.mkdir(exist_ok=True)
        truths: Any = (each for robot in chosen.robot for each in make_logs(folder, robot, chosen))
        if chosen.logs:
            files = sorted(Path(chosen.logs).rglob("*.csv"))
            truths = [
                {"log": str(file), "robot": "pendubot" if "pendubot" in file.name else "acrobot", "cause": NOTHING,
                 "session": "cells" if "cloudpendulum" in str(file) else "recorded"}
                for file in files if "trajectory" not in file.name
            ]  # fmt: skip
        found = []
        for truth in truths:
            found.append(answer(truth | {"session": _domain(truth["session"])}, chosen.policy))
            each = found[-1]
            told = each.get("error") or ", ".join(each["causes"][:3]) or each["answer"]
            print(f"{Path(each['log']).name:34s} {each['named'] or '-'!s:20s} {told}"[:150], flush=True)
        if chosen.keep:
            (folder / "answers.json").write_text(json.dumps(found, indent=0))
    print(f"{'':22s}{'first':>10s}{'first two':>12s}{'of':>6s}")
    for cause in dict.fromkeys(each["cause"] for each in found):
        rows = [each for each in found if each["cause"] == cause]
        if cause == NOTHING:
            named = sum(each["named"] is not None for each in rows)
            print(f"{'no cause, one named':22s}{named:10d}{'':12s}{len(rows):6d}")
            continue
        first = sum(each["named"] == cause for each in rows)
        two = sum(cause in each["causes"][:2] for each in rows)
        print(f"{cause:22s}{first:10d}{two:12d}{len(rows):6d}")
    print(f"{np.median([each.get('seconds', np.nan) for each in found]):.1f} CPU-seconds a log (median)")


def _domain(session: str) -> str:
    return session if session in ("cells", "recorded") else f"session-{session}"


if __name__ == "__main__":
    main()
