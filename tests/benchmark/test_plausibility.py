"""Recordings: no warning of honest runs and robots, one at least of each kind of forgery, which gets no score."""

import dataclasses
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from refusals import refusal
from swingup import BOARDS, SwingupError, get_controller, judge, score
from swingup.benchmark.plausibility import examine
from swingup.benchmark.recording import load_trajectory
from swingup.benchmark.rollout import Trajectory
from swingup.cli import main
from swingup.dynamics.integrate import rk4_step
from swingup.plant.equations import mass_entries
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, get_robot, lump

from .forged import REST, TIME, changed, invented, moved, picked, scaled

ROBOT = get_robot("acrobot")
TURN = 2 * np.pi
TORQUE = 3.0 * np.sin(4.0 * TIME)
"""Enough to swing the acrobot about at up to 15 rad/s."""


@jax.jit
def roll(parameters, torques, periods):
    """States before each step from hanging at rest."""

    def step(x, inputs):
        u, dt = inputs
        return rk4_step(parameters, x, u, dt), x

    return jax.lax.scan(step, jnp.zeros(4), (torques, periods))[1]


def simulated(parameters, time=TIME):
    u = np.column_stack([np.zeros(len(time)), np.interp(time, TIME, TORQUE)])
    with jax.enable_x64(True):
        x = np.asarray(roll(parameters, u, np.append(np.diff(time), 0.002)))
    return Trajectory(time=time, x=x, u=u)


@pytest.fixture(scope="module")
def honest():
    return simulated(LEADERBOARD.driven(ROBOT))


@pytest.fixture(scope="module")
def recorded():
    """As a robot records: friction, jitter, a late first row, quantised positions, noisy velocities and torques."""
    generator = np.random.default_rng(0)
    time = TIME + generator.uniform(0, 0.0008, TIME.size)
    time[3:] += 0.004
    found = simulated(load_plant("C.1"), time - time[0])
    x = found.x + generator.normal(0, [1e-4, 1e-4, 0.1, 0.1], found.x.shape)
    x[:, :2] = 3.8e-4 * np.round(x[:, :2] / 3.8e-4)
    u = found.u + generator.normal(0, 0.05, found.u.shape)
    return dataclasses.replace(found, x=x, u=u)


def look(trajectory, board="performance"):
    return examine(trajectory, ROBOT, BOARDS[board])


def names(trajectory):
    return [warning.name for warning in look(trajectory)]


def test_honest_runs_and_recordings_have_no_warning(honest, recorded):
    """Angles may be wrapped, or full turns away."""
    q, v = np.split(honest.x, 2, axis=1)
    angles = (q + np.pi) % TURN - np.pi, q + np.array([TURN, -2 * TURN])
    others = (dataclasses.replace(honest, x=np.hstack([each, v])) for each in angles)
    for trajectory in (honest, recorded, moved(REST), *others):
        assert look(trajectory, "hardware") == []


def test_a_jump_and_a_defect_are_as_large_as_they_are(honest):
    jump, defect = honest.x.copy(), honest.x.copy()
    jump[2500:, 0] += 0.5  # once, by half a radian
    defect[-1, 2] += 2.0  # nothing follows that it could have moved
    found = {each.name: each.text for each in look(dataclasses.replace(honest, x=jump))}
    assert "by 0.5 rad within 0.1 s" in found["positions_against_velocities"]
    # The impulse M (2, 0) of the last row, as a mean torque over 0.1 s.
    found = {each.text.split(" needs ")[0]: each for each in look(dataclasses.replace(honest, x=defect))}
    assert {each.name for each in found.values()} == {"unexplained_torque"}
    plant, cosine = lump(LEADERBOARD), np.cos(defect[-1, 1])
    for joint, inertia in enumerate(mass_entries(plant, cosine)[:2]):
        assert f"needs {abs(2.0 * inertia / 0.1):.3g} N m" in found[f"joint {joint + 1}"].text


def test_torques_beyond_the_limits():
    still = moved(REST)
    beyond = ([0.51, 0.0], ["passive_torque"]), ([0.0, -6.1], ["torque_limit"])
    for torque, expected in (([0.5, 0.0], []), ([0.0, 6.0], []), *beyond):
        u = still.u.copy()
        u[-1] = torque  # nothing follows that it could have moved
        assert names(dataclasses.replace(still, u=u)) == expected


def test_starts():
    still = moved(REST)
    hanging, others = ([0.1, -0.1, 0, 0.9], [0, TURN, 0, 0]), ([0.3, 0, 0, 0], [0, 0, 0, -1.1])
    for start in (*hanging, *others):
        x = still.x.copy()
        x[0] = start
        assert ("not_hanging" in names(dataclasses.replace(still, x=x))) is (start in others)


@pytest.mark.parametrize(
    ("kept", "warns"),
    [
        (slice(None, None, 2), {"rate"}),
        (np.r_[:2000, 2009:5000], set()),  # one gap of 9 periods: a hiccup
        (np.r_[:2000, 2011:5000], {"irregular_periods"}),
        (np.flatnonzero(np.arange(5000) % 7), {"irregular_periods"}),  # a sixth of them is double
        (np.r_[:100, 100:5000:50, 4991:5000], {"irregular_periods"}),  # most rows, but little time
    ],
)
def test_rates_and_periods(kept, warns):
    assert {*names(picked(moved(REST), kept))} == warns


def test_long_runs_say_so():
    still = moved(REST)
    more = np.concatenate([still.time, still.time + still.time[-1] + 0.002])
    longer = Trajectory(more, np.tile(still.x, (2, 1)), np.tile(still.u, (2, 1)))
    assert names(longer) == ["long_span"]


@pytest.mark.slow
def test_short_runs_score_nothing_and_say_so():
    up = moved((np.pi, 0.0, 0.0))
    assert score(up, ROBOT, force=True).successes
    for rows, warns in ((slice(0, 4951), False), (slice(0, 4950), True), (slice(50, None), True)):
        part = picked(up, rows)
        assert (score(part, ROBOT, force=True).successes, "short_span" in names(part)) == (not warns, warns)


def test_times_that_no_clock_gives_are_refused():
    up = moved((np.pi, 0.0, 0.0))
    back = np.where(np.arange(5000) < 2000, TIME, TIME - 1.0)
    for named, times in {
        "give its times as seconds since its start": (TIME - 1000.0, TIME - 0.21, TIME + 0.21, TIME + 1e6),
        "give its times in seconds": [period * np.arange(5000) for period in (5e-324, 1e-310, 1e-9)],
        "times do not increase": [back],
    }.items():
        for time in times:
            assert named in refusal(score, dataclasses.replace(up, time=time), ROBOT)


@pytest.mark.parametrize("start", [-0.2, -0.01, 0.01, 0.06])
def test_some_periods_of_offset_are_no_fault_and_no_gain(start):
    up = moved((np.pi, 0.0, 0.0))
    criteria = score(dataclasses.replace(up, time=up.time + start), ROBOT, force=True).criteria
    assert criteria.success
    assert criteria.swingup_time == pytest.approx(max(0.0, start) + 0.002)
    assert criteria.score <= 1.0


WORTH = 0.3
"""A forged score above this has to be refused."""


def kept_scores(forged, robot, board):
    """What forged recordings score without an error, by name, with the names of their warnings."""
    found = {}
    for name, rows in forged.items():
        try:
            result = score(rows, robot, board)
        except SwingupError:
            continue
        found[name] = (result.score, {each.partition(":")[0] for each in result.warnings})
    return found


def test_some_inventions_get_no_score():
    forged = invented(np.random.default_rng(0), joint=1)
    some = {name: rows for name, rows in list(forged.items())[::4] if len(rows.time) == 5000}
    assert len(some) >= 10
    assert all(kept == 0 for kept, _ in kept_scores(some, "acrobot", "performance").values())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("board", ["performance", "hardware"])
def test_forged_recordings_get_no_score(robot, board, seed):
    random = np.random.default_rng(seed)
    honest = judge(get_controller("tvlqr-score", robot), robot).trajectory
    gross, fine = changed(honest, random)
    forged = gross | invented(random, robot.joint)
    assert len(forged) >= 45
    worth = {name for name, rows in forged.items() if score(rows, robot, board, force=True).score > WORTH}
    assert len(worth) >= 35
    assert {name for name, (kept, _) in kept_scores(forged, robot, board).items() if kept > WORTH} == set()
    # Small gains are warned of, where there are any.
    for name, (kept, warnings) in kept_scores(fine, robot, board).items():
        assert warnings or kept < score(honest, robot, board).score + 0.001, name


def test_a_robots_recording_keeps_its_score_and_its_forgery_gets_none():
    """At 33 Hz, where energy agrees only because each torque acts from the next row on."""
    path = Path(__file__).parents[2] / "examples/logs/C1-acrobot-mcpilco.csv"
    rows = load_trajectory(path)
    for board, kept, warnings in (
        ("hardware", 0.482, {"rate", "band"}),
        ("performance", 0.262, {"rate", "measured", "band"}),
    ):
        found = score(path, "acrobot", board)
        assert found.score == pytest.approx(kept, abs=5e-4)
        assert {each.partition(":")[0] for each in found.warnings} == warnings
        low, _, high = found.warnings[-1].split()[1:4]
        assert float(low) < kept < float(high)
        for forged in (scaled(rows, torque=0.2), scaled(rows, velocity=0.97)):
            assert "scores it all the same" in refusal(score, forged, "acrobot", board)


@pytest.mark.slow
@pytest.mark.parametrize("board", ["sim2real", "iros-real", "v2-real", "icra-real", "uptime", "hardware"])
def test_own_recordings_keep_their_scores(robot, board):
    compared = 0
    for seed in range(2):
        seeds = None if board == "hardware" else 1
        found = judge(get_controller("adaptive", robot), robot, BOARDS[board], seeds, seed=seed)
        again = score(found.trajectory, robot, board)
        if found.runs[0].score > 0:
            assert again.score == pytest.approx(found.runs[0].score)
            compared += 1
    assert compared or board == "iros-real"  # on which few acrobots swing up


def test_command_shows_rate_and_warnings(tmp_path, capsys):
    path = tmp_path / "teleport.csv"
    rows = [f"{t!r},{0 if t < 0.01 else np.pi!r},0,0,0,0,0" for t in TIME.tolist()]
    path.write_text("\n".join(["time,pos1,pos2,vel1,vel2,tau1,tau2", *rows]), encoding="utf-8")
    words, fault = ["score", str(path), "--robot", "acrobot"], "its positions move by 3.14 rad within 0.1 s"
    assert main(words) == 2
    out, error = capsys.readouterr()
    assert (out, error.count("\n")) == ("", 1)
    assert f"teleport: {fault}" in error
    assert main([*words, "--json", "--force"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["warnings"][0].startswith(f"positions_against_velocities: {fault}")
    assert result["score"] > 0.99
