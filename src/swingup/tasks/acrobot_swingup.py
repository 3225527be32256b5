"""dm_control's ``acrobot-swingup`` as a task in JAX: two equal links of 1 m, and a weak elbow.

The motor has a tenth of gravity's torque on the stretched arm (C.1: 1.57), so that a swing-up takes many swings,
and only states within some 0.012 rad of a surface through upright can be held at all. Facts: DeepMind Control
Suite (arXiv 1801.00690). A test compares a step with MuJoCo's.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp

from ..common.types import Action, Key, Observation, Scalar, State
from ..dynamics.integrate import rk4_step
from ..plant.plant import Plant
from .pendulum import PendulumState
from .task import AbstractTask, Step

CAPSULES = Plant(
    # As load_plant reads them from the suite's acrobot.xml; that takes time at import.
    m1=1.0, m2=1.0, l1=1.0, l2=1.0, r1=0.5, r2=0.5, I1=0.3455703125, I2=0.3453036571964956, Ir=0.0, gr=2.0,
    b1=0.05, b2=0.05, cf1=0.0, cf2=0.0, g=9.81, tl1=0.0, tl2=2.0, name="dm_control's acrobot",
)  # fmt: skip
"""The plant, from q1 = 0 hanging as everywhere in this package."""

RADIUS = 0.2
"""Distance of the tip from its highest place within which a step earns 1 (m)."""
AT_MARGIN = 0.1
"""What a step earns 1 m further away."""


class AcrobotSwingup(AbstractTask[PendulumState]):
    """Bring the tip to the top and keep it there: 1,000 steps of 10 ms, from anywhere at rest."""

    sparse: bool = eqx.field(static=True, default=False)
    """Whether a step earns nothing outside the target."""
    near_top: float = 0.0
    """Share of the episodes that start near upright, at distances from 0.003 to 3 (rad; twice that in rad/s) of
    which each power of ten is as likely. Not in dm_control: for training alone, since a swing-up hardly ever ends
    where the pendulum can be held."""
    action_repeat: int = eqx.field(static=True, default=1)
    """Steps for which an action is held; the reward is their mean."""
    truncation_probability: float = 0.0
    """Probability of a random truncation after each action. Not in dm_control."""

    @property
    def observation_size(self) -> int:
        """Six: see :meth:`observe`."""
        return 6

    @property
    def action_size(self) -> int:
        """One: the elbow."""
        return 1

    def reset(self, key: Key) -> PendulumState:
        """Both angles uniform, at rest; or near upright."""
        uniform, normal, distance, choice = jax.random.split(key, 4)
        angles = jax.random.uniform(uniform, (2,), minval=-math.pi, maxval=math.pi)
        scale = 10.0 ** jax.random.uniform(distance, minval=-2.5, maxval=0.5)
        near = jnp.array([math.pi, 0.0, 0.0, 0.0]) + scale * jax.random.normal(normal, (4,)) * jnp.array(
            [1, 1, 2, 2]
        )
        at_top = jax.random.bernoulli(choice, self.near_top)
        return PendulumState(x=jnp.where(at_top, near, jnp.append(angles, jnp.zeros(2))), steps=jnp.array(0))

    def observe(self, state: PendulumState) -> Observation:
        """Horizontal, then vertical directions of both links (1 upright), then the joints' velocities (rad/s)."""
        upper = state.x[0] - math.pi
        links = jnp.stack([upper, upper + state.x[1]])
        return jnp.concatenate([jnp.sin(links), jnp.cos(links), state.x[2:]])

    def reward(self, x: State) -> Scalar:
        """1 within the target; beyond, a Gaussian of the distance, or nothing."""
        upper = x[0] - math.pi
        lower = upper + x[1]
        distance = jnp.hypot(jnp.sin(upper) + jnp.sin(lower), 2.0 - jnp.cos(upper) - jnp.cos(lower))
        beyond = jnp.maximum(distance - RADIUS, 0.0)
        return jnp.where(beyond > 0.0, 0.0 if self.sparse else AT_MARGIN ** (beyond**2), 1.0)

    def step(self, state: PendulumState, action: Action, key: Key) -> Step[PendulumState]:
        """Hold the elbow's torque; RK4 as in dm_control, whose steps are of 10 ms."""
        u = jnp.append(jnp.zeros(1), CAPSULES.tl2 * action)

        def hold(x: State, _: None) -> tuple[State, Scalar]:
            x = rk4_step(CAPSULES, x, u, 0.01)
            return x, self.reward(x)

        x, rewards = jax.lax.scan(hold, state.x, None, self.action_repeat)
        after = PendulumState(x=x, steps=state.steps + self.action_repeat)
        at_random = jax.random.bernoulli(key, self.truncation_probability)
        truncated = at_random | (after.steps >= 1000)
        return Step(after, self.observe(after), jnp.mean(rewards), jnp.array(False), truncated)
