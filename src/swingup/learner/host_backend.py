"""The back end of Gymnasium: the host steps the environments, and the learner is compiled."""

from typing import Any

import jax
import numpy as np
from gymnasium import Env
from gymnasium.vector import VectorEnv
from jaxtyping import Shaped

from ..areapo.config import Config
from ..areapo.initial import begin_episodes, init_learner
from ..areapo.keys import initial_keys
from ..areapo.state import LearnerState, Metrics
from ..controllers.stack.policy import Policy
from ..tasks.task import Spaces
from .backend import AbstractBackend, portable_policy
from .environments import make_environments
from .host_collection import compile_iteration, host_iteration, new_tally
from .host_evaluators import EpisodeEvaluator, TrainingEvaluator
from .made_environment import tell_changes
from .memory import check_memory
from .rates import rates


class HostBackend(AbstractBackend):
    """Environments of Gymnasium, one seed at a time."""

    evaluator: EpisodeEvaluator | TrainingEvaluator

    def __init__(self, env: Any, name: str, config: Config, seed: int, episodes: int) -> None:
        """Make the environments.

        Args:
            env: an id, an environment or a function that makes one, or a vector environment.
            name: its name in policy files.
            config: the hyperparameters.
            seed: the environments' seeds follow from it and the iteration.
            episodes: of an evaluation; with 0, the episodes of training give the score.

        Raises:
            SwingupError: there is no such environment, its spaces are not supported, or memory is short.
        """
        check_memory(config, Spaces(1, 1))  # before so many environments are made
        self.environments = make_environments(env, config.num_envs)
        check_memory(config, self.environments.spaces)
        if isinstance(env, Env):
            tell_changes(env)
        self._passed_in = isinstance(env, VectorEnv)
        self._config, self._seed = config, seed
        self._tally = new_tally(config.num_envs)
        elsewhere = EpisodeEvaluator(env, name, self.environments, seed, episodes)
        # A vector environment cannot be made again, and resetting it would disturb training.
        by_training = self._passed_in or not episodes
        self.evaluator = TrainingEvaluator(elsewhere, not self._passed_in) if by_training else elsewhere

    def init(self) -> LearnerState:
        """The state before the first iteration; the environments are not reset yet."""
        return _init(jax.random.key(self._seed), self.environments.spaces, self._config)

    def compile(self, state: LearnerState) -> None:
        """Compile an iteration, the start of new episodes, and the policy for an evaluation."""
        compile_iteration(state, self._config, self.environments.all_count)
        _begin.lower(state, np.zeros(state.observations.shape, np.float32), self._config).compile()
        if isinstance(self.evaluator, EpisodeEvaluator):
            self.evaluator.compile(self.policy(state))

    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """Reset the environments, with seeds that follow from the run's seed and the iterations."""
        # Mixed, not added: environment i takes seed + i, and sums of nearby seeds and iterations coincide.
        seed = int(np.random.SeedSequence([self._seed, iterations]).generate_state(1)[0] >> 1)
        self._tally = new_tally(self._config.num_envs)
        return _begin(state, self.environments.reset(seed), self._config)

    def train(self, state: LearnerState, iterations: int) -> tuple[LearnerState, Metrics, dict[str, Any]]:
        """Run some iterations; reports the mean return and length of the episodes that ended."""
        tally = self._tally
        tally.returns.clear()
        tally.finished.clear()
        rows = []
        for _ in range(iterations):
            state, metrics = host_iteration(state, self.environments, tally, self._config)
            rows.append(jax.device_get(metrics))
        mean = jax.tree.map(lambda *leaves: np.mean(leaves, dtype=np.float32), *rows)
        reward, resets = float(mean.reward), float(mean.termination_rate)
        # Perhaps no episode ended since the last report; an endless task never ends one.
        episode_return = float(np.mean(tally.returns)) if tally.returns else None
        episode_length = float(np.mean(tally.finished)) if tally.returns else None
        if isinstance(self.evaluator, TrainingEvaluator):
            score = reward if episode_return is None else episode_return
            # Of all steps since the last report, also those of episodes that go on.
            measured = rates(reward, resets, self.environments.step_time)
            self.evaluator.update({"score": score, "mean_length": episode_length, **measured})
        return state, mean, {"episode_return": episode_return, "episode_length": episode_length}

    def policy(self, member: LearnerState) -> Policy[Any]:
        """The policy of an observation, flattened."""
        return portable_policy((), member, self._config)

    def find_fault(self) -> str:
        """Empty: every observation and reward of the host's environments was checked when it came."""
        return ""

    def to_actions(self, actions: Shaped[np.ndarray, "b m"]) -> Shaped[np.ndarray, "b ..."]:
        """Actions of the environment's space."""
        return self.environments.actions(actions)

    def close(self) -> None:
        """Close the environments, except a vector environment that was passed in: its owner closes it."""
        self.evaluator.close()
        if not self._passed_in:
            self.environments.close()


_begin = jax.jit(begin_episodes)
_init = jax.jit(
    lambda key, spaces, config: init_learner(initial_keys(key), spaces, config), static_argnames="spaces"
)
