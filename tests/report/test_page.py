"""The page as text: what it holds, what it refuses, and that it stands alone."""

import base64
import re

import numpy as np
import pytest

from swingup.benchmark.rollout import Trajectory
from swingup.common.errors import one_line
from swingup.plant.plant import LEADERBOARD, ROBOTS
from swingup.report.page import Section, Show, render_page

from .pages import EVIL, NASTY, make_evil_section, parts_of

ACROBOT = ROBOTS["acrobot"]


@pytest.fixture(scope="module")
def html(sections):
    return render_page(sections[:1], title="Tables & <plots>")


def test_the_page_stands_alone_and_is_small(html):
    assert len(html.encode()) < 1e6
    assert "@import" not in html
    assert re.search(r"Content-Security-Policy\" content=\"default-src 'none'", html)
    # Names and remarks are text; a controller without runs has a note and no player.
    assert "&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt; $$x^2$$" in html
    assert "<title>Tables &amp; &lt;plots&gt;</title>" in html
    assert "<b>broken</b>: It&#39;s &lt;i&gt;broken&lt;/i&gt;." in html
    assert [show["name"] for show in parts_of(html)[1]["sections"][0]["shows"]] == ["ar-eapo", NASTY]


def test_rows_from_the_first_that_is_not_finite_on_are_cut():
    for row, value in ((7, np.nan), (7, np.inf), (7, 1e300), (0, np.nan)):
        trajectory = Trajectory(0.01 * np.arange(20), np.zeros((20, 4)), np.zeros((20, 2)))
        trajectory.x[row, 2] = value
        shows = [Show("wild", {"undisturbed": trajectory}, "It went wild.")]
        html = render_page([Section("acrobot", LEADERBOARD.driven(ACROBOT), [], shows, "Nothing.")])
        _, data = parts_of(html)
        shown = [show["runs"] for show in data["sections"][0]["shows"]]
        lengths = [len(base64.b64decode(data["arrays"][runs["undisturbed"]["time"]])) // 4 for runs in shown]
        assert lengths == [7] * (row > 0)
        assert not any("disturbed" in runs for runs in shown)
        assert "It went wild." in html


def test_foreign_names_are_escaped_everywhere():
    html = render_page([make_evil_section()], title=EVIL[0])
    own = html[: html.index('<script type="application/json"')]
    assert "attacked" in own
    assert not re.search(r"<script|<img|onmouseover='", own)
    assert all(letter.isprintable() or letter == "\n" for letter in own)
    assert "line break and \\u202e separators" in own
    shown = [show["name"] for show in parts_of(html)[1]["sections"][0]["shows"]]
    assert shown == [one_line(name) for name in EVIL]
    html.encode("utf-8")  # no lone surrogate is left
