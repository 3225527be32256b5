"""A minute on a simulated robot by the rules of a real one's board: its scenario, and its recorded uptime."""

import dataclasses

import jax
import numpy as np

from ..loop.domain import Domain
from ..loop.draw import draw
from ..loop.supervisors.cell import Cell, example_disturbances
from ..loop.supervisors.limits import Stop
from ..loop.supervisors.resets import Resets, ResetSupervisor
from ..plant.plant import Plant
from ..plant.robots import Robot
from .criteria import time_up
from .rollout import Scenario, Trajectory
from .rules import UptimeRules


def robot_minute(rules: UptimeRules, domain: Domain, robot: Robot, seed: int) -> Scenario:
    """A plant and a loop drawn from the domain, with drawn throws or disturbances; call it in 64-bit mode.

    Both motors have a torque limit: a controller has to command 0 on its passive joint itself, or no more than the
    compensation of its friction.
    """
    parameters, disturbance = draw(domain, jax.random.key(seed), robot)
    cell = rules.cell is not None
    limit = max(float(parameters.tl1), float(parameters.tl2)) if cell else rules.thrower.limit
    parameters = dataclasses.replace(parameters, tl1=limit, tl2=limit)
    supervisor = draw_cell(rules, domain.base, seed) if cell else draw_resets(rules, domain.base, seed)
    return Scenario(parameters, disturbance, supervisor=supervisor, substeps=domain.substeps)


def draw_resets(rules: UptimeRules, model: Plant, seed: int) -> ResetSupervisor:
    """Random resets: when they are planned, and where they aim.

    The PID compensates the gravity of the nominal model, whatever the plant.
    """
    assert rules.limits is not None
    assert rules.stop is not None
    random = np.random.default_rng(seed)
    plan = np.linspace(rules.first, rules.duration - rules.first, rules.throws)
    plan = plan + random.uniform(-rules.jitter, rules.jitter, rules.throws)
    target = random.uniform(-np.pi, np.pi, (rules.goals or rules.throws, 2))
    resets = Resets(plan, target, rules.throw_duration, rules.clean, rules.limits, rules.thrower, model)
    return ResetSupervisor(resets, Stop(rules.stop))


def draw_cell(rules: UptimeRules, model: Plant, seed: int) -> Cell:
    """The disturbances of a CloudPendulum cell in a random order; moves compensate the nominal model's gravity."""
    assert rules.cell is not None
    assert rules.stop is not None
    return Cell(example_disturbances(np.random.default_rng(seed)), rules.cell, model, Stop(rules.stop))


def recorded_share(record: Trajectory, plant: Plant, rules: UptimeRules) -> float:
    """Time up over the duration of the rules, of what the robot recorded; time in throws counts as well."""
    time, x = np.asarray(record.time), np.asarray(record.x)
    return time_up(time, x, float(plant.l1), float(plant.l2), rules.height) / rules.duration
