"""How far is the torque of `swingup plant --within 5` from the least? Beside a longer search.

Usage: python benchmarks/least_torque.py [--within 5] [--plant NAME ...] [--robot NAME ...]

The longer search bisects down to steps of 2 % instead of 5 %, and evolves 32 islands for 80 generations instead of
16 for 40. Both results are upper bounds, since no search proves that no motion swings up. Prints a row of Markdown
for each design and robot.
"""

import argparse
import time

from swingup.controllers.swingups import least_torque as searching
from swingup.controllers.swingups.least_torque import Effort, least_torque
from swingup.plant.files import load_plant
from swingup.plant.plant import ROBOTS

LONGER = Effort(generations=80, islands=32)


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("--within", type=float, default=5.0)
    options.add_argument("--plant", nargs="*", default=["A.0", "B.0", "C.0", "C.1", "cloudpendulum"])
    options.add_argument("--robot", nargs="*", default=list(ROBOTS))
    chosen = options.parse_args()
    print("| design | robot | least torque (N m) | of the motor's | longer search (N m) | error | CPU-seconds |")
    print("|---|---|---:|---:|---:|---:|---:|")
    for name in chosen.plant:
        for robot in (ROBOTS[each] for each in chosen.robot):
            plant = load_plant(name)
            begun = time.process_time()
            found = least_torque(plant, robot, chosen.within)
            seconds = time.process_time() - begun
            last, searching.LAST_STEP = searching.LAST_STEP, 0.98
            best = least_torque(plant, robot, chosen.within, LONGER)
            searching.LAST_STEP = last
            share, error = "", ""
            if found is not None and best is not None:
                share = f"{found / float(plant.limit(robot.joint)):.2f}"
                error = f"{100 * (found / best - 1):+.0f} %"
            cells = [name, robot.name, found and f"{found:.3g}", share, best and f"{best:.3g}", error]
            print(f"| {' | '.join(map(str, cells))} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    main()
