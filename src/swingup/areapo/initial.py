"""The learner's state before its first iteration, its networks, the start of new episodes, and the first noise."""

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Flag, Key, Scalar
from ..policy.network import RELU, TANH, Activation, Bounds
from ..tasks.task import Spaces
from .config import Config
from .networks import BOUNDS, Actor, AnyActor, CategoricalActor, Critic, Linear
from .optimisation import make_optimiser
from .state import LearnerState, Rollout
from .statistics import ROUNDING, mean, running_statistics

COSTLY_SHARE = 0.05
"""Noise is too expensive if squared actions explain this share of the rewards' variance. With the initial deviation
of `continuing` the share is 0.12 to 1 on the ants, Reacher and Pusher, at most 0.006 on six other tasks."""
WHOLE_SHARE = 0.999  # Where they explain more, nothing but the price of actions was seen
REDUCED_SHARE = 0.15  # Share of the initial deviation that remains where noise is too expensive


def init_learner(key: Key, spaces: Spaces, config: Config) -> LearnerState:
    """The state of a learner that has observed no environment yet; gains and their trace start at 0."""
    actor_key, critic_key, state_key = jax.random.split(key, 3)
    size, layers, activation = spaces.observation_size, config.policy_layers, config.activation
    actor: AnyActor
    if spaces.choices:
        actor = init_categorical_actor(actor_key, size, spaces.choices, layers, activation)
    else:
        bounds: Bounds = TANH if config.deviation == "state" else "clip"
        actor = init_actor(actor_key, size, spaces.action_size, layers, config.log_std_init, activation, bounds)
    critic = init_critic(critic_key, size, config.value_layers, activation)
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
        iterations=jnp.zeros((), int),
        reset_cost=jnp.asarray(config.reset_cost, jnp.float32),
        task_rewards=running_statistics(),
        reward_statistics=running_statistics(),
        step_scale=jnp.ones(()),
        sum_statistics=running_statistics(),
        informed=jnp.zeros((), bool),
    )


def wait_for_rewards(before: LearnerState, after: LearnerState, rollout: Rollout, config: Config) -> LearnerState:
    """The learner after a rollout, whose policy stays as it was if rewards told no more than the price of actions.

    From that price alone, training would only save actions, and a rare goal would not be found, or not again. When
    more is known, ``fitted`` lowers σ once if the rewards fall as Σ a² rises. Where torques cost nothing, as on
    Swimmer, large noise explores better. Where they cost much, training lowers σ, but slowly: a reacher needs
    100,000 steps, and until then the noise hides all other effects of an action. With the paper's deviation, that
    of the state, the policy always moves: its entropy counts where rewards tell nothing.
    """
    if config.deviation == "state":
        return after
    share, varies = price_of_actions(before.actor, rollout)
    told = (varies & (share < WHOLE_SHARE)) | jnp.any(rollout.terminated)
    actor = jax.tree.map(lambda new, old: jnp.where(told, new, old), after.actor, before.actor)
    if config.deviation == "fitted" and isinstance(actor, Actor) and actor.std_head is not None:
        bias = actor.std_head.bias
        lower = jnp.minimum(bias, config.log_std_init + math.log(REDUCED_SHARE))
        costly = told & ~before.informed & (share > COSTLY_SHARE)
        actor = dataclasses.replace(actor, std_head=Linear(actor.std_head.weight, jnp.where(costly, lower, bias)))
    # No divergence was seen to which the step could adapt.
    scale = jnp.where(told, after.step_scale, before.step_scale)
    return dataclasses.replace(after, actor=actor, step_scale=scale, informed=before.informed | told)


def price_of_actions(actor: AnyActor, rollout: Rollout) -> tuple[Scalar, Flag]:
    """Share of the rewards' variance that a price of Σ a² explains, and whether rewards vary at all."""
    counted = jnp.ones_like(rollout.rewards) if rollout.counted is None else rollout.counted
    rewards = rollout.rewards - mean(rollout.rewards, counted)
    first = rollout.rewards.reshape(-1)[jnp.argmax(counted.reshape(-1) > 0.0)]  # exact, as a mean is not
    varies = jnp.any(counted * jnp.abs(rollout.rewards - first) > ROUNDING * jnp.abs(first))
    if isinstance(actor, CategoricalActor):
        return jnp.zeros(()), varies
    efforts = jnp.sum(BOUNDS[actor.bounds](rollout.latents) ** 2, axis=-1)
    efforts = efforts - mean(efforts, counted)
    covariance = mean(efforts * rewards, counted)
    variances = mean(efforts**2, counted) * mean(rewards**2, counted)
    return jnp.where(covariance < 0.0, covariance**2 / jnp.maximum(variances, 1e-30), 0.0), varies


def begin_episodes(state: LearnerState, observations: Float[Array, "envs n"]) -> LearnerState:
    """The learner at the start of new episodes, given their first observations (not normalised)."""
    statistics = state.statistics.update(observations)
    return dataclasses.replace(state, statistics=statistics, observations=statistics.stage()(observations))


def init_categorical_actor(
    key: Key,
    observation_size: int,
    choices: tuple[int, ...],
    layers: tuple[int, ...],
    activation: Activation = RELU,
) -> CategoricalActor:
    """An actor of discrete actions, which starts almost uniform."""
    trunk_key, head_key = jax.random.split(key)
    return CategoricalActor(
        trunk=_init_trunk(trunk_key, observation_size, layers),
        activation=activation,
        logits_head=_init_linear(head_key, layers[-1], sum(choices), 0.01),
        choices=choices,
    )


def init_actor(
    key: Key,
    observation_size: int,
    action_size: int,
    layers: tuple[int, ...],
    log_std_init: float,
    activation: Activation = RELU,
    bounds: Bounds = TANH,
) -> Actor:
    """An actor whose mean starts near 0 and whose σ starts at exp(log_std_init)."""
    trunk_key, mean_key, std_key = jax.random.split(key, 3)
    # The inverse of softplus, so that log softplus(std_bias) = log_std_init.
    std_bias = jnp.log(jnp.expm1(jnp.exp(log_std_init))) if bounds == TANH else log_std_init
    # Normal weights instead of orthogonal ones, as in the authors' code.
    std_scale = 0.01 if bounds == TANH else 0.0
    std_weight = std_scale * jax.random.normal(std_key, (action_size, layers[-1]))
    return Actor(
        trunk=_init_trunk(trunk_key, observation_size, layers),
        activation=activation,
        mean_head=_init_linear(mean_key, layers[-1], action_size, 0.01),
        std_head=Linear(std_weight, jnp.zeros(action_size) + std_bias),
        bounds=bounds,
    )


def init_critic(key: Key, observation_size: int, layers: tuple[int, ...], activation: Activation = RELU) -> Critic:
    """A critic with orthogonal weights (one by one for the two heads) and zero biases."""
    trunk_key, *head_keys = jax.random.split(key, 3)
    # Two heads, as in the authors' code: a joint matrix would make their rows orthogonal to each other.
    rows = [_init_linear(head_key, layers[-1], 1, 1.0).weight for head_key in head_keys]
    heads = Linear(jnp.concatenate(rows), jnp.zeros(2))
    return Critic(_init_trunk(trunk_key, observation_size, layers), activation, heads)


def _init_trunk(key: Key, observation_size: int, layers: tuple[int, ...]) -> tuple[Linear, ...]:
    sizes, keys = (observation_size, *layers), jax.random.split(key, len(layers))
    # A gain of √2, since ReLU drops half of the signal; the authors have it, too. Stable-Baselines3 and CleanRL
    # have it with tanh as well.
    return tuple(_init_linear(*each, 2.0**0.5) for each in zip(keys, sizes[:-1], sizes[1:], strict=True))


def _init_linear(key: Key, size_in: int, size_out: int, scale: float) -> Linear:
    """A layer whose rows or columns are orthogonal, of norm ``scale``, and whose biases are 0."""
    orthogonal = jax.nn.initializers.orthogonal(scale)
    # One seed after another under vmap. LAPACK factors a batch in further threads of XLA and holds its own
    # meanwhile: on two cores two layers at once would wait for ever.
    draw = jax.custom_batching.sequential_vmap(lambda key: orthogonal(key, (size_out, size_in)))
    return Linear(draw(key), jnp.zeros(size_out))
