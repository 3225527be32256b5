"""Behaviour cloning: supervised learning of a teacher's torques, in the states that the teacher visits.

The gradient through the simulation improves a policy's own swing-up but does not find another kind; a teacher shows
it one.
"""

import dataclasses
import functools
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

from ..areapo.networks import Actor
from ..benchmark.robustness import upright
from ..benchmark.rollout import Scenario, Trajectory, simulate
from ..benchmark.rules import ROBUSTNESS_RULES
from ..benchmark.runner import stack
from ..control.controller import AbstractController
from ..errors import SwingupError
from ..physics.integrate import stable_substeps
from ..physics.parameters import Robot
from ..physics.units import scales_of
from ..plants.plant import PlantLike, robot_parameters
from ..policy.jax_backend.controller import PolicyController
from ..policy.jax_backend.policy import Policy
from ..tasks.disturbance import Pushes, undisturbed
from ..types import Scalar
from .analytic_policy_gradient import single_precision

DEMONSTRATION_RULES = ROBUSTNESS_RULES["v2"]
"""The rules whose time step the runs have, and whose tolerance tells a run that ended upright."""
DEMONSTRATION_PUSHES = 3
"""Pushes on each joint in a run of the teacher."""
RETAINED_STATES = 100_000
"""States from anywhere in which the student keeps its own torque."""
RETAINED_SPEED = 10.0
"""Largest standard deviation of their velocities (rad/s)."""


@dataclass(frozen=True)
class CloningSettings:
    """The teacher, its runs, and the supervised learning from them."""

    teacher: str = "tvlqr-score"
    """Name of the teacher, one of the baselines."""
    steps: int = 4000
    """Adam's steps."""
    learning_rate: float = 1e-3
    """Adam's step size, which falls to 0 on a cosine."""
    batch: int = 1024
    """States of the teacher's runs in a minibatch."""
    retained: int = 256
    """States from anywhere in a minibatch, in which the student keeps its own torque."""
    retained_weight: float = 0.003
    """Weight of one of those, beside 1 for a state of the teacher."""
    demonstrations: int = 768
    """Runs of the teacher; those that do not end upright are left out."""
    duration: float = 2.2
    """Length of a run (s)."""
    push: float = 2.0
    """Largest standard deviation of the pushes, which show how the teacher returns to its path (N m)."""


def clone_behaviour(
    student: PolicyController,
    teacher: AbstractController[Any],
    robot: Robot,
    settings: CloningSettings,
    random: np.random.Generator,
    plant: PlantLike | None = None,
) -> PolicyController:
    """A policy with the teacher's torques where the teacher goes, and with the student's elsewhere.

    Args:
        student: the policy to start from.
        teacher: whose torques are learned.
        robot: which joint is driven.
        settings: of the teacher's runs and of the learning.
        random: source of the numbers.
        plant: what the teacher runs on; None for the leaderboards' plant.

    Raises:
        SwingupError: no run of the teacher ended upright.
    """
    visited, answers = demonstrate(teacher, robot, settings, random, plant)
    size = (RETAINED_STATES, 2)
    # A size for each state, or slow states would be rare.
    fastest = RETAINED_SPEED * scales_of(robot_parameters(plant, robot)).velocity
    rates = random.uniform(0, fastest, (RETAINED_STATES, 1)) * random.normal(size=size)
    free = np.concatenate([random.uniform(-np.pi, np.pi, size), rates], axis=1)
    single = single_precision(student)
    own = jax.jit(jax.vmap(lambda x: single(None, jnp.zeros(()), x)[1][robot.joint]))(jnp.float32(free))
    states = jnp.float32(np.concatenate([visited, free]))
    torques = jnp.concatenate([jnp.float32(answers), own])
    # All minibatches are drawn here, so that the training is one compiled scan.
    taught = random.integers(0, len(visited), (settings.steps, settings.batch))
    kept = len(visited) + random.integers(0, RETAINED_STATES, (settings.steps, settings.retained))
    rows = np.concatenate([taught, kept], axis=1).astype(np.int32)
    actor = _train(single, settings, states, torques, jnp.asarray(rows))
    return eqx.tree_at(lambda c: c.policy.actor, student, jax.tree.map(np.asarray, actor))


def _train(
    student: PolicyController,
    settings: CloningSettings,
    states: Float[Array, "n 4"],
    torques: Float[Array, "n"],
    rows: Int[Array, "steps batch"],
) -> Actor:
    """Adam on weighted squared errors of the torque; ``rows`` holds each step's minibatch."""
    weights = np.repeat([1.0, settings.retained_weight], [settings.batch, settings.retained]).astype(np.float32)
    optimiser = optax.adam(optax.cosine_decay_schedule(settings.learning_rate, settings.steps))

    def loss(actor: Actor, x: Float[Array, "batch 4"], u: Float[Array, "batch"]) -> Scalar:
        policy = Policy(student.policy.stages, actor)
        return jnp.mean(weights * (student.torque_limit * jax.vmap(policy)(x)[:, 0] - u) ** 2)

    def step(carry: Any, chosen: Int[Array, "batch"]) -> tuple[Any, None]:
        actor, state = carry
        updates, state = optimiser.update(jax.grad(loss)(actor, states[chosen], torques[chosen]), state)
        return (optax.apply_updates(actor, updates), state), None

    start = student.policy.actor
    (actor, _), _ = jax.jit(functools.partial(jax.lax.scan, step))((start, optimiser.init(start)), rows)
    return actor


def demonstrate(
    teacher: AbstractController[Any],
    robot: Robot,
    settings: CloningSettings,
    random: np.random.Generator,
    plant: PlantLike | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """States (n, 4) of the teacher's runs from hanging under pushes, and its torques in them (N m).

    Raises:
        SwingupError: no run ended upright.
    """
    parameters = robot_parameters(plant, robot)
    scales, substeps = scales_of(parameters), stable_substeps(parameters, DEMONSTRATION_RULES.dt)
    settings = replace(settings, duration=settings.duration * scales.time, push=settings.push * scales.torque_limit)
    rates = np.array([1.0, 1.0, scales.velocity, scales.velocity])
    steps = round(settings.duration / DEMONSTRATION_RULES.dt)
    scenarios, starts = [], []
    for _ in range(settings.demonstrations):
        # One size for pushes and start: the runs reach from calm to rough.
        size = random.uniform()
        shape = (2, DEMONSTRATION_PUSHES)
        pushes = Pushes(
            centre=random.uniform(0.0, 0.8 * settings.duration, shape),
            width=scales.time * random.uniform(0.03, 0.08, shape),
            amplitude=settings.push * size * random.normal(size=shape),
        )
        disturbance = dataclasses.replace(undisturbed(DEMONSTRATION_PUSHES), pushes=pushes)
        scenarios.append(Scenario(parameters, disturbance, substeps=substeps))
        starts.append(0.05 * size * random.normal(size=4) * rates)

    def run(scenario: Scenario, x0: Any) -> tuple[Any, Trajectory, Any]:
        outcome, rows = simulate(scenario, teacher, x0, DEMONSTRATION_RULES.dt, steps)
        assert scenario.disturbance is not None
        # The rows hold the torques that acted; the student learns those that the teacher commanded.
        pushed = jax.vmap(scenario.disturbance.pushes.torque)(jnp.asarray(rows.time))
        return outcome.final, rows, (rows.u - pushed)[:, robot.joint]

    with jax.enable_x64(True):
        final, rows, torque = jax.jit(jax.vmap(run))(stack(scenarios), jnp.asarray(np.stack(starts)))
        final, x, torque = (np.asarray(each) for each in (final, rows.x, torque))
    good = upright(final, (rates * DEMONSTRATION_RULES.tolerance).tolist())
    if not good.any():
        raise SwingupError(f"the teacher {settings.teacher!r} never ended upright: use another one")
    return x[good].reshape(-1, 4), torque[good].reshape(-1)
