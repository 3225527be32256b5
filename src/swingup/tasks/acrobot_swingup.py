"""dm_control's ``acrobot-swingup`` as a task in JAX: two equal links of 1 m, and a weak elbow.

The motor has a tenth of gravity's torque on the stretched arm (C.1: 1.57), so that a swing-up takes several swings,
and only states within some 0.012 rad of a surface through upright can be held at all. Facts: DeepMind Control
Suite (arXiv 1801.00690). A test compares a step with MuJoCo's. :class:`AcrobotPractice` is the same task as it is
learnt.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.types import Action, Key, Observation, Scalar, State, Torque
from ..dynamics.integrate import rk4_step
from ..loop.starts import winnable_states
from ..plant.plant import ROBOTS, Plant, Robot
from ..policy.spaces import Space, discrete
from .pendulum import PendulumState
from .task import AbstractTask, MagnifyStage, Step

CAPSULES = Plant(
    # As load_plant reads them from the suite's acrobot.xml; that takes time at import.
    m1=1.0, m2=1.0, l1=1.0, l2=1.0, r1=0.5, r2=0.5, I1=0.3455703125, I2=0.3453036571964956, Ir=0.0, gr=2.0,
    b1=0.05, b2=0.05, cf1=0.0, cf2=0.0, g=9.81, tl1=0.0, tl2=2.0, name="dm_control's acrobot",
)  # fmt: skip
"""The plant, from q1 = 0 hanging as everywhere in this package."""

MJCF = """<mujoco><option timestep="0.01" integrator="RK4"><flag constraint="disable"/></option>
<default><joint type="hinge" axis="0 1 0" damping="0.05"/>
<geom type="capsule" mass="1" fromto="0 0 0 0 0 1"/></default>
<worldbody><body pos="0 0 2"><joint name="shoulder"/><geom size="0.05"/>
<body pos="0 0 1"><joint name="elbow"/><geom size="0.049"/></body></body></worldbody>
<actuator><motor joint="elbow" gear="2" ctrlrange="-1 1" ctrllimited="true"/></actuator></mujoco>"""
"""The plant for MuJoCo, with the suite's numbers; there q1 = 0 is upright."""

IDS = {"swingup/AcrobotSwingup-v0": False, "swingup/AcrobotSwingupSparse-v0": True}
"""Gymnasium's ids of the task, and whether it is sparse."""

RADIUS = 0.2  # Distance of the tip from its highest place within which a step earns 1 (m)
AT_MARGIN = 0.1  # What a step earns 1 m further away


class AcrobotSwingup(AbstractTask[PendulumState]):
    """Bring the tip to the top and keep it there: 1,000 steps of 10 ms, from anywhere at rest."""

    sparse: bool = eqx.field(static=True, default=False)
    """Whether a step earns nothing outside the target."""
    action_repeat: int = eqx.field(static=True, default=1)
    """Steps for which an action is held; the reward is their mean."""
    truncation_probability: float = 0.0
    """Probability of a random truncation after each action. Not in dm_control."""

    @property
    def robot(self) -> Robot:
        """The acrobot."""
        return ROBOTS["acrobot"]

    @property
    def parameters(self) -> Plant:
        """The plant."""
        return CAPSULES

    @property
    def dt(self) -> float:
        """Time of an action (s)."""
        return 0.01 * self.action_repeat

    def torque(self, action: Action) -> Torque:
        """Torques [u1, u2] (N m) of an action in [-1, 1]."""
        return jnp.append(jnp.zeros(1), CAPSULES.tl2 * action)

    @property
    def observation_size(self) -> int:
        """Six: see :meth:`observe`."""
        return 6

    @property
    def action_size(self) -> int:
        """One: the elbow."""
        return 1

    def reset(self, key: Key) -> PendulumState:
        """Both angles uniform, at rest."""
        angles = jax.random.uniform(key, (2,), minval=-math.pi, maxval=math.pi)
        return PendulumState(x=jnp.append(angles, jnp.zeros(2)), steps=jnp.array(0))

    def observe(self, state: PendulumState) -> Observation:
        """Horizontal, then vertical directions of both links (1 upright), then the joints' velocities (rad/s)."""
        upper = state.x[0] - math.pi
        links = jnp.stack([upper, upper + state.x[1]])
        return jnp.concatenate([jnp.sin(links), jnp.cos(links), state.x[2:]])

    def reward(self, x: State) -> Scalar:
        """1 within the target; outside, a Gaussian of the distance, or nothing."""
        upper = x[0] - math.pi
        lower = upper + x[1]
        # Links of 1 m: the highest place of the tip is 2 m above the shoulder.
        distance = jnp.hypot(jnp.sin(upper) + jnp.sin(lower), 2.0 - jnp.cos(upper) - jnp.cos(lower))
        outside = jnp.maximum(distance - RADIUS, 0.0)
        return jnp.where(outside > 0.0, 0.0 if self.sparse else AT_MARGIN ** (outside**2), 1.0)

    def step(self, state: PendulumState, action: Action, key: Key) -> Step[PendulumState]:
        """Hold the elbow's torque; RK4 as in dm_control, whose steps are of 10 ms."""
        u = self.torque(action)

        def hold(x: State, _: None) -> tuple[State, Scalar]:
            x = rk4_step(CAPSULES, x, u, 0.01)
            return x, self.reward(x)

        x, rewards = jax.lax.scan(hold, state.x, None, self.action_repeat)
        after = PendulumState(x=x, steps=state.steps + self.action_repeat)
        at_random = jax.random.bernoulli(key, self.truncation_probability)
        truncated = at_random | (after.steps >= 1000)
        return Step(after, self.observe(after), jnp.mean(rewards), jnp.array(False), truncated)


UNSTABLE = np.array([
    [-0.7474204, 1.6525201, -0.106089085, 0.22758904], [23.96562, 7.830786, 8.963737, 2.9218223],
])  # fmt: skip
"""Rows w of both unstable coordinates w·x near upright, which grow by 6.542 and 2.657 1/s: left eigenvectors of the
linearised plant, scaled so that the motor brings back what is within ± 1."""
MAGNIFY = MagnifyStage(np.array([1000.0, 1000.0, 0.0, 0.0, 300.0, 300.0]), 10.0 * UNSTABLE)
"""The links' horizontal directions and velocities (s/rad), so that what can be held is 10 wide, and both unstable
coordinates."""
TORQUES = discrete([3], -1, "float32")
"""The choices of a policy: full torque backwards, none, full torque forwards."""
ACTION_REPEAT = 2  # Steps of 10 ms for which an action is held in practice
STARTS, STARTS_SEED = 2**17, 0  # How many starts are drawn for practice, and their seed


class AcrobotPractice(AcrobotSwingup):
    """The task as a policy learns it: three torques, an observation that is sharp near upright, starts of its own.

    The observation is magnified by a stage that the policy's file keeps. In the task itself a policy of three
    choices acts as any other does: they are evenly spaced actions.
    """

    magnifies: bool = eqx.field(static=True, default=True)
    """Whether it shows the magnified observation, or the task's own."""

    starts: Float[Array, "n 4"] | None = None
    """States to start from (rad, rad/s), such as :func:`~swingup.loop.starts.winnable_states`."""
    start_share: float = 0.0  # Share of the episodes that start in one of them

    @property
    def actions(self) -> Space:
        """The task's action of each of the three choices: -1, 0 or 1."""
        return TORQUES

    @property
    def choices(self) -> tuple[int, ...]:
        """Three torques: the best controls are at the limits, where a squashed Gaussian loses its entropy."""
        return TORQUES.choices

    @property
    def judged(self) -> "AcrobotPractice":
        """The task with its own starts, limit and steps, for such a policy."""
        return AcrobotPractice(sparse=self.sparse, magnifies=False)

    @property
    def observation_size(self) -> int:
        """Fourteen, or the task's six."""
        return MAGNIFY.size(6) if self.magnifies else 6

    def reset(self, key: Key) -> PendulumState:
        """Start as in the task, or in one of the starts."""
        state_key, start_key, chance_key = jax.random.split(key, 3)
        state = super().reset(state_key)
        if self.starts is None:
            return state
        start = jax.random.choice(start_key, self.starts)
        at_start = jax.random.bernoulli(chance_key, self.start_share)
        return PendulumState(x=jnp.where(at_start, start, state.x), steps=state.steps)

    def observe(self, state: PendulumState) -> Observation:
        """The task's observation, perhaps with the magnified one behind it."""
        observation = super().observe(state)
        return MAGNIFY(observation) if self.magnifies else observation

    def step(self, state: PendulumState, action: Action, key: Key) -> Step[PendulumState]:
        """Hold a chosen torque."""
        return super().step(state, self.actions(action), key)


def acrobot_practice(sparse: bool = False) -> AcrobotPractice:
    """What the preset `dm-acrobot` trains on: half of the episodes begin on paths of up to 4 s to upright."""
    starts = winnable_states(jax.random.key(STARTS_SEED), CAPSULES, STARTS, steps=400, uniform_share=0.7)
    return AcrobotPractice(sparse, ACTION_REPEAT, 0.004, starts=starts, start_share=0.55)
