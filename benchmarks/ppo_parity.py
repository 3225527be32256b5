"""Our preset ppo beside Stable-Baselines3's PPO with the same hyperparameters, on two cheap tasks.

Usage: python benchmarks/ppo_parity.py [ID ...] [--frames 122880] [--seeds 10] [--first-seed 0]
[--learners swingup-ppo sb3-ppo] [--study FILE] [--updates N]

Needs swingup[mujoco] and stable-baselines3. Both have the peer's defaults with 8 environments of 256 steps,
normalised observations and plain rewards. Finished runs are lines of the study's file and are not repeated.

Prints, for each task, the mean returns of the last of 20 evaluations and of all of them: the interquartile means
over the seeds, and the ratio of ours to the peer's, with a 95 % bootstrap interval.

`--updates N` trains nothing: in each of N updates on the last task, whose actions must be continuous, both learners
begin with the peer's weights and learn from the peer's rollout in the same minibatches. Prints by how much their
weights then differ.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from mujoco_learning import ENVS, STEPS, Point, trained_areapo, trained_sb3
from numpy.typing import ArrayLike
from scipy.stats import bootstrap
from study import Study, cell

from swingup.areapo import algorithm
from swingup.areapo.initial import init_learner
from swingup.areapo.networks import Actor, Linear
from swingup.areapo.optimisation import shuffled
from swingup.areapo.state import IMPROVE, LearnerState, Rollout
from swingup.benchmark.values import interquartile_mean
from swingup.learner.presets import get_preset
from swingup.tasks.task import Spaces


def ours(task: str, seed: int, frames: int) -> Iterator[Point]:
    """Our preset, in rollouts of the peer's form."""
    yield from trained_areapo(task, seed, frames, "ppo", num_envs=ENVS, num_steps=STEPS, normalise_rewards=False)


def peers(task: str, seed: int, frames: int) -> Iterator[Point]:
    """The peer's defaults."""
    yield from trained_sb3(task, seed, frames, ENVS, {"n_steps": STEPS}, scale_rewards=False)


LEARNERS: dict[str, Callable[[str, int, int], Iterator[Point]]] = {"swingup-ppo": ours, "sb3-ppo": peers}
TASKS = ("CartPole-v1", "InvertedDoublePendulum-v5")
RETURNS = {"last evaluation": lambda scores: scores[-1], "all evaluations": fmean}
"""What stands for a run, of the returns of its evaluations."""


def compare_updates(task: str, updates: int) -> None:
    """Print the largest differences of the weights after each update of the same rollout."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    env = VecNormalize(make_vec_env(task, ENVS, seed=0), norm_reward=False)
    if not env.action_space.shape:
        sys.exit(f"--updates: the actions of {task} are not continuous, name another task")
    peer = PPO("MlpPolicy", env, n_steps=STEPS, seed=0, device="cpu")
    _, callback = peer._setup_learn(total_timesteps=updates * ENVS * STEPS)
    config = replace(get_preset("ppo").config, num_envs=ENVS, num_steps=STEPS, normalise_rewards=False)
    state = init_learner(jax.random.key(0), Spaces(*env.observation_space.shape, *env.action_space.shape), config)

    def with_weights(state: LearnerState) -> LearnerState:
        """Our learner with the peer's weights."""

        def linear(layer: torch.nn.Linear) -> Linear:
            return Linear(*(jnp.array(each.detach().numpy()) for each in (layer.weight, layer.bias)))

        policy, layers = peer.policy, peer.policy.mlp_extractor
        trunks = [tuple(linear(net[i]) for i in (0, 2)) for net in (layers.policy_net, layers.value_net)]
        mean = linear(policy.action_net)
        std = Linear(jnp.zeros_like(mean.weight), jnp.array(policy.log_std.detach().numpy()))
        actor = Actor(trunks[0], "tanh", mean, std, "clip")
        values = linear(policy.value_net)  # the entropy's values, a second head, are not used
        heads = Linear(*(jnp.stack([each[0], jnp.zeros_like(each[0])]) for each in (values.weight, values.bias)))
        return replace(state, actor=actor, critic=replace(state.critic, trunk=trunks[1], heads=heads))

    draw = np.random.permutation
    for update in range(1, updates + 1):
        buffer = peer.rollout_buffer
        peer.collect_rollouts(env, callback, buffer, STEPS)
        ended = np.concatenate([buffer.episode_starts[1:], peer._last_episode_starts[None]]) > 0
        rows = buffer.observations, buffer.actions, buffer.log_probs, buffer.rewards, buffer.observations
        before = replace(with_weights(state), observations=jnp.array(peer._last_obs))
        state, _ = algorithm.update(before, Rollout(*map(jnp.array, (*rows, ended, ended & False))), config)
        orders = shuffled(jax.random.fold_in(before.key, IMPROVE), config.num_epochs, config.rollout_size)
        # The peer numbers frames by environment, ours by step.
        ours = iter(np.asarray(orders) % ENVS * STEPS + np.asarray(orders) // ENVS)
        np.random.permutation = lambda size, ours=ours: next(ours)
        peer.train()
        np.random.permutation = draw
        theirs = with_weights(state)
        actor, critic = (
            max(float(jnp.max(jnp.abs(a - b))) for a, b in zip(*map(jax.tree.leaves, pair), strict=True))
            for pair in ((state.actor, theirs.actor), (state.critic, theirs.critic))
        )
        print(f"update {update}: weights of the actor differ by {actor:.1e}, of the critic by {critic:.1e}")


def ratio(mine: Sequence[float], theirs: Sequence[float]) -> str:
    """The ratio of the interquartile means and its interval."""

    def ratio_of_means(first: ArrayLike, second: ArrayLike, axis: int | None = None) -> Any:
        return interquartile_mean(first, axis) / interquartile_mean(second, axis)

    low, high = bootstrap((mine, theirs), ratio_of_means, method="percentile", rng=0).confidence_interval
    return f"{ratio_of_means(mine, theirs):.2f} ({low:.2f} to {high:.2f})"


def main() -> None:
    """Train the missing runs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", default=TASKS, metavar="ID")
    parser.add_argument("--frames", type=int, default=122_880)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0, help="seeds are this one and those that follow")
    parser.add_argument("--learners", nargs="+", choices=list(LEARNERS), default=list(LEARNERS))
    parser.add_argument("--study", type=Path, default=Path("benchmarks/runs/ppo-parity.jsonl"))
    parser.add_argument("--updates", type=int, default=0, help="compare updates instead")
    options = parser.parse_args()
    if options.updates:
        compare_updates(options.tasks[-1], options.updates)
        return
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for task in options.tasks:
            for name in options.learners:
                if not Study(options.study).has([task, name], seed, options.frames):
                    points = list(LEARNERS[name](task, seed, options.frames))
                    Study(options.study).add([task, name], seed, points)
                    print(
                        f"{name} {task} seed {seed}: return {points[-1][1]:.1f}, {points[-1][2]:.0f} s", flush=True
                    )
    study = Study(options.study)  # the table has all finished runs
    print(f"\n| {options.frames:,} frames | swingup-ppo | peer | ratio |\n|---|---|---|---|")
    for task in options.tasks:
        for what, summary in RETURNS.items():
            mine, theirs = ([summary(curve["scores"]) for curve in study.of(task, name)] for name in LEARNERS)
            row = f"{task}, {what}, {len(mine)} seeds", cell(mine, 0), cell(theirs, 0), ratio(mine, theirs)
            print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
