"""From how many starts near upright the regulator holds plants whose passive joint has dry friction.

Usage: python benchmarks/hold_at_top.py [ROBOT ...] [--starts 32] [--seed 0]

Nothing compensates the passive joint's friction; the driven joint has none. Each start is up to 0.1 rad and 0.375
rad/s off upright, in C.1's units, and runs for 3,000 calls of 2 ms. It is held if no angle is more than 0.6 rad off
in the last 500 calls. The loop is perfect: the regulator knows its plant and measures without delay or noise.
"""

import argparse
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from swingup.common.types import Scalar, State
from swingup.controllers.baselines.baselines import design_of
from swingup.controllers.baselines.upright import HAND_OVER, holding_regulator
from swingup.dynamics.dynamics import UPRIGHT, wrap_difference
from swingup.dynamics.integrate import rk4_step
from swingup.loop.loop import LOOP_DT
from swingup.plant.files import load_plant
from swingup.plant.plant import ROBOTS, Robot

PLANTS = ("A.0", "B.0", "C.0", "C.1", "cloudpendulum")
CALLS, LAST_CALLS = 3000, 500  # of a run, and those of its end that count
FALLEN_ANGLE = 0.6  # rad


def errors_held(robot: Robot, plant: str, starts: int = 32, seed: int = 0) -> np.ndarray:
    """Largest error of an angle at the end of the run from each start (rad)."""
    design = design_of(robot, load_plant(plant))
    model, dt = design.with_friction, LOOP_DT / design.scales.time
    regulator = holding_regulator(model, robot)
    offsets = np.random.default_rng(seed).uniform(-0.25, 0.25, (starts, 4)) * HAND_OVER

    def run(offset: State) -> Scalar:
        def step(carry: Any, _: None) -> Any:
            x, memory = carry
            memory, u = regulator(memory, jnp.zeros(()), x)
            x = rk4_step(model, x, u, dt)
            return (x, memory), jnp.abs(wrap_difference((x - UPRIGHT)[:2])).max()

        _, errors = jax.lax.scan(step, (UPRIGHT + offset, regulator.init()), length=CALLS)
        return jnp.max(errors[-LAST_CALLS:])

    with jax.enable_x64(True):
        return np.asarray(jax.jit(jax.vmap(run))(jnp.asarray(offsets)))


def main() -> None:
    """Print a row for each robot: starts held, and the median error of those that are (rad)."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", help="acrobot, pendubot or both")
    parser.add_argument("--starts", type=int, default=32)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(f"| held of {given.starts} | {' | '.join(PLANTS)} |\n|---|{'---|' * len(PLANTS)}")
    for name in given.robots or ROBOTS:
        cells = []
        for plant in PLANTS:
            errors = errors_held(ROBOTS[name], plant, given.starts, given.seed)
            held = errors < FALLEN_ANGLE
            cells.append(f"{held.sum()}" + (f" ({np.median(errors[held]):.2f} rad)" if held.any() else ""))
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
