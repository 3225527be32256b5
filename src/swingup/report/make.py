"""Compute everything that a report shows of a robot."""

from collections.abc import Mapping
from typing import Any

from ..benchmark.disturbances import make_disturbance
from ..benchmark.evaluate import evaluate
from ..benchmark.leaderboard import entrants_for, leaderboard
from ..benchmark.rollout import Trajectory
from ..benchmark.rules import PushRules
from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot, leaderboard_parameters
from ..policy.jax_backend.controller import shipped_policy
from ..tasks.disturbance import Disturbance
from .content import Section, Show

THINNING = 5
"""Of the 500 rows a second every fifth is kept."""

VELOCITY_NOISE = 0.05
"""Noise of the disturbed swing-ups' velocity measurements (rad/s)."""
TORQUE_NOISE = 0.2
"""Noise of their torque (N m)."""
SHOW_PUSHES = PushRules(amplitude=(0.5, 3.0))
"""Their pushes: as many as on the robustness board, and up to 3 N m instead of 5."""


def make_section(robot: Robot | str, controllers: Mapping[str, Any] | None = None, seed: int = 0) -> Section:
    """Judge the paper's controllers and others on one robot.

    Args:
        robot: which joint is driven.
        controllers: controllers by name that enter beside the paper's four.
        seed: of the noise and the pushes.

    Raises:
        SwingupError: there is no such robot. A controller that fails gets a note.
    """
    robot = get_robot(robot)
    entrants = entrants_for(robot, controllers or {})
    return Section(
        robot=robot.name,
        parameters=leaderboard_parameters(robot),
        boards=leaderboard(robot, controllers, seed=seed),
        shows=[make_show(name, controller, robot, seed) for name, controller in entrants.items()],
        disturbance=describe_disturbance(seed),
        policy=shipped_policy(robot)[0],
    )


def make_show(name: str, controller: Any, robot: Robot, seed: int) -> Show:
    """Simulate one controller clean and disturbed; what fails is left out and noted."""
    runs: dict[str, Trajectory | None] = {}
    notes: dict[str, None] = {}
    for run, disturbance in (("clean", None), ("disturbed", disturb(seed))):
        try:
            runs[run] = thin(evaluate(controller, robot, name, disturbance=disturbance).trajectory)
        except SwingupError as error:
            runs[run] = None
            notes[str(error)] = None
    return Show(name, runs["clean"], runs["disturbed"], "; ".join(notes) or None)


def disturb(seed: int) -> Disturbance:
    """The disturbance of the page's disturbed swing-ups, the same for each controller."""
    return make_disturbance(velocity_noise=VELOCITY_NOISE, torque_noise=TORQUE_NOISE, pushes=SHOW_PUSHES, seed=seed)


def describe_disturbance(seed: int) -> str:
    """The disturbance of the page's disturbed swing-ups in one sentence."""
    low, high = SHOW_PUSHES.amplitude
    return (
        f"Disturbed means Gaussian noise on the measured velocities ({VELOCITY_NOISE:g} rad/s) and on the torque "
        f"({TORQUE_NOISE:g} N m), and {SHOW_PUSHES.pushes} random pushes of {low:g} to {high:g} N m on the driven joint "
        f"(seed {seed}), the same for each controller."
    )


def thin(trajectory: Trajectory) -> Trajectory:
    """Every fifth row: 100 a second are enough to look at."""
    return Trajectory(trajectory.time[::THINNING], trajectory.x[::THINNING], trajectory.u[::THINNING])
