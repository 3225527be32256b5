"""The swing-up and balancing of the double pendulum as a continuing task (paper, section IV).

Every variant of the task is an :class:`AbstractPendulumTask`: it has the fields of the paper's task and its
quadratic reward. The variants differ in their first states, in what a step simulates, and in the reward.
:class:`PendulumTask` is the paper's; :class:`RecoveryTask` trains for the global-policy score.
"""

import abc
import math
from typing import Annotated

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Action, Count, Key, Observation, Scalar, State, Torque
from ..dynamics.dynamics import UPRIGHT, tip_height, wrap
from ..dynamics.integrate import rk4_steps
from ..plant.plant import Plant, Robot
from ..plant.units import LENGTH, NUMBER, TIME, VELOCITY, Unit
from .task import AbstractTask, PendulumStage, Step

DIVERGED_VELOCITY = 1000.0
"""Velocity beyond which a state is no longer physics but an integration error (rad/s)."""
UP_FRACTION = 0.9  # The tip is up above this fraction of l1 + l2, as in the benchmark's rules
UP_LINE_WIDTH = 0.01  # Width of the smooth step in the reward at that height, for design C.1 (m)


class PendulumState(eqx.Module):
    """State of the task."""

    x: State  # State of the pendulum, angles unwrapped (rad, rad/s)
    steps: Count  # Steps since the last reset


class AbstractPendulumTask(AbstractTask[PendulumState]):
    """Swing up and balance; truncated at random and by a limit, never terminated.

    The numbers suit the leaderboards' plant, design C.1. By their units :func:`swingup.plant.units.scaled` makes
    them suit another plant: a similar pendulum has the same Markov decision process, step for step. The temperature
    and the number of steps in an episode have no unit. Source: AR-EAPO paper, section IV.
    """

    robot: Robot = eqx.field(static=True)  # Which joint is driven
    parameters: Plant  # The plant; the torque limit of the driven joint scales the action
    observation: PendulumStage = PendulumStage()  # What the policy sees
    dt: Annotated[float, TIME] = 0.01  # Time of one action (s): 100 Hz
    substeps: int = eqx.field(static=True, default=1)
    """Steps of RK4 in an action: more than one where friction is stiff."""
    state_cost: Annotated[tuple[float, ...], NUMBER, NUMBER, Unit(time=2), Unit(time=2)] = (50.0, 50.0, 4.0, 2.0)
    """Diagonal of Q (1/rad², s²/rad²)."""
    torque_cost: Annotated[float, Unit(torque=-2)] = 1.0  # R (1/(N m)²)
    reward_scale: float = 0.001  # α
    reset_noise: float = 0.01
    """Standard deviation of the initial state around hanging (rad, and rad/s times ``reset_rate``)."""
    reset_rate: Annotated[float, VELOCITY] = 1.0
    """Standard deviation of the initial velocities per that of the angles (1/s)."""
    truncation_probability: float = 1e-3  # p_trunc: probability of a random truncation at each step
    max_steps: int = eqx.field(static=True, default=1000)  # Steps after which the task is truncated in any case
    cost_velocity_limit: Annotated[float, VELOCITY] = math.inf
    """Velocities count in the reward only up to ± this (rad/s). Not in the paper: if a policy spins the pendulum
    faster than it can observe, costs without bound would ruin the critic for millions of frames."""

    @property
    def observation_size(self) -> int:
        """Length of an observation."""
        return self.observation.size()

    @property
    def action_size(self) -> int:
        """One: the driven joint."""
        return 1

    def torque(self, action: Action) -> Torque:
        """Torques [u1, u2] (N m) of an action in [-1, 1]; the passive joint gets none."""
        limits = jnp.array([self.parameters.tl1, self.parameters.tl2], action.dtype)
        # Selected, not multiplied by 0: NaN stays on the driven joint.
        return jnp.where(jnp.array(self.robot.actuation) > 0, action * limits, 0.0)

    def quadratic_reward(self, x: State, u: Torque) -> Scalar:
        """r(x', a) = -α[(x' - g)ᵀ Q (x' - g) + R a²], with q1 wrapped to [0, 2π) and q2 to [-π, π)."""
        limited = jnp.clip(x[2:], -self.cost_velocity_limit, self.cost_velocity_limit)
        error = jnp.concatenate([wrap(x)[:2], limited]) - jnp.array(UPRIGHT, x.dtype)
        cost = error @ (jnp.array(self.state_cost, x.dtype) * error) + self.torque_cost * (u @ u)
        return -self.reward_scale * cost

    @abc.abstractmethod
    def reward(self, x: State, u: Torque) -> Scalar:
        """Reward of the state after the step and the torque (N m)."""

    def observe(self, state: PendulumState) -> Observation:
        """Scaled angles and velocities."""
        return self.observation(state.x)

    def step(self, state: PendulumState, action: Action, key: Key) -> Step[PendulumState]:
        """Hold the torque for dt, in steps of Runge-Kutta.

        If the integrator diverges, which takes some 60 rad/s, the last good state is kept and the episode
        truncated.
        """
        u = self.torque(action)
        x = rk4_steps(self.parameters, state.x, u, self.dt, self.substeps)
        # Negated, so that NaN counts as diverged.
        diverged = ~jnp.all(jnp.abs(x[2:]) < DIVERGED_VELOCITY)
        # The step counts even then, so that the limit is reached in any case.
        after = PendulumState(x=jnp.where(diverged, state.x, x), steps=state.steps + 1)
        at_random = jax.random.bernoulli(key, self.truncation_probability)
        return Step(
            state=after,
            observation=self.observe(after),
            reward=self.reward(after.x, u),
            terminated=jnp.array(False),
            truncated=at_random | diverged | (after.steps >= self.max_steps),
        )


class PendulumTask(AbstractPendulumTask):
    """The paper's task: start hanging, with the quadratic reward on the state after the step."""

    def reset(self, key: Key) -> PendulumState:
        """Hang down, disturbed by Gaussian noise on all four states."""
        # Rates have the plant's unit of time; angles have no unit.
        noise = self.reset_noise * jax.random.normal(key, (4,)) * jnp.array([1.0, 1.0, *2 * [self.reset_rate]])
        return PendulumState(x=noise, steps=jnp.array(0))

    def reward(self, x: State, u: Torque) -> Scalar:
        """r(x', a) of the state after the step and the torque (N m)."""
        return self.quadratic_reward(x, u)


class RecoveryTask(AbstractPendulumTask):
    """Get up from any of many given states; the time until then costs.

    The quadratic cost is saturated, so that a fast motion on the way costs no more than a slow one:
    r = -[(1 - w) (1 - exp(-cost / s)) + w down]. This is not the paper's reward; every number was chosen.
    """

    starts: Float[Array, "n 4"] = eqx.field(kw_only=True)  # States that episodes begin in (rad, rad/s)
    saturation: float = 0.3  # s: a quadratic cost that is already large
    down_weight: float = 0.5  # w: share of the reward that depends only on whether the tip is up
    up_line_width: Annotated[float, LENGTH] = eqx.field(kw_only=True, static=True, default=UP_LINE_WIDTH)
    """Width of the smooth step at the line (m)."""

    def reset(self, key: Key) -> PendulumState:
        """Any of the given states."""
        start = self.starts[jax.random.randint(key, (), 0, len(self.starts))]
        return PendulumState(x=start, steps=jnp.array(0))

    def reward(self, x: State, u: Torque) -> Scalar:
        """From -1, far down, to 0, upright at rest without torque."""
        # Saturated: far down all states are alike, and only the time counts.
        away = 1 - jnp.exp(self.quadratic_reward(x, u) / self.saturation)
        # By the height, as the board counts the time until the tip is up.
        below = UP_FRACTION * self.parameters.length - tip_height(self.parameters, x)
        down = jax.nn.sigmoid(below / self.up_line_width)
        return -((1 - self.down_weight) * away + self.down_weight * down)
