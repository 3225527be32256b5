"""Distillation: one network that sees its plant learns from a teacher for each of many plants.

The rounds are those of DAgger (Ross, Gordon and Bagnell, AISTATS 2011): in the first the teachers act, in the
others mostly the student, and in the states that are visited the teachers say what they would do. Runs begin near a
plant's swing-up or where a throw leaves the pendulum, under noise of the torques. In many of them the student sees
the nominal plant at first and its own only later, as behind an identifier. At the end the gradient of the score
through whole swing-ups of the nominal plant is added, and if settings ask, of recoveries on the plants.
"""

import functools
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from ..areapo.initial import init_actor
from ..areapo.networks import Actor
from ..common.types import Key, Scalar, State
from ..controllers.baselines.continuation import SwingUps, continue_swingups, nominal_swingups
from ..controllers.baselines.continuation_settings import ContinuationSettings
from ..controllers.stack.controller import PolicyController, plant_of
from ..controllers.stack.policy import Policy
from ..loop.domain import Domain
from ..plant.base_parameters import BASE, base_parameters
from ..plant.plant import LEADERBOARD
from ..tasks.observation import PendulumStage, PlantStage
from .analytic_policy_gradient import PolicyGradientSettings, batch_cost, single_precision, with_actor
from .dataset import Dataset, dagger_rollouts, swings_up, uniform_states
from .distillation_settings import DistillationSettings, plant_scale
from .plant_draws import draw_plants
from .recoveries import Recoveries, make_recoveries, recovery_cost
from .teacher import make_teachers

Progress = Callable[[str, int, int], None]
"""Called with what is computed, how much of it is done, and of how much."""
UP_SHARE = 0.1
"""Share of an episode in which the tip is up, from about which on its score counts."""
PARTS = 40
"""Calls in which steps are taken; progress is told between them."""
SPREAD = 0.01
"""Largest standard deviation of the first states of the scored swing-ups (rad, rad/s)."""


def distil(
    recovery: PolicyController,
    settings: DistillationSettings,
    random: np.random.Generator,
    tell: Callable[[PolicyController, int], None] = lambda _, __: None,
    domain: Domain | None = None,
    progress: Progress = lambda _, __, ___: None,
) -> PolicyController:
    """A policy that sees its plant, from nothing but teachers.

    The policy to start from recovers from anywhere on the nominal plant, in C.1's units. ``tell`` is called after
    each round with the student and the number of rounds so far, and once more at the end.
    """
    robot, nominal = recovery.robot, plant_of(recovery)
    targets = draw_plants(random, robot, settings.draws, nominal, domain)
    start = LEADERBOARD if nominal.values() == LEADERBOARD.driven(robot).values() else nominal
    # Optimal swing-ups of the plants, as far as they are reached, and then those of the nominal one.
    found = continue_swingups(robot, targets, progress=partial(progress, "swing-ups"), nominal=start)
    more = nominal_swingups(robot, settings.nominal, ContinuationSettings(), start)
    swingups: SwingUps = jax.tree.map(lambda *parts: np.concatenate(parts), found, more)
    teachers, recovery = make_teachers(swingups, nominal), single_precision(recovery)
    student = new_student(recovery, settings, random)
    dataset = uniform_states(teachers, recovery, settings, random)
    for number in range(1, settings.rounds + 1):
        which, own = np.arange(teachers.number), 0.0
        if number > 1:
            failing, own = np.flatnonzero(~swings_up(student, teachers, settings.duration)), settings.own
            replaced = random.uniform(size=which.shape) < settings.failing
            which = np.where(replaced, random.choice(failing, which.shape), which) if len(failing) else which
        dataset += dagger_rollouts(teachers, recovery, student, settings, random, own, which)
        longest = number in (1, settings.rounds)
        steps = settings.steps if longest else settings.steps // 2
        rate = settings.learning_rate * (1.0 if number == 1 else 0.6)
        optimiser = optax.adam(optax.cosine_decay_schedule(rate, steps))
        told = partial(progress, f"lessons {number} of {settings.rounds}")
        student = descend(student, teachers.base, dataset, settings, _key(random), steps, optimiser, told)
        tell(student, number)
    if steps := settings.score_steps:
        schedule = optax.warmup_cosine_decay_schedule(0.0, settings.score_rate, steps // 8, steps)
        # Gradients through the pendulum are bounded.
        optimiser = optax.chain(optax.clip_by_global_norm(2.0), optax.adam(schedule))
        ends = (
            PolicyGradientSettings(duration=settings.score_duration),
            make_recoveries(student, teachers, settings, random) if settings.recovery_episodes else None,
        )
        told, key = partial(progress, "score"), _key(random)
        student = descend(student, teachers.base, dataset, settings, key, steps, optimiser, told, *ends)
        tell(student, settings.rounds + 1)
    return eqx.tree_at(lambda c: c.policy, student, jax.tree.map(np.asarray, student.policy))


def new_student(
    recovery: PolicyController, settings: DistillationSettings, random: np.random.Generator
) -> PolicyController:
    """A policy with random weights that sees the state and the plant."""
    plant = plant_of(recovery)
    nominal = base_parameters(plant)
    centre, scale = (jnp.asarray(each, jnp.float32) for each in (nominal, plant_scale(nominal, plant.gr)))
    stages = PendulumStage(angles="sincos"), PlantStage(centre, scale, clip=3.0)
    actor = init_actor(_key(random), stages[0].size() + BASE, 1, settings.layers, 0.0)
    policy = Policy(stages, replace(actor, std_head=None))
    return PolicyController(policy, recovery.torque_limit, recovery.robot, recovery.plant)


def descend(
    student: PolicyController,
    bases: Float[Array, "plants 9"],
    dataset: Dataset,
    settings: DistillationSettings,
    key: Key,
    steps: int,
    optimiser: optax.GradientTransformation,
    told: Callable[[int, int], None],
    episodes: PolicyGradientSettings | None = None,
    recoveries: Recoveries | None = None,
) -> PolicyController:
    """The student after steps on the squared errors of the torque, a part of them in each compiled call.

    Where there are ``episodes``, the score of the nominal plant's swing-ups counts as well, and ``recoveries``.
    """
    carry, keys = (student.policy.actor, optimiser.init(student.policy.actor)), jax.random.split(key, steps)
    dataset = jax.tree.map(jnp.asarray, dataset)
    for done in range(0, steps, max(1, steps // PARTS)):
        part = keys[done : done + max(1, steps // PARTS)]
        told(done, steps)
        carry = _steps(carry, student, bases, dataset, settings, part, optimiser, episodes, recoveries)
        jax.block_until_ready(carry)
    told(steps, steps)
    return with_actor(student, carry[0])


@functools.partial(jax.jit, static_argnames=("settings", "optimiser", "episodes"))
def _steps(
    carry: tuple[Actor, optax.OptState],
    student: PolicyController,
    bases: Float[Array, "plants 9"],
    dataset: Dataset,
    settings: DistillationSettings,
    keys: Any,
    optimiser: optax.GradientTransformation,
    episodes: PolicyGradientSettings | None,
    recoveries: Recoveries | None,
) -> tuple[Actor, optax.OptState]:
    """The student's network after steps on minibatches of the dataset; those from anywhere come first."""
    s, limit = settings, student.torque_limit
    sizes = s.anywhere_batch, s.batch
    first = jnp.array(np.repeat([0, s.anywhere], sizes))
    count = jnp.array(np.repeat([s.anywhere, len(dataset.u) - s.anywhere], sizes))
    plant, others = plant_of(student), eqx.tree_at(lambda c: c.policy.actor, student, None)

    def observe(x: State, base: Array) -> Array:
        return student.policy.observe(x, base)

    def loss(actor: Actor, key: Key) -> Scalar:
        rows_key, size_key, start_key, recovery_key = jax.random.split(key, 4)
        chosen = first + jax.random.randint(rows_key, first.shape, 0, count)
        seen = jax.vmap(observe)(dataset.x[chosen], bases[dataset.plant[chosen]])
        errors = limit * actor.mode(seen.T)[0] - dataset.u[chosen]
        total = jnp.mean(dataset.weight[chosen] * errors**2)
        if episodes is None:
            return total
        shape = s.score_episodes, 4
        x0 = SPREAD * jax.random.uniform(size_key, (shape[0], 1)) * jax.random.normal(start_key, shape)
        measures = batch_cost(actor, others, x0, episodes, plant)[1]
        if recoveries is not None:
            total += recovery_cost(with_actor(others, actor), recoveries, s, recovery_key)
        # As on the board: without a swing-up there is no score. Hanging still would have the best one.
        return total - s.score_weight * jnp.mean(measures.score * jnp.tanh((1 - measures.down) / UP_SHARE))

    def step(carry: Any, key: Key) -> tuple[Any, None]:
        actor, state = carry
        updates, state = optimiser.update(jax.grad(loss)(actor, key), state)
        return (optax.apply_updates(actor, updates), state), None

    after: tuple[Actor, optax.OptState] = jax.lax.scan(step, carry, keys)[0]
    return after


def _key(random: np.random.Generator) -> Key:
    return jax.random.key(int(random.integers(2**31)))
