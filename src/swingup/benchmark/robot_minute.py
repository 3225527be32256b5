"""A minute on the simulated robot by the rules of ICRA 2025's real one: its scenario, and its recorded uptime."""

import dataclasses

import jax
import numpy as np

from ..physics.parameters import Parameters, Robot, leaderboard_parameters
from ..plants.domain import Domain
from ..tasks.draw import draw
from ..tasks.limits import Stop
from ..tasks.resets import Resets, ResetSupervisor
from .criteria import tip_is_up
from .rollout import Scenario, Trajectory
from .rules import UptimeRules


def robot_minute(rules: UptimeRules, domain: Domain, robot: Robot, seed: int) -> Scenario:
    """A plant and a loop drawn from the domain, with drawn resets; call it in 64-bit mode.

    Both motors have the torque limit of the rules: a controller has to command 0 on its passive joint itself, or no
    more than the compensation of its friction.
    """
    parameters, disturbance = draw(domain, jax.random.key(seed), robot)
    limit = rules.thrower.limit
    parameters = dataclasses.replace(parameters, tl1=limit, tl2=limit)
    return Scenario(parameters, disturbance, supervisor=draw_resets(rules, robot, seed), substeps=domain.substeps)


def draw_resets(rules: UptimeRules, robot: Robot, seed: int) -> ResetSupervisor:
    """Random resets: when they are planned, and where they aim.

    The PID compensates the gravity of the nominal model, whatever the plant.
    """
    assert rules.limits is not None
    assert rules.stop is not None
    random = np.random.default_rng(seed)
    plan = np.linspace(rules.first, rules.duration - rules.first, rules.throws)
    plan = plan + random.uniform(-rules.jitter, rules.jitter, rules.throws)
    target = random.uniform(-np.pi, np.pi, (rules.goals or rules.throws, 2))
    model = leaderboard_parameters(robot)
    resets = Resets(plan, target, rules.throw_duration, rules.clean, rules.limits, rules.thrower, model)
    return ResetSupervisor(resets, Stop(rules.stop))


def recorded_share(record: Trajectory, plant: Parameters, rules: UptimeRules) -> float:
    """Time up over the duration of the rules, of what the robot recorded; time in throws counts as well."""
    time, x = np.asarray(record.time), np.asarray(record.x)
    up = tip_is_up(x, float(plant.l1), float(plant.l2), rules.height)
    # A row counts with the time before it, as in a recording.
    return float(np.diff(time, prepend=time[0])[up].sum()) / rules.duration
