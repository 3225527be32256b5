"""The closed loop of the benchmark, one step in its exact order: measure, control, drive, integrate.

Two loops run the same steps: :func:`simulate` compiles a whole simulation with a controller in JAX, and
:mod:`.host` calls a controller in plain Python between two compiled half steps.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..control.controller import AbstractController
from ..physics.integrate import rk4_step
from ..physics.parameters import Parameters
from ..tasks.disturbance import Disturbance, Past, drive, measure, remember, step_noise
from ..tasks.throws import PID, Throws, is_thrown, start_pid, throw
from ..types import Count, Flag, State, Torque

Rows = Array | np.ndarray


class Trajectory(eqx.Module):
    """States before each step and the torques applied at it, row by row."""

    time: Float[Rows, "rows"]
    """s"""
    x: Float[Rows, "rows 4"]
    """[q1, q2, dq1, dq2] (rad, rad/s)"""
    u: Float[Rows, "rows 2"]
    """[u1, u2] (N m) that acted: after the torque limits, with pushes if there were any"""


class Scenario(eqx.Module):
    """What one simulation runs on; batch it with ``vmap``."""

    parameters: Parameters
    """The plant, whatever model the controller has. A torque limit of 0 makes a joint passive."""
    disturbance: Disturbance | None = None
    """None is a perfect world, and faster than a disturbance that changes nothing."""
    throws: Throws | None = None
    """When something else than the controller has the pendulum."""


class Plant(eqx.Module):
    """Where a simulation stands between two steps."""

    x: State
    u: Torque
    """The torques that acted in the step before (N m)."""
    motors: Torque
    """What the motors start from (N m)."""
    past: Past
    pid: PID
    torque_noise: Torque
    """What the step that was sensed last adds to its torques (N m): drawn with the measurement's noise, once."""


class Outcome(eqx.Module):
    """How one simulation ended."""

    final: Float[Rows, "4"]
    """The state after the last step."""
    fault: Int[Rows, ""]
    """First step in which the controller answered a finite measurement with a torque that is not finite, or -1."""


def begin(x0: State, depth: int = 1) -> Plant:
    """A plant before its first step, with room for delays below ``depth`` steps."""
    rest = jnp.zeros(2, x0.dtype)
    return Plant(x0, rest, rest, jnp.tile(x0, (depth, 1)), start_pid(x0.dtype), rest)


def sense(scenario: Scenario, plant: Plant, step: Count) -> tuple[Plant, State, Flag]:
    """First half of a step: what the controller would see, and whether it is called at all."""
    called = jnp.array(True) if scenario.throws is None else ~is_thrown(scenario.throws, step)
    if scenario.disturbance is None:
        return plant, plant.x, called
    past = remember(plant.past, step, plant.x)
    noise, torque_noise = step_noise(scenario.disturbance, step, plant.x.dtype)
    seen = measure(scenario.disturbance, past, step, noise)
    return replace(plant, past=past, torque_noise=torque_noise), seen, called


def act(scenario: Scenario, plant: Plant, step: Count, command: Torque, dt: float) -> Plant:
    """Second half of a step: the motor, the pushes, and the plant for dt (s) with its torque held."""
    p, pid, motors = scenario.parameters, plant.pid, plant.motors
    limits = jnp.array([p.tl1, p.tl2], plant.x.dtype)
    if scenario.throws is not None:
        thrown = is_thrown(scenario.throws, step)
        thrower, torque = throw(scenario.throws, p, pid, step, plant.x)
        command = jnp.where(thrown, torque, command)
        pid = jax.tree.map(lambda new, old: jnp.where(thrown, new, old), thrower, pid)
    if scenario.disturbance is None:
        u = jnp.clip(command, -limits, limits)
    else:
        time = step.astype(plant.x.dtype) * dt
        noise = plant.torque_noise
        u, motors = drive(scenario.disturbance, command, motors, time, noise, limits, plant.x[:2], dt)
    return replace(plant, x=rk4_step(p, plant.x, u, dt), u=u, motors=motors, pid=pid)


def simulate(
    scenario: Scenario,
    controller: AbstractController[Any],
    x0: State,
    dt: float,
    steps: int,
    depth: int = 1,
    guard: Callable[[State], State] = lambda x: x,
) -> tuple[Outcome, Trajectory]:
    """Run a controller for ``steps`` steps of dt (s) from x0, RK4 with the torque held over each step.

    Args:
        scenario: the plant and what disturbs it.
        controller: called at every step, unless something else has the pendulum.
        x0: first state.
        dt: time of a step (s).
        steps: number of steps.
        depth: states that are remembered: more than the largest delay (steps).
        guard: what the state goes through before each step; it may change gradients, not values.
    """
    Carry = tuple[Plant, Any, Count]

    def step(carry: Carry, index: Count) -> tuple[Carry, Trajectory]:
        before, memory, fault = carry
        time = index.astype(x0.dtype) * dt
        before = eqx.tree_at(lambda plant: plant.x, before, replace_fn=guard)
        plant, seen, called = sense(scenario, before, index)
        after_call, command = controller(memory, time, seen)
        if scenario.throws is None:
            memory = after_call
        else:
            memory = jax.tree.map(lambda new, old: jnp.where(called, new, old), after_call, memory)
        failed = called & jnp.isfinite(seen).all() & ~jnp.isfinite(command).all()
        fault = jnp.where((fault < 0) & failed, index, fault)
        after = act(scenario, plant, index, command, dt)
        return (after, memory, fault), Trajectory(time=time, x=before.x, u=after.u)

    start = (begin(x0, depth), controller.init(), jnp.array(-1))
    (plant, _, fault), trajectory = jax.lax.scan(step, start, jnp.arange(steps))
    return Outcome(plant.x, fault), trajectory
