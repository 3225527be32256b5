"""The back end of Gymnasium: the host steps the environments, with one compiled call a step of all of them.

Its evaluator plays episodes in environments of its own; their mean return is the score.
"""

import contextlib
import functools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..areapo import algorithm
from ..areapo.config import Config
from ..areapo.initial import begin_episodes, init_learner
from ..areapo.networks import AnyActor, sample_actions
from ..areapo.state import COLLECT, LearnerState, Metrics, Purpose, Rollout, root_key
from ..areapo.statistics import RunningStatistics
from ..common.errors import SwingupError
from ..common.types import Key, fetch
from ..controllers.stack.policy import Policy, act, network_of
from ..policy.policy import spaced
from ..policy.spaces import box
from .backend import (
    EPISODE_STEPS,
    EPISODES,
    AbstractBackend,
    AbstractEvaluator,
    check_actions,
    check_spaces,
    join_seeds,
    split_seeds,
    summarise_episodes,
)
from .environments import SAME_AGAIN, Environments, HostStep, make_environments, own_number
from .metrics import Evaluation, HostMetrics, TrainingMetrics, make_evaluation


class EpisodeEvaluator(AbstractEvaluator):
    """The mean return of episodes in environments of its own, the same episodes each time."""

    def __init__(self, env: Any, name: str, environments: Environments, seed: int, episodes: int) -> None:
        """Prepare for environments like those of training, made when first needed; with None none are made."""
        space = environments.observation_space
        self.observation_space = box(space.shape, space.low, space.high)
        self._env, self.task, self._seed, self._episodes = env, name, seed, episodes
        self.action_space, self.step_time = environments.actions, environments.step_time
        self._environments: Environments | None = None

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> Evaluation:
        """Means over the episodes."""
        if self._env is None:
            raise SwingupError("what was passed in trains: pass evaluate another environment as env")
        if episodes not in (None, self._episodes):
            # Users ask for another number once or twice; only the default number of environments is kept.
            with contextlib.closing(make_environments(self._env, episodes)) as environments:
                return evaluate_episodes(policy, environments, self._seed)
        if self._environments is None:
            self._environments = make_environments(self._env, self._episodes)
        return evaluate_episodes(policy, self._environments, self._seed)

    def compile(self, policy: Policy[Any]) -> None:
        """Compile the policy for the default number of episodes."""
        observations = np.zeros((self._episodes, self.observation_space.size), np.float32)
        act(policy, observations)

    def close(self) -> None:
        """Close the environments that were made here."""
        if self._environments is not None:
            self._environments.close()
        self._environments = None


class HostBackend(AbstractBackend):
    """Environments of Gymnasium. Each seed has its own; the seeds train one after another.

    The host steps one environment at a time in any case, and so each seed trains bit for bit as it does alone.
    """

    evaluator: EpisodeEvaluator

    def __init__(
        self, env: Any, name: str, config: Config, seeds: Sequence[int], episodes: int, stream: bool = False
    ) -> None:
        """Make the environments; with 0 episodes of an evaluation those of training give the score.

        Those of a stream are reset once in their life.
        """
        passed_in = own_number(env, stream) is not None
        if passed_in and len(seeds) > 1:
            raise SwingupError(
                f"seeds = {len(seeds)}, but an environment that was passed in serves one: pass the function that "
                "makes it"
            )
        self._environments: list[Environments] = []
        with contextlib.ExitStack() as stack:
            for _ in seeds:
                self._environments.append(make_environments(env, config.num_envs, stream))
                stack.callback(self._environments[-1].close)
            alone = callable(env) and config.num_envs == 1 and not passed_in and not stream
            if alone and self._share_one(env, another=bool(episodes)):
                stack.pop_all()  # it is the caller's, and stays open
                raise SwingupError(f"{name} {SAME_AGAIN}, or pass the environment itself")
            stack.pop_all()  # all were made
        first = self._environments[0]
        self._config, self._seeds = config, seeds
        self.evaluator = EpisodeEvaluator(None if passed_in or stream else env, name, first, seeds[0], episodes)
        # It cannot be made again, and resetting it would disturb training.
        self._scored_by_training = passed_in or not episodes
        self._training_results = [Evaluation(None) for _ in seeds]  # before the first step

    def _share_one(self, env: Callable[[], Any], another: bool) -> bool:
        """Whether a function returns one environment each time, which seeds or evaluations would share."""
        made = [identity for each in self._environments for identity in each.identities]
        if another and len(made) == 1:
            probe = make_environments(env, 1)
            made += probe.identities
            if made[0] != made[1]:
                probe.close()
        return len(set(made)) < len(made)

    def init(self) -> LearnerState:
        """The state before the first iteration; the environments are not reset yet."""
        spaces = self._environments[0].spaces
        return join_seeds([_init(root_key(seed, Purpose.TRAINING), spaces, self._config) for seed in self._seeds])

    def compile(self, state: LearnerState) -> None:
        """Compile what training calls by an iteration on made-up steps, and time the update of another."""
        member = split_seeds(state, len(self._seeds))[0]
        member = _begin(member, np.zeros(member.observations.shape, np.float32))
        for _ in range(2):
            member, rollout = collect_on_host(member, _MadeUp(self._environments[0]), self._config)
            began = time.perf_counter()
            member, _ = jax.block_until_ready(_update(member, rollout, self._config))
            self.pause = time.perf_counter() - began
        if not self._scored_by_training:
            self.evaluator.compile(self.policy(member))

    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """Reset the environments, with seeds that follow from the run's seeds and the iterations.

        A running stream goes on: from what it shows, if that is not what the learner saw last.
        """

        def begin(member: LearnerState, environments: Environments, seed: int) -> LearnerState:
            latest = environments.latest
            if latest is None:
                # Mixed, not added: environment i takes seed + i, and sums of nearby seeds and iterations coincide.
                mixed = int(np.random.SeedSequence([seed, iterations]).generate_state(1)[0] >> 1)
                latest = environments.reset(mixed)
            elif np.allclose(member.statistics.stage()(latest), member.observations, atol=1e-4):
                return member
            return _begin(member, latest)

        members = split_seeds(state, len(self._seeds))
        return join_seeds(list(map(begin, members, self._environments, self._seeds)))

    def train(
        self, state: LearnerState, iterations: int, stopping: Callable[[], bool] = lambda: False
    ) -> tuple[LearnerState, list[TrainingMetrics]]:
        """Run some iterations of each seed; also reports the episodes that ended."""
        members = split_seeds(state, len(self._seeds))
        metrics: list[list[Metrics]] = [[] for _ in members]
        resets_before = [each.own_resets for each in self._environments]
        for each in self._environments:
            each.episodes.clear()
            each.successes.clear()
            each.late_steps, each.longest_pause = 0, 0.0
        for iteration in range(iterations):
            if iteration and stopping():
                break
            for index, environments in enumerate(self._environments):
                member, rollout = collect_on_host(members[index], environments, self._config)
                members[index], measured = _update(member, rollout, self._config)
                metrics[index].append(jax.device_get(measured))
        self._training_results, found = [], list[TrainingMetrics]()
        for own, environments, before in zip(metrics, self._environments, resets_before, strict=True):
            means = jax.tree.map(lambda *leaves: np.mean(leaves, dtype=np.float32), *own)
            frames = len(own) * self._config.rollout_size
            resets = float(means.termination_rate) + (environments.own_resets - before) / frames
            # Perhaps no episode ended since the last report; an endless task never ends one.
            ended = [float(np.mean(each)) for each in zip(*environments.episodes, strict=True)]
            episode_return, length = ended or (None, None)
            means = replace(means, termination_rate=resets)
            said = environments.successes if environments.names_goals else []
            success = float(np.mean(said)) if said else None
            pauses = environments.longest_pause, environments.late_steps
            host = HostMetrics(episode_return, length, success, *pauses)
            found.append(TrainingMetrics(means, host))
            # The rates are those of all steps since the last report, also of episodes that go on.
            reward = float(means.reward)
            score = reward if environments.endless else episode_return
            result = make_evaluation(score, length, reward, resets, environments.step_time)
            self._training_results.append(replace(result, success_rate=success))
        return join_seeds(members), found

    def evaluate(self, policies: Sequence[Policy[Any]]) -> list[Evaluation]:
        """The results of all seeds: of episodes that are played, or of the training since the last report."""
        # In the caller's thread, on which an environment may depend.
        return self._training_results if self._scored_by_training else list(map(self.evaluator.evaluate, policies))

    @contextlib.contextmanager
    def occupied(self) -> Iterator[None]:
        """Of all seeds."""
        with contextlib.ExitStack() as stack:
            for each in self._environments:
                stack.enter_context(each.occupied())
            yield

    def memory(self) -> list[bool]:
        """Whether the environments of each seed ever said whether an end is a success."""
        return [each.names_goals for each in self._environments]

    def remember(self, memory: Any) -> None:
        """Take up what :meth:`memory` gave; a checkpoint of an older version has nothing."""
        known = memory if isinstance(memory, list) else ()
        for environments, names_goals in zip(self._environments, known, strict=False):
            environments.names_goals = bool(names_goals)

    def close(self) -> None:
        """Close the environments, except one that was passed in."""
        self.evaluator.close()
        for each in self._environments:
            each.close()


def collect_on_host(
    state: LearnerState, environments: "Environments | _MadeUp", config: Config
) -> tuple[LearnerState, Rollout]:
    """Act for ``num_steps`` in every environment, as :func:`swingup.areapo.algorithm.collect` does."""
    seen, noise = np.asarray(state.observations), fetch(_noise(state.actor, state.key, config))
    # Flat, since a call takes a tenth of a step to take modules apart.
    actor, shape = jax.tree.flatten(state.actor)
    statistics, statistics_shape = jax.tree.flatten(state.statistics)
    shapes = shape, statistics_shape
    actions, latents, log_probs = fetch(_sample(actor, seen, noise[0], shape))
    decisions: list[tuple[np.ndarray, ...]] = []
    steps: list[HostStep] = []
    for index in range(1, config.num_steps + 1):
        step = environments.step(actions)
        if steps and step.late.any():
            # What came before is cut off from a state that moved on by itself, as by a reset.
            environments.late_steps += int(np.sum(step.late))
            steps[-1].truncated[step.late] = True
        true_next = None if step.true_next is step.following else step.true_next
        statistics, *answer = _advance(actor, statistics, step.following, true_next, noise[index], shapes)
        following, true_next, *chosen = fetch(answer)
        true_next = following if true_next is None else true_next
        decisions.append((seen, latents, log_probs, true_next))
        steps.append(step)
        seen, (actions, latents, log_probs) = following, chosen
    stack: Any = np.stack  # compiled functions take NumPy's arrays
    observations, latents, log_probs, next_observations = map(stack, zip(*decisions, strict=True))
    names = "rewards", "terminated", "truncated", "counted", "goals"
    rewards, terminated, truncated, counted, goals = (
        stack([getattr(each, name) for each in steps]) for name in names
    )
    rollout = Rollout(
        observations, latents, log_probs, rewards, next_observations, terminated, truncated,
        None if environments.all_count else counted.astype(np.float32), goals if environments.names_goals else None,
    )  # fmt: skip
    # The last decision is dropped: the next rollout decides with its own key and the improved actor.
    after = replace(
        state, statistics=jax.tree.unflatten(statistics_shape, statistics), observations=jnp.asarray(seen)
    )
    return after, rollout


class _MadeUp:
    """Steps in which nothing happens, to compile an iteration before the environments' first."""

    def __init__(self, environments: Environments) -> None:
        self.all_count, self.late_steps, self._count = environments.all_count, 0, environments.num_envs
        self.names_goals = environments.names_goals
        self._size, self._steps = environments.spaces.observation_size, 0

    def step(self, actions: Any) -> HostStep:
        self._steps += 1
        following, no = np.zeros((self._count, self._size), np.float32), np.zeros(self._count, np.bool_)
        # Two programs, without and with a reset.
        true_next = following if self._steps % 2 else following.copy()
        return HostStep(following, true_next, np.zeros(self._count, np.float32), no, no, ~no, no, no)


@jax.jit
def _noise(actor: AnyActor, key: Key, config: Config) -> Float[Array, "decisions k envs"]:
    """The noise of all decisions of a rollout: drawn at each step, it would take a quarter of the step's call."""
    keys = jax.random.split(jax.random.fold_in(key, COLLECT), config.num_steps + 1)
    return jax.vmap(lambda each: actor.noise(each, (config.num_envs,)))(keys)


@functools.partial(jax.jit, static_argnames="shape")
def _sample(
    actor: Sequence[Array], seen: Float[Array, "envs n"], noise: Float[Array, "k envs"], shape: Any
) -> tuple[Array, Array, Array]:
    """Actions, latents and log-probabilities for normalised observations."""
    chosen = sample_actions(jax.tree.unflatten(shape, actor), seen, noise)
    return chosen.actions, chosen.latents, chosen.log_probs


@functools.partial(jax.jit, static_argnames="shapes")
def _advance(
    actor: Sequence[Array],
    statistics: Sequence[Array],
    following: Float[Array, "envs n"],
    true_next: Float[Array, "envs n"] | None,
    noise: Float[Array, "k envs"],
    shapes: Any,
) -> tuple[Any, ...]:
    """Update the statistics with a step's observations and sample the next actions; one call saves overhead.

    True next observations of None, where no episode ended, stay None: they are the following ones.
    """
    updated: RunningStatistics = jax.tree.unflatten(shapes[1], statistics).update(following)
    normalise = updated.stage()
    seen, seen_next = normalise(following), None if true_next is None else normalise(true_next)
    return jax.tree.leaves(updated), seen, seen_next, *_sample(actor, seen, noise, shapes[0])


_begin = jax.jit(begin_episodes)
_init = jax.jit(init_learner, static_argnames="spaces")
_update = jax.jit(algorithm.update)


def play_once(policy: Policy[Any], env: Any, episodes: int | None, seed: int, trained: Any) -> Evaluation:
    """Evaluate episodes in a given environment, or in new ones made for them.

    Without a number of episodes it is one in each environment that was passed in, or else ``EPISODES``. ``trained``
    describes the actions of training.
    """
    own = own_number(env)
    if episodes is not None and own not in (None, episodes):
        raise SwingupError(
            f"episodes = {episodes}, but the environment that was passed in plays {own}: leave episodes out"
        )
    with contextlib.closing(make_environments(env, own or episodes or EPISODES)) as environments:
        check_spaces(policy, environments.spaces)
        check_actions(trained, environments.actions)
        return evaluate_episodes(policy, environments, seed)


def evaluate_episodes(policy: Policy[Any], environments: Environments, seed: int) -> Evaluation:
    """The first episode of each environment under the deterministic policy, as means.

    The score of a continuing task, of whose stream ``EPISODE_STEPS`` are played, is its reward rate.
    """
    observations, network = environments.reset(seed), network_of(policy)
    running = np.ones(environments.num_envs, np.bool_)
    returns, lengths = np.zeros(running.size), np.zeros(running.size, np.int64)
    reached = 0
    terminations = -environments.own_resets
    for _ in range(EPISODE_STEPS):
        actions, choices = act(policy, observations), network.choices
        if choices is not None and not environments.spaces.choices:
            actions = spaced(actions, choices)
        step = environments.step(actions)
        # Environments that ended start another episode by themselves; it does not count.
        returns += running * step.rewards
        lengths += running
        terminations += int(np.sum(running & step.terminated))
        reached += int(np.sum(running & step.goals))
        running &= ~step.ended
        observations = step.following
        if not running.any():
            break
    terminations += environments.own_resets
    result = summarise_episodes(returns.tolist(), lengths.tolist(), terminations, environments.step_time)
    if environments.names_goals:
        result = replace(result, success_rate=reached / running.size)
    return replace(result, score=result.reward_rate) if environments.endless else result
