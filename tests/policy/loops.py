"""Closed loops to compare runtimes on: states, recorded measurements, and a plain simulator."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from swingup.areapo.networks import init_actor
from swingup.control.registry import get_controller
from swingup.physics.integrate import rk4_step
from swingup.physics.parameters import get_robot, leaderboard_parameters
from swingup.policy.jax_backend.controller import PolicyController, shipped_policy
from swingup.policy.jax_backend.observation import Normalise, PendulumObservation
from swingup.policy.jax_backend.policy import Policy

DT = 0.002
AWAY = 1e-3
"""Distance from a wrap of the angles (rad) from which runtimes must agree."""
TOLERANCE = 3e-5
"""How far torques of different runtimes may lie apart (N m)."""

SENSORS = {
    # Noise of the velocities (rad/s), age of a measurement (steps), steps of the angles (rad), and times between
    # calls (s), one of which is drawn for each.
    "perfect": (0.0, 0, 0.0, [DT]),
    "noisy": (0.5, 0, 2 * np.pi / 2**14, [DT]),
    "late": (0.0, 20, 0.0, [DT]),
    "late and noisy": (0.3, 15, 2 * np.pi / 2**14, [DT]),
    "400 Hz": (0.1, 4, 2 * np.pi / 2**14, [0.0025]),
    "uneven": (0.1, 4, 2 * np.pi / 2**14, [DT, 0.0025]),
}

UNSOUND = np.where(np.eye(4), np.array([np.nan, np.inf, -np.inf])[:, None, None], 0.1).reshape(-1, 4)
"""States (12, 4) with one number that is not finite, for which every torque must be NaN."""


@functools.cache
def random_states(number=10_000):
    """States (number, 4) in several turns and beyond the velocities' scale, away from where an angle is wrapped."""
    x = np.random.default_rng(5).uniform(-1, 1, (2 * number, 4)) * [9, 9, 25, 25]
    wrap = np.abs((x[:, :2] + np.pi) % (2 * np.pi) - np.pi).min(axis=1)
    return x[wrap > AWAY][:number]


def in_double(controller):
    """A controller whose weights are float64: its networks do all in double precision, which the judge's do not."""
    return jax.tree.map(
        lambda leaf: leaf.astype(np.float64) if getattr(leaf, "dtype", None) == np.float32 else leaf, controller
    )


@functools.cache
def judged_torques(robot, kind="refined", exact=False):
    """The torques (N m) of a shipped policy's driven joint at the random states, as the judge computes them.

    Where they are to be exact, they are those of the same network in double precision.
    """
    policy, joint = shipped_policy(robot, kind)[0], get_robot(robot).joint
    policy = in_double(policy) if exact else policy
    with jax.enable_x64(True):
        call = jax.jit(jax.vmap(lambda x: policy(None, jnp.zeros(()), x)[1][joint]))
        return np.asarray(call(jnp.asarray(random_states())))


def paper_policy(normalised=True):
    """A small untrained policy of the pendubot with the paper's observation, which jumps at its wraps."""
    with jax.enable_x64(False):  # single precision, as a file has it
        actor = jax.tree.map(lambda leaf: leaf + 0.1, init_actor(jax.random.key(0), 4, 1, (16, 12), -1.0))
    normalise = Normalise(mean=np.linspace(-1, 1, 4), variance=np.linspace(0.5, 2, 4), clip=1.0)
    stages = (PendulumObservation(20.0, "wrapped"), *([normalise] if normalised else []))
    return PolicyController(Policy(stages, actor), 3.0, get_robot("pendubot"))


@functools.cache
def recorded(robot, sensor, steps=2500):
    """A closed loop of the shipped controller in JAX: times, measurements (n, 4) and torques (n, 2)."""
    sigma, age, quantum, periods = SENSORS[sensor]
    p, controller = leaderboard_parameters(get_robot(robot)), in_double(get_controller("refined", robot))
    random = np.random.default_rng(3)
    noise, pauses = sigma * random.normal(size=(steps, 2)), random.choice(periods, steps)

    def step(carry, now):
        past, memory = carry
        t, pause, normal = now
        angles = past[age, :2]
        angles = jnp.round(angles / quantum) * quantum if quantum else angles
        measured = jnp.concatenate([angles, past[age, 2:] + normal])
        memory, u = controller(memory, t, measured)
        x = rk4_step(p, past[0], jnp.clip(u, -jnp.array([p.tl1, p.tl2]), jnp.array([p.tl1, p.tl2])), pause)
        return (jnp.concatenate([x[None], past[:-1]]), memory), (measured, u)

    times = np.cumsum(pauses) - pauses
    with jax.enable_x64(True):
        start = (jnp.zeros((age + 1, 4)), controller.init())
        _, rows = jax.jit(lambda: jax.lax.scan(step, start, tuple(map(jnp.asarray, (times, pauses, noise)))))()
        return times, *(np.asarray(part) for part in rows)
