"""The regulator, against SciPy's Riccati equations, on plants that are not its file's, and between its bounds."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from benchmark.independent import derivative, gravity, rk4
from swingup.controllers.baselines.upright import linearised
from swingup.controllers.interface import AbstractController, check_interface
from swingup.controllers.stack.estimator import with_estimator
from swingup.controllers.stack.regulator import with_regulator
from swingup.dynamics.dynamics import UPRIGHT
from swingup.plant.base_parameters import base_parameters, friction_of, geometry_of, lumped
from swingup.plant.equations import NUMPY
from swingup.plant.plant import LEADERBOARD, ROBOTS, get_robot
from swingup.policy import regulator as equations
from swingup.policy.identifier import IdentifierSettings
from swingup.policy.numpy_backend import held, regulator_loop
from swingup.policy.pendulum import policy_plant
from swingup.policy.regulator import STATE_WEIGHTS, TORQUE_WEIGHT, RegulatorSettings, dry_friction, fixed_point

from .references import UNSOUND

DT = 0.002
SETTINGS = RegulatorSettings()
ERROR = np.array([0.01, 0.02, -0.1, 0.05])


@functools.cache
def plants(robot):
    """The leaderboards' plant, and another one that has negative friction, too."""
    own = LEADERBOARD.driven(robot)
    changed = dataclasses.replace(own, m2=1.1 * own.m2, r1=0.95 * own.r1, I2=1.15 * own.I2, Ir=5e-5)
    return own, dataclasses.replace(changed, b1=0.05, b2=-0.02, cf1=0.1, cf2=-0.05)


def counted(plant, robot, far=False):
    """What the friction of a plant counts as."""
    theta = base_parameters(plant).tolist()
    return dry_friction(NUMPY, lumped(theta, geometry_of(plant)), friction_of(theta), robot.joint, far)


def designed(plant, robot):
    """P and K by SciPy's equation, of the errors and a torque on the undriven joint; torques are held for a step.

    The latter fades by a millionth in each. Dry friction is damping too.
    """
    h = equations.RICCATI_STEP
    b1, b2 = counted(plant, robot).damping
    damped = dataclasses.replace(plant, b1=b1, b2=b2, cf1=0.0, cf2=0.0)
    (A,), (B,), (D,) = linearised(damped, robot, UPRIGHT[None], np.zeros(1))
    held = h * np.eye(4) + 0.5 * h**2 * A
    a = np.block([[np.eye(4) + held @ A, held @ D[:, None]], [np.zeros(4), 1 - 1e-6]])
    b, weight = np.append(held @ B, 0.0), h * TORQUE_WEIGHT
    P = solve_discrete_are(a, b[:, None], h * np.diag([*STATE_WEIGHTS, 0.0]), [[weight]])
    return P, b @ P @ a / (weight + b @ P @ b)


def unit_error(plant, robot):
    """An error of the undriven joint whose cost-to-go is 1."""
    error = ERROR * np.roll([1, 0, 1, 0], 1 - robot.joint)
    return error / np.sqrt(error @ fixed_point(plant, robot.joint)[0][:4, :4] @ error)


def falling(plant, robot, x):
    """The driven joint's angle and rate, and the other one's momentum and torque of gravity."""
    p, driven, other, at = plant.values(), robot.joint, 1 - robot.joint, np.array(x, float)
    still = derivative(p, at, np.zeros(2))[2:]
    mass = np.linalg.inv([derivative(p, at, u)[2:] - still for u in np.eye(2)])
    return np.array([at[driven], at[2 + driven], mass[other] @ at[2:], gravity(p, at)[other]])


def linear_error(plant, robot, x):
    """The errors with which the pendulum, linearised upright, has these numbers."""
    columns = [
        (falling(plant, robot, UPRIGHT + d) - falling(plant, robot, UPRIGHT - d)) / 2e-4 for d in 1e-4 * np.eye(4)
    ]
    return np.linalg.solve(np.transpose(columns), falling(plant, robot, x) - falling(plant, robot, UPRIGHT))


def state_of(error):
    """The state of these linear errors of the undriven joint alone: gravity's torque goes by its angle's sine."""
    return UPRIGHT + np.append(np.arcsin(error[:2]), error[2:])


class NumpyRegulator:
    """NumPy's regulator of one pendulum, with its memory."""

    def __init__(self, settings, plant, robot):
        self.loop = regulator_loop(settings, plant, robot.joint, plant.limit(robot.joint))
        self.state = equations.begin(NUMPY, self.loop)
        self.tell(base_parameters(plant))

    def tell(self, base):
        self._base = list(map(float, base))

    def __call__(self, x):
        """The torque where it acts, else None."""
        with np.errstate(all="ignore"):
            plant = held(self.loop, self._base, bool(self.state.far))
            self.state, torque = equations.regulate(NUMPY, self.loop, self.state, plant, x)
        return torque if self.state.acting else None


def regulator(robot, plant=None, settings=SETTINGS):
    """The regulator of the leaderboards' plant, told another one."""
    made = NumpyRegulator(settings, policy_plant(plants(robot)[0], robot), robot)
    if plant is not None:
        made.tell(base_parameters(plant))
    return made


def test_the_fixed_point_is_scipys(robot):
    for plant in plants(robot):
        (found, gains), (expected, expected_gains) = fixed_point(plant, robot.joint), designed(plant, robot)
        np.testing.assert_allclose(found[:4, :4], expected[:4, :4], rtol=1e-7)
        np.testing.assert_allclose(found[:4, 4], expected[:4, 4], rtol=1e-3)
        np.testing.assert_allclose(gains, expected_gains, rtol=1e-3)


def test_the_cost_to_go_follows_the_plant(robot):
    """Within a tenth of a second, from the file's plant to the one that is told."""
    told, own = regulator(robot, plants(robot)[1]), regulator(robot)
    # Of what the friction costs alone both have 0.
    expected, start, errors = fixed_point(plants(robot)[1], robot.joint)[0][:4], own.state.cost_to_go[:5, :5], []
    assert np.abs(start[:4] / expected - 1).max() > 0.2
    for _ in range(100):
        told(UPRIGHT)
        errors.append(np.abs(told.state.cost_to_go[:4, :5] / expected - 1).max())
    assert errors[50] < 0.1
    assert errors[-1] < 2e-3
    # The file's plant stays where it is; a spoilt cost-to-go starts again there.
    own(np.zeros(4))
    np.testing.assert_allclose(own.state.cost_to_go[:5, :5], start, rtol=1e-9)
    own.state = own.state._replace(cost_to_go=np.full((6, 6), np.inf))
    own(np.zeros(4))
    np.testing.assert_array_equal(own.state.cost_to_go[:5, :5], start)


def test_it_holds_another_plant_that_it_is_told(robot):
    # Coulomb friction would leave it standing a little off.
    plant = dataclasses.replace(plants(robot)[1], cf1=0.0, cf2=0.0)
    told, p = regulator(robot, plant), plant.values()
    x = np.array([np.pi + 0.015 + 2 * np.pi, -0.01 - 2 * np.pi, 0.0, 0.0])
    for _ in range(1500):
        torque = told(x)
        assert torque is not None
        x = rk4(p, x, np.clip(torque, -6, 6) * np.array(robot.actuation), DT)
    assert np.abs(x - [3 * np.pi, -2 * np.pi, 0, 0]).max() < 1e-3


def test_errors_as_if_linear(robot):
    other = 1e-5 * np.eye(4)[1 - robot.joint]
    for plant in plants(robot):
        for x in (UPRIGHT + 16 * ERROR, UPRIGHT - 30 * ERROR):
            lumps = lumped(base_parameters(plant), geometry_of(plant))
            found, slope = equations.as_if_linear(NUMPY, lumps, robot.joint, x)
            np.testing.assert_allclose(found, linear_error(plant, robot, x), rtol=1e-4)
            slopes = (falling(plant, robot, x + other) - falling(plant, robot, x - other)) / 2e-5
            assert slope == pytest.approx(slopes[3], rel=1e-6)


@pytest.mark.parametrize(("name", "most"), [("acrobot", 0.1), ("pendubot", 0.07)])
def test_it_holds_against_pushes_of_the_undriven_joint(name, most):
    """Of so many N m s: with the errors themselves 0.04 and 0.06. It never takes hanging for upright."""
    robot = get_robot(name)
    plant = plants(robot)[0]
    found, p = regulator(robot, settings=RegulatorSettings(leave=1e4)), plant.values()
    assert found(np.zeros(4)) is None
    assert found(UPRIGHT) == 0.0
    blow = derivative(p, UPRIGHT, np.eye(2)[1 - robot.joint])[2:] - derivative(p, UPRIGHT, np.zeros(2))[2:]
    x = UPRIGHT + np.array([0.0, 0.0, *(most * blow)])
    for _ in range(2000):
        torque = found(x)
        assert torque is not None
        x = rk4(p, x, torque * np.array(robot.actuation), DT)
    assert np.abs(x - UPRIGHT).max() < 0.02


def test_bounds():
    """It takes over below ``enter`` and gives up above ``leave``, with P of the file's plant."""
    robot = get_robot("acrobot")
    own, found = plants(robot)[0], regulator(robot)
    e = unit_error(own, robot)
    sizes = np.sqrt([1.1, 0.9, 9.0, 0.0, 9.9, 10.1, 9.9, 0.9, 0.0, 0.9])
    states = [state_of(size * e) for size in sizes]
    states[3][:], states[8][:] = np.nan, np.inf
    torques = [found(x) for x in states]
    acting = [torque is not None for torque in torques]
    assert acting == [False, True, True, True, True, False, False, True, True, True]
    assert torques[1] == pytest.approx(-designed(own, robot)[1][:4] @ e * sizes[1], rel=1e-6)
    assert np.isnan([torques[3], torques[8]]).all()
    assert abs(torques[2]) == 6.0


@pytest.mark.parametrize("sign", [1, -1])
def test_dry_friction_of_the_undriven_joint_lowers_the_bounds(robot, sign):
    """0.03 N m makes of 1 and 10 a half, and 3 more; the driven joint's friction changes nothing."""
    own = dataclasses.replace(LEADERBOARD.driven(robot), **{f"cf{2 - robot.joint}": 0.03 * sign})
    own = dataclasses.replace(own, **{f"cf{robot.joint + 1}": 0.05})
    settings = dataclasses.replace(SETTINGS, enter_coulomb=0.03, leave_coulomb=0.015)
    found, e = regulator(robot, own, settings), unit_error(own, robot)
    # At rest at the top until P has followed the plant.
    acting = [found(state_of(size * e)) is not None for size in np.sqrt([*[0.0] * 500, 3.4, 3.6, 0.6, 0.4])]
    assert acting[-4:] == [True, False, False, True]


def test_dry_friction_of_the_undriven_joint_moves_the_torque(robot):
    """By the gain of a constant torque with the friction's sign; the driven joint's friction does not."""
    other, rate = 2 - robot.joint, np.array([0, 0, 0.02, 0.02])
    own = dataclasses.replace(LEADERBOARD.driven(robot), **{f"cf{other}": 0.01, f"cf{robot.joint + 1}": 0.05})
    found = NumpyRegulator(SETTINGS, own, robot)
    share, knee = equations.WEAK
    friction = -share * 0.01 * np.arctan(knee * 0.02)
    for sign in (1, -1):
        expected = -designed(own, robot)[1] @ [*(sign * rate), sign * friction]
        assert found(UPRIGHT + sign * rate) == pytest.approx(expected, rel=1e-3)


def rough(robot, friction):
    """The leaderboards' plant with dry friction of its undriven joint (N m)."""
    return dataclasses.replace(LEADERBOARD.driven(robot), **{f"cf{2 - robot.joint}": friction})


def test_weak_friction_counts_as_it_is_and_strong_friction_on_both_sides_of_where_control_is_lost(robot):
    """There the torque does not reach the growing motion: the least singular value of [B AB A²B A³B] is 0."""
    joint = 1 - robot.joint
    assert counted(rough(robot, 0.02), robot).damping[joint] == pytest.approx(0.02 + 0.02**2 / 0.012)
    assert counted(rough(robot, -0.02), robot).damping[joint] == -0.02
    far, near = (counted(rough(robot, 0.1), robot, far).damping[joint] for far in (True, False))
    lost = near / 3
    assert far == pytest.approx(0.4 * lost)
    reach = []
    for damping in (far, lost, near):
        plant = dataclasses.replace(rough(robot, 0.0), **{f"b{joint + 1}": damping})
        (A,), (B,), _ = linearised(plant, robot, UPRIGHT[None], np.zeros(1))
        # The growing motion's own row: w A = λ w, and w B is how the torque reaches it.
        rates, rows = np.linalg.eig(A.T)
        row = rows[:, np.argsort(rates.real)[-1]].real, rows[:, np.argsort(rates.real)[-2]].real
        reach.append(min((w @ B for w in row), key=abs))
    assert abs(reach[1]) < 1e-6 * min(abs(reach[0]), abs(reach[2]))
    # Friction above it has the design beyond it alone.
    beyond = rough(robot, 1.2 * lost)
    assert counted(rough(robot, 0.9 * lost), robot).two
    assert not counted(beyond, robot).two
    assert counted(beyond, robot, True) == counted(beyond, robot, False)


def test_strong_friction_has_a_design_far_from_the_top_and_one_near_it(robot):
    plant = rough(robot, 0.1)
    found, e = NumpyRegulator(SETTINGS, plant, robot), unit_error(plant, robot)
    far = []
    for size in (0.0, 0.9, 1.1, np.nan, 0.9, 0.0):
        found(state_of(np.sqrt(size) * e))
        far.append(bool(found.state.far))
    assert far == [False, False, True, True, True, False]
    weak = NumpyRegulator(SETTINGS, rough(robot, 0.02), robot)
    weak(np.zeros(4))
    assert not weak.state.far


def test_strong_friction_is_held_from_where_the_law_of_weak_friction_falls(robot, monkeypatch):
    plant, largest = rough(robot, 0.08), []
    for strong in (equations.STRONG, np.inf):
        monkeypatch.setattr(equations, "STRONG", strong)
        found = NumpyRegulator(dataclasses.replace(SETTINGS, enter=1e4, leave=1e4), plant, robot)
        x, angles = UPRIGHT + np.array([0.05, 0.05, 0.0, 0.0]), []
        while len(angles) < 1500 and (not angles or angles[-1] < 3.0):
            x = rk4(plant.values(), x, (found(x) or 0.0) * np.array(robot.actuation), DT)
            angles.append(np.abs(x - UPRIGHT)[:2].max())
        largest.append(max(angles[-250:]))
    assert largest[0] < 0.8
    assert largest[1] > 3.0


class Marked(AbstractController):
    """Commands the same torque always, and counts its calls."""

    def init(self):
        return jnp.array(0)

    def __call__(self, carry, t, x):
        return carry + 1, jnp.full(2, 7.0, x.dtype)


def in_jax(robot):
    own = policy_plant(plants(robot)[0], robot)
    return with_regulator(Marked(), robot, own, SETTINGS, own.limit(robot.joint))


def test_jax_does_the_same(either_robot):
    """Told a plant that an identifier finds, and with measurements that are not finite while it acts or not."""
    found, numpys, calls = in_jax(either_robot), regulator(either_robot), 0
    broken = np.where(np.isfinite(UNSOUND), UPRIGHT, UNSOUND)
    errors = np.array([3.0, 1.0, 1.0, 40.0, 1.0])[:, None] * np.array([0.01, -0.02, 0.05, 0.05])
    with jax.enable_x64(True):
        memory, call = found.init(), jax.jit(lambda *given: found.control(*given))
        for base in (base_parameters(plants(either_robot)[1]), 1.05 * base_parameters(plants(either_robot)[0])):
            numpys.tell(base)
            for x in (*(UPRIGHT + errors), broken[3], broken[7], UPRIGHT, *broken):
                memory, u = call(memory, 0.0, jnp.asarray(x), base)
                torque, calls = numpys(x), calls + 1
                # The policy's torques while it acts, its number of calls always.
                expected = [7.0, 7.0] if torque is None else np.array(either_robot.actuation) * torque
                np.testing.assert_allclose(u[either_robot.joint], expected[either_robot.joint], rtol=0, atol=1e-9)
                if torque is not None:
                    assert np.isnan(torque) if not np.isfinite(x).all() else u[1 - either_robot.joint] == 0.0
    assert int(memory.controller) == calls


@pytest.mark.parametrize("double", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_it_belongs_behind_an_estimator(double):
    """Which tells it the plant that an identifier found."""
    robot = ROBOTS["acrobot"]
    with jax.enable_x64(double):
        controller, plant = in_jax(robot), plants(robot)[0]
        check_interface(controller)
        check_interface(with_estimator(controller, robot, plant, identifier=IdentifierSettings()))
