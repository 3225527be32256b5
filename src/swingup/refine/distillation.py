"""Distillation: one network that sees its plant learns from a teacher for each of many plants.

The rounds are those of DAgger (Ross, Gordon and Bagnell, AISTATS 2011): in the first the teachers act, in the
others mostly the student, and in the states that are visited the teachers say what they would do. Runs begin near a
plant's swing-up or where a throw leaves the pendulum, under noise of the torques. In many of them the student sees
the nominal plant at first and its own only later, as behind an identifier. At the end the gradient of the score
through whole swing-ups of the nominal plant is added, and if settings ask, of recoveries on the plants.

A policy that has learnt so can be taken on by its own torques and that gradient alone (:func:`recover`).

A student may learn from schools about several nominal plants, as of several designs. Its gear, score and recoveries
are those of the first.
"""

import functools
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

from ..areapo.initial import init_actor
from ..areapo.networks import Actor
from ..benchmark.runner import StageProgress, stack
from ..common.errors import SwingupError
from ..common.types import Key, Scalar
from ..controllers.interface import AbstractController
from ..controllers.stack.policy import Policy, PolicyController, plant_of
from ..controllers.stack.regulator import TRIANGLE
from ..plant.base_parameters import BASE, base_parameters
from ..plant.plant import Plant
from ..policy.regulator import RegulatorSettings, fixed_point
from ..tasks.task import PendulumStage, PlantStage
from .analytic_policy_gradient import PolicyGradientSettings, mean_cost, single_precision, with_actor
from .dataset import Dataset, dagger_rollouts, draw_key, own_runs, swings_up, uniform_states
from .distillation_settings import DistillationSettings, plant_scale
from .plant_draws import plants_of
from .recoveries import Recoveries, make_recoveries, make_regulators, recovery_cost
from .teacher import School

UP_SHARE = 0.1
"""Share of an episode in which the tip is up, from about which on its score counts."""
PARTS = 40
"""Calls in which steps are taken; progress is told between them."""
KEEP = 8
"""The student is kept after so many of them."""
CLIP = 3.0
"""Most of a base parameter that the network sees, in its units: the ends of what several schools teach."""
INERTIAL = slice(0, 4)
"""Places of the inertial ones among them."""
SPREAD = 0.01
"""Largest standard deviation of the first states of the scored swing-ups (rad, rad/s)."""


def distil(
    schools: Sequence[School],
    settings: DistillationSettings,
    random: np.random.Generator,
    tell: Callable[[PolicyController, int], None] = lambda _, __: None,
    progress: StageProgress = lambda _, __, ___: None,
) -> PolicyController:
    """A policy that sees its plant, from nothing but teachers, for the first school's nominal plant.

    ``tell`` is called after each round with the student and the number of rounds so far, and once more at the end.
    """
    schools, each = _behind_one_gear(schools), settings.anywhere // len(schools)
    settings = replace(settings, anywhere=each * len(schools))
    student = new_student(schools, settings, random)
    bases = jnp.concatenate([school.teachers.base for school in schools])
    firsts = np.cumsum([0, *(school.teachers.number for school in schools[:-1])])
    states = [uniform_states(school, replace(settings, anywhere=each), random) for school in schools]
    dataset = _joined(states, firsts)
    for number in range(1, settings.rounds + 1):
        runs = []
        for school in schools:
            which, own = np.arange(school.teachers.number), 0.0
            if number > 1:
                up, own = swings_up(student, school.teachers, settings.duration), settings.own
                failing, replaced = np.flatnonzero(~up), random.uniform(size=which.shape) < settings.failing
                which = np.where(replaced, random.choice(failing, which.shape), which) if len(failing) else which
            runs.append(dagger_rollouts(school, student, settings, random, own, which))
        dataset = _joined([dataset, *runs], [0, *firsts])
        longest = number in (1, settings.rounds)
        steps = settings.steps if longest else settings.steps // 2
        rate = settings.learning_rate * (1.0 if number == 1 else 0.6)
        optimiser = optax.adam(optax.cosine_decay_schedule(rate, steps))
        told = partial(progress, f"lessons {number} of {settings.rounds}")
        student = descend(student, bases, dataset, settings, random, steps, optimiser, told)
        tell(student, number)
    if settings.score_steps:
        first = schools[0].teachers
        plants = first.plant, first.base, first.cost_to_go[-1]
        recoveries = make_recoveries(student, *plants, settings.recoveries, random)
        student = _scored(student, bases, dataset, settings, recoveries, random, partial(progress, "score"))
        tell(student, settings.rounds + 1)
    return _in_numpy(student)


def recover(
    student: PolicyController,
    plants: Plant,
    settings: DistillationSettings,
    random: np.random.Generator,
    regulator: RegulatorSettings,
    tell: Callable[[PolicyController, int], None] = lambda _, __: None,
    progress: StageProgress = lambda _, __, ___: None,
) -> PolicyController:
    """A policy that sees its plant, better at recoveries on these plants and on its own; it is its own teacher.

    The plants (leaves of shape (n,)) are in C.1's units, and so is the regulator that acts at the top. Those that
    none can hold are left out. ``tell`` is called as it proceeds and at the end.
    """
    nominal, held, costs = plant_of(student), [], []
    for plant in [*plants_of(plants), nominal]:
        with suppress(SwingupError):
            costs.append(fixed_point(plant, student.robot.joint)[0])
            held.append(plant)
    bases = jnp.float32(np.stack([base_parameters(plant) for plant in held]))
    plants = single_precision(stack(held))
    student = single_precision(student)
    dataset = own_runs(student, plants, bases, settings, random)
    regulators = make_regulators(student, np.stack([P[TRIANGLE] for P in costs]), regulator)
    known = plants, bases, jnp.float32(costs[-1][:4, :4])
    recoveries = make_recoveries(student, *known, settings.recoveries, random, regulators)
    told, keep = partial(progress, "recoveries"), lambda now: tell(_in_numpy(now), 0)
    student = _scored(student, bases, dataset, settings, recoveries, random, told, keep)
    tell(student, 1)
    return _in_numpy(student)


def _scored(
    student: PolicyController,
    bases: Float[Array, "plants 9"],
    dataset: Dataset,
    settings: DistillationSettings,
    recoveries: Recoveries | None,
    random: np.random.Generator,
    told: Callable[[int, int], None],
    keep: Callable[[PolicyController], None] = lambda _: None,
) -> PolicyController:
    """The student after the steps in which the score counts, and recoveries if there are any."""
    steps = settings.score_steps
    schedule = optax.warmup_cosine_decay_schedule(0.0, settings.score_rate, steps // 8, steps)
    # Gradients through the pendulum are bounded. A drawn plant that is too fast for its time step spoils its batch.
    optimiser = optax.chain(optax.clip_by_global_norm(2.0), optax.adam(schedule))
    optimiser = optax.apply_if_finite(optimiser, max_consecutive_errors=steps)
    return descend(student, bases, dataset, settings, random, steps, optimiser, told, True, recoveries, keep)


def _in_numpy(student: PolicyController) -> PolicyController:
    return eqx.tree_at(lambda c: c.policy, student, jax.tree.map(np.asarray, student.policy))


def new_student(
    schools: Sequence[School], settings: DistillationSettings, random: np.random.Generator
) -> PolicyController:
    """A policy with random weights that sees the state and the plant, for the first school's nominal one."""
    recovery = schools[0].recovery
    centre, gear = base_parameters(plant_of(recovery)), plant_of(recovery).gr
    scale = plant_scale(centre, gear)
    if len(schools) > 1:
        # Designs are farther apart than the shares of one: from the least to the most that is taught.
        taught = np.concatenate([np.asarray(school.teachers.base[:, INERTIAL], float) for school in schools])
        least, most = taught.min(axis=0), taught.max(axis=0)
        centre[INERTIAL], scale[INERTIAL] = (least + most) / 2, (most - least) / (2 * CLIP)
    sees = PlantStage(jnp.asarray(centre, jnp.float32), jnp.asarray(scale, jnp.float32), clip=CLIP)
    stages = PendulumStage(angles="sincos"), sees
    actor = init_actor(draw_key(random), stages[0].size() + BASE, 1, settings.layers, 0.0)
    policy = Policy(stages, replace(actor, std_head=None))
    return PolicyController(policy, recovery.torque_limit, recovery.robot, recovery.plant)


def _behind_one_gear(schools: Sequence[School]) -> list[School]:
    """The schools with the inertias that rotors would have behind the first one's gear."""
    found, gear = [], plant_of(schools[0].recovery).gr
    for teachers, recovery in schools:
        factors = np.append(np.ones(BASE - 1), (plant_of(recovery).gr / gear) ** 2).astype(np.float32)
        bases = teachers.base * factors, teachers.nominal * factors
        found.append(School(replace(teachers, base=bases[0], nominal=bases[1]), recovery))
    return found


def _joined(parts: Sequence[Dataset], firsts: Sequence[int] | Int[np.ndarray, "parts"]) -> Dataset:
    """All parts in one, whose plants begin at these places."""
    moved = [part._replace(plant=part.plant + np.int32(at)) for part, at in zip(parts, firsts, strict=True)]
    return Dataset(*map(np.concatenate, zip(*moved, strict=True)))


def descend(
    student: PolicyController,
    bases: Float[Array, "plants 9"],
    dataset: Dataset,
    settings: DistillationSettings,
    random: np.random.Generator,
    steps: int,
    optimiser: optax.GradientTransformation,
    told: Callable[[int, int], None],
    scored: bool = False,
    recoveries: Recoveries | None = None,
    keep: Callable[[PolicyController], None] = lambda _: None,
) -> PolicyController:
    """The student after steps on the squared errors of the torque, a part of them in each compiled call.

    If ``scored``, the score of the nominal plant's swing-ups counts as well, and ``recoveries``. ``keep`` has the
    student now and then.
    """
    carry = student.policy.actor, optimiser.init(student.policy.actor)
    keys, dataset = jax.random.split(draw_key(random), steps), jax.tree.map(jnp.asarray, dataset)
    for number, done in enumerate(range(0, steps, max(1, steps // PARTS)), start=1):
        part = keys[done : done + max(1, steps // PARTS)]
        told(done, steps)
        carry = _steps(carry, student, bases, dataset, settings, part, optimiser, scored, recoveries)
        jax.block_until_ready(carry)
        if number % KEEP == 0:
            keep(with_actor(student, carry[0]))
    told(steps, steps)
    return with_actor(student, carry[0])


@functools.partial(jax.jit, static_argnames=("settings", "optimiser", "scored"))
def _steps(
    carry: tuple[Actor, optax.OptState],
    student: PolicyController,
    bases: Float[Array, "plants 9"],
    dataset: Dataset,
    settings: DistillationSettings,
    keys: Any,
    optimiser: optax.GradientTransformation,
    scored: bool,
    recoveries: Recoveries | None,
) -> tuple[Actor, optax.OptState]:
    """The student's network after steps on minibatches of the dataset; those from anywhere come first."""
    s, limit = settings, student.torque_limit
    sizes = s.anywhere_batch, s.batch
    first = jnp.array(np.repeat([0, s.anywhere], sizes))
    count = jnp.array(np.repeat([s.anywhere, len(dataset.u) - s.anywhere], sizes))
    plant, others = plant_of(student), eqx.tree_at(lambda c: c.policy.actor, student, None)

    def loss(actor: Actor, key: Key) -> Scalar:
        rows_key, size_key, start_key, recovery_key = jax.random.split(key, 4)
        chosen = first + jax.random.randint(rows_key, first.shape, 0, count)
        seen = jax.vmap(student.policy.observe)(dataset.x[chosen], bases[dataset.plant[chosen]])
        errors = limit * actor.mode(seen.T)[0] - dataset.u[chosen]
        total = jnp.mean(dataset.weight[chosen] * errors**2)
        if not scored:
            return total
        shape = s.score_episodes, 4
        x0 = SPREAD * jax.random.uniform(size_key, (shape[0], 1)) * jax.random.normal(start_key, shape)
        policy = with_actor(others, actor)
        acting: AbstractController[Any] = policy
        if recoveries is not None and s.recoveries is not None:
            total += recovery_cost(policy, recoveries, s.recoveries, recovery_key)
            acting = recoveries.told(policy, -1)
        measures = mean_cost(acting, x0, PolicyGradientSettings(duration=s.score_duration), plant)[1]
        # As on the board: without a swing-up there is no score. Hanging still would have the best one.
        return total - s.score_weight * jnp.mean(measures.score * jnp.tanh((1 - measures.down) / UP_SHARE))

    def step(carry: Any, key: Key) -> tuple[Any, None]:
        actor, state = carry
        updates, state = optimiser.update(jax.grad(loss)(actor, key), state)
        return (optax.apply_updates(actor, updates), state), None

    after: tuple[Actor, optax.OptState] = jax.lax.scan(step, carry, keys)[0]
    return after
