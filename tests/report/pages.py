"""Reports made from real policies and cheap controllers, for the tests of the page."""

import json
import re

import numpy as np
import pytest

from policies import lone_policy
from swingup.benchmark.boards import BOARDS
from swingup.benchmark.leaderboard import OURS, Row, Table, published_rows
from swingup.benchmark.rollout import Trajectory
from swingup.controllers.stack.policy import policy_of
from swingup.plant.plant import LEADERBOARD, ROBOTS, Robot
from swingup.report.page import LIVE_NOTE, Section, Show, describe_disturbance, make_show

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
    published, columns = published_rows(robot, measure), BOARDS[measure].columns
    ours = [
        Row("ar-eapo", OURS, dict(published[0].values)),
        Row(NASTY, OURS, dict.fromkeys(columns) | {"score": 0.0}, "it is <b>not</b> a controller"),
    ]
    rows = sorted([*published, *ours], key=lambda row: -(row.values["score"] or 0.0))
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
    for measure, value in (("performance", 0.5), ("robustness", 80.0)):  # bars to hover over, in percent
        values = dict.fromkeys(BOARDS[measure].columns, value)
        rows = tuple(Row(name, OURS if k % 2 else name, values, name) for k, name in enumerate(EVIL))
        tables.append(Table("acrobot", measure, tuple(values), 0, rows))
    shows = [Show(name, STILL, name) for name in EVIL]
    return Section("acrobot", LEADERBOARD.driven(ROBOTS["acrobot"]), tables, shows, f"Disturbed {EVIL[0]}")


def parts_of(html):
    """The text around the scripts and styles of a page that stands alone, and its data, in numbers of JSON."""
    markup = re.sub(r"<script.*?</script>|<style.*?</style>", "", html, flags=re.DOTALL)
    assert not re.search(r"""\b(src|href|action)=["'](?!#|data:)""", markup)
    assert len(re.findall("</script>", html)) == 2  # nothing inside a script ends it
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL).group(1)
    return markup, json.loads(data, parse_constant=lambda name: pytest.fail(f"{name} in the page's data"))
