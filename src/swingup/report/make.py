"""What the page of a robot shows, computed: its boards and the swing-ups of each controller."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..benchmark.board import AbstractBoard
from ..benchmark.disturbances import DisturbanceSettings
from ..benchmark.judge import judge
from ..benchmark.leaderboard import DEFAULT_BOARDS, ENTRANTS, OURS, Table, entrants_for, leaderboard
from ..benchmark.rollout import Trajectory
from ..benchmark.rules import PushRules
from ..benchmark.runner import StageProgress
from ..common.errors import SwingupError, one_line
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
DISTURBANCE = DisturbanceSettings(velocity_noise=0.05, torque_noise=0.2, pushes=PushRules(amplitude=(0.5, 3.0)))
"""What disturbs the disturbed swing-ups (rad/s, N m): as many pushes as on the robustness board, up to 3 N m."""


@dataclass(frozen=True)
class Show:
    """One controller's recorded swing-ups."""

    name: str
    runs: Mapping[str, Trajectory]
    """``undisturbed``, and ``disturbed`` as the section says: those in which the controller did not fail."""
    note: str | None = None
    """Why a run is missing, or another remark."""


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
    progress: StageProgress | None = None,
    entrants: Sequence[str] = SHOWN_CONTROLLERS,
    plant: PlantLike = LEADERBOARD,
    boards: Sequence[AbstractBoard | str] = DEFAULT_BOARDS,
    recompute: bool = False,
) -> Section:
    """Score controllers on one robot, and simulate the swing-ups of the built-in ``entrants``: it takes minutes.

    ``progress`` is called with the name of a stage, the number of its finished parts, and of all. A stage is a row
    of a board or a controller's swing-ups; its name begins with the robot's. The plant is what the page shows, and
    the baselines are designed for. ``recompute`` is for rows that the package ships because they take minutes.
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
    shows, disturbance = make_shows(shown, robot, seed, found, tell), describe_disturbance(seed, found)
    return Section(robot.name, found.driven(robot), tables, shows, disturbance, live, LIVE_NOTE)


def trained_section(
    robot: Robot, policies: Mapping[str, PolicyController], progress: StageProgress = lambda *_: None
) -> Section:
    """Score a policy that was trained just now beside known ones, and simulate their swing-ups.

    The first policy drives the live pendulum and enters the board.
    """
    name, policy = next(iter(policies.items()))
    shipped = {each: get_controller(each, robot) for each in SHIPPED}
    # Not as the boards' own entrants, which enter a second time without their estimators.
    (table,) = leaderboard(robot, {name: policy, **shipped}, ("performance",), entrants=(), progress=progress)
    rows = tuple(row for row in table.rows if row.source == OURS or (row.controller, row.source) in PUBLISHED)
    tables, plant = [replace(table, rows=rows)], LEADERBOARD.driven(robot)
    shows = make_shows({**policies, **shipped}, robot, 0, LEADERBOARD, progress)
    return Section(robot.name, plant, tables, shows, describe_disturbance(0), policy_of(policy))


def make_shows(
    controllers: Mapping[str, Any], robot: Robot, seed: int, plant: Plant, tell: StageProgress
) -> list[Show]:
    """Simulate several controllers, one after another."""
    shows: list[Show] = []
    for name, controller in controllers.items():
        tell(f"swing-ups of {name}", len(shows), len(controllers))
        shows.append(make_show(name, controller, robot, seed, plant))
    tell("finished", len(shows), len(controllers))
    return shows


def make_show(name: str, controller: Any, robot: Robot, seed: int, plant: Plant = LEADERBOARD) -> Show:
    """Simulate one controller without and with a disturbance; a failed run becomes a note."""
    runs: dict[str, Trajectory] = {}
    notes: dict[str, None] = {}
    for run, disturbance in (("undisturbed", None), ("disturbed", scaled(DISTURBANCE, scales_of(plant)))):
        try:
            found = judge(controller, robot, seed=seed, name=name, disturbance=disturbance, plant=plant).trajectory
        except SwingupError as error:
            notes[str(error)] = None
        else:
            assert found is not None
            runs[run] = found.take(slice(None, None, THINNING))
    return Show(name, runs, "; ".join(notes) or None)


def describe_disturbance(seed: int, plant: Plant = LEADERBOARD) -> str:
    """The disturbance of the page's disturbed swing-ups in one sentence."""
    found = scaled(DISTURBANCE, scales_of(plant))
    assert found.pushes is not None
    low, high = found.pushes.amplitude
    return (
        f"Disturbed means Gaussian noise on the measured velocities ({found.velocity_noise:.3g} rad/s) and on the "
        f"torque ({found.torque_noise:.3g} N m), and {found.pushes.pushes} random pushes of {low:.3g} to "
        f"{high:.3g} N m on the driven joint (seed {seed}), the same for each controller."
    )
