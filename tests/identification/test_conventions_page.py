"""docs/conventions.md: each line of --columns maps another convention, whose equations are written anew here."""

import re
from pathlib import Path

import numpy as np
import pytest

import swingup
from swingup.common.columns import parse_columns
from swingup.dynamics.dynamics import acceleration
from swingup.plant.plant import LEADERBOARD as P

PAGE = Path(swingup.__file__).parents[2] / "docs" / "conventions.md"
LINES = re.findall(
    r"^\| ([^|]+) \| [^|]+ \| `([^`]+)` \|$", PAGE.read_text() if PAGE.exists() else "", re.MULTILINE
)
ROWS = 7
WEIGHT1, WEIGHT2 = (P.m1 * P.r1 + P.m2 * P.l1) * P.g, P.m2 * P.r2 * P.g
COUPLING, INERTIA1 = P.m2 * P.l1 * P.r2, P.I1 + P.m2 * P.l1**2

pytestmark = pytest.mark.skipif(not PAGE.exists(), reason="the pages are only in a checkout")


def relative(q1, q2, d1, d2, u2, pulls):
    """Spong's equations (IEEE Control Systems 15, 1995): the inertias d11, d12, d22, and the pulls phi1, phi2."""
    d11 = INERTIA1 + P.I2 + 2 * COUPLING * np.cos(q2)
    d12, d22 = P.I2 + COUPLING * np.cos(q2), P.I2
    h1 = -COUPLING * np.sin(q2) * (d2**2 + 2 * d1 * d2)
    h2 = COUPLING * np.sin(q2) * d1**2
    right = -np.stack([h1 + pulls[0], h2 + pulls[1] - u2])
    determinant = d11 * d22 - d12**2
    return np.stack([d22 * right[0] - d12 * right[1], d11 * right[1] - d12 * right[0]]) / determinant


def from_hanging(x, u):
    pull = WEIGHT2 * np.sin(x[0] + x[1])
    return relative(*x, u, (WEIGHT1 * np.sin(x[0]) + pull, pull))


def from_horizontal(x, u):
    pull = WEIGHT2 * np.cos(x[0] + x[1])
    return relative(*x, u, (WEIGHT1 * np.cos(x[0]) + pull, pull))


def from_upright(x, u):
    pull = -WEIGHT2 * np.sin(x[0] + x[1])
    return relative(*x, u, (-WEIGHT1 * np.sin(x[0]) + pull, pull))


def absolute_from_up(x, u):
    """Lagrange's equations in the angles a of both links from up, on which u1 - u2 and u2 act."""
    a1, a2, d1, d2 = x
    cos, sin = COUPLING * np.cos(a2 - a1), COUPLING * np.sin(a2 - a1)
    right = -u + sin * d2**2 + WEIGHT1 * np.sin(a1), u - sin * d1**2 + WEIGHT2 * np.sin(a2)
    determinant = INERTIA1 * P.I2 - cos**2
    first = (P.I2 * right[0] - cos * right[1]) / determinant
    second = (INERTIA1 * right[1] - cos * right[0]) / determinant
    return np.stack([first, second - first])


def realaigym(x, u):
    return columns_of("pos_meas1", "pos_meas2", "vel_meas1", "vel_meas2", "tau_con2")(x, u) | {"tau_con1": 0 * u}


def columns_of(*names):
    return lambda x, u: dict(zip(names, (*x, u), strict=True))


def gymnasium(x, u):
    names = ("cos1", "sin1", "cos2", "sin2", "omega1", "omega2", "action")
    return dict(
        zip(names, (np.cos(x[0]), np.sin(x[0]), np.cos(x[1]), np.sin(x[1]), x[2], x[3], u + 1), strict=True)
    )


TRUTHS = {
    "RealAIGym": (from_hanging, realaigym),
    "Drake": (from_hanging, columns_of("x0", "x1", "x2", "x3", "u")),
    "Spong": (from_horizontal, columns_of("theta1", "theta2", "omega1", "omega2", "tau")),
    "Gymnasium": (from_hanging, gymnasium),
    "MuJoCo": (from_upright, lambda x, u: columns_of("qpos0", "qpos1", "qvel0", "qvel1", "ctrl")(x, u / 2)),
    "two IMUs": (absolute_from_up, lambda x, u: columns_of("a1", "a2", "da1", "da2", "u2")(x, u) | {"u1": 0 * u}),
}  # fmt: skip
"""Accelerations of both joints in a convention, and the columns of its log."""


def test_the_page_has_all_of_them():
    assert [name for name, _ in LINES] == [
        next(line for line, _ in LINES if line.startswith(name)) for name in TRUTHS
    ]


@pytest.mark.parametrize("name", TRUTHS)
def test_a_line_makes_our_motion_of_another_conventions(name, x64):
    truth, write = TRUTHS[name]
    x, u = np.random.default_rng(0).normal(size=(4, ROWS)), np.linspace(-2, 2, ROWS)
    log = write(x, u) | {"time": 0 * u, "t": 0 * u}
    line = next(words for title, words in LINES if title.startswith(name))
    found = {
        each: column.expression.evaluate(log.__getitem__, ROWS)
        for each, column in parse_columns("log", line.split(), list(log)).items()
    }
    states = np.stack([found[each] for each in ("pos_meas1", "pos_meas2", "vel_meas1", "vel_meas2")], axis=1)
    torques = np.stack([found["tau_con1"], found["tau_con2"]], axis=1)
    ours = np.array([acceleration(P, state, torque) for state, torque in zip(states, torques, strict=True)])
    np.testing.assert_allclose(ours.T, truth(x, u), rtol=1e-9, atol=1e-9)


def test_gymnasiums_own_equations_are_those_of_its_line():
    acrobot = pytest.importorskip("gymnasium.envs.classic_control.acrobot").AcrobotEnv()
    # Links of 1 m and 1 kg, centres in the middle, moments of 1 kg m² about them, and g = 9.8 m/s².
    plant = P.changed(m1=1.0, m2=1.0, l1=1.0, l2=1.0, r1=0.5, r2=0.5, I1=1.25, I2=1.25, g=9.8)
    for state in np.random.default_rng(1).normal(size=(5, 4)):
        theirs = acrobot._dsdt(np.append(state, -1.0))[2:4]
        np.testing.assert_allclose(acceleration(plant, state, np.array([0.0, -1.0])), theirs, rtol=1e-5)
