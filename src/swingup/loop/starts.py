"""States in which episodes begin."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.types import State
from ..dynamics.integrate import rk4_steps, stable_substeps
from ..plant.plant import Plant
from ..plant.units import STATE, scales_of, similar_plant
from .loop import LOOP_DT
from .supervisors import PID, THROWER, WITHOUT_DERIVATIVE, Thrower, throwing_torque

TURNS = ((0.1, 0.4, 0.4, 0.1), (0.1, 0.8, 0.1))
"""Chosen: probabilities of q1 = -3π, -π, π or 3π and of q2 = -2π, 0 or 2π upright before a throw."""


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
