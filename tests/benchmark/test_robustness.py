"""The robustness score, against its definition and against loops written independently."""

import dataclasses
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from policies import lone_policy
from swingup.benchmark.grid import Case, make_cases
from swingup.benchmark.robustness import Result, robustness, summarise, upright
from swingup.benchmark.rollout import Scenario
from swingup.benchmark.rules import CRITERIA, RANDOM
from swingup.benchmark.runner import run_many, stack
from swingup.common.errors import SwingupError
from swingup.loop.disturbance import step_noise
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import get_robot

from .controllers import BRIEF, LOOSE, V2, Swinging, swinging
from .independent import World, closed_loop, rk4


@pytest.mark.parametrize("criterion", CRITERIA)
def test_the_batch_agrees_with_a_numpy_loop(robot, criterion):
    """Single simulations picked from the grid's criteria end where an independent loop ends."""
    rules = dataclasses.replace(BRIEF, tolerance=(9.0,) * 4)
    cases = make_cases(robot, rules, criterion, 7)
    picked = cases[:: max(1, len(cases) // 5)]
    batch = run_many(Swinging(), stack([case.scenario for case in picked]), rules.dt, rules.steps, depth=21)
    for case, final in zip(picked, batch.final, strict=True):
        p, disturbance = case.scenario.parameters.values(), case.scenario.disturbance
        with jax.enable_x64(True):
            noise = jax.vmap(lambda k, d=disturbance: step_noise(d, k, jnp.dtype(float)))(jnp.arange(rules.steps))
        pushes = [
            (
                joint,
                *(float(getattr(disturbance.pushes, name)[joint, i]) for name in ("centre", "width", "amplitude")),
            )
            for joint in range(2)
            for i in range(3)
        ]
        world = World(
            rules.steps, float(disturbance.response), int(disturbance.delay_steps), pushes,
            np.asarray(noise[0]), np.asarray(noise[1]),
        )  # fmt: skip
        rows = closed_loop(p, (robot.joint,), swinging, np.zeros(4), rules.dt, world)
        before, u = rows[-1, 1:5], rows[-1, 5:]
        np.testing.assert_allclose(final, rk4(p, before, u, rules.dt), rtol=1e-9, atol=1e-9)


def test_success_is_strict_and_wraps_the_angles():
    good = np.array([[np.pi + 0.349, -0.349, 0.999, -0.999], [-np.pi, 4 * np.pi, 0, 0], [3 * np.pi, 0, 0, 0]])
    bad = np.array([[np.pi, 0, 1.0, 0], [np.pi + 0.351, 0, 0, 0], [np.pi, np.pi, 0, 0], [np.nan, 0, 0, 0]])
    tolerance = V2.tolerance
    assert upright(good, tolerance).tolist() == [True] * 3
    assert upright(bad, tolerance).tolist() == [False] * 4


def case(criterion, group, seed=None):
    scenario = Scenario(LEADERBOARD.driven(get_robot("acrobot")))
    return Case(criterion, group, {} if seed is None else {"seed": seed}, scenario)


def test_a_value_counts_if_more_than_half_of_its_repetitions_succeed():
    # Of 10 repetitions 5 do not suffice, 6 do: one of two values counts.
    results = [Result(case("velocity_noise", 0, 0), index < 5) for index in range(10)]
    results += [Result(case("velocity_noise", 1, 0), index < 6) for index in range(10)]
    percent, overall, intervals = summarise(results, [0])
    assert percent == {"velocity_noise": 50.0}
    assert overall is None
    assert intervals == {}


def test_scores_of_several_seeds():
    results = [Result(case(name, 0), True) for name in ("model", "torque_response", "delay")]
    for name in RANDOM:
        results += [Result(case(name, 0, seed), seed == 1) for seed in (1, 2, 3)]
    percent, overall, intervals = summarise(results, [1, 2, 3])
    assert percent["model"] == percent["delay"] == 100.0
    assert percent["perturbations"] == pytest.approx(100 / 3)
    # (3 · 100 + 3 · 33.3) / 6 = 66.7 %
    assert overall == pytest.approx(2 / 3)
    # Overall by seed: 1, 1/2, 1/2; mean 2/3, standard deviation 1 / (2 √3), t(0.975, 2) = 4.3027.
    reach = 4.302652729911275 / (2 * math.sqrt(3)) / math.sqrt(3)
    assert intervals["overall"] == pytest.approx((max(0, 2 / 3 - reach), 1.0))
    assert set(intervals) == {*RANDOM, "overall"}


@pytest.mark.slow
def test_a_whole_grid_as_json():
    result = robustness(Swinging(), "pendubot", "mine", LOOSE, seed=4)
    row = json.loads(json.dumps(result.as_dict()))
    assert list(row) == [
        "robot", "controller", "estimator", "rules", "seed", "version", *CRITERIA, "overall", "details",
    ]  # fmt: skip
    assert (row["robot"], row["controller"], row["rules"], row["seed"]) == ("pendubot", "mine", "loose", 4)
    assert len(row["details"]) == 722
    assert {"criterion", "value", "repetition", "seed", "success"} == set(row["details"][210])
    assert row["overall"] == pytest.approx(sum(row[name] for name in CRITERIA) / 600)
    assert 0.05 < row["overall"] < 0.95
    assert robustness(Swinging(), "pendubot", "mine", LOOSE, seed=4).as_dict() == result.as_dict()
    assert robustness(Swinging(), "pendubot", "mine", LOOSE, seed=5).as_dict() != result.as_dict()


@pytest.mark.slow
def test_single_criteria_repeat_the_whole_grid():
    whole = robustness(Swinging(), "pendubot", seed=2, rules=LOOSE)
    for criterion in ("perturbations", "torque_noise"):
        part = robustness(Swinging(), "pendubot", seed=2, rules=LOOSE, criteria=criterion)
        successes = [entry.success for entry in whole.results if entry.case.criterion == criterion]
        assert [entry.success for entry in part.results] == successes
        assert 0 < sum(successes) < len(successes)
        assert part.overall is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"criteria": ["model", "speed"]}, "unknown criterion 'speed'"),
        ({"criteria": []}, "unknown criterion"),
        ({"seed": -1}, "seed = -1"),
        ({"seeds": 0}, "seeds = 0"),
        ({"rules": "v9"}, "unknown robustness rules 'v9'"),
        ({"robot": "hexapod"}, "unknown robot"),
    ],
)
def test_bad_input(options, message):
    with pytest.raises(SwingupError, match=message):
        robustness(Swinging(), **{"robot": "acrobot", **options})


def test_the_other_robots_policy_is_refused():
    with pytest.raises(SwingupError, match="is for the pendubot"):
        robustness(lone_policy("ar-eapo", "pendubot")[0], "acrobot")
