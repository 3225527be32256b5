"""Compute what the page of a policy shows that was trained just now: its swing-ups and score beside known ones."""

from collections.abc import Mapping
from dataclasses import replace

from ..benchmark.leaderboard import OURS, RowProgress, Table, leaderboard
from ..controllers.registry import get_controller
from ..controllers.stack.controller import PolicyController, policy_of
from ..plant.plant import LEADERBOARD
from ..plant.robots import Robot
from ..policy.shipped import AR_EAPO, DEFAULT
from .make import describe_disturbance, make_show
from .page import Section, Show

SHIPPED = (DEFAULT, AR_EAPO)
"""Shipped policies beside the new one."""
PUBLISHED = (("AR-EAPO", "paper"), ("TVLQR", "paper"), ("History SAC", "board"))
"""Published rows beside it: the paper's method, its best baseline, and the best of the public leaderboard."""


def trained_section(
    robot: Robot, policies: Mapping[str, PolicyController], progress: RowProgress | None = None, seed: int = 0
) -> Section:
    """Score policies on one robot, and simulate their swing-ups.

    Args:
        robot: which joint is driven.
        policies: by name; the first one drives the live pendulum and enters the board.
        progress: called with the name of a stage, the number of its finished parts, and of all.
        seed: of the noise and the pushes of the disturbed swing-ups.
    """
    name, policy = next(iter(policies.items()))
    shown = {**policies, **{each: get_controller(each, robot) for each in SHIPPED}}
    table = trained_table(robot, name, policy, progress)
    shows: list[Show] = []
    for each, controller in shown.items():
        if progress is not None:
            progress(f"swing-ups of {each}", len(shows), len(shown))
        shows.append(make_show(each, controller, robot, seed))
    return Section(
        robot=robot.name,
        plant=LEADERBOARD.driven(robot),
        tables=[table],
        shows=shows,
        disturbance=describe_disturbance(seed),
        policy=policy_of(policy),
    )


def trained_table(robot: Robot, name: str, policy: PolicyController, progress: RowProgress | None = None) -> Table:
    """The performance board with a policy, the shipped ones, and the published rows that matter most."""
    # Not as the boards' own entrants, which enter a second time without their estimators.
    policies = {name: policy, **{each: get_controller(each, robot) for each in SHIPPED}}
    (table,) = leaderboard(robot, policies, ("performance",), entrants=(), progress=progress)
    rows = tuple(row for row in table.rows if row.source == OURS or (row.controller, row.source) in PUBLISHED)
    return replace(table, rows=rows)
