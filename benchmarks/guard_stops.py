"""False stops: how often the guard stops `adaptive` in the simulated robots of a domain, which are wired rightly.

Usage: python benchmarks/guard_stops.py ROBOT DOMAIN [--seed 20000] [--seeds 25]

The controller is the NumPy one that a robot's computer runs, with its guard; a run takes some ten CPU-seconds.
"""

import argparse

import numpy as np

import swingup
from swingup.policy.numpy_backend import load_controller


class Watched:
    """The guarded controller, which notes why it was stopped."""

    def __init__(self, robot: str) -> None:
        """Load it for a robot."""
        self._controller = load_controller("adaptive", robot)
        self.stops: list[str] = []

    def reset(self) -> None:
        """Begin a run."""
        self._controller.reset()

    def get_control_output(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (N m)."""
        before = self._controller.fault
        torques = self._controller(x, t)
        if before is None and self._controller.fault is not None:
            self.stops.append(str(self._controller.fault))
        return torques

    def __deepcopy__(self, memo: object) -> "Watched":
        """Itself: runs follow each other, and their stops stand in one list."""
        return self


def main() -> None:
    """Simulate the runs and print the stops."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot")
    parser.add_argument("domain")
    parser.add_argument("--seed", type=int, default=20_000)
    parser.add_argument("--seeds", type=int, default=25)
    options = parser.parse_args()
    watched = Watched(options.robot)
    found = swingup.judge(
        watched, options.robot, "sim2real", options.seeds, seed=options.seed, domain=options.domain, name="adaptive"
    )
    up = f"up {found.successes} of {len(found.runs)}"
    print(f"{options.robot} in {options.domain}: {up}, stopped {len(watched.stops)}")
    print("\n".join(watched.stops))


if __name__ == "__main__":
    main()
