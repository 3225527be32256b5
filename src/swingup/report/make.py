"""What the page of a robot shows, computed: its boards and the swing-ups of each controller."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..benchmark.board import AbstractBoard
from ..benchmark.disturbances import DisturbanceSettings
from ..benchmark.judge import judge
from ..benchmark.leaderboard import DEFAULT_BOARDS, ENTRANTS, OURS, RowProgress, Table, entrants_for, leaderboard
from ..benchmark.rollout import Trajectory
from ..benchmark.rules import PushRules
from ..common.errors import SwingupError
from ..common.text import one_line
from ..controllers.registry import get_controller
from ..controllers.stack.controller import PolicyController, policy_of
from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from ..plant.units import scaled, scales_of
from ..policy.pendulum import PARTS, PendulumPolicy
from ..policy.plant_facts import policy_plant
from ..policy.shipped import AR_EAPO, DEFAULT, load_policy

SHOWN_CONTROLLERS = (DEFAULT, *ENTRANTS)
"""Controllers whose swing-ups the page shows: the default one and the paper's."""
SHIPPED = (DEFAULT, AR_EAPO)
"""Shipped policies beside one that was trained just now."""
PUBLISHED = (("AR-EAPO", "paper"), ("TVLQR", "paper"), ("History SAC", "board"))
"""Published rows beside it: the paper's method, its best baseline, and the best of the public leaderboard."""

LIVE_NOTE = (
    f"This policy is the network of {DEFAULT} alone, for this page's plant: its estimator, identifier and "
    "regulator, which run in Python and C only, are not in this page."
)
"""What the page says of the policy that drives the live pendulum."""

THINNING = 5
"""Every fifth of the benchmark's 500 rows a second: a film of 100 rows a second still looks smooth."""
VELOCITY_NOISE, TORQUE_NOISE, PUSHES = 0.05, 0.2, PushRules(amplitude=(0.5, 3.0))
"""What disturbs the disturbed swing-ups (rad/s, N m): as many pushes as on the robustness board, up to 3 N m."""


@dataclass(frozen=True)
class Show:
    """One controller's recorded swing-ups."""

    name: str
    clean: Trajectory | None
    """Without a disturbance; None if the controller failed."""
    disturbed: Trajectory | None
    """With the section's disturbance; None if the controller failed."""
    note: str | None = None
    """Why a trajectory is missing, or another remark."""


@dataclass(frozen=True)
class Section:
    """What the page shows about one robot."""

    robot: str
    plant: Plant
    """A torque limit of 0 makes a joint passive."""
    tables: Sequence[Table]
    shows: Sequence[Show]
    disturbance: str
    """What disturbs the disturbed trajectories, in one sentence."""
    policy: PendulumPolicy | None = None
    """Drives the live pendulum; without a policy the page has no live pendulum."""
    policy_note: str | None = None
    """Which policy that is, in one sentence; None for nothing to say."""


def make_section(
    robot: Robot | str,
    controllers: Mapping[str, Any] | None = None,
    seed: int = 0,
    progress: RowProgress | None = None,
    entrants: Sequence[str] = SHOWN_CONTROLLERS,
    plant: PlantLike = LEADERBOARD,
    boards: Sequence[AbstractBoard | str] = DEFAULT_BOARDS,
    recompute: bool = False,
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
        boards: the boards of the tables.
        recompute: also compute the rows that the package ships because they take minutes.

    Raises:
        SwingupError: there is no such robot or plant. A controller that fails gets a note.
    """
    robot, found = get_robot(robot), load_plant(plant)
    shown = entrants_for(robot, controllers or {}, entrants, plant=found)

    def tell(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(f"{robot.name}: {one_line(stage)}", done, total)

    tables = leaderboard(robot, controllers, boards, seed, recompute, progress=tell, plant=found)
    # The shipped policy that sees its plant, told the page's, without what a page cannot run.
    alone: dict[str, Any] = dict.fromkeys(PARTS)
    live = replace(load_policy(DEFAULT, robot), plant=policy_plant(found, robot), **alone)
    shows = _make_shows(shown, robot, seed, found, tell)
    tell("finished", len(shows), len(shown))
    told = describe_disturbance(seed, found)
    return Section(robot.name, found.driven(robot), tables, shows, told, live, LIVE_NOTE)


def trained_section(
    robot: Robot, policies: Mapping[str, PolicyController], progress: RowProgress = lambda *_: None
) -> Section:
    """Score a policy that was trained just now beside known ones, and simulate their swing-ups.

    The first policy drives the live pendulum and enters the board.
    """
    name, policy = next(iter(policies.items()))
    shipped = {each: get_controller(each, robot) for each in SHIPPED}
    # Not as the boards' own entrants, which enter a second time without their estimators.
    (table,) = leaderboard(robot, {name: policy, **shipped}, ("performance",), entrants=(), progress=progress)
    rows = tuple(row for row in table.rows if row.source == OURS or (row.controller, row.source) in PUBLISHED)
    shows = _make_shows({**policies, **shipped}, robot, 0, LEADERBOARD, progress)
    tables, told = [replace(table, rows=rows)], describe_disturbance(0)
    return Section(robot.name, LEADERBOARD.driven(robot), tables, shows, told, policy_of(policy))


def _make_shows(
    controllers: Mapping[str, Any], robot: Robot, seed: int, plant: Plant, tell: Callable[[str, int, int], None]
) -> list[Show]:
    shows: list[Show] = []
    for name, controller in controllers.items():
        tell(f"swing-ups of {name}", len(shows), len(controllers))
        shows.append(make_show(name, controller, robot, seed, plant))
    return shows


def make_show(name: str, controller: Any, robot: Robot, seed: int, plant: Plant = LEADERBOARD) -> Show:
    """Simulate one controller without and with a disturbance; a failed run becomes a note."""
    runs: dict[str, Trajectory | None] = {}
    notes: dict[str, None] = {}
    for run, disturbance in (("clean", None), ("disturbed", disturb(plant))):
        try:
            result = judge(controller, robot, seed=seed, name=name, disturbance=disturbance, plant=plant)
            assert result.trajectory is not None
            time, x, u = result.trajectory.time, result.trajectory.x, result.trajectory.u
            runs[run] = Trajectory(time[::THINNING], x[::THINNING], u[::THINNING])
        except SwingupError as error:
            runs[run] = None
            notes[str(error)] = None
    return Show(name, **runs, note="; ".join(notes) or None)


def describe_disturbance(seed: int, plant: Plant = LEADERBOARD) -> str:
    """The disturbance of the page's disturbed swing-ups in one sentence."""
    found = disturb(plant)
    assert found.pushes is not None
    low, high = found.pushes.amplitude
    return (
        f"Disturbed means Gaussian noise on the measured velocities ({found.velocity_noise:.3g} rad/s) and on the "
        f"torque ({found.torque_noise:.3g} N m), and {found.pushes.pushes} random pushes of {low:.3g} to "
        f"{high:.3g} N m on the driven joint (seed {seed}), the same for each controller."
    )


def disturb(plant: Plant) -> DisturbanceSettings:
    """The disturbance in the units of a plant."""
    scales = scales_of(plant)
    velocity_noise, torque_noise = VELOCITY_NOISE * scales.velocity, TORQUE_NOISE * scales.torque
    return DisturbanceSettings(velocity_noise, torque_noise, pushes=scaled(PUSHES, scales))
