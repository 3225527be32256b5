"""The real robot's task: friction, motors with limits, old and noisy measurements, and no two plants alike."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..physics.integrate import rk4_step
from ..physics.parameters import Parameters
from ..policy.jax_backend.front_end import FrontEnd, FrontEndMemory
from ..types import Action, Count, Flag, Key, Observation, State, Torque
from .disturbance import Disturbance, Past, drive, measure, remember
from .domain import DT, Domain
from .pendulum import DIVERGED, PendulumState, PendulumTask
from .task import Step

CALLS = 5
"""Steps of the loop in an action: the policy acts at 100 Hz."""


class Sim2RealState(PendulumState):
    """State of the task: plant, loop, and what the controller remembers."""

    plant: Parameters
    disturbance: Disturbance
    u: Torque
    """The torques that act (N m)."""
    motors: Torque
    """The motors' own (N m), without ripple, noise and push."""
    past: Past
    """The last states, for the delay."""
    memory: FrontEndMemory
    calls: Count
    """Steps of the loop since the last reset."""


class Sim2RealTask(PendulumTask):
    """Swing up and stay there on a plant that every episode draws from a domain, through the front end.

    The loop runs at 500 Hz as on the robot, the policy acts at the task's rate: the front end sees every
    measurement, and its friction compensation acts at every step. First states, reward and ends are the paper's.
    """

    domain: Domain = eqx.field(kw_only=True, static=True)
    """What plants and loops are drawn from."""
    front_end: FrontEnd = eqx.field(kw_only=True)
    """What stands between measurement, policy and motors."""
    estimated: bool = eqx.field(kw_only=True, static=True, default=False)
    """A state estimator goes before the front end, and is taken to be right: neither delay nor noise is seen."""

    @property
    def unseen(self) -> list[str]:
        """What the domain does to measurements, and training behind an estimator leaves out."""
        highs = {name: high for name, _, high in self.domain.ranges}
        return [name for name in ("delay", "velocity_noise") if self.estimated and highs.get(name, 0.0) > 0]

    def reset(self, key: Key) -> Sim2RealState:
        """Hang down, disturbed by noise, on a plant and in a loop drawn from the domain."""
        start_key, domain_key, noise_key = jax.random.split(key, 3)
        start = super().reset(start_key)
        plant, disturbance = self.domain.draw(domain_key, self.robot)
        past = jnp.tile(start.x, (self.domain.depth, 1))
        seen = self._seen(disturbance, past, jnp.array(0), jax.random.normal(noise_key, (2,)), start.x)
        memory = self.front_end.begin(seen)
        rest = jnp.zeros(2)
        return Sim2RealState(start.x, start.steps, plant, disturbance, rest, rest, past, memory, calls=jnp.array(0))

    def _seen(self, disturbance: Disturbance, past: Past, call: Count, noise: Float[Array, "2"], x: State) -> State:
        """What the front end is given at a call, for noise of deviation 1 and the present state."""
        return x if self.estimated else measure(disturbance, past, call, disturbance.velocity_noise * noise)

    def observe(self, state: PendulumState) -> Observation:
        """What the front end shows, scaled."""
        assert isinstance(state, Sim2RealState)
        return self.observation(state.memory.seen)

    def step(self, state: PendulumState, action: Action, key: Key) -> Step[PendulumState]:
        """Hold the policy's torque for dt: steps of the loop at 500 Hz, each with a measurement and its noise.

        Should the integrator diverge, the last good state is kept and truncated.
        """
        assert isinstance(state, Sim2RealState)
        noise_key, end_key = jax.random.split(key)
        noises = jax.random.normal(noise_key, (CALLS, 4), action.dtype)
        limits = jnp.array([state.plant.tl1, state.plant.tl2])
        asked = self.torque(action)

        def loop(now: Sim2RealState, noise: Float[Array, "4"]) -> tuple[Sim2RealState, Flag]:
            command = self.front_end.command(now.memory, jnp.sum(asked), self.robot)
            time = now.calls * DT
            torque_noise = now.disturbance.torque_noise * noise[2:]
            u, motors = drive(now.disturbance, command, now.motors, time, torque_noise, limits, now.x[:2], DT)
            x = rk4_step(now.plant, now.x, u, DT)
            diverged = ~jnp.all(jnp.abs(x[2:]) < DIVERGED)
            x = jnp.where(diverged, now.x, x)
            call = now.calls + 1
            past = remember(now.past, call, x)
            memory = self.front_end.measure(now.memory, self._seen(now.disturbance, past, call, noise[:2], x))
            after = Sim2RealState(x, now.steps, now.plant, now.disturbance, u, motors, past, memory, call)
            return after, diverged

        after, diverged = jax.lax.scan(loop, state, noises, unroll=True)
        after = eqx.tree_at(lambda s: s.steps, after, state.steps + 1)
        at_random = jax.random.bernoulli(end_key, self.truncation_probability)
        return Step(
            state=after,
            observation=self.observe(after),
            reward=self.reward(after.x, asked),
            terminated=jnp.array(False),
            truncated=at_random | jnp.any(diverged) | (after.steps >= self.max_steps),
        )
