"""The learner's state before its first iteration, and at the start of new episodes."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..tasks.task import Spaces
from .act import update_statistics
from .advantage import init_gains
from .config import Config
from .keys import InitialKeys
from .layers import LayerKind
from .networks import init_critic, init_policy, init_shared_critic
from .normalise import init_statistics
from .optimiser import make_optimiser
from .popart import init_value_scale
from .reward_scale import init_reward_scale
from .state import LearnerState


def init_learner(keys: InitialKeys, spaces: Spaces, config: Config) -> LearnerState:
    """The state of a learner that has observed no environment yet."""
    kind = LayerKind(config.activation, config.layer_norm, config.gru_width)
    actor = init_policy(
        keys.actor, spaces, config.policy_layers, config.log_std_init, kind, config.state_dependent_std
    )
    if config.shared_trunk:
        critic = init_shared_critic(keys.critic, kind.width(config.policy_layers))
    else:
        critic = init_critic(keys.critic, spaces.observation_size, config.value_layers, kind)
    return LearnerState(
        actor=actor,
        critic=critic,
        # One optimiser for both networks: their gradients are clipped by their joint norm.
        optimiser=make_optimiser(config).init((actor, critic)),
        gains=init_gains(),
        statistics=init_statistics(spaces.observation_size),
        task_states=None,
        observations=jnp.zeros((config.num_envs, spaces.observation_size)),
        key=keys.state,
        iterations=jnp.array(0),
        value_scale=init_value_scale() if config.popart else None,
        reset_cost=jnp.asarray(config.reset_cost, jnp.float32) if config.adapts_reset_cost else None,
        reward_scale=init_reward_scale() if config.normalise_rewards else None,
        memory=_no_memories(config),
    )


def begin_episodes(state: LearnerState, observations: Float[Array, "envs n"], config: Config) -> LearnerState:
    """The learner at the start of new episodes, given their first observations (not normalised)."""
    statistics, normalise = update_statistics(state.statistics, observations, config.observation_clip)
    return dataclasses.replace(
        state, statistics=statistics, observations=normalise(observations), memory=_no_memories(config)
    )


def _no_memories(config: Config) -> Float[Array, "envs w"] | None:
    """The memories of a recurrent policy at the start of episodes."""
    return jnp.zeros((config.num_envs, config.gru_width)) if config.gru_width else None
