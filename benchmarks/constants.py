"""Constants and units that should not matter: offsets and sizes of rewards, sizes and places of observations.

Usage: python benchmarks/constants.py PRESET [SEEDS [FRAMES]]. The defaults are 5 seeds and 300,000 frames of
Gymnasium's Pendulum-v1 as a task in JAX. Prints the return of the task itself, the mean of 50 episodes of the
deterministic policy, for each change and seed.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import tyro
from jaxtyping import Array, Float

from swingup.areapo import algorithm
from swingup.areapo.state import LearnerState
from swingup.common.types import Key, Observation
from swingup.learner.presets import get_preset
from swingup.tasks.task import AbstractTask, Step

FIRST_SEED = 6300
EPISODES, STEPS = 50, 200
CHANGES: list[dict[str, Any]] = [
    {}, {"offset": 100.0}, {"offset": -100.0}, {"offset": 1e3}, {"offset": -1e3}, {"size": 1e-6}, {"size": 1e6},
    {"seen_size": 1e-6}, {"seen_offset": 1e6},
]  # fmt: skip


class Pendulum(AbstractTask[Any]):
    """Pendulum-v1 with rewards (r + offset) · size and observations o · seen_size + seen_offset."""

    offset: float = 0.0
    size: float = 1.0
    seen_size: float = 1.0
    seen_offset: float = 0.0
    observation_size: int = eqx.field(static=True, default=3)
    action_size: int = eqx.field(static=True, default=1)

    def reset(self, key: Key) -> Float[Array, "3"]:
        """Angle from upright (rad), angular velocity (rad/s) and steps so far."""
        return jax.random.uniform(key, (3,), minval=-1.0) * jnp.array([jnp.pi, 1.0, 0.0])

    def observe(self, state: Float[Array, "3"]) -> Observation:
        """Cosine, sine and velocity."""
        angle, velocity, _ = state
        return self.seen_offset + self.seen_size * jnp.stack([jnp.cos(angle), jnp.sin(angle), velocity])

    def step(self, state: Float[Array, "3"], action: Float[Array, "1"], key: Key) -> Step[Any]:
        """Gymnasium's step; the time limit is a truncation."""
        (angle, velocity, steps), torque = state, 2.0 * action[0]
        wrapped = (angle + jnp.pi) % (2 * jnp.pi) - jnp.pi
        reward = -(wrapped**2 + 0.1 * velocity**2 + 0.001 * torque**2)
        velocity = jnp.clip(velocity + 0.05 * (15.0 * jnp.sin(angle) + 3.0 * torque), -8.0, 8.0)
        after = jnp.stack([angle + 0.05 * velocity, velocity, steps + 1.0])
        earned = (reward + self.offset) * self.size
        return Step(after, self.observe(after), earned, jnp.array(False), after[2] >= STEPS)


@jax.jit
def task_return(state: LearnerState, task: Pendulum) -> Float[Array, ""]:
    """Mean return of Pendulum-v1 over the episodes."""
    normalise, plain = state.statistics.stage(), Pendulum()

    def episode(key: Key) -> Float[Array, ""]:
        def act(place: Array, _: None) -> tuple[Array, Array]:
            step = plain.step(place, state.actor.mode(normalise(task.observe(place))), key)
            return step.state, step.reward

        return jnp.sum(jax.lax.scan(act, task.reset(key), None, STEPS)[1])

    return jnp.mean(jax.vmap(episode)(jax.random.split(jax.random.key(0), EPISODES)))


def learner(preset: str, seeds: int, frames: int) -> Callable[[Pendulum], Float[Array, "seeds"]]:
    """Trains all seeds side by side; gives the task's own returns."""
    config = get_preset(preset).config
    keys = jnp.stack([jax.random.key(FIRST_SEED + seed) for seed in range(seeds)])

    def one(key: Key, task: Pendulum) -> Float[Array, ""]:
        state = algorithm.init(key, task, config)
        return task_return(algorithm.train(state, task, config, frames // config.rollout_size)[0], task)

    learn = jax.jit(jax.vmap(one, (0, None)))
    return lambda task: learn(keys, jax.tree.map(jnp.asarray, task))


def main(preset: str, seeds: int = 5, frames: int = 300_000, /) -> None:
    """Print the returns of each change."""
    learn = learner(preset, seeds, frames)
    for change in CHANGES:
        returns = learn(Pendulum(**change)).tolist()
        print(f"{preset} {change or 'unchanged'}: {', '.join(f'{each:.0f}' for each in returns)}", flush=True)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
