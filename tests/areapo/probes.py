"""Probe tasks whose gain, bias and maximum-entropy policy are known."""

import abc
import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from swingup.tasks.task import AbstractTask, Step


class Probe(AbstractTask):
    """A task whose state is one number, seen as it is; subclasses of the tests give reward and transition."""

    max_steps: int = eqx.field(static=True, default=10)
    terminates: bool = eqx.field(static=True, default=False)
    offset: float = 0.0
    """Added to every reward."""

    observation_size = 1
    action_size = 1

    def reset(self, key):
        return jnp.zeros(2)

    def observe(self, state):
        return state[:1]

    @abc.abstractmethod
    def outcome(self, value, action):
        """Reward and next value."""

    def step(self, state, action, key):
        reward, value = self.outcome(state[0], action[0])
        after = jnp.stack([value, state[1] + 1.0])
        ended = after[1] >= self.max_steps
        never = jnp.array(False)
        return Step(
            after,
            self.observe(after),
            reward + self.offset,
            terminated=ended if self.terminates else never,
            truncated=never if self.terminates else ended,
        )


class Constant(Probe):
    """Reward 1 whatever happens: ρ = 1, v = 0."""

    def outcome(self, value, action):
        return jnp.array(1.0), value


class Cycle(Probe):
    """States 0 and 1 in turn with rewards 0 and 2: ρ = 1 and v(1) - v(0) = 1."""

    def outcome(self, value, action):
        return 2.0 * value, 1.0 - value


class Ring(Probe):
    """Four states in turn, each with its reward; after the last one the task may end: ρ is the mean."""

    rewards: jax.Array = eqx.field(default_factory=lambda: jnp.zeros(4))
    ends: jax.Array = eqx.field(default_factory=lambda: jnp.array(False))

    def outcome(self, value, action):
        return self.rewards[value.astype(int)], (value + 1.0) % 4.0

    def step(self, state, action, key):
        step = super().step(state, action, key)
        return dataclasses.replace(step, terminated=self.ends & (state[0] == 3.0), truncated=jnp.array(False))


class Bowl(Probe):
    """Reward -a²: with temperature τ the best density is proportional to exp(-a²/τ)."""

    def outcome(self, value, action):
        return -(action**2), value


class Switch(Probe):
    """The sign of the action chooses the next state; state 1 pays 1."""

    def outcome(self, value, action):
        return value, jnp.where(action > 0, 1.0, 0.0)


def best_squashed_gaussian(reward, temperature):
    """Largest E[r(a)] + τ H over tanh(N(μ, σ²)), by quadrature on a grid of μ and log σ.

    Returns the objective, μ and log σ. The policy class cannot reach every density, so this is what to expect.
    """
    z = np.linspace(-12.0, 12.0, 4001)
    log_slope = 2.0 * (np.log(2.0) - z - np.logaddexp(0.0, -2.0 * z))
    best = (-np.inf, 0.0, 0.0)
    for mean in np.linspace(-1.5, 1.5, 61):
        for log_std in np.linspace(-3.0, 1.0, 81):
            log_normal = -0.5 * ((z - mean) / np.exp(log_std)) ** 2 - log_std - 0.5 * np.log(2 * np.pi)
            weight = np.exp(log_normal) * (z[1] - z[0])
            objective = np.sum(weight * (reward(np.tanh(z)) - temperature * (log_normal - log_slope)))
            best = max(best, (objective, mean, log_std))
    return best


class Levers(Probe):
    """Two choices at a time: the first decides the next state, which pays or not; the second does nothing."""

    choices = (2, 4)
    action_size = 2

    def step(self, state, action, key):
        return super().step(state, action[None], key)

    def outcome(self, value, action):
        return value, (action[0] == 1).astype(float)


class Walk(Probe):
    """Reward 1 until the task ends itself, after ``max_steps``."""

    def outcome(self, value, action):
        return jnp.array(1.0), value + 1.0


class Trap(Probe):
    """The second of two choices pays 1 and ends the task, which begins anew in the only state."""

    choices = (2,)

    def outcome(self, value, action):
        return action.astype(float), value

    def step(self, state, action, key):
        return dataclasses.replace(super().step(state, action, key), terminated=action[0] == 1)
