"""Compute what a report shows of a robot: its boards and the swing-ups of each controller."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..benchmark.disturbances import DisturbanceSettings
from ..benchmark.judge import judge
from ..benchmark.leaderboard import ENTRANTS, RowProgress, entrants_for, leaderboard
from ..benchmark.rollout import Trajectory
from ..benchmark.rules import PushRules
from ..common.errors import SwingupError
from ..common.text import one_line
from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from ..plant.units import scaled, scales_of
from ..policy.pendulum import PARTS, PendulumPolicy
from ..policy.plant_facts import policy_plant
from ..policy.shipped import DEFAULT, load_policy
from .page import Section, Show

SHOWN_CONTROLLERS = (DEFAULT, *ENTRANTS)
"""Controllers whose swing-ups the page shows: the default one and the paper's."""

LIVE_NOTE = (
    f"This policy is the network of {DEFAULT} alone, for this page's plant: its estimator, identifier and "
    "regulator, which run in Python and C only, are not in this page."
)
"""What the page says of the policy that drives the live pendulum."""

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
    plant: PlantLike = LEADERBOARD,
) -> Section:
    """Score controllers on one robot, and simulate their swing-ups.

    Args:
        robot: which joint is driven.
        controllers: further controllers by name.
        seed: of the noise and the pushes.
        progress: called with the name of a stage, the number of its finished parts, and of all; a robot takes
            minutes. A stage is a row of a board or a controller's swing-ups; its name begins with the robot's.
        entrants: names of the built-in controllers whose swing-ups are shown; the boards have their own.
        plant: what the page shows, and the baselines are designed for: a plant, its name or its
            file.

    Raises:
        SwingupError: there is no such robot or plant. A controller that fails gets a note.
    """
    robot, found = get_robot(robot), load_plant(plant)
    shown = entrants_for(robot, controllers or {}, entrants, plant=found)

    def tell(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(f"{robot.name}: {one_line(stage)}", done, total)

    tables = leaderboard(robot, controllers, seed=seed, progress=tell, plant=found)
    shows: list[Show] = []
    for name, controller in shown.items():
        tell(f"swing-ups of {name}", len(shows), len(shown))
        shows.append(make_show(name, controller, robot, seed, found))
    tell("finished", len(shows), len(shown))
    return Section(
        robot=robot.name,
        plant=found.driven(robot),
        tables=tables,
        shows=shows,
        disturbance=describe_disturbance(seed, found),
        policy=live_policy(robot, found),
        policy_note=LIVE_NOTE,
    )


def live_policy(robot: Robot, plant: Plant) -> PendulumPolicy:
    """The shipped policy that sees its plant, told the page's plant, without what a page cannot run."""
    alone: dict[str, Any] = dict.fromkeys(PARTS)
    return replace(load_policy(DEFAULT, robot), plant=policy_plant(plant, robot), **alone)


def make_show(name: str, controller: Any, robot: Robot, seed: int, plant: Plant = LEADERBOARD) -> Show:
    """Simulate one controller without and with a disturbance; a failed run becomes a note."""
    runs: dict[str, Trajectory | None] = {}
    notes: dict[str, None] = {}
    for run, disturbance in (("clean", None), ("disturbed", disturb(plant))):
        try:
            result = judge(controller, robot, seed=seed, name=name, disturbance=disturbance, plant=plant)
            assert result.trajectory is not None
            runs[run] = thin(result.trajectory)
        except SwingupError as error:
            runs[run] = None
            notes[str(error)] = None
    return Show(name, runs["clean"], runs["disturbed"], "; ".join(notes) or None)


def disturb(plant: Plant = LEADERBOARD) -> DisturbanceSettings:
    """The disturbance of the page's disturbed swing-ups."""
    velocity_noise, torque_noise, pushes = _sizes(plant)
    return DisturbanceSettings(velocity_noise=velocity_noise, torque_noise=torque_noise, pushes=pushes)


def describe_disturbance(seed: int, plant: Plant = LEADERBOARD) -> str:
    """The disturbance of the page's disturbed swing-ups in one sentence."""
    velocity_noise, torque_noise, pushes = _sizes(plant)
    low, high = pushes.amplitude
    return (
        f"Disturbed means Gaussian noise on the measured velocities ({velocity_noise:.3g} rad/s) and on the torque "
        f"({torque_noise:.3g} N m), and {pushes.pushes} random pushes of {low:.3g} to {high:.3g} N m on the driven "
        f"joint (seed {seed}), the same for each controller."
    )


def _sizes(plant: Plant) -> tuple[float, float, PushRules]:
    """Noise of velocities and torque, and the pushes, in the units of a plant."""
    scales = scales_of(plant)
    return VELOCITY_NOISE * scales.velocity, TORQUE_NOISE * scales.torque, scaled(SHOW_PUSHES, scales)


def thin(trajectory: Trajectory) -> Trajectory:
    """Keep every fifth row of a trajectory."""
    return Trajectory(trajectory.time[::THINNING], trajectory.x[::THINNING], trajectory.u[::THINNING])
