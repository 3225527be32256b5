"""The grid and its score, against the benchmark's definition and against loops written independently."""

import dataclasses
import json
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from swingup.benchmark.grid import Case, change_grid, draw_pushes, make_cases
from swingup.benchmark.robustness import Result, robustness, summarise, upright
from swingup.benchmark.rollout import Scenario
from swingup.benchmark.rules import CRITERIA, RANDOM, PushRules, Sweep, get_robustness_rules
from swingup.benchmark.runner import run_many, stack
from swingup.control.controller import AbstractController
from swingup.control.plain import PlainController
from swingup.errors import SwingupError
from swingup.physics.parameters import get_robot, leaderboard_parameters
from swingup.tasks.disturbance import step_noise

from .independent import World, closed_loop, rk4

V2 = get_robustness_rules("v2")
BRIEF = dataclasses.replace(V2, name="brief", duration=0.8)
"""The whole grid, each run of 0.8 s, with pushes that fit into it."""
BRIEF = dataclasses.replace(BRIEF, perturbations=dataclasses.replace(V2.perturbations, apart=0.1))


LOOSE = dataclasses.replace(BRIEF, name="loose", tolerance=(2.9, 9.0, 1e9, 1e9))
"""With a success that some of these short runs have."""


class Swinging(AbstractController):
    """Torque with the driven joint's velocity: it pumps energy into the pendulum from any disturbance."""

    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, jnp.ones(2) * (3 * jnp.tanh(x[2] + x[3]) + 0.5 * jnp.cos(3 * t))


def swinging(x, t):
    """The same in NumPy."""
    return np.ones(2) * (3 * math.tanh(x[2] + x[3]) + 0.5 * math.cos(3 * t))


def every_case(robot, rules=V2, seed=0):
    return [case for criterion in CRITERIA for case in make_cases(robot, rules, criterion, seed)]


def test_the_grid_has_722_simulations(robot):
    cases = every_case(robot)
    counts = {name: sum(case.criterion == name for case in cases) for name in CRITERIA}
    assert counts == {
        "model": 210, "velocity_noise": 210, "torque_noise": 210, "torque_response": 21, "delay": 21,
        "perturbations": 50,
    }  # fmt: skip
    assert sum(counts.values()) == 722


def test_model_errors_change_one_parameter_each(robot):
    nominal = vars(leaderboard_parameters(robot))
    fields = {"m1r1": "r1", "m2r2": "r2"}
    ranges = {
        "Ir": (0, 1e-4), "b1": (-0.1, 0.1), "b2": (-0.1, 0.1), "cf1": (-0.2, 0.2), "cf2": (-0.2, 0.2),
        **{name: (0.75 * nominal[field], 1.25 * nominal[field])
           for name, field in (("m1r1", "r1"), ("I1", "I1"), ("m2r2", "r2"), ("m2", "m2"), ("I2", "I2"))},
    }  # fmt: skip
    cases = make_cases(robot, V2, "model", 0)
    assert {case.settings["parameter"] for case in cases} == set(ranges)
    for name, (low, high) in ranges.items():
        chosen = [vars(case.scenario.parameters) for case in cases if case.settings["parameter"] == name]
        field = fields.get(name, name)
        np.testing.assert_allclose([p[field] for p in chosen], np.linspace(low, high, 21), rtol=1e-14, atol=1e-18)
        assert all(p[other] == nominal[other] for p in chosen for other in nominal if other != field)


@pytest.mark.parametrize(
    ("criterion", "field", "values"),
    [
        ("velocity_noise", "velocity_noise", np.repeat(np.linspace(0, 0.5, 21), 10)),
        ("torque_noise", "torque_noise", np.repeat(np.linspace(0, 1.1, 21), 10)),
        ("torque_response", "response", np.linspace(0.1, 2.0, 21)),
        ("delay", "delay", range(21)),  # 0 to 0.04 s in steps of 0.002 s
    ],
)
def test_sweeps(robot, criterion, field, values):
    cases = make_cases(robot, V2, criterion, 3)
    disturbances = [case.scenario.disturbance for case in cases]
    found = [getattr(disturbance, field) for disturbance in disturbances]
    if criterion == "delay":
        # Rounded down in floating point, as the benchmark's int(delay / dt) is.
        assert found == [int(value / 0.002) for value in np.linspace(0, 0.04, 21)]
    else:
        np.testing.assert_allclose(found, values)
    keys = {tuple(disturbance.noise) for disturbance in disturbances}
    assert len(keys) == (len(cases) if criterion in RANDOM else 1)


def test_noise_differs_between_criteria_and_seeds(robot):
    keys = [
        tuple(case.scenario.disturbance.noise)
        for seed in (0, 1)
        for name in ("velocity_noise", "torque_noise")
        for case in make_cases(robot, V2, name, seed)
    ]
    assert len(set(keys)) == len(keys) == 840


def test_pushes_keep_the_benchmarks_distribution():
    random = np.random.default_rng(0)
    profiles = [draw_pushes(random, PushRules(), 10.0) for _ in range(2000)]
    centres = np.array([np.sort(profile.centre, axis=None) for profile in profiles])
    # μ_i = μ_{i-1} + 1 + U/2 from μ_{-1} = 0: means 1.25 (i + 1), within 1 (i + 1) and 1.5 (i + 1).
    steps = np.diff(centres, axis=1, prepend=0.0)
    assert steps.min() >= 1.0
    assert steps.max() <= 1.5
    np.testing.assert_allclose(centres.mean(axis=0), 1.25 * np.arange(1, 7), atol=0.04)  # 5 standard errors
    amplitudes = np.abs([profile.amplitude for profile in profiles])
    widths = np.array([profile.width for profile in profiles])
    assert 0.5 <= amplitudes.min() < 0.51 < 4.99 < amplitudes.max() <= 5.0
    assert 0.05 <= widths.min() < 0.0501 < 0.0999 < widths.max() <= 0.1
    signs = np.mean([np.sign(profile.amplitude) for profile in profiles])
    assert abs(signs) < 0.05
    # Shuffled: the earliest push is on either joint.
    first = np.mean([profile.centre[0].min() < profile.centre[1].min() for profile in profiles])
    assert abs(first - 0.5) < 0.06


@pytest.mark.parametrize("criterion", CRITERIA)
def test_the_batch_agrees_with_a_numpy_loop(robot, criterion):
    """Single simulations picked from the grid's criteria end where an independent loop ends."""
    rules = dataclasses.replace(BRIEF, tolerance=(9.0,) * 4)
    cases = make_cases(robot, rules, criterion, 7)
    picked = cases[:: max(1, len(cases) // 5)]
    batch = run_many(Swinging(), stack([case.scenario for case in picked]), rules.dt, rules.steps, depth=21)
    for case, final in zip(picked, batch.final, strict=True):
        p, disturbance = vars(case.scenario.parameters), case.scenario.disturbance
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
            rules.steps, float(disturbance.response), int(disturbance.delay), pushes,
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
    scenario = Scenario(leaderboard_parameters(get_robot("acrobot")))
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


def test_a_whole_grid_as_json():
    result = robustness(Swinging(), "pendubot", "mine", LOOSE, seed=4)
    row = json.loads(json.dumps(result.as_dict()))
    assert list(row) == [
        "robot", "controller", "rules", "seed", "version", *CRITERIA, "overall", "details",
    ]  # fmt: skip
    assert (row["robot"], row["controller"], row["rules"], row["seed"]) == ("pendubot", "mine", "loose", 4)
    assert len(row["details"]) == 722
    assert {"criterion", "value", "repetition", "seed", "success"} == set(row["details"][210])
    assert row["overall"] == pytest.approx(sum(row[name] for name in CRITERIA) / 600)
    assert 0.05 < row["overall"] < 0.95
    assert robustness(Swinging(), "pendubot", "mine", LOOSE, seed=4).as_dict() == result.as_dict()
    assert robustness(Swinging(), "pendubot", "mine", LOOSE, seed=5).as_dict() != result.as_dict()


def test_single_criteria_repeat_the_whole_grid():
    whole = robustness(Swinging(), "pendubot", seed=2, rules=LOOSE)
    for criterion in ("perturbations", "torque_noise"):
        part = robustness(Swinging(), "pendubot", seed=2, rules=LOOSE, criteria=criterion)
        successes = [entry.success for entry in whole.results if entry.case.criterion == criterion]
        assert [entry.success for entry in part.results] == successes
        assert 0 < sum(successes) < len(successes)
        assert part.overall is None


class Breaking(AbstractController):
    """NaN when it sees a delay of more than ten steps by the velocity it is shown at the start."""

    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, jnp.where((t > 0.021) & (x[3] == 0), jnp.nan, 1.0) * jnp.array([0.0, 1.0])


def test_a_controller_that_breaks_loses_only_the_simulations_in_which_it_does():
    loose = dataclasses.replace(BRIEF, duration=0.1, tolerance=(9.0, 9.0, 1e9, 1e9))
    result = robustness(Breaking(), "acrobot", rules=loose, criteria=["delay"])
    # With a delay of 11 steps or more the first state, at rest, is still seen at t = 0.022 s, in step 11.
    assert [entry.success for entry in result.results] == [True] * 11 + [False] * 10
    assert len(result.faults) == 10
    assert "not finite" in result.faults[0].fault
    assert "fault" in result.as_dict()["details"][-1]


def plain(x, t):
    return swinging(x, t)


class Counting:
    """Memory in the object: torque grows with the number of calls since the last reset."""

    def __init__(self):
        self.calls = 99

    def reset(self):
        self.calls = 0

    def get_control_output(self, x, t):
        self.calls += 1
        return [0.0, 0.01 * self.calls * math.cos(5 * t)]


class JaxCounting(AbstractController):
    """The same with explicit memory."""

    def init(self):
        return jnp.zeros(())

    def __call__(self, carry, t, x):
        return carry + 1, jnp.array([0.0, 1.0]) * 0.01 * (carry + 1) * jnp.cos(5 * t)


class Uncopyable(Counting):
    """As a handle into another library would be."""

    def __deepcopy__(self, memo):
        raise TypeError("no copies")


@pytest.mark.parametrize(
    ("source", "twin"),
    [(plain, Swinging()), (Counting(), JaxCounting()), (Uncopyable(), JaxCounting())],
    ids=["function", "object", "one by one"],
)
def test_plain_python_gets_the_same_table(source, twin):
    rules = dataclasses.replace(BRIEF, duration=0.3, tolerance=(3.2, 2.0, 9.0, 9.0))
    rules = change_grid(change_grid(rules, "velocity_noise=0:0.5:5:3"), "delay=0:0.04:5")
    chosen = ["velocity_noise", "delay"]
    found = robustness(source, "acrobot", rules=rules, criteria=chosen, seed=1)
    expected = robustness(twin, "acrobot", rules=rules, criteria=chosen, seed=1)
    assert [entry.success for entry in found.results] == [entry.success for entry in expected.results]


def test_a_plain_controller_that_raises_loses_that_simulation():
    def fragile(x, t):
        if abs(x[3]) > 0.2:
            raise RuntimeError("too fast")
        return [0.0, 0.0]

    rules = dataclasses.replace(BRIEF, duration=0.02, tolerance=(9.0, 9.0, 9.0, 9.0))
    rules = change_grid(rules, "velocity_noise=0:0.5:2:2")
    result = robustness(fragile, "acrobot", rules=rules, criteria=["velocity_noise"])
    assert [entry.success for entry in result.results] == [True, True, False, False]
    assert "RuntimeError (too fast) at t = " in result.results[3].fault


@pytest.mark.parametrize(
    ("text", "field", "expected"),
    [
        ("delay=0:0.02:5", "delay", Sweep(0.0, 0.02, 5, 1)),
        ("velocity_noise=0:1:3", "velocity_noise", Sweep(0.0, 1.0, 3, 10)),
        ("torque_noise=0.5:1:3:2", "torque_noise", Sweep(0.5, 1.0, 3, 2)),
    ],
)
def test_other_grids(text, field, expected):
    changed = change_grid(V2, text)
    assert getattr(changed, field) == expected
    assert changed.name == f"v2 {text}"


def test_other_grids_of_the_model_and_of_pushes(robot):
    changed = change_grid(change_grid(V2, "m1r1=0.5:1.5:3"), "perturbations=7")
    assert changed.model["m1r1"].sweep == Sweep(0.5, 1.5, 3)
    assert len(make_cases(robot, changed, "perturbations", 0)) == 7
    assert len(make_cases(robot, changed, "model", 0)) == 210 - 21 + 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("speed=0:1:2", "names no sweep"),
        ("delay", "malformed"),
        ("delay=0:1", "malformed"),
        ("delay=0:x:3", "malformed"),
        ("delay=0:inf:3", "malformed"),
        ("delay=0:nan:3", "malformed"),
        ("delay=0:1:2.5", "whole number"),
        ("delay=0:1:0", "whole number"),
        ("perturbations=0", "whole number"),
    ],
)
def test_malformed_grids(text, message):
    with pytest.raises(SwingupError, match=message) as error:
        change_grid(V2, text)
    assert repr(text) in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("velocity_noise=-1:1:3", "must not be negative"),
        ("delay=0:5:3", "make it shorter"),
        ("m2=-1:1:3", "must be positive"),
    ],
)
def test_grids_that_are_no_disturbance(text, message):
    with pytest.raises(SwingupError, match=message):
        robustness(Swinging(), "acrobot", rules=change_grid(V2, text))


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
        robustness(swingup.shipped_policy("pendubot")[0], "acrobot")


class Network(AbstractController):
    """A network from Equinox: its activation is a leaf that is no array."""

    network: eqx.nn.MLP
    label: str

    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, self.network(x.astype(jnp.float32)).astype(x.dtype)


def test_controllers_may_hold_what_is_no_array():
    controller = Network(eqx.nn.MLP(4, 2, 8, 1, key=jax.random.key(0)), "mine")
    assert swingup.check_controller(controller, "acrobot")[0].startswith("it commands up to")
    assert swingup.evaluate(controller, "acrobot").criteria.score == 0.0
    rules = dataclasses.replace(BRIEF, duration=0.1, tolerance=(9.0, 9.0, 1e9, 1e9))
    assert robustness(controller, "acrobot", rules=rules, criteria="delay").percent["delay"] == 100.0


class Broken(AbstractController):
    """It cannot be compiled, for one reason or another."""

    how: str = eqx.field(static=True)

    def init(self):
        if self.how == "init":
            raise RuntimeError("not\nyet")
        return jnp.zeros((), jnp.float32)

    def __call__(self, carry, t, x):
        if self.how == "branch":
            return carry, jnp.zeros(2) if x[0] > 0 else jnp.ones(2)
        if self.how == "scalar":
            return carry, jnp.sin(t)
        if self.how == "memory":
            return carry + t, jnp.zeros(2)
        return jnp.zeros(2)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("init", "tracing it raised RuntimeError: not yet"),
        ("branch", "tracing it raised TracerBoolConversionError"),
        ("scalar", r"its torque has shape \(\)"),
        ("memory", "its memory changes shape or dtype"),
        ("alone", "a call of it must return two things"),
    ],
)
@pytest.mark.parametrize("judge", [swingup.evaluate, swingup.robustness, swingup.uptime])
def test_controllers_that_cannot_be_compiled(judge, how, message):
    with pytest.raises(SwingupError, match=f"controller 'mine': {message}") as error:
        judge(Broken(how), "acrobot", "mine")
    assert "\n" not in str(error.value)


def test_plain_controllers_that_cannot_be_started():
    class Starting:
        def reset(self):
            raise OSError("no device")

        def get_control_output(self, x, t):
            return [0.0, 0.0]

    with pytest.raises(SwingupError, match=r"controller 'mine': its reset\(\) raised OSError \(no device\)"):
        swingup.evaluate(Starting(), "acrobot", "mine")
    rules = dataclasses.replace(BRIEF, duration=0.01)
    result = robustness(Starting(), "acrobot", rules=rules, criteria="delay")
    assert len(result.faults) == 21


def test_copies_that_share_a_memory_run_one_by_one():
    class Shared:
        calls = 0

        def reset(self):
            Shared.calls = 0

        def get_control_output(self, x, t):
            Shared.calls += 1
            return [0.0, 0.01 * Shared.calls * math.cos(5 * t)]

    rules = change_grid(dataclasses.replace(BRIEF, duration=0.3, tolerance=(0.1, 3.2, 9.0, 9.0)), "delay=0:0.04:3")
    cases = [case.scenario for case in make_cases(get_robot("acrobot"), rules, "delay", 0)]
    found = run_many(PlainController(Shared()), stack(cases), rules.dt, rules.steps, depth=21)
    expected = run_many(JaxCounting(), stack(cases), rules.dt, rules.steps, depth=21)
    np.testing.assert_allclose(found.final, expected.final, rtol=1e-9, atol=1e-9)


def test_an_infinite_torque_is_named_with_its_time():
    class Infinite(Broken):
        def init(self):
            return None

        def __call__(self, carry, t, x):
            return None, jnp.where(t > 0.0199, jnp.inf, 0.0) * jnp.array([0.0, 1.0])

    # inf times 0 is NaN on the passive joint; the driven joint's torque would be clipped to 6 N m.
    with pytest.raises(SwingupError, match=r"not finite at t = 0\.02 s"):
        swingup.evaluate(Infinite("late"), "acrobot")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pushes": PushRules(pushes=10)}, "do not fit into 10 s"),
        ({"pushes": PushRules(pushes=0)}, "do not fit"),
        ({"pushes": True}, "pushes = True are no rules"),
        ({"velocity_noise": -0.1}, "velocity_noise = -0.1 is out of range"),
        ({"delay": math.nan}, "delay = nan"),
        ({"seed": -1}, "seed = -1"),
    ],
)
def test_disturbances_out_of_range(options, message):
    with pytest.raises(SwingupError, match=message):
        swingup.make_disturbance(**options)


def test_a_result_tells_what_disturbed_it():
    disturbance = swingup.make_disturbance(velocity_noise=0.1, delay=0.004, pushes=PushRules(), seed=3)
    row = json.loads(json.dumps(swingup.evaluate(Swinging(), "acrobot", disturbance=disturbance).as_dict()))
    assert row["disturbance"]["velocity_noise"] == 0.1
    assert row["disturbance"]["delay_steps"] == 2
    assert row["disturbance"]["noise"] == [3, 0]
    assert np.shape(row["disturbance"]["pushes"]["centre"]) == (2, 3)
    assert "disturbance" not in swingup.evaluate(Swinging(), "acrobot").as_dict()
