"""The task on the simulated robot: friction, limited motors, late and noisy measurements."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..physics.integrate import rk4_steps
from ..physics.parameters import Parameters
from ..plants.domain import Domain
from ..plants.loop import LOOP_DT
from ..policy.jax_backend.front_end import FrontEnd, FrontEndMemory
from ..types import Action, Count, Flag, Key, Observation, Scalar, State, Torque
from .clock import Times, start_times
from .disturbance import Disturbance, Past, measured_state, motor_torques, remember, step_period
from .draw import draw
from .pendulum import DIVERGED, AbstractPendulumTask
from .task import Step

CALLS = 5
"""Steps of the loop in an action, for design C.1: the policy acts at 100 Hz."""


class Sim2RealState(eqx.Module):
    """State of the task: pendulum, plant, loop, and the front end's memory."""

    x: State
    """State of the pendulum, angles unwrapped (rad, rad/s)."""
    steps: Count
    """Steps since the last reset."""
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
    times: Times | None = None
    """The loop's own clock; None where every step takes the same time and nothing is measured by it."""


class Sim2RealTask(AbstractPendulumTask[Sim2RealState]):
    """Swing up and stay there on a plant that every episode draws from a domain, through the front end.

    The loop runs at 500 Hz as on the robot, the policy acts at the task's rate: the front end receives every
    measurement, and its friction compensation acts at every step. First states, reward and ends are the paper's.
    """

    domain: Domain = eqx.field(kw_only=True, static=True)
    """Ranges of plant and loop."""
    front_end: FrontEnd = eqx.field(kw_only=True)
    """Filter, dead-band and friction compensation between measurement, policy and motors."""
    estimated: bool = eqx.field(kw_only=True, static=True, default=False)
    """A state estimator precedes the front end. Training shows the true state, without delay and noise."""
    calls: int = eqx.field(kw_only=True, static=True, default=CALLS)
    """Steps of the loop in an action."""

    @property
    def unseen(self) -> list[str]:
        """Disturbances of the domain's measurements that training behind an estimator leaves out."""
        highs = {name: high for name, _, high in self.domain.ranges}
        names = ("delay", "velocity_noise", "quantum1", "quantum2")
        return [name for name in names if self.estimated and highs.get(name, 0.0) > 0]

    def reset(self, key: Key) -> Sim2RealState:
        """Hang down, disturbed by noise, on a plant and in a loop drawn from the domain."""
        start_key, domain_key, noise_key = jax.random.split(key, 3)
        x = self.hanging_start(start_key)
        plant, disturbance = draw(self.domain, domain_key, self.robot)
        depth = self.domain.depth
        past, zero, rest = jnp.tile(x, (depth, 1)), jnp.array(0), jnp.zeros(2)
        times = start_times(depth, LOOP_DT, x.dtype).remember(zero) if disturbance.is_timed else None
        noise = jax.random.normal(noise_key, (2,))
        memory = self.front_end.begin(self._measured(disturbance, past, times, zero, noise, x))
        return Sim2RealState(x, zero, plant, disturbance, rest, rest, past, memory, zero, times)

    def _measured(
        self,
        disturbance: Disturbance,
        past: Past,
        times: Times | None,
        call: Count,
        noise: Float[Array, "2"],
        x: State,
    ) -> State:
        """Input of the front end at a call, for noise of deviation 1 and the present state x."""
        if not self.estimated:
            return measured_state(disturbance, past, call, disturbance.velocity_noise * noise, times)
        # An estimator makes up for delay, noise and quantum, but cannot know where an angle's zero is.
        return x if disturbance.sensor is None else x.at[:2].add(jnp.asarray(disturbance.sensor.offset))

    def observe(self, state: Sim2RealState) -> Observation:
        """Output of the front end, scaled."""
        return self.observation(state.memory.seen)

    def reward(self, x: State, u: Torque) -> Scalar:
        """The paper's, of the state after the step and the policy's torque (N m)."""
        return self.quadratic_reward(x, u)

    def step(self, state: Sim2RealState, action: Action, key: Key) -> Step[Sim2RealState]:
        """Hold the policy's torque for dt: steps of the loop at 500 Hz, each with a measurement and its noise.

        If the integrator diverges, the last good state is kept and the episode truncated.
        """
        noise_key, end_key = jax.random.split(key)
        noises = jax.random.normal(noise_key, (self.calls, 4), action.dtype)
        limits = jnp.array([state.plant.tl1, state.plant.tl2])
        wanted = self.torque(action)

        def loop(now: Sim2RealState, noise: Float[Array, "4"]) -> tuple[Sim2RealState, Flag]:
            # One joint is driven: the sum is its torque, whichever it is.
            command = self.front_end.command(now.memory, jnp.sum(wanted), self.robot)
            disturbance, times = now.disturbance, now.times
            time = now.calls * LOOP_DT if times is None else times.now
            period = step_period(disturbance, now.calls, LOOP_DT, now.x.dtype)
            torque_noise = disturbance.torque_noise * noise[2:]
            u, motors = motor_torques(
                disturbance, command, now.motors, time, torque_noise, limits, now.x[:2], period
            )
            x = rk4_steps(now.plant, now.x, u, period, self.domain.substeps)
            # Negated, so that NaN counts as diverged.
            diverged = ~jnp.all(jnp.abs(x[2:]) < DIVERGED)
            x = jnp.where(diverged, now.x, x)
            # The measurement of the new state, which the next command uses, as in the judge's loop.
            call = now.calls + 1
            past, times = remember(now.past, call, x), times and times.after(period).remember(call)
            measured = self._measured(disturbance, past, times, call, noise[:2], x)
            memory = self.front_end.measure(now.memory, measured)
            after = Sim2RealState(x, now.steps, now.plant, disturbance, u, motors, past, memory, call, times)
            return after, diverged

        after, diverged = jax.lax.scan(loop, state, noises, unroll=True)
        after = eqx.tree_at(lambda s: s.steps, after, state.steps + 1)
        at_random = jax.random.bernoulli(end_key, self.truncation_probability)
        return Step(
            state=after,
            observation=self.observe(after),
            reward=self.reward(after.x, wanted),
            terminated=jnp.array(False),
            # Any step of the loop: later ones start from the state that was kept, and look sound.
            truncated=at_random | jnp.any(diverged) | (after.steps >= self.max_steps),
        )
