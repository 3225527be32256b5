"""The regulator, against SciPy's Riccati equations, on plants that are not its file's, and between its bounds."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_discrete_are

from swingup.common.errors import SwingupError
from swingup.controllers.baselines.known_plant import damped
from swingup.controllers.baselines.lqr import linearised
from swingup.controllers.interface.controller import AbstractController, check_interface
from swingup.controllers.stack.controller import make_controller, policy_of
from swingup.controllers.stack.estimator import with_estimator
from swingup.controllers.stack.regulator import TRIANGLE, with_regulator
from swingup.dynamics.angles import UPRIGHT
from swingup.dynamics.integrate import rk4_step
from swingup.plant.base_parameters import base_parameters, geometry_of
from swingup.plant.maths import NUMPY
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import ROBOTS
from swingup.policy.identifier.settings import IdentifierSettings
from swingup.policy.numpy_backend.regulator import held, regulator_loop
from swingup.policy.pendulum import PARTS, read_pendulum_policy, write_pendulum_policy
from swingup.policy.plant_facts import policy_plant
from swingup.policy.regulator import core
from swingup.policy.regulator import settings as chosen
from swingup.policy.regulator.settings import STATE_WEIGHTS, TORQUE_WEIGHT, RegulatorSettings, fixed_point
from swingup.policy.regulator.upright import upright_step

from .references import UNSOUND, sighted_policy

DT, STEPS = 0.002, 1500
SETTINGS = RegulatorSettings()
CHANGED = {"m2": 1.1, "r1": 0.95, "I2": 1.15}
"""Parameters of another plant, relative to the leaderboards'."""


class Marked(AbstractController):
    """Commands the same torque always, and counts its calls."""

    torque: float

    def init(self):
        return jnp.array(0)

    def __call__(self, carry, t, x):
        return carry + 1, jnp.full(2, self.torque, x.dtype)


@functools.cache
def plants(robot):
    """The leaderboards' plant, and another one that has negative friction, too."""
    own = LEADERBOARD.driven(robot)
    changed = {name: factor * getattr(own, name) for name, factor in CHANGED.items()}
    return own, dataclasses.replace(own, **changed, b1=0.05, b2=-0.02, cf1=0.1, cf2=-0.05, Ir=5e-5)


def regulated(robot, settings=SETTINGS, torque=7.0):
    own = policy_plant(plants(robot)[0], robot)
    return with_regulator(Marked(torque), robot, own, settings, own.limit(robot.joint))


def gains(plant, robot):
    """K of the recursion's fixed point."""
    theta, geometry = base_parameters(plant), geometry_of(plant)
    step = chosen.COULOMB_DAMPING, chosen.RICCATI_STEP
    a, b = map(np.array, upright_step(theta, geometry, robot.joint, *step))
    P = fixed_point(plant, robot.joint)
    return b @ P @ a / (chosen.R + b @ P @ b)


class NumpyRegulator:
    """NumPy's regulator of one pendulum, with its memory."""

    def __init__(self, settings, plant, robot):
        self._loop = regulator_loop(settings, plant, robot.joint, plant.limit(robot.joint))
        self._state = core.begin(NUMPY, self._loop)

    def tell(self, base):
        self._held = held(self._loop, base.tolist())

    def __call__(self, x):
        """The torque where it acts, else None."""
        self._state, torque = core.regulate(NUMPY, self._loop, self._state, self._held, x)
        return torque if self._state.acting else None


@pytest.fixture(autouse=True)
def _double():
    with jax.enable_x64(True):
        yield


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.name)
def test_the_fixed_point_is_scipys(robot):
    for plant in plants(robot):
        h = chosen.RICCATI_STEP
        A, B = linearised(damped(plant), robot, UPRIGHT[None], np.zeros(1))
        a = np.eye(4) + h * A[0] + 0.5 * h**2 * A[0] @ A[0]
        b = h * B[0] + 0.5 * h**2 * A[0] @ B[0]
        expected = solve_discrete_are(a, b[:, None], h * np.diag(STATE_WEIGHTS), [[h * TORQUE_WEIGHT]])
        np.testing.assert_allclose(fixed_point(plant, robot.joint), expected, rtol=1e-7)


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.name)
def test_gains_converge_to_those_in_continuous_time(robot, monkeypatch):
    """The difference is that of a torque which is held for a step: it halves with the step."""
    for plant in plants(robot):
        A, B = linearised(damped(plant), robot, UPRIGHT[None], np.zeros(1))
        S = solve_continuous_are(A[0], B[0][:, None], np.diag(STATE_WEIGHTS), [[TORQUE_WEIGHT]])
        expected, errors = B[0] @ S / TORQUE_WEIGHT, []
        for h in (0.005, 0.0025, 0.00125):
            monkeypatch.setattr(chosen, "RICCATI_STEP", h)
            monkeypatch.setattr(chosen, "Q", tuple(h * weight for weight in STATE_WEIGHTS))
            monkeypatch.setattr(chosen, "R", h * TORQUE_WEIGHT)
            found = gains(plant, robot)
            errors.append(np.abs(found / expected - 1).max())
        assert errors[0] < 0.12
        assert errors[2] < 0.55 * errors[1] < 0.55**2 * errors[0]


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.name)
def test_the_cost_to_go_follows_the_plant(robot):
    """Within a tenth of a second, from the file's plant to the one that is told."""
    controller = regulated(robot)
    memory, told = controller.init(), dataclasses.replace(controller, base=base_parameters(plants(robot)[1]))
    expected = fixed_point(plants(robot)[1], robot.joint)[TRIANGLE]
    assert np.abs(memory.regulator.cost_to_go / expected - 1).max() > 0.5

    def call(carry, _):
        after = told(carry, 0.0, jnp.zeros(4))[0]
        return after, after.regulator.cost_to_go

    found = np.asarray(jax.lax.scan(call, memory, length=100)[1])
    errors = np.abs(found / expected - 1).max(axis=1)
    assert errors[50] < 0.05
    assert errors[-1] < 1e-3
    # The file's plant stays where it is.
    stayed = controller(memory, 0.0, jnp.zeros(4))[0].regulator.cost_to_go
    np.testing.assert_allclose(stayed, memory.regulator.cost_to_go, rtol=1e-9)


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.name)
def test_it_holds_another_plant_that_it_is_told(robot):
    # Coulomb friction would leave it standing a little off.
    controller, plant = regulated(robot, torque=0.0), dataclasses.replace(plants(robot)[1], cf1=0.0, cf2=0.0)
    told, limits = dataclasses.replace(controller, base=base_parameters(plant)), jnp.array([plant.tl1, plant.tl2])

    def step(carry, _):
        x, memory = carry
        memory, u = told(memory, 0.0, x)
        return (rk4_step(plant, x, jnp.clip(u, -limits, limits), DT), memory), (x, memory.regulator.acting, u)

    start = jnp.array([np.pi + 0.015 + 2 * np.pi, -0.01 - 2 * np.pi, 0.0, 0.0])
    x, acting, u = map(np.asarray, jax.lax.scan(step, (start, told.init()), length=STEPS)[1])
    assert acting.all()
    assert np.abs(x[-1] - [3 * np.pi, -2 * np.pi, 0, 0]).max() < 1e-3
    assert not u[:, 1 - robot.joint].any()


def test_bounds():
    """It takes over below ``enter`` and gives up above ``leave``, with P of the file's plant."""
    robot = ROBOTS["acrobot"]
    controller = regulated(robot)
    e = np.array([0.01, 0.02, -0.1, 0.05])
    e /= np.sqrt(e @ fixed_point(plants(robot)[0], robot.joint) @ e)
    sizes = np.sqrt([1.1, 0.9, 9.0, np.nan, 9.9, 10.1, 9.9, 0.9, np.inf, 0.9])
    memory, acting, torques = controller.init(), [], []
    for size in sizes:
        memory, u = controller(memory, 0.0, jnp.asarray(UPRIGHT + size * e))
        acting.append(bool(memory.regulator.acting))
        torques.append(np.asarray(u))
    assert acting == [False, True, True, True, True, False, False, True, True, True]
    # The policy's torques while it acts, its number of calls always.
    assert [torque.tolist() == [7.0, 7.0] for torque in torques] == [not one for one in acting]
    assert int(memory.controller) == len(sizes)
    K = gains(plants(robot)[0], robot)
    assert torques[1] == pytest.approx([0, -K @ e * sizes[1]], rel=1e-6)
    assert np.isnan([torques[3][1], torques[8][1]]).all()
    assert np.abs(torques[2]).max() == 6.0


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.name)
@pytest.mark.parametrize("sign", [1, -1])
def test_dry_friction_of_the_undriven_joint_lowers_the_bounds(robot, sign):
    """0.1 N m makes of 1 and 10 a half, and 3 more; the driven joint's friction changes nothing."""
    own = dataclasses.replace(LEADERBOARD.driven(robot), **{f"cf{2 - robot.joint}": 0.1 * sign})
    own = dataclasses.replace(own, **{f"cf{robot.joint + 1}": 0.3})
    base, settings = base_parameters(own), dataclasses.replace(SETTINGS, enter_coulomb=0.1, leave_coulomb=0.05)
    controller = dataclasses.replace(regulated(robot, settings), base=base)
    nominal = policy_plant(plants(robot)[0], robot)
    other = NumpyRegulator(settings, nominal, robot)
    other.tell(base)
    e = np.array([0.01, 0.02, -0.1, 0.05])
    e /= np.sqrt(e @ fixed_point(own, robot.joint) @ e)
    # At rest at the top until P has followed the plant.
    sizes = np.sqrt([*[0.0] * 200, 3.4, 3.6, 0.6, 0.4])
    states = UPRIGHT + sizes[:, None] * e

    def call(memory, x):
        memory, _ = controller(memory, 0.0, x)
        return memory, memory.regulator.acting

    acting = jax.lax.scan(call, controller.init(), jnp.asarray(states))[1]
    assert acting[-4:].tolist() == [other(x) is not None for x in states][-4:] == [True, False, False, True]


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.name)
def test_a_broken_measurement_is_not_hidden_while_it_acts(robot):
    """An infinite rate must not become the largest torque."""
    controller = regulated(robot)
    memory = controller.init()
    memory = memory._replace(regulator=memory.regulator._replace(acting=jnp.array(True)))
    broken = jnp.where(jnp.isfinite(UNSOUND), UPRIGHT, UNSOUND)
    after, torques = jax.vmap(lambda x: controller(memory, 0.0, x))(broken)
    assert np.asarray(after.regulator.acting).all()
    assert np.isnan(np.asarray(torques)[:, robot.joint]).all()


def test_a_spoilt_cost_to_go_starts_again():
    controller = regulated(ROBOTS["pendubot"])
    memory = controller.init()
    memory = memory._replace(regulator=memory.regulator._replace(cost_to_go=jnp.full(10, jnp.inf)))
    after = controller(memory, 0.0, jnp.zeros(4))[0]
    np.testing.assert_array_equal(after.regulator.cost_to_go, controller.start)


@pytest.mark.parametrize("double", [False, True])
def test_it_belongs_behind_an_estimator(double):
    """Which tells it the plant that an identifier found."""
    robot = ROBOTS["acrobot"]
    with jax.enable_x64(double):
        controller, plant = regulated(robot), plants(robot)[0]
        check_interface(controller)
        check_interface(with_estimator(controller, robot, plant, finding=IdentifierSettings()))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"enter": 2.0, "leave": 1.0}, "leave = 1 is below enter = 2"),
        ({"enter": float("nan")}, "enter"),
        ({"leave_coulomb": 0}, "leave_coulomb"),
    ],
)
def test_settings_that_cannot_work_are_refused(values, message):
    with pytest.raises(SwingupError, match=message):
        RegulatorSettings(**values)


@pytest.fixture
def file(tmp_path):
    """A policy file with metadata of one's choice."""

    def write(**metadata):
        write_pendulum_policy(tmp_path / "p.safetensors", policy_of(sighted_policy()), metadata)
        return tmp_path / "p.safetensors"

    return write


def test_files(file, tmp_path):
    assert read_pendulum_policy(file(regulator={})).regulator == SETTINGS
    assert read_pendulum_policy(file()).regulator is None
    found = read_pendulum_policy(file(regulator={"enter": 2, "enter_coulomb": 3}))
    assert found.regulator == RegulatorSettings(enter=2.0, enter_coulomb=3.0)
    write_pendulum_policy(tmp_path / "again.safetensors", found, {})
    assert read_pendulum_policy(tmp_path / "again.safetensors").regulator == found.regulator
    assert make_controller(found).settings == found.regulator
    assert make_controller(found, estimator=True).controller.settings == found.regulator


def changed(policy, tmp_path, **fields):
    """A policy with other fields, written with its file's metadata, and read again."""
    write_pendulum_policy(tmp_path / "changed.safetensors", dataclasses.replace(policy, **fields), policy.metadata)
    return read_pendulum_policy(tmp_path / "changed.safetensors")


def test_what_a_policy_has_wins_over_the_old_metadata(file, tmp_path):
    old = read_pendulum_policy(
        file(estimator={"dt": 0.004}, identifier={"passive_limit": 0.4}, regulator={"enter": 2})
    )
    assert changed(old, tmp_path).regulator == RegulatorSettings(enter=2.0)
    assert changed(old, tmp_path, regulator=RegulatorSettings(enter=3.0)).regulator.enter == 3.0
    assert changed(old, tmp_path, torque_limit=2.0).torque_limit == 2.0
    # With and without an identifier beside it.
    for kept in (old, changed(old, tmp_path, identifier=None)):
        estimator = dataclasses.replace(old.estimator, velocity_noise=0.3)
        found = changed(kept, tmp_path, estimator=estimator)
        assert (found.estimator, found.identifier) == (estimator, kept.identifier)
    bare = dataclasses.replace(policy_of(sighted_policy()), estimator=estimator)
    assert changed(bare, tmp_path).estimator == estimator


def test_what_a_policy_has_no_more_is_not_written(file, tmp_path):
    old = read_pendulum_policy(file(estimator={}, identifier={}, regulator={}, guard={}, command="none"))
    for part in ("identifier", "regulator", "guard"):
        found = changed(old, tmp_path, **{part: None})
        others = {"estimator", "identifier", "regulator", "guard"} - {part}
        assert getattr(found, part) is None
        assert others == {name for name in PARTS if getattr(found, name) is not None}
        assert others == found.metadata.keys() & set(PARTS)
    assert found.metadata["command"] == "none"
    alone = changed(old, tmp_path, estimator=None, identifier=None)
    assert (alone.estimator, alone.identifier, alone.regulator) == (None, None, SETTINGS)


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"regulator": None}, "regulator None is not an object of settings"),
        ({"regulator": {"entre": 1}}, "unknown regulator setting 'entre': use some of enter"),
        ({"regulator": {"leave": "1"}}, "regulator setting leave = '1': use a number"),
    ],
)
def test_files_that_cannot_work_are_refused(file, metadata, message):
    with pytest.raises(SwingupError, match=message):
        read_pendulum_policy(file(**metadata))


def test_numpys_is_told_a_plant_like_jaxs():
    """Behind an identifier that finds the plant in two steps; the rows of the conformance table have one plant."""
    robot = ROBOTS["pendubot"]
    controller, own = regulated(robot), policy_plant(plants(robot)[0], robot)
    other, memory = NumpyRegulator(SETTINGS, own, robot), controller.init()
    x = UPRIGHT + np.array([0.01, -0.02, 0.05, 0.05])
    for base in (base_parameters(plants(robot)[1]), 1.05 * base_parameters(own)):
        other.tell(base)
        for _ in range(3):
            memory, u = controller.control(memory, 0.0, jnp.asarray(x), base)
            assert other(x) == pytest.approx(float(u[robot.joint]), abs=1e-9)
    assert abs(float(u[robot.joint])) > 0.1
