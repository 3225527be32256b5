"""Compute what a report shows of a robot: its boards and the swing-ups of each controller."""

from collections.abc import Mapping, Sequence
from typing import Any

from ..benchmark.disturbances import make_disturbance
from ..benchmark.evaluate import evaluate
from ..benchmark.leaderboard import ENTRANTS, RowProgress, entrants_for, leaderboard
from ..benchmark.rollout import Trajectory
from ..benchmark.rules import PushRules
from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot
from ..plants.plant import Plant, PlantLike, find_plant, robot_parameters
from ..policy.jax_backend.controller import shipped_policy
from ..policy.shipped import REFINED
from ..tasks.disturbance import Disturbance
from ..text import one_line
from .content import Section, Show

SHOWN_CONTROLLERS = (REFINED, *ENTRANTS)
"""Controllers whose swing-ups the page shows: the default one and the paper's."""

THINNING = 5
"""Every fifth of the benchmark's 500 rows a second: a film of 100 rows a second still looks smooth."""

VELOCITY_NOISE = 0.05
"""Noise of the disturbed swing-ups' velocity measurements (rad/s)."""
TORQUE_NOISE = 0.2
"""Noise of their torque (N m)."""
SHOW_PUSHES = PushRules(amplitude=(0.5, 3.0))
"""Their pushes: as many as on the robustness board, and up to 3 N m instead of 5."""


def make_section(
    robot: Robot | str,
    controllers: Mapping[str, Any] | None = None,
    seed: int = 0,
    progress: RowProgress | None = None,
    entrants: Sequence[str] = SHOWN_CONTROLLERS,
    plant: PlantLike | None = None,
) -> Section:
    """Score controllers on one robot, and simulate their swing-ups.

    Args:
        robot: which joint is driven.
        controllers: further controllers by name.
        seed: of the noise and the pushes.
        progress: called with the name of a stage, the number of its finished parts, and of all; a robot takes
            minutes. A stage is a row of a board or a controller's swing-ups; its name begins with the robot's.
        entrants: names of the built-in controllers whose swing-ups are shown; the boards have their own.
        plant: what the page shows, and the baselines are designed for: a plant, its parameters, its name or its
            file; None for the leaderboards'.

    Raises:
        SwingupError: there is no such robot or plant. A controller that fails gets a note.
    """
    robot, found = get_robot(robot), find_plant(plant)
    shown = entrants_for(robot, controllers or {}, entrants, plant=found)

    def tell(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(f"{robot.name}: {one_line(stage)}", done, total)

    boards = leaderboard(robot, controllers, seed=seed, progress=tell, plant=found)
    shows: list[Show] = []
    for name, controller in shown.items():
        tell(f"swing-ups of {name}", len(shows), len(shown))
        shows.append(make_show(name, controller, robot, seed, found))
    tell("finished", len(shows), len(shown))
    return Section(
        robot=robot.name,
        parameters=robot_parameters(found, robot),
        boards=boards,
        shows=shows,
        disturbance=describe_disturbance(seed),
        policy=shipped_policy(robot)[0],
    )


def make_show(name: str, controller: Any, robot: Robot, seed: int, plant: Plant | None = None) -> Show:
    """Simulate one controller without and with a disturbance; a failed run becomes a note."""
    runs: dict[str, Trajectory | None] = {}
    notes: dict[str, None] = {}
    for run, disturbance in (("clean", None), ("disturbed", disturb(seed))):
        try:
            result = evaluate(controller, robot, name, disturbance=disturbance, plant=plant)
            runs[run] = thin(result.trajectory)
        except SwingupError as error:
            runs[run] = None
            notes[str(error)] = None
    return Show(name, runs["clean"], runs["disturbed"], "; ".join(notes) or None)


def disturb(seed: int) -> Disturbance:
    """The disturbance of the page's disturbed swing-ups; equal seeds give equal disturbances."""
    return make_disturbance(velocity_noise=VELOCITY_NOISE, torque_noise=TORQUE_NOISE, pushes=SHOW_PUSHES, seed=seed)


def describe_disturbance(seed: int) -> str:
    """The disturbance of the page's disturbed swing-ups in one sentence."""
    low, high = SHOW_PUSHES.amplitude
    return (
        f"Disturbed means Gaussian noise on the measured velocities ({VELOCITY_NOISE:g} rad/s) and on the torque "
        f"({TORQUE_NOISE:g} N m), and {SHOW_PUSHES.pushes} random pushes of {low:g} to {high:g} N m on the driven "
        f"joint (seed {seed}), the same for each controller."
    )


def thin(trajectory: Trajectory) -> Trajectory:
    """Keep every fifth row of a trajectory."""
    return Trajectory(trajectory.time[::THINNING], trajectory.x[::THINNING], trajectory.u[::THINNING])
