"""What every back end is compared with: the judge's JAX in double precision, on states and on recorded loops."""

import dataclasses
import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from policies import new_actor
from swingup.controllers.stack.policy import (
    Policy,
    PolicyController,
    make_controller,
    make_policy,
    policy_alone,
    policy_of,
)
from swingup.dynamics.integrate import rk4_step
from swingup.plant.base_parameters import base_parameters
from swingup.plant.equations import NUMPY, damped_midpoint_step
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, get_robot, lump
from swingup.policy.estimator import EstimatorSettings
from swingup.policy.identifier import IdentifierSettings
from swingup.policy.network import Layer, Network
from swingup.policy.numpy_backend import numpy_controller
from swingup.policy.pendulum import policy_plant
from swingup.policy.policy import NumpyNetwork, TaskPolicy, task_metadata
from swingup.policy.regulator import RegulatorSettings
from swingup.policy.shipped import ADAPTIVE, AR_EAPO, SHIPPED_POLICIES, load_policy
from swingup.policy.spaces import box, discrete
from swingup.tasks.task import NormaliseStage, PendulumStage, PlantStage

DT = 0.002
TOLERANCE = 5e-5
"""How far torques in single precision may lie from those in double precision (N m)."""
ENCODER = 2 * np.pi / 2**14
"""Quantum of the angles (rad) of an encoder with 2^14 counts."""


class Sensor(NamedTuple):
    """What measures the state, and when; and what friction the plant has."""

    noise: float = 0.0  # deviation of the velocities' (rad/s)
    age: int = 0  # of a measurement (steps)
    quantum: float = 0.0  # steps of the angles (rad)
    periods: tuple[float, ...] = (DT,)  # times between calls (s), one of which is drawn for each
    differences: bool = False  # of the measured angles are the velocities; the loop's periods must be equal
    offset: float = 0.0  # error of the zeros, + for the shoulder, - for the elbow (rad)
    coulomb: float = 0.0  # friction of both joints; with any, the passive joint's motor is live (N m)


SENSORS = {
    "clean": Sensor(),
    "noisy": Sensor(0.5, 0, ENCODER),
    "late": Sensor(0.0, 20),
    "late and noisy": Sensor(0.3, 15, ENCODER),
    "250 Hz": Sensor(0.1, 4, ENCODER, (0.004,)),
    "uneven": Sensor(0.1, 4, ENCODER, (DT, 0.0025)),
    "quantum": Sensor(0.0, 1, 3.81e-4, differences=True),
    "offsets and friction": Sensor(0.1, 1, ENCODER, offset=0.02, coulomb=0.1),
}
COLUMNS = [*SENSORS, "not finite"]

UNSOUND = np.where(np.eye(4), np.array([np.nan, np.inf, -np.inf])[:, None, None], 0.1).reshape(-1, 4)
"""States (12, 4) with one number that is not finite, for which every torque of a policy must be NaN."""

SHIPPED = [f"{robot}-{name}" for robot in ("acrobot", "pendubot") for name in SHIPPED_POLICIES if name != ADAPTIVE]
"""Those that every back end runs."""
ESTIMATED = ["acrobot-estimated", "pendubot-estimated"]
"""``ar-eapo`` behind a state estimator."""
ADAPTIVES = ["acrobot-adaptive", "pendubot-adaptive"]
"""The shipped ones with an identifier and a regulator."""
SMALL = ["pendubot-wrapped", "pendubot-bare"]
"""Untrained, with the paper's observation, which jumps at its wraps: with normalisation, or GELU and clip."""


@functools.cache
def random_states(number=2_500):
    """States (number, 4) in several turns and beyond the velocities' scale, away from where an angle is wrapped."""
    x = np.random.default_rng(5).uniform(-1, 1, (2 * number, 4)) * [9, 9, 25, 25]
    wrap = np.abs((x[:, :2] + np.pi) % (2 * np.pi) - np.pi).min(axis=1)
    return x[wrap > 1e-3][:number]


def random_layer(outputs, inputs, seed):
    rng = np.random.default_rng(seed)
    return Layer(*(rng.normal(size=shape).astype(np.float32) for shape in ((outputs, inputs), outputs)))


@functools.cache
def policy(name):
    """A policy by its name: one above, or one of those here."""
    robot, _, kind = name.partition("-")
    if name in SMALL:
        found = policy_of(small_policy(kind == "wrapped"))
        other = {} if kind == "wrapped" else {"activation": "gelu", "bounds": "clip"}
        return dataclasses.replace(found, network=dataclasses.replace(found.network, **other))
    if name == "acrobot-sighted":
        return policy_of(sighted_policy())
    if name == "acrobot-regulated":
        return dataclasses.replace(policy("acrobot-sighted"), regulator=RegulatorSettings())
    if name == "acrobot-rough":  # its regulator has two designs, near the top and far from it
        found = policy("acrobot-regulated")
        return dataclasses.replace(found, plant=found.plant.changed(cf1=0.1))
    if name == "acrobot-told":  # its identifier tells policy and regulator what it finds
        near = RegulatorSettings(enter=5.0, leave=50.0, enter_coulomb=0.1, leave_coulomb=0.05)
        identifier = IdentifierSettings(load_deviation=0.05, spring_deviation=0.02)
        parts = {"estimator": EstimatorSettings(), "identifier": identifier, "regulator": near}
        return dataclasses.replace(policy("acrobot-sighted"), **parts)
    if name == "acrobot-friction":  # its estimator believes in C.1 as it is: with friction and motors' rotors
        return dataclasses.replace(policy("acrobot-estimated"), plant=policy("acrobot-sighted").plant)
    if name in ESTIMATED:
        return dataclasses.replace(load_policy(AR_EAPO, robot), estimator=EstimatorSettings())
    return load_policy(kind, robot)


def untrained(size, seed):
    """An actor in single precision, as a file has it."""
    with jax.enable_x64(False):
        return jax.tree.map(lambda leaf: leaf + 0.1, new_actor(size, (16, 12), seed))


def small_policy(normalised=True):
    """A small untrained policy of the pendubot with the paper's observation."""
    normalise = NormaliseStage(mean=np.linspace(-1, 1, 4), variance=np.linspace(0.5, 2, 4), clip=1.0)
    stages = (PendulumStage("wrapped", 20.0), *([normalise] if normalised else []))
    return PolicyController(Policy(stages, untrained(4, 0)), 3.0, get_robot("pendubot"))


def sighted_policy():
    """A small untrained policy of the acrobot that sees its plant, C.1 with its friction and rotors."""
    plant = policy_plant(load_plant("C.1"), get_robot("acrobot"))
    base = base_parameters(plant)
    # Inputs from -0.15 to 0.15, except the last, which is clipped.
    centre, scale = base * np.linspace(1.3, 0.7, 9), 2 * np.abs(base)
    scale[8] = 0.01 * base[8]
    stages = (PendulumStage("sincos", 20.0), PlantStage(centre, scale, clip=1.0))
    return PolicyController(Policy(stages, untrained(15, 1)), 3.0, get_robot("acrobot"), plant=plant)


def in_double(controller):
    """A controller whose weights are float64: its networks do all in double precision, which the judge's do not."""
    return jax.tree.map(
        lambda leaf: leaf.astype(np.float64) if getattr(leaf, "dtype", None) == np.float32 else leaf, controller
    )


@functools.cache
def recorded(name, steps):
    """Loops of a policy by sensor: times, measurements (n, 4) and torques (n, 2).

    Behind a sensor the loop is closed; "not finite" is a recording that is played to the controller.
    """
    columns, (times, played) = [], (np.resize(rows, (steps, *rows.shape[1:])) for rows in faults())
    for name_of_sensor in COLUMNS:
        sensor, random = SENSORS.get(name_of_sensor, Sensor()), np.random.default_rng(3)
        noise, pauses = sensor.noise * random.normal(size=(steps, 2)), random.choice(sensor.periods, steps)
        wrong, closed = sensor.offset * np.array([1.0, -1.0]), name_of_sensor in SENSORS
        how = sensor.age, sensor.quantum, sensor.differences, wrong, sensor.coulomb
        columns.append((*how, np.cumsum(pauses) - pauses if closed else times, pauses, noise, not closed, played))
    with jax.enable_x64(True):
        stacked = tuple(jnp.asarray(np.array(column)) for column in zip(*columns, strict=True))
        found = in_double(make_controller(policy(name)))
        measured, torques = (np.asarray(rows) for rows in _loops(found, *stacked))
    lengths = [steps] * len(SENSORS) + [len(faults()[0])]
    return {
        sensor: (column[5][:length], x[:length], u[:length])
        for sensor, length, column, x, u in zip(COLUMNS, lengths, columns, measured, torques, strict=True)
    }


@eqx.filter_jit
def _loops(found, *columns):
    p = LEADERBOARD.driven(found.robot)

    def loop(age, quantum, differences, offset, coulomb, times, pauses, noise, played, recording):
        plant = dataclasses.replace(p, cf1=coulomb, cf2=coulomb)
        limits = jnp.maximum(jnp.array([p.tl1, p.tl2]), jnp.where(coulomb > 0, 0.5, 0.0))

        def angles(x):
            return jnp.where(quantum > 0, jnp.round(x[:2] / (quantum + 1e-30)) * quantum, x[:2]) + offset

        def step(carry, now):
            past, memory = carry
            t, pause, normal, given = now
            seen, before = angles(past[age]), angles(past[age + 1])
            rates = jnp.where(differences, (seen - before) / pause, past[age, 2:] + normal)
            measured = jnp.where(played, given, jnp.concatenate([seen, rates]))
            memory, u = found(memory, t, measured)
            x = rk4_step(plant, past[0], jnp.clip(u, -limits, limits), pause)
            return (jnp.concatenate([x[None], past[:-1]]), memory), (measured, u)

        rows = (times, pauses, noise, recording)
        return jax.lax.scan(step, (jnp.zeros((22, 4)), found.init()), rows)[1]

    return jax.vmap(loop)(*columns)


@functools.cache
def numpy_run(name, period=DT, shift=0.0):
    """A closed loop in NumPy alone, without a compiler: times (n,), measurements (n, 4) and torques (n, 2)."""
    return numpy_loop(numpy_controller(policy(name)), period, shift)


def numpy_loop(found, period=DT, shift=0.0, start=(0.0, 0.0, 0.0, 0.0), steps=1000, plant=None, wrong=(0.0, 0.0)):
    """The same with a controller, whose clock may be ahead (s), from another state or for fewer calls.

    Another plant may move, and measured angles may be wrong by offsets (rad).
    """
    plant, noise, x = plant or found.inner.policy.plant, np.random.default_rng(0).normal(size=(steps, 2)), start
    lumped, rows = lump(plant), []
    for k in range(steps):
        t, measured = k * period, np.add(x, [*wrong, *(0.02 * noise[k])])
        rows.append((t, measured, found(measured, t + shift)))
        x = damped_midpoint_step(lumped, plant.friction, x, rows[-1][2].tolist(), period, NUMPY)
    return [np.array(column) for column in zip(*rows, strict=True)]


def faults():
    """Times (n,) and measurements (n, 4) with a pause, a clock set back, a jump, and some that are not finite."""
    random, steps = np.random.default_rng(0), 60
    x = np.cumsum(random.normal(size=(steps, 4)) * [5e-4, 5e-4, 0.1, 0.1], axis=0) + np.array([0.3, 0.2, 0, 0])
    times = DT * np.arange(steps)
    times[20:] += 0.01  # a pause
    times[30:] -= 0.05  # a clock set back
    x[40:, 1] += 1.0  # a jump
    x[45], x[48], x[51, 2] = np.nan, np.inf, 1e200
    gap = np.tile(UNSOUND, (3, 1))  # an estimator bears 25 of them
    times = np.concatenate([times, times[-1] + 1.01 * DT * np.arange(1, len(gap) + 1)])
    return times, np.concatenate([x, gap])


def silent(name, states):
    """In which calls (n,) of ``faults`` a torque must be NaN: behind an estimator, after 0.05 s of them."""
    broken = ~np.isfinite(states).all(axis=1)
    if policy(name).estimator is None:
        return broken
    gaps = np.array([np.argmin(broken[call::-1]) for call in range(len(broken))])
    return broken & (1.01 * DT * gaps > 0.05)


LONGEST = 1200
"""Calls that are compiled together, so that one program serves recordings of any length."""


def replay(found, times, states, given=None):
    """A JAX controller's torques (n, 2) from its start on; its motors may be given others (n, 2)."""
    columns = (times, states) if given is None else (times, states, given)
    padded = [np.resize(column, (LONGEST, *column.shape[1:])) for column in columns]
    with jax.enable_x64(True):
        return np.asarray(_replayed(found, *map(jnp.asarray, padded)))[: len(times)]


def within(name, torques):
    """Torques (n, 2) with the driven joint's within its limit."""
    cut, joint = torques.copy(), policy(name).robot.joint
    limit = policy(name).plant.limit(joint)
    cut[:, joint] = np.clip(cut[:, joint], -limit, limit)
    return cut


@eqx.filter_jit
def _replayed(found, *columns):
    def step(memory, now):
        memory, u = found(memory, *now[:2])
        return memory if len(now) == 2 else _given(memory, now[2], found.robot.joint), u

    return jax.lax.scan(step, found.init(), columns)[1]


def _given(memory, u, joint):
    """The memory of an estimator and its identifier once the motors were given other torques."""
    state, identified = memory.estimator, memory.estimator.identifier
    identified = identified._replace(torques=identified.torques.at[0].set(u))
    state = state._replace(torques=state.torques.at[0].set(u[joint]), identifier=identified)
    return memory._replace(estimator=state)


def exact(name):
    """The policy alone, in double precision."""
    return in_double(policy_alone(policy(name)))


def alone(found, states):
    """The torques (n,) of the driven joint of a policy alone in JAX."""
    with jax.enable_x64(True):
        u = np.asarray(_alone(found, jnp.asarray(states)))
    assert not u[:, 1 - found.robot.joint].any()
    return u[:, found.robot.joint]


@eqx.filter_jit
def _alone(found, states):
    return jax.vmap(lambda x: found(None, jnp.zeros(()), x)[1])(states)


def space_task(name, actions, seen, activation="relu", bounds="tanh", mean=0.0, deviation=1.0):
    """An untrained policy of a task with these spaces, whose observations have a mean and a deviation."""
    rng, size = np.random.default_rng(1), seen.size
    normalise = NormaliseStage(
        (mean + deviation * rng.normal(size=size)).astype(np.float32), np.full(size, deviation**2), 10.0, 1e-18
    )
    widths = [size, 32, 24, sum(actions.choices) or actions.size]
    layers = [random_layer(*sizes, seed) for seed, sizes in enumerate(zip(widths[1:], widths, strict=False))]
    layers = [
        Layer(each.weight * np.float32(1.5 * each.weight.shape[1] ** -0.5), 0.1 * each.bias) for each in layers
    ]
    network = Network(
        (normalise,), tuple(layers[:-1]), layers[-1], None, actions.choices or None, activation, bounds
    )
    return TaskPolicy(network, task_metadata(name, seen, actions, 0.02))


TASKS = {
    "unequal": (box((2,), [0.0, -0.1], [5.0, 20.0], "float64"), box((3,)), "relu", "clip"),
    "discrete": (discrete(3), box((4,))),
    "tanh": (box((1,), -2.0, 2.0), box((3,)), "tanh"),
    "elu": (box((2, 2), -1.0, 3.0), box((2, 3)), "elu", "clip"),
    "silu": (box((1,), -2.0, 2.0), box((3,)), "silu"),
    "tiny": (box((1,), -2.0, 2.0), box((3,)), "relu", "tanh", 0.0, 1e-6),
    "far": (box((1,), -2.0, 2.0), box((3,)), "relu", "tanh", 1e6),
    "choices": (discrete([3, 2], [1, 5]), box((), -1.0, 1.0, "float64"), "gelu"),
}


@functools.cache
def task_policy(name):
    return space_task(name, *TASKS[name])


@functools.cache
def task_actions(name, number=10_000):
    """Observations (number, ...), JAX's actions in double precision, and the lead of the best logits."""
    policy = task_policy(name)
    stage, seen, space = policy.network.stages[0], policy.observation_space, policy.action_space
    rows = stage.mean + stage.deviation * np.random.default_rng(2).normal(size=(number, seen.size))
    rows = rows.astype(np.float32).astype(np.float64)
    with jax.enable_x64(True):
        found = in_double(make_policy(policy.network))
        actions = np.asarray(jax.jit(jax.vmap(found))(rows))
    lead = np.full(number, np.inf)
    if space.choices:
        logits = np.split(NumpyNetwork(policy.network)(rows), np.cumsum(space.choices)[:-1], axis=-1)
        lead = np.min([np.diff(np.sort(each, axis=-1)[:, -2:])[:, 0] for each in logits], axis=0)
    exact_space = dataclasses.replace(space, dtype="int64" if space.choices else "float64")
    return rows.reshape(number, *seen.shape), exact_space(actions), lead
