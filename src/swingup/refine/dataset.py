"""The dataset of a distillation: states that runs visit, and what a teacher of the run's plant does in them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..common.types import Flag, Key, Scalar, State
from ..controllers.stack.policy import PolicyController, plant_of
from ..dynamics.integrate import rk4_step
from ..loop.starts import anywhere_states, thrown_states
from ..plant.base_parameters import BASE_NAMES
from ..plant.plant import Plant, Robot
from .distillation_settings import DistillationSettings
from .teacher import ARRIVED, School, Teachers, taught, top_cost

DT = 0.002
"""Step of the runs (s)."""
KEPT = 5
"""One of so many steps is in the dataset: neighbours are alike."""
ANYWHERE_SPEED = 10.0
"""Largest standard deviation of the velocities of states from anywhere (rad/s)."""
STILL = 0.7
"""Largest angle of the upper link in a state of rest (rad)."""
SPOILT = 40.0
"""A run that is ever faster than this (rad/s) is left out."""
ROUGH = (0.1, 0.1, 0.6, 0.6)
"""Deviations of the first states of the roughest runs from a swing-up (rad, rad/s)."""


class Dataset(NamedTuple):
    """States, the teachers' torques there (N m), whose plants they are, and how much they count."""

    x: Float[np.ndarray, "n 4"]
    u: Float[np.ndarray, "n"]
    plant: Int[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]


def uniform_states(school: School, settings: DistillationSettings, random: np.random.Generator) -> Dataset:
    """States from anywhere on all plants."""
    number = settings.anywhere
    x = anywhere_states(random, number, ANYWHERE_SPEED).astype(np.float32)
    plant = random.integers(0, school.teachers.number, number).astype(np.int32)
    weight = np.full(number, settings.anywhere_weight, np.float32)
    return Dataset(x, np.asarray(_answers(school, settings.tube, x, plant)), plant, weight)


def dagger_rollouts(
    school: School,
    student: PolicyController,
    settings: DistillationSettings,
    random: np.random.Generator,
    own: float,
    which: Int[np.ndarray, "plants"],
) -> Dataset:
    """The states of runs on these plants; in a share ``own`` of them the student acts, else the teacher."""
    teachers, recovery = jax.tree.map(lambda leaf: leaf[which], school.teachers), school.recovery
    shape = teachers.number, settings.runs
    starts = thrown_states(random, plant_of(recovery), teachers.number * settings.runs).reshape(*shape, 4)
    still = random.uniform(size=shape) < settings.still
    rests = _hanging_still(random, np.asarray(teachers.base), recovery.robot, shape)
    starts = np.where(still[..., None], rests, starts)
    thrown, acts = random.uniform(size=shape) < settings.thrown, random.uniform(size=shape) < own
    keys = jax.random.split(draw_key(random), shape)
    rows = _runs(School(teachers, recovery), student, settings, jnp.float32(starts), thrown, acts, keys)
    x, u, distance = map(np.asarray, rows)
    return _good_runs(x, u, which, np.where(distance < settings.tube, 1.0, settings.outside_weight))


def own_runs(
    student: PolicyController,
    plants: Plant,
    bases: Float[Array, "plants 9"],
    settings: DistillationSettings,
    random: np.random.Generator,
) -> Dataset:
    """The states of a policy's own swing-ups of plants, the last of them the nominal one, and its torques there."""
    shape = len(bases), settings.runs
    keys = jax.random.split(draw_key(random), shape)
    x, u = map(np.asarray, _own_runs(student, plants, bases, settings, keys))
    found = _good_runs(x, u, np.arange(len(bases)), np.ones_like(u))
    # Where no run is good, no torque is kept: a row that does not count stands for them.
    return found if len(found.u) else Dataset(*(np.zeros((1, *each.shape[1:]), each.dtype) for each in found))


def draw_key(random: np.random.Generator) -> Key:
    """JAX's key for the next random numbers."""
    return jax.random.key(int(random.integers(2**31)))


def _good_runs(x: np.ndarray, u: np.ndarray, which: np.ndarray, weight: np.ndarray) -> Dataset:
    """The rows (plants, runs, rows) of the runs that teach; ``which`` plants they are of."""
    good = np.isfinite(x).all((2, 3)) & (np.abs(x[..., 2:]).max((2, 3)) < SPOILT)
    plant = np.broadcast_to(which.astype(np.int32)[:, None, None], u.shape)
    rows = x, u, plant, weight.astype(np.float32)
    return Dataset(*(each[good].reshape(-1, *each.shape[3:]) for each in rows))


def _hanging_still(
    random: np.random.Generator, base: Float[np.ndarray, "plants 9"], robot: Robot, shape: tuple[int, int]
) -> Float[np.ndarray, "plants runs 4"]:
    """States at rest below, in which a constant torque of the driven joint may hold the plants (rad)."""
    k, m2r2 = (base[:, BASE_NAMES.index(name), None] for name in ("k", "m2r2"))
    upper = random.uniform(-STILL, STILL, shape)
    # No motor turns the undriven joint: gravity does not either. Its torque there is g m2 r2 sin(q1 + q2), on the
    # shoulder g k sin(q1) more.
    balance = 0.0 if robot.joint == 0 else -np.arcsin(np.clip(k / m2r2 * np.sin(upper), -1.0, 1.0))
    return np.stack([upper, balance - upper, *np.zeros((2, *shape))], axis=-1)


@jax.jit(static_argnames="duration")
def swings_up(student: PolicyController, teachers: Teachers, duration: float) -> Bool[Array, "plants"]:
    """On which plants a student that is told them comes from hanging to the top within this time (s)."""
    driven = jnp.array(student.robot.actuation, jnp.float32)

    def one(teacher: Teachers) -> Flag:
        def step(x: State, _: None) -> tuple[State, Scalar]:
            u = student.control(None, jnp.zeros(()), x, teacher.base)[1] * driven
            return rk4_step(teacher.plant, x, u, DT), top_cost(teacher, x)

        return jnp.min(jax.lax.scan(step, jnp.zeros(4, jnp.float32), None, round(duration / DT))[1]) < ARRIVED

    return jax.vmap(one)(teachers)


@jax.jit
def _answers(school: School, tube: Scalar, x: Float[Array, "n 4"], plant: Int[Array, "n"]) -> Float[Array, "n"]:
    """The teachers' torques in states outside of any run."""

    def one(chosen: tuple[State, Int[Array, ""]]) -> Scalar:
        x, index = chosen
        return taught(jax.tree.map(lambda leaf: leaf[index], school.teachers), school.recovery, tube, x)[0]

    return jax.lax.map(one, (x, plant), batch_size=256)


@jax.jit(static_argnames="settings")
def _runs(
    school: School,
    student: PolicyController,
    settings: DistillationSettings,
    thrown_at: Float[Array, "plants runs 4"],
    thrown: Float[Array, "plants runs"],
    acts: Float[Array, "plants runs"],
    keys: Any,
) -> Any:
    """States, the teachers' torques and the distances from the swing-ups, of every ``KEPT``-th step."""
    robot = school.recovery.robot

    def run(teacher: Teachers, thrown_at: State, thrown: Flag, acts: Flag, key: Key) -> Any:
        def start(rough: Scalar, key: Key) -> State:
            return jnp.where(thrown, thrown_at, _near_swingup(teacher, rough, key))

        def act(x: State, base: Array) -> tuple[Scalar, Any]:
            u, distance = taught(teacher, school.recovery, settings.tube, x)
            own = student.control(None, jnp.zeros(()), x, base)[1][robot.joint]
            return jnp.where(acts, own, u), (x, u, distance)

        return _noisy_run(act, start, teacher.plant, (teacher.nominal, teacher.base), settings, robot, key)

    on_a_plant = jax.vmap(run, in_axes=(None, 0, 0, 0, 0))
    return jax.vmap(on_a_plant)(school.teachers, thrown_at, thrown, acts, keys)


@jax.jit(static_argnames="settings")
def _own_runs(
    student: PolicyController, plants: Plant, bases: Array, settings: DistillationSettings, keys: Any
) -> Any:
    """States and the policy's torques when told the plant, of every ``KEPT``-th step of swing-ups."""
    robot = student.robot

    def start(rough: Scalar, key: Key) -> State:
        return 0.3 * rough * jnp.array(ROUGH, jnp.float32) * jax.random.normal(key, (4,))

    def run(plant: Plant, base: Array, key: Key) -> Any:
        def act(x: State, known: Array) -> tuple[Scalar, Any]:
            u, told = (student.control(None, jnp.zeros(()), x, each)[1][robot.joint] for each in (known, base))
            return u, (x, told)

        return _noisy_run(act, start, plant, (bases[-1], base), settings, robot, key)

    return jax.vmap(jax.vmap(run, in_axes=(None, None, 0)))(plants, bases, keys)


def _noisy_run(
    act: Callable[[State, Array], tuple[Scalar, Any]],
    start: Callable[[Scalar, Key], State],
    plant: Plant,
    ends: tuple[Array, Array],
    settings: DistillationSettings,
    robot: Robot,
    key: Key,
) -> Any:
    """What ``act`` notes in every ``KEPT``-th step; the θ that it is told goes from one end to the other."""
    rough_key, start_key, slow_key, noise_key = jax.random.split(key, 4)
    rough = jax.random.uniform(rough_key) ** 1.5
    steps, driven = round(settings.duration / DT), jnp.array(robot.actuation, jnp.float32)
    # In two of five runs the plant is known at once.
    known_after = settings.slowest * jnp.clip(jax.random.uniform(slow_key, minval=-0.7), 0.0)

    def step(carry: tuple[State, Array], each: tuple[Scalar, Array]) -> Any:
        (x, drift), (time, kick) = carry, each
        drift = 0.98 * drift + 0.1 * rough * kick
        known = jnp.clip(time / jnp.maximum(known_after, DT), 0, 1)
        u, row = act(x, ends[0] + known * (ends[1] - ends[0]))
        # The noise ends before the run does: it should come to rest.
        noise = settings.noise * drift * (time < 0.6 * steps * DT)
        return (rk4_step(plant, x, u * driven + noise, DT), drift), row

    times, kicks = jnp.arange(steps) * jnp.float32(DT), jax.random.normal(noise_key, (steps, 2))
    rows = jax.lax.scan(step, (start(rough, start_key), jnp.zeros(2)), (times, kicks))[1]
    return jax.tree.map(lambda row: row[::KEPT], rows)


def _near_swingup(teacher: Teachers, rough: Scalar, key: Key) -> State:
    """A first state: mostly hanging, else on the way, and off it by as much as the run is rough."""
    which_key, row_key, off_key = jax.random.split(key, 3)
    row = jax.random.randint(row_key, (), 0, len(teacher.torque))
    row = jnp.where(jax.random.uniform(which_key) < 0.6, 0, row)
    off = rough * jnp.array(ROUGH, jnp.float32) * jax.random.normal(off_key, (4,))
    return teacher.states[row] + jnp.where(row == 0, 0.3, 1.0) * off
