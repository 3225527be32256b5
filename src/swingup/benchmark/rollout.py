"""The closed loop of the benchmark, one step in its exact order: measure, control, apply the torque, integrate.

Two loops run the same steps: :func:`simulate` compiles a whole simulation with a controller in JAX, and
:mod:`.runner` calls a controller in plain Python between two compiled half steps.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..common.types import Count, Flag, Scalar, State, Torque
from ..controllers.check import CallTime
from ..controllers.interface import AbstractController
from ..dynamics.integrate import rk4_steps
from ..loop.disturbance import (
    Disturbance,
    Past,
    Times,
    loaded,
    measured_state,
    motor_side,
    motor_torques,
    remember,
    sample_gap,
    start_times,
    step_noise,
    step_period,
)
from ..loop.loop import LOOP_DT
from ..loop.supervisors import AbstractSupervisor, Intervention, no_intervention
from ..plant.plant import Plant

Rows: TypeAlias = Any  # An array of JAX, or one of NumPy when the run is over


class Record(eqx.Module):
    """What a robot writes down of a run, row by row."""

    x: Float[Rows, "rows 4"]
    """The measured states (rad, rad/s), less the encoders' zeros."""
    u: Float[Rows, "rows 2"]
    """The torques that were asked for (N m), within the motors' limits: the controller's, or the supervisor's."""
    over: Bool[Rows, "rows"]
    """The supervisor has stopped the run at this row or before."""
    alone: Bool[Rows, "rows"]
    """The controller alone drives: the supervisor does nothing."""


class Trajectory(eqx.Module):
    """States before each step and the torques applied at it, row by row."""

    time: Float[Rows, "rows"]
    """s"""
    x: Float[Rows, "rows 4"]
    """[q1, q2, dq1, dq2] (rad, rad/s)"""
    u: Float[Rows, "rows 2"]
    """[u1, u2] (N m) that acted: after the torque limits, with pushes if there were any"""
    record: Record | None = None
    """None where no supervisor stands beside the controller."""

    def take(self, rows: slice | np.ndarray) -> "Trajectory":
        """Some of the rows in NumPy, without the robot's record."""
        time, x, u = (np.asarray(part)[rows] for part in (self.time, self.x, self.u))
        return Trajectory(time, x, u)


class Scenario(eqx.Module):
    """What one simulation runs on; batch it with ``vmap``."""

    parameters: Plant
    """The plant, whatever model the controller has. A torque limit of 0 makes a joint passive."""
    disturbance: Disturbance | None = None
    """None is a perfect loop, and faster than a disturbance that changes nothing."""
    supervisor: AbstractSupervisor[Any] | None = None
    """What stands beside the controller: it stops the run, throws the pendulum or pushes it."""
    start: State | None = None
    """The first state; None is hanging at rest."""
    substeps: int = eqx.field(static=True, default=1)
    """Steps of RK4 in a step of the loop: ``stable_substeps`` of the plant. The boards' plants have 1."""


class LoopState(eqx.Module):
    """State of the closed loop, without the controller's, between two steps."""

    x: State
    u: Torque  # The torques that acted in the step before (N m)
    motors: Torque  # The motors' own torques, which their next ones start from (N m)
    past: Past
    torque_noise: Torque
    """Noise on the torques of the step measured last (N m), drawn together with the measurement's noise."""
    times: Times | None = None
    """The loop's own clock; None where every step takes the same time and nothing is measured by it."""
    supervision: tuple[Any, Intervention] | None = None
    """The supervisor's memory, and what it does in the step measured last."""


@dataclass
class SimulatedBatch:
    """Simulations side by side; NumPy arrays in float64."""

    final: np.ndarray  # States after the last step, shape (n, 4)
    faults: list[str | None]  # What was wrong with each controller's answers, if anything
    trajectory: Trajectory | None  # With a leading axis; None if it was not to be kept
    call_time: CallTime | None = None  # Of the first calls of a controller in plain Python


def initial_state(scenario: Scenario) -> State:
    """Where a simulation begins."""
    return jnp.zeros(4) if scenario.start is None else scenario.start


def initial_loop(scenario: Scenario, x0: State, depth: int = 1, dt: float = LOOP_DT) -> LoopState:
    """The loop before its first step, with room for delays below ``depth`` steps of dt (s).

    Velocities that are differences need room for one step more.
    """
    rest, disturbance, supervisor = jnp.zeros(2, x0.dtype), scenario.disturbance, scenario.supervisor
    timed = disturbance is not None and disturbance.is_timed
    shown = encoded(scenario.parameters, x0)
    times = start_times(depth, dt, x0.dtype) if timed else None
    supervision = None if supervisor is None else (supervisor.start(x0.dtype), no_intervention(x0.dtype))
    # A delay that reaches before the start measures the first state, as in the benchmark.
    return LoopState(x0, rest, rest, jnp.tile(shown, (depth, 1)), rest, times, supervision)


def encoded(plant: Plant, x: State) -> State:
    """The state as the encoders show it: from their zeros."""
    return x.at[:2].add(jnp.stack(plant.zeros).astype(x.dtype))


def decoded(plant: Plant, shown: State) -> State:
    """The measured state without the encoders' zeros, which the robot's own software subtracts."""
    return shown.at[:2].add(-jnp.stack(plant.zeros).astype(shown.dtype))


def loop_time(loop: LoopState, step: Count, dt: float) -> Scalar:
    """The time (s) of a step: by the loop's own clock, if it has one."""
    return step.astype(loop.x.dtype) * dt if loop.times is None else loop.times.now


def measure(scenario: Scenario, loop: LoopState, step: Count, dt: float = LOOP_DT) -> tuple[LoopState, State, Flag]:
    """First half of a step of dt (s): the measured state, and whether the controller is called at all."""
    called, now = jnp.array(True), loop_time(loop, step, dt)
    shown = measured = encoded(scenario.parameters, loop.x)
    if scenario.disturbance is not None:
        disturbance, held, broken = scenario.disturbance, jnp.array(0), None
        if disturbance.effects.windup:
            shown = motor_side(disturbance.loop, shown, loop.motors[1])
        past = remember(loop.past, step, shown)
        times = None if loop.times is None else loop.times.remember(step)
        noise, torque_noise = step_noise(disturbance, step, loop.x.dtype)
        if disturbance.effects.gaps:
            held, broken = sample_gap(disturbance, step, dt, loop.x.dtype)
            # A sample repeats with its noise.
            noise = step_noise(disturbance, step - held, loop.x.dtype)[0]
        shown = measured = measured_state(disturbance, past, step, noise, times, held)
        if broken is not None:  # what the controller sees, and the supervisor does not
            measured = measured_state(disturbance, past, step, noise + broken, times, held)
        loop = replace(loop, past=past, times=times, torque_noise=torque_noise)
    if scenario.supervisor is not None and loop.supervision is not None:
        supervision = scenario.supervisor(loop.supervision[0], now, decoded(scenario.parameters, shown))
        loop, called = replace(loop, supervision=supervision), ~supervision[1].takes
    return loop, measured, called


def asked(loop: LoopState, command: Torque) -> Torque:
    """The torques that are asked of the motors (N m): the controller's command, or the supervisor's."""
    if loop.supervision is None:
        return command
    done = loop.supervision[1]
    return jnp.where(done.takes, done.torque, command) + done.push


def record(scenario: Scenario, loop: LoopState, measured: State, command: Torque) -> Record | None:
    """A row of the robot's own record, for the loop after the first half of a step; None without a supervisor."""
    if loop.supervision is None:
        return None
    p, done = scenario.parameters, loop.supervision[1]
    limits = jnp.array([p.tl1, p.tl2], measured.dtype)
    torques, idle = jnp.clip(asked(loop, command), -limits, limits), ~(done.takes | jnp.any(done.push != 0))
    return Record(decoded(p, measured), torques, done.stops, idle)


def apply_torque(scenario: Scenario, loop: LoopState, step: Count, command: Torque, dt: float) -> LoopState:
    """Second half of a step: the motor, the pushes, and the plant for dt (s) with its torque held."""
    p, motors, command, disturbance = scenario.parameters, loop.motors, asked(loop, command), scenario.disturbance
    period: float | Scalar = dt
    limits = jnp.array([p.tl1, p.tl2], loop.x.dtype)
    if disturbance is None:
        u = acting = jnp.clip(command, -limits, limits)
    else:
        period = step_period(disturbance, step, dt, loop.x.dtype)
        time, noise = loop_time(loop, step, dt), loop.torque_noise
        u, motors = motor_torques(disturbance, command, motors, time, noise, limits, loop.x, period)
        acting = loaded(disturbance, u, loop.x)
    times = None if loop.times is None else loop.times.after(period)
    x = rk4_steps(p, loop.x, acting, period, scenario.substeps)
    return replace(loop, x=x, u=u, motors=motors, times=times)


def simulate(
    scenario: Scenario,
    controller: AbstractController[Any],
    x0: State,
    dt: float,
    steps: int,
    depth: int = 1,
    guard: Callable[[State], State] = lambda x: x,
) -> tuple[State, Count, Trajectory]:
    """Run a controller for ``steps`` steps of dt (s) from x0, RK4 with the torque held over each step.

    Returns the state after the last step; the first step in which the controller answered a finite measurement with
    a torque that is not finite, or -1; and all rows.

    It is called at every step but those of a throw. So many states are remembered as ``depth`` says: more than the
    largest delay (steps), and one more for velocities that are differences. The guard has the state before each
    step; it may change gradients, not values.
    """
    Carry = tuple[LoopState, Any, Count]

    def step(carry: Carry, index: Count) -> tuple[Carry, Trajectory]:
        before, memory, fault = carry
        time = loop_time(before, index, dt)
        before = eqx.tree_at(lambda loop: loop.x, before, replace_fn=guard)
        # The measurement comes before the control and the motor: the benchmark's order.
        loop, measured, called = measure(scenario, before, index, dt)
        after_call, command = controller(memory, time, measured)
        if scenario.supervisor is None:
            memory = after_call
        else:
            # The compiled loop computes the call during a throw, too. The memory must not advance then.
            memory = jax.tree.map(lambda new, old: jnp.where(called, new, old), after_call, memory)
        # A state that has diverged is not the controller's fault: only finite measurements count.
        failed = called & jnp.isfinite(measured).all() & ~jnp.isfinite(command).all()
        fault = jnp.where((fault < 0) & failed, index, fault)
        if scenario.disturbance is not None and scenario.disturbance.effects.gaps:
            # What is answered to a spoilt sample, and is not finite, moves no motor.
            command = jnp.where(jnp.isfinite(measured).all() | jnp.isfinite(command).all(), command, 0.0)
        after = apply_torque(scenario, loop, index, command, dt)
        rows = Trajectory(time=time, x=before.x, u=after.u, record=record(scenario, loop, measured, command))
        return (after, memory, fault), rows

    start = initial_loop(scenario, x0, depth, dt), controller.init(), jnp.array(-1)
    (loop, _, fault), trajectory = jax.lax.scan(step, start, jnp.arange(steps))
    return loop.x, fault, trajectory
