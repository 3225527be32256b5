"""How many plants of a domain a controller can hold upright in the robot's loop that is told all about them.

Usage: python benchmarks/holdable.py ROBOT [--controller adaptive] [--domain recorded] [--seed 10000] [--seeds 200]

Each plant begins at rest, 0.005 rad off upright. It has no friction, its motors deliver what they are asked for,
and its angles have no offsets: as if all three were known and compensated. Delay, lag, quanta and late periods are
the domain's, which must have the robot's own loop. The controller's estimator has the true plant, and its
regulator, for the true plant, acts throughout. Beside that stand the controller's own swing-ups of the same seeds,
which are told nothing. Rows are sorted by the error that the motor can bring back (``holding_range.py``).
"""

import argparse
import itertools
import sys
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from adaptive_plants import tell_everything
from holding_range import holding_range

from swingup.benchmark.judge import judge
from swingup.benchmark.rollout import Scenario, simulate
from swingup.benchmark.runner import stack
from swingup.controllers.stack.estimator import EstimatingController
from swingup.controllers.stack.policy import make_controller
from swingup.controllers.stack.regulator import TRIANGLE
from swingup.dynamics.dynamics import UPRIGHT
from swingup.loop.domain import Domain
from swingup.loop.draw import draw
from swingup.loop.resolve import resolve
from swingup.plant.plant import ROBOTS, Robot
from swingup.plant.units import similar_plant
from swingup.policy.pendulum import PendulumPolicy
from swingup.policy.regulator import RegulatorSettings, fixed_point
from swingup.policy.shipped import ADAPTIVE, load_policy

OFF = np.array([0.005, 0.0, 0.0, 0.0])
"""From upright at the start (rad, rad/s)."""
TIME = 5.0
"""Of a run (s)."""
FALLEN_ANGLE = 0.6
"""Error of an angle in its last second beyond which a pendulum has fallen (rad)."""
BOUNDS = (0.0, 0.125, 0.25, 0.5, np.inf)
"""Between the rows of the table (rad)."""


def known_scenario(domain: Domain, robot: Robot, seed: int) -> Scenario:
    """The plant and loop of a seed, without what a controller that knows them compensates."""
    parameters, disturbance = draw(domain, jax.random.key(seed), robot)
    if not (disturbance.effects.drive and disturbance.effects.sensors):
        sys.exit(
            "holdable.py: error: this domain has no motors with a gain, or no quanta: use recorded or a session"
        )
    limit = f"tl{robot.joint + 1}"
    most = float(getattr(parameters, limit) * getattr(disturbance.loop, f"gain{robot.joint + 1}"))
    plant = replace(jax.tree.map(float, parameters), b1=0.0, b2=0.0, cf1=0.0, cf2=0.0, **{limit: most})
    return Scenario(plant, disturbance.changed(gain1=1.0, gain2=1.0, offset1=0.0, offset2=0.0))


def held(policy: PendulumPolicy, scenarios: list[Scenario], depth: int) -> np.ndarray:
    """Which plants a policy's regulator holds that is told them."""
    # It acts throughout.
    regulator = replace(
        policy.regulator or RegulatorSettings(), enter=1e6, leave=1e6, enter_coulomb=1e6, leave_coulomb=1e6
    )
    controller = make_controller(replace(policy, regulator=regulator))
    assert isinstance(controller, EstimatingController)
    plants = [similar_plant(each.parameters, controller.scales) for each in scenarios]
    costs = [fixed_point(plant, policy.robot.joint)[0][TRIANGLE] for plant in plants]
    steps = round(TIME / 0.002)

    @jax.jit
    @jax.vmap
    def states(scenario: Scenario, cost_to_go: jax.Array) -> jax.Array:
        knowing = tell_everything(controller, scenario.parameters)
        knowing = eqx.tree_at(lambda c: c.controller.start, knowing, cost_to_go)
        return jnp.asarray(simulate(scenario, knowing, jnp.asarray(UPRIGHT + OFF), 0.002, steps, depth)[-1].x)

    with jax.enable_x64(True):
        x = np.asarray(states(stack(scenarios), np.stack(costs)))
    errors = np.abs(x[:, -500:, :2] - UPRIGHT[:2])
    return np.asarray(errors.max((1, 2)) < FALLEN_ANGLE)


def main() -> None:
    """Simulate and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", choices=list(ROBOTS))
    parser.add_argument("--controller", default=ADAPTIVE)
    parser.add_argument("--domain", default="recorded")
    parser.add_argument("--seed", type=int, default=10_000)
    parser.add_argument("--seeds", type=int, default=200)
    options = parser.parse_args()
    robot, domain = ROBOTS[options.robot], resolve(domain=options.domain)
    policy = load_policy(options.controller, robot)
    with jax.enable_x64(True):
        seeds = range(options.seed, options.seed + options.seeds)
        scenarios = [known_scenario(domain, robot, seed) for seed in seeds]
    told = held(policy, scenarios, domain.depth)
    judged = judge(make_controller(policy), robot, "sim2real", options.seeds, seed=options.seed, domain=domain)
    runs = judged.runs
    own = np.array([run.success for run in runs])
    ranges = np.array([holding_range(each.parameters, robot) for each in scenarios])
    print("| error that the motor brings back (rad) | plants | held, told all | swing-ups, told nothing |")
    print("|---|---:|---:|---:|")
    for low, high in itertools.pairwise(BOUNDS):
        within = (ranges >= low) & (ranges < high)
        print(f"| {low:g} to {high:g} | {within.sum()} | {told[within].sum()} | {own[within].sum()} |")
    print(f"| **all** | {len(ranges)} | **{told.sum()}** | **{own.sum()}** |")


if __name__ == "__main__":
    main()
