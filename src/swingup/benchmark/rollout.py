"""The closed loop of the benchmark, one step in its exact order: measure, control, clip, integrate."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..control.controller import AbstractController
from ..physics.integrate import rk4_step
from ..physics.parameters import Parameters
from ..types import Count, State

Rows = Array | np.ndarray


class Trajectory(eqx.Module):
    """States before each step and the torques applied at it, row by row."""

    time: Float[Rows, "rows"]
    """s"""
    x: Float[Rows, "rows 4"]
    """[q1, q2, dq1, dq2] (rad, rad/s)"""
    u: Float[Rows, "rows 2"]
    """[u1, u2] (N m), after the torque limits"""


def simulate(
    parameters: Parameters, controller: AbstractController[Any], x0: State, dt: float, steps: int
) -> Trajectory:
    """Run a controller for ``steps`` steps of dt (s) from x0, RK4 with the torque held over each step.

    Both torques are clipped to the parameters' limits: a limit of 0 makes a joint passive.
    """
    limits = jnp.array([parameters.tl1, parameters.tl2], x0.dtype)

    def step(carry: tuple[State, Any], index: Count) -> tuple[tuple[State, Any], Trajectory]:
        x, memory = carry
        time = index.astype(x.dtype) * dt
        memory, command = controller(memory, time, x)
        u = jnp.clip(command, -limits, limits)
        return (rk4_step(parameters, x, u, dt), memory), Trajectory(time=time, x=x, u=u)

    _, trajectory = jax.lax.scan(step, (x0, controller.init()), jnp.arange(steps))
    return trajectory
