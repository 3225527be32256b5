"""A controller's simulated run beside a recorded one."""

from dataclasses import asdict, dataclass, replace
from typing import Any

import jax
import numpy as np

from ..benchmark.criteria import Criteria, TipHistory, follow_tip, judge
from ..benchmark.rollout import Scenario, Trajectory
from ..benchmark.rules import PERFORMANCE_RULES, PerformanceRules
from ..benchmark.runner import prepare, run_one
from ..common.errors import SwingupError
from ..identification.log.recording import Recording
from ..loop.domain import Domain
from ..loop.draw import draw
from ..plant.robots import ROBOTS, Robot

LONGEST = 120.0
"""Longest simulated run (s)."""
DOMINANT = 3.0
"""A joint whose largest torque is this many times the other's is the driven one."""
HANGING = 0.2
"""Largest angle (rad) of a start that counts as hanging."""


@dataclass(frozen=True)
class Run:
    """One run and how it is judged, by the rules of the real robot's board and for the log's duration."""

    trajectory: Trajectory
    criteria: Criteria
    tip: TipHistory
    speed: float
    """Largest speed of a joint (rad/s)."""

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {**asdict(self.criteria), **self.tip.as_dict(), "speed": self.speed}


@dataclass(frozen=True)
class ClosedLoop:
    """The recorded run, and the controller's on a simulated plant in its loop."""

    controller: str
    robot: Robot
    domain: Domain
    recorded: Run
    simulated: Run

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "controller": self.controller,
            "robot": self.robot.name,
            "domain": {"name": self.domain.name} | self.domain.as_dict(),
            "recorded": self.recorded.as_dict(),
            "simulated": self.simulated.as_dict(),
        }


def driven_robot(recording: Recording) -> Robot:
    """The robot of a log: its joint with torque, or with most of it where friction of the other is compensated.

    Raises:
        SwingupError: the log has no torque, or both joints have much.
    """
    size = np.abs(recording.u).max(axis=0)
    joint = int(size.argmax())
    if size[joint] == 0.0 or size[joint] < DOMINANT * size[1 - joint]:
        seen = "has no torque" if size[joint] == 0.0 else "drives both joints"
        raise SwingupError(f"{recording.name} {seen}: say --robot acrobot or pendubot for the closed loop")
    return next(robot for robot in ROBOTS.values() if robot.joint == joint)


def close_loop(
    recording: Recording, controller: Any, name: str, robot: Robot, domain: Domain, seed: int = 0
) -> ClosedLoop:
    """Run a controller from hanging at rest on a plant in its loop, for as long as the log lasts.

    Args:
        recording: the log.
        controller: a controller in JAX, an object with ``get_control_output(x, t)`` or a function of (x, t).
        name: of the controller in the result.
        robot: which joint is driven.
        domain: plant and loop; one is drawn from its ranges.
        seed: of all that is drawn.

    Raises:
        SwingupError: the controller is for the other robot, or fails.
    """
    rules = replace(PERFORMANCE_RULES["hardware"], duration=min(recording.duration, LONGEST))
    with jax.enable_x64(True):
        scenario = Scenario(*draw(domain, jax.random.key(seed), robot), substeps=domain.substeps)
    rows = run_one(prepare(controller, robot, name), scenario, rules.dt, rules.steps, domain.depth)
    measured = Trajectory(recording.time, np.concatenate([recording.q, recording.dq], axis=1), recording.u)
    lengths = float(scenario.parameters.l1), float(scenario.parameters.l2)
    return ClosedLoop(name, robot, domain, _judged(measured, lengths, rules), _judged(rows, lengths, rules))


def starts_hanging(recording: Recording) -> bool:
    """Whether a log begins near hanging."""
    return bool(np.abs(recording.q[0]).max() < HANGING)


def _judged(rows: Trajectory, lengths: tuple[float, float], rules: PerformanceRules) -> Run:
    time, x, u = (np.asarray(part) for part in (rows.time, rows.x, rows.u))
    criteria, tip = judge(time, x, u, *lengths, rules), follow_tip(time, x, *lengths, rules)
    return Run(rows, criteria, tip, float(np.abs(x[:, 2:]).max()))
