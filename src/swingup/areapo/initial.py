"""The learner's state before its first iteration, and at the start of new episodes; its optimiser."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

from ..common.types import Key, Scalar
from ..tasks.task import Spaces
from .config import Config
from .networks import init_critic, init_policy
from .normalise import running_statistics
from .state import LearnerState

ADAM_EPSILON = 1e-5
"""Adam's ε (authors' code)."""


def init_learner(key: Key, spaces: Spaces, config: Config) -> LearnerState:
    """The state of a learner that has observed no environment yet; gains and their trace start at 0."""
    actor_key, critic_key, state_key = jax.random.split(key, 3)
    shared = 0.5 * math.log(spaces.action_size) if config.share_std else 0.0
    actor = init_policy(
        actor_key, spaces, config.policy_layers, config.log_std_init - shared, config.activation,
        config.state_dependent_std,
    )  # fmt: skip
    critic = init_critic(critic_key, spaces.observation_size, config.value_layers, config.activation)
    return LearnerState(
        actor=actor,
        critic=critic,
        optimiser=make_optimiser(config).init((actor, critic)),
        gains=jnp.zeros(2),
        gain_trace=jnp.zeros(()),
        statistics=running_statistics(spaces.observation_size),
        task_states=None,
        observations=jnp.zeros((config.num_envs, spaces.observation_size)),
        key=state_key,
        iterations=jnp.array(0),
        reset_cost=jnp.asarray(config.reset_cost, jnp.float32),
        task_rewards=running_statistics(),
        reward_statistics=running_statistics(),
        step_scale=jnp.ones(()),
        sum_statistics=running_statistics(),
    )


def begin_episodes(state: LearnerState, observations: Float[Array, "envs n"]) -> LearnerState:
    """The learner at the start of new episodes, given their first observations (not normalised)."""
    statistics = state.statistics.update(observations)
    return dataclasses.replace(state, statistics=statistics, observations=statistics.stage()(observations))


def make_optimiser(config: Config, scale: Scalar | float = 1.0) -> optax.GradientTransformation:
    """One Adam for both networks, with ``scale`` times the learning rate; clips the gradients' joint norm first."""
    return optax.chain(
        optax.clip_by_global_norm(config.max_grad_norm),
        optax.scale_by_adam(eps=ADAM_EPSILON),
        optax.scale(-config.learning_rate * scale),
    )
