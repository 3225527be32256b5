"""The robustness score and its grid, against their definitions and against loops written independently."""

import dataclasses
import functools
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from refusals import refusal
from swingup.benchmark.board import Case, Run
from swingup.benchmark.boards import PERFORMANCE
from swingup.benchmark.disturbances import DisturbanceSettings, PushRules, draw_pushes
from swingup.benchmark.judge import judge
from swingup.benchmark.robustness_board import CRITERIA, RANDOM_CRITERIA, Sweep, change_grid, make_cases, upright
from swingup.benchmark.rollout import Scenario
from swingup.benchmark.runner import run_many, stack
from swingup.loop.disturbance import step_noise
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, ROBOTS, get_robot

from .controllers import BRIEF, SWINGING, V2, swinging
from .independent import World, closed_loop, rk4


def test_the_batch_agrees_with_a_numpy_loop():
    """Cases picked from all of the grid's criteria on both robots end where an independent loop ends."""
    rules, dt, steps = dataclasses.replace(BRIEF, tolerance=(9.0,) * 4), BRIEF.dt, BRIEF.steps
    grids = [(robot.joint, make_cases(robot, rules, each, 7)) for robot in ROBOTS.values() for each in CRITERIA]
    picked = [(joint, case.scenario) for joint, grid in grids for case in grid[:: max(1, len(grid) // 3)]]
    batch = run_many(SWINGING, stack([scenario for _, scenario in picked]), dt, steps, depth=21)
    for (joint, scenario), final in zip(picked, batch.final, strict=True):
        p, disturbance = scenario.parameters.values(), scenario.disturbance
        with jax.enable_x64(True):
            noise = jax.vmap(lambda k, d=disturbance: step_noise(d, k, jnp.dtype(float)))(jnp.arange(steps))
        loop = float(disturbance.loop.response), int(disturbance.delay_steps), disturbance.pushes
        world = World(steps, *loop, np.asarray(noise[0]), np.asarray(noise[1]))
        rows = closed_loop(p, (joint,), swinging, np.zeros(4), dt, world)
        np.testing.assert_allclose(final, rk4(p, rows[-1, 1:5], rows[-1, 5:], dt), rtol=1e-9, atol=1e-9)


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
    assert (percent, intervals) == ({"velocity_noise": 50.0, "score": None}, {})


def test_scores_of_several_seeds():
    results = [Run(case(name, 0), True, 0.0, 0.0) for name in ("model", "torque_response", "delay")]
    for name in RANDOM_CRITERIA:
        results += [Run(case(name, 0, seed), seed == 1, 0.0, 0.0) for seed in (1, 2, 3)]
    percent, intervals = V2.summarise(results, [1, 2, 3])
    assert percent["model"] == percent["delay"] == 100.0
    assert percent["perturbations"] == pytest.approx(100 / 3)
    # (3 · 100 + 3 · 33.3) / 6 = 66.7 %
    assert percent["score"] == pytest.approx(2 / 3)
    # Overall by seed: 1, 1/2, 1/2; mean 2/3, standard deviation 1 / (2 √3), t(0.975, 2) = 4.3027.
    reach = 4.302652729911275 / (2 * math.sqrt(3)) / math.sqrt(3)
    assert intervals["score"] == pytest.approx((max(0, 2 / 3 - reach), 1.0))
    assert set(intervals) == {*RANDOM_CRITERIA, "score"}


@pytest.mark.parametrize("plant", ["leaderboard", "C.1"])
def test_model_errors_change_one_parameter_each(robot, plant):
    """Around the plant's values, of which the leaderboards' has none of the first five."""
    nominal, fields = load_plant(plant).driven(robot).values(), {"m1r1": "r1", "m2r2": "r2"}
    added = {"Ir": (0, 1e-4), "b1": (-0.1, 0.1), "b2": (-0.1, 0.1), "cf1": (-0.2, 0.2), "cf2": (-0.2, 0.2)}
    ranges = {name: nominal[name] + np.array(ends) for name, ends in added.items()}
    for name in ("m1r1", "I1", "m2r2", "m2", "I2"):
        ranges[name] = nominal[fields.get(name, name)] * np.array([0.75, 1.25])
    cases = make_cases(robot, V2, "model", 0, load_plant(plant))
    assert {case.settings["parameter"] for case in cases} == set(ranges)
    for name, (low, high) in ranges.items():
        chosen = [case.scenario.parameters.values() for case in cases if case.settings["parameter"] == name]
        field = fields.get(name, name)
        np.testing.assert_allclose([p[field] for p in chosen], np.linspace(low, high, 21), rtol=1e-14, atol=1e-16)
        assert all(p[other] == nominal[other] for p in chosen for other in nominal if other != field)


@pytest.mark.parametrize(
    ("criterion", "field", "values"),
    [
        ("velocity_noise", "velocity_noise", np.repeat(np.linspace(0, 0.5, 21), 10)),
        ("torque_noise", "torque_noise", np.repeat(np.linspace(0, 1.1, 21), 10)),
        ("torque_response", "response", np.linspace(0.1, 2.0, 21)),
        # Rounded down in floating point, as the benchmark's int(delay / dt) is.
        ("delay", "delay_steps", [int(value / 0.002) for value in np.linspace(0, 0.04, 21)]),
    ],
)
def test_sweeps(robot, criterion, field, values):
    cases = make_cases(robot, V2, criterion, 3)
    disturbances = [case.scenario.disturbance for case in cases]
    found = [getattr(each if criterion == "delay" else each.loop, field) for each in disturbances]
    np.testing.assert_allclose(found, values)
    assert criterion in RANDOM_CRITERIA or len({tuple(each.noise) for each in disturbances}) == 1


def test_noise_differs_between_criteria_and_seeds_and_fifty_runs_have_pushes(robot):
    assert len(make_cases(robot, V2, "perturbations", 0)) == 50
    grids = [make_cases(robot, V2, name, seed) for name in ("velocity_noise", "torque_noise") for seed in (0, 1)]
    assert len({tuple(case.scenario.disturbance.noise) for grid in grids for case in grid}) == 4 * 210


def test_pushes_keep_the_benchmarks_distribution():
    random = np.random.default_rng(0)
    profiles = [draw_pushes(random, PushRules(), 10.0) for _ in range(2000)]
    centres = np.array([np.sort(profile.centre, axis=None) for profile in profiles])
    # μ_i = μ_{i-1} + 1 + U/2 from μ_{-1} = 0: means 1.25 (i + 1), within 1 (i + 1) and 1.5 (i + 1).
    steps = np.diff(centres, axis=1, prepend=0.0)
    assert steps.min() >= 1.0
    assert steps.max() <= 1.5
    np.testing.assert_allclose(centres.mean(axis=0), 1.25 * np.arange(1, 7), atol=0.04)  # 5 standard errors
    amplitudes, widths = (np.array([getattr(each, name) for each in profiles]) for name in ("amplitude", "width"))
    assert 0.5 <= np.abs(amplitudes).min() < 0.51 < 4.99 < np.abs(amplitudes).max() <= 5.0
    assert 0.05 <= widths.min() < 0.0501 < 0.0999 < widths.max() <= 0.1
    assert abs(np.mean(np.sign(amplitudes))) < 0.05
    # Shuffled: the earliest push is on either joint.
    first = np.mean([profile.centre[0].min() < profile.centre[1].min() for profile in profiles])
    assert abs(first - 0.5) < 0.06


def test_other_grids(robot):
    texts = "delay=0:0.02:5", "velocity_noise=0:1:3", "torque_noise=0.5:1:3:2", "m1r1=0.5:1.5:3", "perturbations=7"
    changed = functools.reduce(change_grid, texts, V2)
    assert changed.name == " ".join(["robustness", *texts])
    found = changed.delay, changed.velocity_noise, changed.torque_noise, changed.model["m1r1"].sweep
    values = ((0.0, 0.02, 5, 1), (0.0, 1.0, 3, 10), (0.5, 1.0, 3, 2), (0.5, 1.5, 3))
    assert found == tuple(Sweep(*each) for each in values)
    assert len(make_cases(robot, changed, "perturbations", 0)) == 7
    assert len(make_cases(robot, changed, "model", 0)) == 210 - 21 + 3


def test_a_disturbance_has_the_boards_own_period_and_duration():
    settings = DisturbanceSettings(delay=0.01, pushes=PushRules(spacing=0.5))
    board = dataclasses.replace(PERFORMANCE, dt=0.005, duration=4.0)
    result = judge(SWINGING, "acrobot", board, disturbance=settings, seed=3)
    row = json.loads(json.dumps(result.as_dict()))
    disturbance = row["details"][0]["disturbance"]
    assert (row["seeds"], row["details"][0]["seed"], disturbance["noise"]) == ([3], 3, [3, 0])
    assert disturbance["delay_steps"] == 2  # 0.01 s; five steps of 2 ms would be 25 ms
    # Seven gaps of at least 0.5 s, at both ends too.
    centres = np.asarray(disturbance["pushes"]["centre"])
    assert np.all((centres >= 0.5) & (centres <= 3.5))
    again, other = (settings.draw(0.005, 4.0, seed) for seed in (3, 4))
    np.testing.assert_array_equal(again.pushes.centre, centres)
    assert not np.any(other.pushes.centre == centres)
    assert "do not fit into 4 s" in refusal(DisturbanceSettings(pushes=PushRules()).draw, 0.005, 4.0, 0)
