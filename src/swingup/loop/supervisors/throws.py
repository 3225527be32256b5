"""Throws: at times a PID takes both joints from the controller and drives them to a random configuration.

Source: the rules of the global-policy benchmark (ICRA 2025). They include the PID's quirks: its error is not
wrapped, its error sum and its last error continue from throw to throw, and its period is not the loop's.
"""

import functools
from dataclasses import replace
from typing import Annotated

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...common.types import Count, Scalar, State, Torque
from ...dynamics.dynamics import gravity_torque
from ...dynamics.integrate import rk4_steps, stable_substeps
from ...plant.plant import Plant
from ...plant.units import DAMPING, STATE, TORQUE, TORQUE_RATE, scales_of, similar_plant
from ..loop import LOOP_DT
from .supervisor import AbstractSupervisor, Intervention, no_intervention

WITHOUT_DERIVATIVE = 2
"""First calls of the run in which the PID takes its derivative for 0."""

TURNS = ((0.1, 0.4, 0.4, 0.1), (0.1, 0.8, 0.1))
"""Chosen: probabilities of q1 = -3π, -π, π or 3π and of q2 = -2π, 0 or 2π upright before a throw."""


class Thrower(eqx.Module):
    """Gains of the PID that throws."""

    kp: Annotated[float | Scalar, TORQUE] = 10.0
    """N m/rad"""
    ki: Annotated[float | Scalar, TORQUE_RATE] = 0.1
    """N m/(rad s)"""
    kd: Annotated[float | Scalar, DAMPING] = 1.0
    """N m s/rad"""
    dt: float | Scalar = 0.001
    """The PID's period in its own formula (s); it is called every 0.002 s. It is real time for every pendulum."""
    limit: Annotated[float | Scalar, TORQUE] = 6.0
    """Torque limit of the PID, and of each of the two motors (N m)."""
    proportional_limit: Annotated[float | Scalar | None, TORQUE] = None
    """Limit of its proportional part alone (N m); None for none."""


THROWER = Thrower()
"""The benchmark's."""


class PID(eqx.Module):
    """The PID's memory between calls."""

    calls: Count
    total: Float[Array, "2"]
    """Sum of the errors so far (rad)."""
    last: Float[Array, "2"]
    """Error of the last call (rad)."""


def start_pid(dtype: jnp.dtype) -> PID:
    """A PID before its first call."""
    return PID(jnp.zeros((), int), jnp.zeros(2, dtype), jnp.zeros(2, dtype))


class Throws(AbstractSupervisor[tuple[PID, Count]]):
    """When the pendulum is thrown, where to, and the PID that does it."""

    number: Int[Array | np.ndarray, "steps"]
    """Number of the throw at each step, -1 between throws."""
    target: Float[Array | np.ndarray, "throws 2"]
    """Angles that each throw aims at (rad)."""
    thrower: Thrower
    model: Plant
    """The model with which the PID compensates gravity."""

    def start(self, dtype: jnp.dtype) -> tuple[PID, Count]:
        """The PID and the number of the first step."""
        return start_pid(dtype), jnp.zeros((), int)

    def __call__(self, memory: tuple[PID, Count], t: Scalar, x: State) -> tuple[tuple[PID, Count], Intervention]:
        """The PID drives both joints during a throw."""
        before, step = memory
        # By the step and not by the time: the benchmark's clock is a sum, whose rounding the plan contains.
        number = jnp.asarray(self.number)[step]
        thrown, none = number >= 0, no_intervention(x.dtype)
        pid, torque = throwing_torque(self.thrower, self.model, before, jnp.asarray(self.target)[number], x)
        # Between throws the PID rests: its error sum runs on from throw to throw.
        pid = jax.tree.map(lambda new, old: jnp.where(thrown, new, old), pid, before)
        return (pid, step + 1), replace(none, takes=thrown, torque=torque)


def throwing_torque(
    thrower: Thrower, parameters: Plant, pid: PID, target: Float[Array, "2"], x: State
) -> tuple[PID, Torque]:
    """One call of the PID towards a target (rad): its torque, minus the gravity torque of a model (N m)."""
    error = target - x[:2]
    total = pid.total + error
    derivative = jnp.where(pid.calls < WITHOUT_DERIVATIVE, 0.0, (error - pid.last) / thrower.dt)
    proportional = thrower.kp * error
    if thrower.proportional_limit is not None:
        proportional = jnp.clip(proportional, -thrower.proportional_limit, thrower.proportional_limit)
    u = proportional + thrower.ki * thrower.dt * total + thrower.kd * derivative
    # Clipped before the gravity torque; the motors clip the sum once more (benchmark).
    command = jnp.clip(u, -thrower.limit, thrower.limit) - gravity_torque(parameters, x)
    return PID(pid.calls + 1, total, error), command


def thrown_states(
    random: np.random.Generator, plant: Plant, number: int, thrower: Thrower = THROWER, duration: float = 0.2
) -> Float[np.ndarray, "number 4"]:
    """States after throws of an upright pendulum, from which a controller has to recover; in the plant's own units.

    It is the similar pendulum that is thrown: the periods of the PID and of the loop scale here, too. A throw lasts
    for ``duration`` (s), in the time of design C.1.
    """
    scales = scales_of(plant)
    similar = similar_plant(plant, scales)
    turns = [random.choice(len(odds), number, p=odds) - len(odds) // 2 for odds in TURNS]
    # Full turns matter: the PID's error is not wrapped.
    upright = np.stack([np.pi * (2 * turns[0] + 1), 2 * np.pi * turns[1]], axis=1)
    x0 = np.concatenate([upright, np.zeros((number, 2))], axis=1) + 0.05 * random.normal(size=(number, 4))
    # Any last error: the throw before it aimed elsewhere, so that the first derivative saturates.
    targets, last = random.uniform(-np.pi, np.pi, (number, 2)), random.uniform(-6.0, 6.0, (number, 2))
    starts = jnp.asarray(targets), jnp.asarray(last), jnp.asarray(x0)
    steps = round(duration / LOOP_DT)
    thrown = np.asarray(_thrown(thrower, similar, *starts, steps, stable_substeps(similar, LOOP_DT)))
    return np.asarray(scales.scaled(thrown, *STATE))


def anywhere_states(random: np.random.Generator, number: int, speed: float) -> Float[np.ndarray, "number 4"]:
    """States in any configuration; the velocities' deviation is of all sizes up to ``speed`` (rad/s).

    Slow motions would be rare among normally distributed velocities.
    """
    rates = random.uniform(0, speed, (number, 1)) * random.normal(size=(number, 2))
    return np.concatenate([random.uniform(-np.pi, np.pi, (number, 2)), rates], axis=1)


@functools.partial(jax.jit, static_argnums=(5, 6))
@functools.partial(jax.vmap, in_axes=(None, None, 0, 0, 0, None, None))
def _thrown(
    thrower: Thrower,
    plant: Plant,
    target: Float[Array, "2"],
    last: Float[Array, "2"],
    x: State,
    steps: int,
    substeps: int,
) -> State:
    """State after one throw by a PID whose throw before ended with the error ``last``."""

    def step(carry: tuple[State, PID], _: None) -> tuple[tuple[State, PID], None]:
        x, pid = carry
        pid, u = throwing_torque(thrower, plant, pid, target, x)
        return (rk4_steps(plant, x, jnp.clip(u, -thrower.limit, thrower.limit), LOOP_DT, substeps), pid), None

    # Past the first two calls of the run, as in all throws but the first.
    pid = PID(jnp.array(WITHOUT_DERIVATIVE), jnp.zeros_like(last), last)
    (x, _), _ = jax.lax.scan(step, (x, pid), length=steps)
    return x
