"""Evaluators of Gymnasium environments: the mean return of episodes that the host steps."""

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..areapo.networks import CategoricalActor
from ..common.errors import SwingupError
from ..controllers.stack.policy import Policy, act, save_policy
from ..tasks.adapters import as_task
from ..tasks.task import AbstractTask, Spaces
from .environments import Environments, make_environments, own_number
from .evaluators import (
    EPISODE_STEPS,
    EPISODES,
    AbstractEvaluator,
    ReturnEvaluator,
    check_actions,
    summarise_episodes,
)
from .rates import REWARD_RATE


class EpisodeEvaluator(AbstractEvaluator):
    """The mean return of episodes in environments of its own, the same episodes each time."""

    def __init__(self, env: Any, name: str, environments: Environments, seed: int, episodes: int) -> None:
        """Prepare for environments like those of training, which are made when they are first needed."""
        self.observation_shape = environments.observation_space.shape or ()
        self._env, self._name, self._seed, self._episodes = env, name, seed, episodes
        self.actions = environments.actions
        self._made: dict[int, Environments] = {}

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> dict[str, Any]:
        """Means over the episodes."""
        count = self._episodes if episodes is None else episodes
        if own_number(self._env) is not None:
            raise SwingupError("the environment that was passed in trains: pass evaluate another as env")
        if count not in self._made:
            self._made[count] = make_environments(self._env, count)
        return play(policy, self._made[count], self._seed)

    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """Write a policy file that names the environment and the bounds of its actions."""
        save_policy(path, policy, {"env": self._name, **self.described_actions, **provenance})

    def compile(self, policy: Policy[Any]) -> None:
        """Compile the policy for the default number of episodes."""
        observations = np.zeros((self._episodes, int(np.prod(self.observation_shape))), np.float32)
        act(policy, observations)

    def close(self) -> None:
        """Close the environments that were made here."""
        for environments in self._made.values():
            environments.close()
        self._made = {}


def play_once(
    policy: Policy[Any], env: Any, episodes: int | None, seed: int, trained: Mapping[str, Any]
) -> dict[str, Any]:
    """Evaluate episodes in a given environment, or in new ones made for them.

    Without a number of episodes it is one in each environment that was passed in, or else ``EPISODES``. ``trained``
    describes the actions of training.
    """
    task = as_task(env)
    if isinstance(task, AbstractTask):
        _check_spaces(policy, task.spaces)
        by_return = ReturnEvaluator(task, seed, episodes or EPISODES)
        check_actions(trained, by_return.described_actions)
        return by_return.evaluate(policy)
    own = own_number(env)
    if episodes is not None and own not in (None, episodes):
        raise SwingupError(
            f"episodes = {episodes}, but the environment that was passed in plays {own}: leave episodes out"
        )
    with contextlib.closing(make_environments(env, own or episodes or EPISODES)) as environments:
        _check_spaces(policy, environments.spaces)
        check_actions(trained, environments.actions.describe())
        return play(policy, environments, seed)


def play(policy: Policy[Any], environments: Environments, seed: int) -> dict[str, Any]:
    """The first episode of each environment under the deterministic policy, as means.

    The score of a continuing task, of whose stream ``EPISODE_STEPS`` are played, is its reward rate.
    """
    observations = environments.reset(seed)
    running = np.ones(environments.num_envs, np.bool_)
    returns, lengths = np.zeros(running.size), np.zeros(running.size, np.int64)
    terminations = -environments.own_resets
    for _ in range(EPISODE_STEPS):
        step = environments.step(act(policy, observations))
        # Environments that ended start another episode by themselves; it does not count.
        returns += running * step.rewards
        lengths += running
        terminations += int(np.sum(running & step.terminated))
        running &= ~step.ended
        observations = step.following
        if not running.any():
            break
    terminations += environments.own_resets
    result = summarise_episodes(returns.tolist(), lengths.tolist(), terminations, environments.step_time)
    return result | {"score": result[REWARD_RATE]} if environments.endless else result


def _check_spaces(policy: Policy[Any], spaces: Spaces) -> None:
    """Refuse an environment whose observations or actions are not the policy's."""
    actor = policy.actor
    seen, choices = actor.trunk[0].weight.shape[1], actor.choices if isinstance(actor, CategoricalActor) else ()
    if seen != spaces.observation_size:
        raise SwingupError(f"the policy sees {seen} numbers, the environment shows {spaces.observation_size}")
    size = len(choices) or actor.mean_head.weight.shape[0]
    if (size, choices) != (spaces.action_size, spaces.choices):
        mine, its = _actions(size, choices), _actions(spaces.action_size, spaces.choices)
        raise SwingupError(f"the policy's actions are {mine}, the environment's are {its}")


def _actions(size: int, choices: tuple[int, ...]) -> str:
    return f"{size} choices of {', '.join(map(str, choices))}" if choices else f"{size} numbers"
