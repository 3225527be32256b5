"""A gymnax task beside rejax's PPO in one process: speed and learning, with the same sizes, in turns.

Usage: python benchmarks/compiled_suite.py [--task ID] [--frames N] [--seeds N] [--preset NAME]; leave the machine
idle. Both have 64 environments, 64 steps a rollout, 8 epochs in 16 minibatches, networks of 64-64 for policy and
values, the learning rate 3e-4, the clip range 0.2 and λ 0.95: these are rejax's own defaults. Both normalise
observations. Both are compiled end to end; compilation is not timed. Each seed trains in quarters. After each, the
mean return of 128 episodes of the deterministic policy is taken, also not timed.

rejax 0.1.3 unpacks a step of five values, as gymnax returned before version 1.0. A time limit is therefore an end
of the task for it. Here it gets gymnax 1.0.1's environments in that form.
"""

import argparse
import time
from statistics import mean, median
from typing import Any

import gymnax
import jax
import jax.numpy as jnp
from rejax import PPO
from rejax.evaluate import evaluate

from swingup import AREAPO

ENVS, STEPS, EPOCHS, MINIBATCHES, LAYERS = 64, 64, 8, 16, (64, 64)
LEARNING_RATE, CLIP_RANGE, GAE_LAMBDA = 3e-4, 0.2, 0.95
ROLLOUT, QUARTERS, EPISODES = ENVS * STEPS, 4, 128
NEVER = 10**12
"""Frames between reports: each call of ``learn`` then ends with the only one."""


class Ours:
    """The learner of this package, on the environment as it is."""

    def __init__(self, task: str, preset: str, seed: int) -> None:
        self.model = AREAPO(
            gymnax.make(task), preset, seed, num_envs=ENVS, num_steps=STEPS, num_epochs=EPOCHS,
            batch_size=ROLLOUT // MINIBATCHES, policy_layers=LAYERS, value_layers=LAYERS,
            learning_rate=LEARNING_RATE, clip_range=CLIP_RANGE, gae_lambda=(GAE_LAMBDA,) * 2, evaluation_episodes=1,
            evaluate_every=NEVER, checkpoint_every=NEVER,
        )  # fmt: skip
        # The first rollout, which compiles; both learners begin with it.
        self.model.learn(ROLLOUT)

    def learn(self, frames: int) -> None:
        """Train for more frames."""
        self.model.learn(frames)

    def score(self) -> float:
        """The mean return."""
        return float(self.model.evaluate(EPISODES)["score"])


class FiveValues:
    """A gymnax 1.0 environment whose steps are those of the versions before."""

    def __init__(self, env: Any) -> None:
        self._env = env

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)

    def __deepcopy__(self, memo: Any) -> "FiveValues":
        return self

    def step(self, *arguments: Any) -> tuple[Any, ...]:
        """A step that merges both ends."""
        seen, state, reward, terminated, truncated, info = self._env.step(*arguments)
        return seen, state, reward, terminated | truncated, info


class Peer:
    """rejax's PPO."""

    def __init__(self, task: str, seed: int, frames: int) -> None:
        env, params = gymnax.make(task)
        common = {
            "env": FiveValues(env), "env_params": params, "num_envs": ENVS, "num_steps": STEPS,
            "num_epochs": EPOCHS, "num_minibatches": MINIBATCHES, "learning_rate": LEARNING_RATE,
            "clip_eps": CLIP_RANGE, "gae_lambda": GAE_LAMBDA, "normalize_observations": True,
            "skip_initial_evaluation": True, "agent_kwargs": {"hidden_layer_sizes": LAYERS, "activation": "tanh"},
        }  # fmt: skip
        # One episode after each call, as ours.
        self._algorithm, self._train = _compiled(PPO.create(**common), frames)
        first = _compiled(PPO.create(**common), ROLLOUT)[1]
        self._state = first(jax.jit(self._algorithm.init_state)(jax.random.key(seed)))[0]
        # Compiled here, without running it.
        self._train = self._train.lower(self._state).compile()
        self._returns = jax.jit(lambda state: _episodes(self._algorithm, state, jax.random.key(0), EPISODES))

    def learn(self, frames: int) -> None:
        """Train for the frames that the program was compiled for."""
        self._state, _ = jax.block_until_ready(self._train(self._state))

    def score(self) -> float:
        """The mean return."""
        return float(self._returns(self._state).mean())


def _compiled(algorithm: Any, frames: int) -> tuple[Any, Any]:
    """The algorithm with one episode of evaluation at the end, and its training as a function of the state.

    The function also returns that evaluation: what is not returned is not computed.
    """
    algorithm = algorithm.replace(
        total_timesteps=frames,
        eval_freq=frames,
        eval_callback=lambda algorithm, state, key: _episodes(algorithm, state, key, 1),
    )
    return algorithm, jax.jit(lambda state: algorithm.train(train_state=state))


def _episodes(algorithm: Any, state: Any, key: jax.Array, number: int) -> Any:
    """Returns of the deterministic policy: the likeliest choice, or the mean within the bounds."""
    space = algorithm.action_space

    def act(observation: jax.Array, _: jax.Array) -> jax.Array:
        seen = algorithm.normalize_obs(state.obs_rms_state, observation)
        distribution = algorithm.actor.apply(state.actor_ts.params, seen[None], method="_action_dist")
        mode = distribution.mode()[0]
        return mode if algorithm.discrete else jnp.clip(mode, space.low, space.high)

    limit = algorithm.env_params.max_steps_in_episode
    return evaluate(act, key, algorithm.env, algorithm.env_params, number, limit)[1]


def main(task: str, frames: int, seeds: int, preset: str) -> None:
    """Train both in turns and print a table."""
    # Whole rollouts, as both learners round up.
    quarter = -(-frames // (QUARTERS * ROLLOUT)) * ROLLOUT
    names = (f"swingup AREAPO, {preset}", "rejax PPO")
    rates: dict[str, list[float]] = {name: [] for name in names}
    scores: dict[str, list[list[float]]] = {name: [] for name in names}
    for seed in range(seeds):
        both = (Ours(task, preset, seed), Peer(task, seed, quarter))
        learners: dict[str, Ours | Peer] = dict(zip(names, both, strict=True))
        curves: dict[str, list[float]] = {name: [] for name in names}
        for _ in range(QUARTERS):
            for name, learner in learners.items():
                start = time.perf_counter()
                learner.learn(quarter)
                rates[name].append(quarter / (time.perf_counter() - start))
                curves[name].append(learner.score())
        for name, curve in curves.items():
            scores[name].append(curve)
    print(f"{task}, {QUARTERS * quarter + ROLLOUT:,} frames, {seeds} seeds\n")
    print("| learner | frames/s, median (range) | mean return after each quarter | last return of each seed |")
    print("|---|---|---|---|")
    for name in names:
        speed = f"{median(rates[name]):,.0f} ({min(rates[name]):,.0f} to {max(rates[name]):,.0f})"
        means = ", ".join(f"{mean(column):.1f}" for column in zip(*scores[name], strict=True))
        last = ", ".join(f"{curve[-1]:.1f}" for curve in scores[name])
        print(f"| {name} | {speed} | {means} | {last} |")
    ours, peer = (median(rates[name]) for name in names)
    print(f"\nratio of the speeds: {ours / peer:.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="CartPole-v1", help="gymnax's name of it")
    parser.add_argument("--frames", type=int, default=524_288, help="of each seed, rounded up to quarters")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--preset", default="continuing", help="of swingup's learner")
    arguments = parser.parse_args()
    main(arguments.task, arguments.frames, arguments.seeds, arguments.preset)
