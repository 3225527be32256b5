"""Iterative LQR: improve the torques of a trajectory until nothing more is to be gained.

A backward pass, with μ added to Q_uu, proposes a policy, and a forward pass tries it; μ falls when the cost did
and rises when it did not. The dynamics' second derivatives are left out. What it finds is a local optimum near its
first torques. Limits on torques are kept by clipping, without planning for them; there are none on states. Source:
Tassa, Erez and Todorov, "Synthesis and stabilization of complex behaviors through online trajectory optimization",
IROS 2012.
"""

import dataclasses
import enum

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..types import Count, Flag, Scalar
from .riccati_passes import Cost, Policy, Rollout, backward, forward
from .scalar_algebra import unpack
from .transition import AbstractTransition


class Status(enum.IntEnum):
    """How an optimisation ended."""

    RUNNING = 0
    """It has not."""
    CONVERGED = 1
    """The backward pass expects less than the tolerance: use the result."""
    STALLED = 2
    """Nothing improves at the largest regularisation: at an optimum to rounding, or the derivatives are wrong."""
    ITERATION_LIMIT = 3
    """The cost may still fall: allow more iterations."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """How to iterate."""

    max_iterations: int
    tolerance: float
    """Stop when the backward pass expects the cost to fall by less than this."""
    regularisation: float
    """μ at the start."""
    min_regularisation: float
    max_regularisation: float
    torque_limit: float
    """N m"""
    decrease: float = 0.7
    """μ is multiplied by this after an improvement."""
    increase: float = 2.0
    """And by this otherwise."""
    step_sizes: tuple[float, ...] = (1.0,)
    """Factors of k that a line search tries, all at once, to keep the cheapest; (1.0,) is none."""


class Solution(eqx.Module):
    """What an optimisation found, and how it ended."""

    states: Float[Array, "n+1 4"]
    torque: Float[Array, "n"]
    cost: Scalar
    iterations: Count
    regularisation: Scalar
    """μ after the last iteration."""
    status: Count
    """A :class:`Status`."""


class Iterate(eqx.Module):
    """Between two iterations."""

    rollout: Rollout
    """The best so far."""
    regularisation: Scalar
    iteration: Count
    status: Count


def solve(
    transition: AbstractTransition,
    cost: Cost,
    x0: Float[Array, "4"],
    torque: Float[Array, "n"],
    settings: Settings,
    idle: Flag | bool = False,
) -> Solution:
    """Optimise the torques from a first guess; where ``idle``, do not iterate."""
    last = jax.lax.while_loop(
        lambda now: now.status == Status.RUNNING,
        lambda now: improve(transition, cost, now, settings),
        start(transition, cost, x0, torque, settings, idle),
    )
    return Solution(
        states=jnp.concatenate([jnp.stack(last.rollout.x, -1), jnp.stack(last.rollout.last)[None]]),
        torque=last.rollout.u,
        cost=last.rollout.cost,
        iterations=last.iteration,
        regularisation=last.regularisation,
        status=last.status,
    )


def start(
    transition: AbstractTransition,
    cost: Cost,
    x0: Float[Array, "4"],
    torque: Float[Array, "n"],
    settings: Settings,
    idle: Flag | bool = False,
) -> Iterate:
    """The first guess, rolled out."""
    return Iterate(
        rollout=forward(transition, cost, unpack(x0), torque, settings.torque_limit),
        regularisation=jnp.full_like(x0[0], settings.regularisation),
        iteration=jnp.zeros((), jnp.int32),
        status=jnp.where(idle, Status.ITERATION_LIMIT, Status.RUNNING).astype(jnp.int32),
    )


def improve(transition: AbstractTransition, cost: Cost, now: Iterate, settings: Settings) -> Iterate:
    """One iteration: backward, forward, accept or not, adapt μ, decide whether to go on."""
    policy, expected = backward(cost, now.rollout, now.regularisation)
    tried = _search(transition, cost, now.rollout, policy, settings)
    improved = tried.cost < now.rollout.cost
    regularisation = now.regularisation * jnp.where(improved, settings.decrease, settings.increase)
    stalled = ~improved & (now.regularisation >= settings.max_regularisation)
    iteration = now.iteration + 1
    status = jnp.where(iteration >= settings.max_iterations, Status.ITERATION_LIMIT, Status.RUNNING)
    status = jnp.where(expected < settings.tolerance, Status.CONVERGED, status)
    status = jnp.where(stalled, Status.STALLED, status)
    return Iterate(
        rollout=jax.tree.map(lambda new, old: jnp.where(improved, new, old), tried, now.rollout),
        regularisation=jnp.clip(regularisation, settings.min_regularisation, settings.max_regularisation),
        iteration=iteration,
        status=status.astype(jnp.int32),
    )


def feedback_gains(
    transition: AbstractTransition, cost: Cost, solution: Solution, regularisation: float
) -> Float[Array, "n 4"]:
    """K of a backward pass about a solution: LQ-optimal without regularisation, weaker with it."""
    x, u = unpack(solution.states[:-1]), solution.torque
    rollout = Rollout(x, u, transition.jacobian(x, u), tuple(solution.states[-1]), solution.cost)
    return jnp.stack(backward(cost, rollout, regularisation)[0].gains, -1)


def _search(
    transition: AbstractTransition, cost: Cost, now: Rollout, policy: Policy, settings: Settings
) -> Rollout:
    first = tuple(rows[0] for rows in now.x)

    def attempt(size: Scalar | float) -> Rollout:
        torque = now.u + size * policy.step
        return forward(transition, cost, first, torque, settings.torque_limit, (now.x, policy.gains))

    if len(settings.step_sizes) == 1:
        return attempt(settings.step_sizes[0])
    attempts = jax.vmap(attempt)(jnp.array(settings.step_sizes, now.u.dtype))
    cheapest = jnp.nanargmin(attempts.cost)
    return jax.tree.map(lambda rows: rows[cheapest], attempts)
