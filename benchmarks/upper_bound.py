"""How much of the robustness board's model errors a controller can hold that is told the plant.

Usage: python benchmarks/upper_bound.py ROBOT

Each plant of the grid gets its own optimal swing-up and its own LQR at the top
(``controllers/baselines/continuation.py``), and is judged by the board's rules. A plant that the
continuation does not reach gets the swing-up of the nearest plant on its way. Prints a table in Markdown, and the
cells that fail. This is no bound in the strict sense: another swing-up or regulator may hold a cell that fails
here.
"""

import argparse
import sys
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from swingup.benchmark.board import Case
from swingup.benchmark.boards import ROBUSTNESS
from swingup.benchmark.robustness_board import RobustnessBoard, make_cases, upright
from swingup.benchmark.rollout import Scenario, Trajectory, simulate
from swingup.benchmark.runner import stack
from swingup.controllers.baselines.continuation import SwingUps, continue_swingups
from swingup.controllers.baselines.upright import LatchingSwitch
from swingup.controllers.interface import split
from swingup.plant.plant import ROBOTS, Plant


def simulated(
    controllers: list[LatchingSwitch], plants: list[Plant], rules: RobustnessBoard
) -> tuple[np.ndarray, Trajectory]:
    """Each controller on its own plant from hanging at rest: last states (n, 4), and rows with n in front."""
    static = split(controllers[0])[1]
    arrays = jax.tree.map(lambda *leaves: np.stack(leaves), *(split(each)[0] for each in controllers))

    @jax.jit
    @jax.vmap
    def run(arrays: LatchingSwitch, plant: Plant) -> tuple[jax.Array, Trajectory]:
        controller = eqx.combine(arrays, static)
        final, _, rows = simulate(Scenario(plant), controller, jnp.zeros(4), rules.dt, rules.steps)
        return final, rows

    with jax.enable_x64(True):
        final, rows = run(arrays, stack(plants))
    return np.asarray(final), rows


def table(cases: list[Case], found: SwingUps, successes: np.ndarray) -> str:
    """Plants that were reached and held, by parameter, and the cells that fail."""
    lines = ["| parameter | plants | reached | held |", "|---|---:|---:|---:|"]
    names = np.array([case.settings["parameter"] for case in cases])
    reached = np.asarray(found.reached) == 1.0
    for name in dict.fromkeys(names):
        one = names == name
        lines.append(f"| {name} | {one.sum()} | {reached[one].sum()} | {successes[one].sum()} |")
    lines.append(f"| **all** | {len(cases)} | {reached.sum()} | **{successes.sum()}** |")
    cells = [
        f"{case.settings['parameter']} = {case.settings['value']:.3g}" + ("" if end == 1.0 else f" (λ = {end:.2f})")
        for case, end, success in zip(cases, found.reached, successes, strict=True)
        if not success
    ]
    return "\n".join([*lines, "", f"Not held: {', '.join(cells) or 'none'}."])


def main() -> None:
    """Compute the swing-ups, judge them and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", choices=list(ROBOTS))
    robot, rules = ROBOTS[parser.parse_args().robot], ROBUSTNESS
    cases = make_cases(robot, rules, "model", 0)
    plants = [case.scenario.parameters for case in cases]
    began = time.process_time()

    def progress(done: int, total: int) -> None:
        print(f"{done} of {total} plants", file=sys.stderr, flush=True)

    found = continue_swingups(robot, stack(plants), progress=progress)
    controllers = [found.controller(index, plant) for index, plant in enumerate(plants)]
    successes = upright(simulated(controllers, plants, rules)[0], rules.tolerance)
    print(table(cases, found, successes))
    print(f"{time.process_time() - began:.0f} s of CPU time")


if __name__ == "__main__":
    main()
