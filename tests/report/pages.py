"""Reports made from real policies and cheap controllers, for the tests of the page."""

import numpy as np

from policies import lone_policy
from swingup.benchmark.boards import BOARDS
from swingup.benchmark.leaderboard import OURS, Row, Table, published_rows
from swingup.benchmark.rollout import Trajectory
from swingup.controllers.stack.controller import policy_of
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import ROBOTS, Robot
from swingup.report.make import LIVE_NOTE, Section, Show, describe_disturbance, make_show

NASTY = "</script><img src=x onerror=alert(1)> $$x^2$$"
"""A controller's name that must be shown as it is."""

EVIL = (
    "</script><script>window.attacked = 1</script>",
    '"><img src=x onerror="window.attacked = 2">',
    "' onmouseover='window.attacked = 3",
    "<!--<script>",
    "{{ 7 * 7 }}{% raw %}",
    "line\nbreak\r\tand \u2028 \u202e separators",
    "\x00\x1b[31mcontrol",
    "\udcff not UTF-8",
    "$$\\href{javascript:window.attacked=4}{x}$$",
    "@percent{safe}<b>",
    "\\u003cimg src=x onerror=window.attacked=5>",
    "&lt;img src=x onerror=window.attacked=6&gt;",
)
"""Names that attack the markup, the scripts, the plots or the terminal."""

HANGING = Trajectory(0.01 * np.arange(1000), np.zeros((1000, 4)), np.zeros((1000, 2)))
STILL = {"undisturbed": HANGING, "disturbed": HANGING}


def make_board(robot: Robot, measure: str) -> Table:
    """A board with made-up rows of ours beside the published ones."""
    published = published_rows(robot, measure)
    score = "score"
    ours = [
        Row("ar-eapo", OURS, dict(published[0].values)),
        Row(NASTY, OURS, dict.fromkeys(BOARDS[measure].columns) | {score: 0.0}, "it is <b>not</b> a controller"),
    ]
    rows = sorted([*published, *ours], key=lambda row: -(row.values[score] or 0.0))
    columns = BOARDS[measure].columns
    return Table(robot.name, measure, columns, 0 if measure == "robustness" else None, tuple(rows))


def make_section(robot: Robot) -> Section:
    """A section with the shipped policy, which the acrobot's alone plays, one that hangs and one that fails."""
    policy = lone_policy("ar-eapo", robot)[0]
    plays = make_show("ar-eapo", policy, robot, 0) if robot.joint == 1 else Show("ar-eapo", STILL)
    return Section(
        robot=robot.name,
        plant=LEADERBOARD.driven(robot),
        tables=[make_board(robot, measure) for measure in ("performance", "robustness")],
        shows=[plays, Show(NASTY, STILL), Show("broken", {}, "It's <i>broken</i>.")],
        disturbance=describe_disturbance(0),
        policy=policy_of(policy),
        policy_note=LIVE_NOTE,
    )


def make_evil_section() -> Section:
    """A section whose names, sources, remarks and notes all attack."""
    tables = []
    for measure in ("performance", "robustness"):
        value = 80.0 if measure == "robustness" else 0.5  # bars to hover over, in percent
        rows = [
            Row(name, OURS if k % 2 else name, dict.fromkeys(BOARDS[measure].columns, value), name)
            for k, name in enumerate(EVIL)
        ]
        tables.append(Table("acrobot", measure, BOARDS[measure].columns, 0, tuple(rows)))
    shows = [Show(name, STILL, name) for name in EVIL]
    parameters = LEADERBOARD.driven(ROBOTS["acrobot"])
    return Section("acrobot", parameters, tables, shows, f"Disturbed {EVIL[0]}")
