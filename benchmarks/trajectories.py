"""Compute a swing-up trajectory that the package ships: ``python benchmarks/trajectories.py acrobot 0``."""

import sys
import time
from pathlib import Path

from swingup.control.published import PUBLISHED
from swingup.control.reference import compute_reference, save_reference

ZOO = Path(__file__).parents[1] / "src" / "swingup" / "zoo"


def main(robot: str, seed: int) -> None:
    """Write the robot's file into the package's zoo."""
    start = time.perf_counter()
    reference, provenance = compute_reference(robot, PUBLISHED[robot].swingup, seed)
    command = f"python benchmarks/trajectories.py {robot} {seed}"
    save_reference(ZOO / f"{robot}-ilqr.npz", reference, {**provenance, "command": command})
    print(f"{robot}: {provenance}, {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 0)
