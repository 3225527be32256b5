"""The robustness score, against its definition and against loops written independently."""

import dataclasses
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.benchmark.board import Case, Run
from swingup.benchmark.grid import make_cases
from swingup.benchmark.judge import judge
from swingup.benchmark.robustness_board import upright
from swingup.benchmark.rollout import Scenario
from swingup.benchmark.rules import CRITERIA, RANDOM
from swingup.benchmark.runner import run_many, stack
from swingup.loop.disturbance import step_noise
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import ROBOTS, get_robot

from .controllers import BRIEF, LOOSE, SWINGING, V2, swinging
from .independent import World, closed_loop, rk4


@pytest.fixture(scope="module")
def picked():
    """Cases picked from all of the grid's criteria on both robots, with their last states, run as one batch."""
    rules = dataclasses.replace(BRIEF, tolerance=(9.0,) * 4)
    grids = [make_cases(robot, rules, each, 7) for robot in ROBOTS.values() for each in CRITERIA]
    cases = [case for grid in grids for case in grid[:: max(1, len(grid) // 3)]]
    batch = run_many(SWINGING, stack([case.scenario for case in cases]), rules.dt, rules.steps, depth=21)
    return list(zip(cases, batch.final, strict=True))


@pytest.mark.parametrize("criterion", CRITERIA)
def test_the_batch_agrees_with_a_numpy_loop(picked, robot, criterion):
    """Single simulations end where an independent loop ends."""
    plant, rules, compared = LEADERBOARD.driven(robot), BRIEF, 0
    for case, final in picked:
        p, disturbance = case.scenario.parameters, case.scenario.disturbance
        if case.criterion != criterion or p.limit(robot.joint) != plant.limit(robot.joint):
            continue
        with jax.enable_x64(True):
            noise = jax.vmap(lambda k, d=disturbance: step_noise(d, k, jnp.dtype(float)))(jnp.arange(rules.steps))
        profile = np.stack(
            [disturbance.pushes.centre, disturbance.pushes.width, disturbance.pushes.amplitude], axis=-1
        )
        pushes = [(joint, *push) for joint in range(2) for push in profile[joint].tolist()]
        loop = float(disturbance.loop.response), int(disturbance.delay_steps), pushes
        world = World(rules.steps, *loop, np.asarray(noise[0]), np.asarray(noise[1]))
        rows = closed_loop(p.values(), (robot.joint,), swinging, np.zeros(4), rules.dt, world)
        before, u = rows[-1, 1:5], rows[-1, 5:]
        np.testing.assert_allclose(final, rk4(p.values(), before, u, rules.dt), rtol=1e-9, atol=1e-9)
        compared += 1
    assert compared >= 3


def test_success_is_strict_and_wraps_the_angles():
    good = np.array([[np.pi + 0.349, -0.349, 0.999, -0.999], [-np.pi, 4 * np.pi, 0, 0], [3 * np.pi, 0, 0, 0]])
    bad = np.array([[np.pi, 0, 1.0, 0], [np.pi + 0.351, 0, 0, 0], [np.pi, np.pi, 0, 0], [np.nan, 0, 0, 0]])
    tolerance = V2.tolerance
    assert upright(good, tolerance).tolist() == [True] * 3
    assert upright(bad, tolerance).tolist() == [False] * 4


def case(criterion, group, seed=None):
    scenario = Scenario(LEADERBOARD.driven(get_robot("acrobot")))
    return Case(scenario, {} if seed is None else {"seed": seed}, criterion, group)


def test_a_value_counts_if_more_than_half_of_its_repetitions_succeed():
    # Of 10 repetitions 5 do not suffice, 6 do: one of two values counts.
    results = [Run(case("velocity_noise", 0, 0), index < 5, 0.0, 0.0) for index in range(10)]
    results += [Run(case("velocity_noise", 1, 0), index < 6, 0.0, 0.0) for index in range(10)]
    percent, intervals = V2.summarise(results, [0])
    overall = percent.pop("score")
    assert percent == {"velocity_noise": 50.0}
    assert overall is None
    assert intervals == {}


def test_scores_of_several_seeds():
    results = [Run(case(name, 0), True, 0.0, 0.0) for name in ("model", "torque_response", "delay")]
    for name in RANDOM:
        results += [Run(case(name, 0, seed), seed == 1, 0.0, 0.0) for seed in (1, 2, 3)]
    percent, intervals = V2.summarise(results, [1, 2, 3])
    overall = percent["score"]
    assert percent["model"] == percent["delay"] == 100.0
    assert percent["perturbations"] == pytest.approx(100 / 3)
    # (3 · 100 + 3 · 33.3) / 6 = 66.7 %
    assert overall == pytest.approx(2 / 3)
    # Overall by seed: 1, 1/2, 1/2; mean 2/3, standard deviation 1 / (2 √3), t(0.975, 2) = 4.3027.
    reach = 4.302652729911275 / (2 * math.sqrt(3)) / math.sqrt(3)
    assert intervals["score"] == pytest.approx((max(0, 2 / 3 - reach), 1.0))
    assert set(intervals) == {*RANDOM, "score"}


@pytest.mark.slow
def test_a_whole_grid_as_json():
    result = judge(SWINGING, "pendubot", LOOSE, seed=4, name="mine")
    row = json.loads(json.dumps(result.as_dict()))
    names = ("robot", "controller", "board", "seeds", "runs", "intervals")
    assert [row[name] for name in names] == ["pendubot", "mine", "loose", [4], 722, {}]
    assert row["successes"] == sum(each["success"] for each in row["details"])
    assert {"criterion", "value", "repetition", "seed", "success", "score"} == set(row["details"][210])
    assert row["score"] == pytest.approx(sum(row[name] for name in CRITERIA) / 600)
    assert 0.05 < row["score"] < 0.95
    assert judge(SWINGING, "pendubot", LOOSE, seed=4).values == result.values
    assert judge(SWINGING, "pendubot", LOOSE, seed=5).values != result.values


@pytest.mark.slow
def test_single_criteria_repeat_the_whole_grid():
    whole = judge(SWINGING, "pendubot", LOOSE, seed=2)
    for criterion in ("perturbations", "torque_noise"):
        part = judge(SWINGING, "pendubot", dataclasses.replace(LOOSE, criteria=(criterion,)), seed=2)
        successes = [run.success for run in whole.runs if run.case.criterion == criterion]
        assert [run.success for run in part.runs] == successes
        assert 0 < sum(successes) < len(successes)
        assert part.score is None
