"""The back end of Gymnasium: the host steps the environments, and the learner is compiled."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from ..areapo.config import Config
from ..areapo.initial import begin_episodes, init_learner
from ..areapo.keys import Purpose, root_key
from ..areapo.metrics import Metrics
from ..areapo.state import LearnerState
from ..common.errors import SwingupError
from ..controllers.stack.policy import Policy
from ..tasks.task import Spaces
from .backend import AbstractBackend, join_seeds, split_seeds
from .environments import Environments, make_environments, own_number
from .host_collection import compile_iteration, host_iteration
from .host_evaluators import EpisodeEvaluator
from .memory import check_memory
from .rates import RESETS, REWARD_RATE, rates


class HostBackend(AbstractBackend):
    """Environments of Gymnasium. Each seed has its own; the seeds train one after another.

    The host steps one environment at a time in any case, and so each seed trains bit for bit as it does alone.
    """

    evaluator: EpisodeEvaluator

    def __init__(self, env: Any, name: str, config: Config, seeds: Sequence[int], episodes: int) -> None:
        """Make the environments; with 0 episodes of an evaluation those of training give the score."""
        passed_in = own_number(env) is not None
        if passed_in and len(seeds) > 1:
            raise SwingupError(
                f"seeds = {len(seeds)}, but an environment that was passed in serves one: pass the function that "
                "makes it"
            )
        check_memory(config, Spaces(1, 1), len(seeds))  # before so many environments are made
        self._environments = [make_environments(env, config.num_envs) for _ in seeds]
        first = self._environments[0]
        check_memory(config, first.spaces, len(seeds))
        self._config, self._seeds = config, seeds
        self.evaluator = EpisodeEvaluator(env, name, first, seeds[0], episodes)
        # It cannot be made again, and resetting it would disturb training.
        self._scored_by_training = passed_in or not episodes
        # Before the first step.
        unknown = dict.fromkeys(("score", "mean_length", REWARD_RATE, RESETS))
        self._training_results: list[dict[str, Any]] = [unknown for _ in seeds]

    def init(self) -> LearnerState:
        """The state before the first iteration; the environments are not reset yet."""
        spaces = self._environments[0].spaces
        return join_seeds([_init(root_key(seed, Purpose.TRAINING), spaces, self._config) for seed in self._seeds])

    def compile(self, state: LearnerState) -> None:
        """Compile an iteration, the start of new episodes, and the policy for an evaluation."""
        member = split_seeds(state, len(self._seeds))[0]
        compile_iteration(member, self._config, self._environments[0].all_count)
        _begin.lower(member, np.zeros(member.observations.shape, np.float32)).compile()
        if not self._scored_by_training:
            self.evaluator.compile(self.policy(member))

    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """Reset the environments, with seeds that follow from the run's seeds and the iterations."""

        def begin(member: LearnerState, environments: Environments, seed: int) -> LearnerState:
            # Mixed, not added: environment i takes seed + i, and sums of nearby seeds and iterations coincide.
            mixed = int(np.random.SeedSequence([seed, iterations]).generate_state(1)[0] >> 1)
            return _begin(member, environments.reset(mixed))

        members = split_seeds(state, len(self._seeds))
        return join_seeds(list(map(begin, members, self._environments, self._seeds)))

    def train(
        self, state: LearnerState, iterations: int, stopping: Callable[[], bool] = lambda: False
    ) -> tuple[LearnerState, list[dict[str, Any]]]:
        """Run some iterations of each seed; also reports the episodes that ended."""
        members = split_seeds(state, len(self._seeds))
        metrics: list[list[Metrics]] = [[] for _ in members]
        resets = [each.own_resets for each in self._environments]
        for each in self._environments:
            each.episodes.clear()
        for iteration in range(iterations):
            if iteration and stopping():
                break
            for index, environments in enumerate(self._environments):
                members[index], found = host_iteration(members[index], environments, self._config)
                metrics[index].append(jax.device_get(found))
        self._training_results, rows = [], []
        for own, environments, before in zip(metrics, self._environments, resets, strict=True):
            row = jax.tree.map(lambda *leaves: np.mean(leaves, dtype=np.float32), *own).as_dict()
            frames = len(own) * self._config.rollout_size
            row["termination_rate"] += (environments.own_resets - before) / frames
            # Perhaps no episode ended since the last report; an endless task never ends one.
            means = [float(np.mean(each)) for each in zip(*environments.episodes, strict=True)]
            episode_return, episode_length = means or (None, None)
            rows.append(row | {"episode_return": episode_return, "episode_length": episode_length})
            # The rates are those of all steps since the last report, also of episodes that go on.
            measured = rates(row["reward"], row["termination_rate"], environments.step_time)
            score = row["reward"] if environments.endless else episode_return
            self._training_results.append({"score": score, "mean_length": episode_length, **measured})
        return join_seeds(members), rows

    def evaluate(self, policies: Sequence[Policy[Any]]) -> list[dict[str, Any]]:
        """The results of all seeds: of episodes that are played, or of the training since the last report."""
        # In the caller's thread, on which an environment may depend.
        return self._training_results if self._scored_by_training else list(map(self.evaluator.evaluate, policies))

    def close(self) -> None:
        """Close the environments, except one that was passed in."""
        self.evaluator.close()
        for each in self._environments:
            each.close()


_begin = jax.jit(begin_episodes)
_init = jax.jit(init_learner, static_argnames="spaces")
