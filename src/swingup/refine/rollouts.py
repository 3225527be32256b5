"""The dataset of a distillation: states that runs visit, and what the teacher of the run's plant does in them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..common.types import Flag, Key, Scalar, State
from ..controllers.stack.policy import PolicyController, plant_of
from ..dynamics.integrate import rk4_step
from ..loop.starts import anywhere_states, still_states, thrown_states
from ..plant.plant import Plant, Robot
from .teachers import ARRIVED_COST, TUBE, Teachers, TrainingSet, draw_key, teacher_torque, top_cost

DT = 0.002  # step of the runs (s)
RUN_DURATION = 2.5  # length of a run (s)
KEPT = 5  # one of so many steps is in the dataset: neighbours are alike
THROWN_SHARE = 0.5
"""Share of the runs that begin after a throw or hanging still at an angle; the others begin near a swing-up."""
STILL_SHARE = 0.3  # share of these that hang still, where a constant torque may hold the plant for good
NOISE = 0.6  # twice the standard deviation of the torques' noise on each joint in the roughest runs (N m)
MAXIMUM_APPROACH = 0.4
"""Maximum time in which the plant that the student sees approaches the run's from the nominal one (s)."""
OFF_SWINGUP = (0.1, 0.1, 0.6, 0.6)
"""Deviations of the initial states of the roughest runs from a swing-up (rad, rad/s)."""
SPEED_LIMIT = 40.0  # A run that is ever faster than this (rad/s) is left out: its time step is too long for it
OUTSIDE_WEIGHT = 0.15  # weight of a state outside the tube, beside 1 within
ANYWHERE = 60_000  # states from anywhere, with random velocities
ANYWHERE_WEIGHT = 0.02  # weight of a state from anywhere
ANYWHERE_SPEED = 10.0  # maximum standard deviation of their velocities (rad/s)


class Dataset(NamedTuple):
    """States, the teachers' torques there (N m), whose plants they are, and how much they count."""

    x: Float[np.ndarray, "n 4"]
    u: Float[np.ndarray, "n"]
    plant: Int[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]


def uniform_states(training: TrainingSet, random: np.random.Generator) -> Dataset:
    """States from anywhere on all plants."""
    x = anywhere_states(random, ANYWHERE, ANYWHERE_SPEED).astype(np.float32)
    plant = random.integers(0, training.teachers.number, ANYWHERE).astype(np.int32)
    return Dataset(x, np.asarray(_answers(training, x, plant)), plant, np.full(len(x), ANYWHERE_WEIGHT, np.float32))


def dagger_rollouts(
    training: TrainingSet,
    student: PolicyController,
    random: np.random.Generator,
    runs: int,
    student_share: float,
    which: Int[np.ndarray, "plants"],
) -> Dataset:
    """The states of so many runs on each of these plants; the student acts in a share of them, else the teacher."""
    teachers, recovery = jax.tree.map(lambda leaf: leaf[which], training.teachers), training.recovery
    shape = teachers.number, runs
    starts = thrown_states(random, plant_of(recovery), teachers.number * runs).reshape(*shape, 4)
    still = random.uniform(size=shape) < STILL_SHARE
    rests = still_states(random, np.asarray(teachers.base), recovery.robot, runs)
    starts = np.where(still[..., None], rests, starts)
    thrown, acts = random.uniform(size=shape) < THROWN_SHARE, random.uniform(size=shape) < student_share
    keys = jax.random.split(draw_key(random), shape)
    rows = _runs(TrainingSet(teachers, recovery), student, jnp.float32(starts), thrown, acts, keys)
    x, u, distance = map(np.asarray, rows)
    return _good_runs(x, u, which, np.where(distance < TUBE, 1.0, OUTSIDE_WEIGHT))


def own_runs(
    student: PolicyController,
    plants: Plant,
    bases: Float[Array, "plants 9"],
    random: np.random.Generator,
    runs: int,
) -> Dataset:
    """The states of a policy's own swing-ups of plants, the last of them the nominal one, and its torques there."""
    keys = jax.random.split(draw_key(random), (len(bases), runs))
    x, u = map(np.asarray, _own_runs(student, plants, bases, keys))
    found = _good_runs(x, u, np.arange(len(bases)), np.ones_like(u))
    # Where no run is good, no torque is kept: a row that does not count stands for them.
    return found if len(found.u) else Dataset(*(np.zeros((1, *each.shape[1:]), each.dtype) for each in found))


def _good_runs(x: np.ndarray, u: np.ndarray, which: np.ndarray, weight: np.ndarray) -> Dataset:
    # Arrays (plants, runs, rows) of runs on the plants ``which``.
    good = np.isfinite(x).all((2, 3)) & (np.abs(x[..., 2:]).max((2, 3)) < SPEED_LIMIT)
    plant = np.broadcast_to(which.astype(np.int32)[:, None, None], u.shape)
    rows = x, u, plant, weight.astype(np.float32)
    return Dataset(*(each[good].reshape(-1, *each.shape[3:]) for each in rows))


@jax.jit
def swings_up(student: PolicyController, teachers: Teachers) -> Bool[Array, "plants"]:
    """On which plants a student that is informed of them comes from hanging to the top within a run."""
    driven = jnp.array(student.robot.actuation, jnp.float32)

    def one(teacher: Teachers) -> Flag:
        def step(x: State, _: None) -> tuple[State, Scalar]:
            u = student.control(None, jnp.zeros(()), x, teacher.base)[1] * driven
            return rk4_step(teacher.plant, x, u, DT), top_cost(teacher, x)

        costs = jax.lax.scan(step, jnp.zeros(4, jnp.float32), None, round(RUN_DURATION / DT))[1]
        return jnp.min(costs) < ARRIVED_COST

    return jax.vmap(one)(teachers)


@jax.jit
def _answers(training: TrainingSet, x: Float[Array, "n 4"], plant: Int[Array, "n"]) -> Float[Array, "n"]:
    def one(chosen: tuple[State, Int[Array, ""]]) -> Scalar:
        x, index = chosen
        return teacher_torque(jax.tree.map(lambda leaf: leaf[index], training.teachers), training.recovery, x)[0]

    return jax.lax.map(one, (x, plant), batch_size=256)


@jax.jit
def _runs(
    training: TrainingSet,
    student: PolicyController,
    thrown_at: Float[Array, "plants runs 4"],
    thrown: Float[Array, "plants runs"],
    acts: Float[Array, "plants runs"],
    keys: Any,
) -> Any:
    """States, the teachers' torques and the distances from the swing-ups, of every ``KEPT``-th step."""
    robot = training.recovery.robot

    def run(teacher: Teachers, thrown_at: State, thrown: Flag, acts: Flag, key: Key) -> Any:
        def start(rough: Scalar, key: Key) -> State:
            # Mostly hanging, else on the way, and off it by as much as the run is rough.
            which_key, row_key, off_key = jax.random.split(key, 3)
            row = jax.random.randint(row_key, (), 0, len(teacher.torque))
            row = jnp.where(jax.random.uniform(which_key) < 0.6, 0, row)
            off = rough * jnp.array(OFF_SWINGUP, jnp.float32) * jax.random.normal(off_key, (4,))
            return jnp.where(thrown, thrown_at, teacher.states[row] + jnp.where(row == 0, 0.3, 1.0) * off)

        def act(x: State, base: Array) -> tuple[Scalar, Any]:
            u, distance = teacher_torque(teacher, training.recovery, x)
            own = student.control(None, jnp.zeros(()), x, base)[1][robot.joint]
            return jnp.where(acts, own, u), (x, u, distance)

        return _noisy_run(act, start, teacher.plant, (teacher.nominal, teacher.base), robot, key)

    on_a_plant = jax.vmap(run, in_axes=(None, 0, 0, 0, 0))
    return jax.vmap(on_a_plant)(training.teachers, thrown_at, thrown, acts, keys)


@jax.jit
def _own_runs(student: PolicyController, plants: Plant, bases: Array, keys: Any) -> Any:
    """States and the informed policy's torques of every ``KEPT``-th step of swing-ups."""
    robot = student.robot

    def start(rough: Scalar, key: Key) -> State:
        return 0.3 * rough * jnp.array(OFF_SWINGUP, jnp.float32) * jax.random.normal(key, (4,))

    def run(plant: Plant, base: Array, key: Key) -> Any:
        def act(x: State, known: Array) -> tuple[Scalar, Any]:
            u, informed = (student.control(None, jnp.zeros(()), x, each)[1][robot.joint] for each in (known, base))
            return u, (x, informed)

        return _noisy_run(act, start, plant, (bases[-1], base), robot, key)

    return jax.vmap(jax.vmap(run, in_axes=(None, None, 0)))(plants, bases, keys)


def _noisy_run(
    act: Callable[[State, Array], tuple[Scalar, Any]],
    start: Callable[[Scalar, Key], State],
    plant: Plant,
    ends: tuple[Array, Array],
    robot: Robot,
    key: Key,
) -> Any:
    """What ``act`` notes in every ``KEPT``-th step; the θ that it sees goes from one end to the other."""
    rough_key, start_key, slow_key, noise_key = jax.random.split(key, 4)
    # Of all sizes, small ones more often: a policy has to be exact near the swing-up, and safe far from it.
    rough = jax.random.uniform(rough_key) ** 1.5
    steps, driven = round(RUN_DURATION / DT), jnp.array(robot.actuation, jnp.float32)
    # In two of five runs the plant is known at once.
    approach = MAXIMUM_APPROACH * jnp.clip(jax.random.uniform(slow_key, minval=-0.7), 0.0)

    def step(carry: tuple[State, Array], each: tuple[Scalar, Array]) -> Any:
        (x, drift), (time, kick) = carry, each
        drift = 0.98 * drift + 0.1 * rough * kick
        known = jnp.clip(time / jnp.maximum(approach, DT), 0, 1)
        u, row = act(x, ends[0] + known * (ends[1] - ends[0]))
        # The noise ends before the run does: it should come to rest.
        noise = NOISE * drift * (time < 0.6 * steps * DT)
        return (rk4_step(plant, x, u * driven + noise, DT), drift), row

    times, kicks = jnp.arange(steps) * jnp.float32(DT), jax.random.normal(noise_key, (steps, 2))
    rows = jax.lax.scan(step, (start(rough, start_key), jnp.zeros(2)), (times, kicks))[1]
    return jax.tree.map(lambda row: row[::KEPT], rows)
