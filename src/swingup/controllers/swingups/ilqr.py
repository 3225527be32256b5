"""Iterative LQR: the torques of a trajectory, improved until the cost falls no further.

A backward pass, with μ added to Q_uu, proposes a feedback policy, and a forward pass tries it. μ falls after an
improvement and rises otherwise. The dynamics' second derivatives are left out. The result is a local optimum near
the first torques. Torques are clipped to their limit, which the planning ignores; states have no limits.

Source: Tassa, Erez and Todorov, "Synthesis and stabilization of complex behaviors through online trajectory
optimization", IROS 2012.
"""

import dataclasses
import enum
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.types import Count, Flag, Scalar
from .riccati_passes import Cost, CostedTrajectory, FeedbackPolicy, backward, forward
from .scalar_algebra import unpack
from .transition import AbstractTransition


class Status(enum.IntEnum):
    """How an optimisation ended, as a value of its result."""

    RUNNING = 0
    """It has not ended."""
    CONVERGED = 1
    """The backward pass expects less than the tolerance: use the result."""
    STALLED = 2
    """Nothing improves at the largest regularisation: at an optimum to rounding, or the derivatives are wrong."""
    ITERATION_LIMIT = 3
    """The cost may still fall: allow more iterations."""


@dataclasses.dataclass(frozen=True)
class ILQRSettings:
    """The iteration's limits, and how it adapts the regularisation."""

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
    """μ is multiplied by this after an iteration without improvement."""
    step_sizes: tuple[float, ...] = (1.0,)
    """Factors of the feedforward that a line search tries side by side; (1.0,) searches nothing."""


class Solution(eqx.Module):
    """The trajectory that an optimisation found, and how it ended."""

    states: Float[Array, "n+1 4"]
    torque: Float[Array, "n"]
    cost: Scalar
    iterations: Count
    regularisation: Scalar
    """μ after the last iteration."""
    status: Count
    """A :class:`Status`."""


class ILQRState(eqx.Module):
    """An optimisation between two iterations."""

    trajectory: CostedTrajectory
    """The best trajectory so far."""
    regularisation: Scalar
    iteration: Count
    status: Count


def solve(
    transition: AbstractTransition,
    cost: Cost,
    x0: Float[Array, "4"],
    torque: Float[Array, "n"],
    settings: ILQRSettings,
    idle: Flag | bool = False,
) -> Solution:
    """Optimise the torques from a first guess; where ``idle``, return the guess."""
    last = jax.lax.while_loop(
        lambda now: now.status == Status.RUNNING,
        lambda now: ilqr_iteration(transition, cost, now, settings),
        initial_state(transition, cost, x0, torque, settings, idle),
    )
    return Solution(
        states=jnp.concatenate([jnp.stack(last.trajectory.x, -1), jnp.stack(last.trajectory.last)[None]]),
        torque=last.trajectory.u,
        cost=last.trajectory.cost,
        iterations=last.iteration,
        regularisation=last.regularisation,
        status=last.status,
    )


def initial_state(
    transition: AbstractTransition,
    cost: Cost,
    x0: Float[Array, "4"],
    torque: Float[Array, "n"],
    settings: ILQRSettings,
    idle: Flag | bool = False,
) -> ILQRState:
    """The first guess, rolled out."""
    return ILQRState(
        trajectory=forward(transition, cost, unpack(x0), torque, settings.torque_limit),
        # In the state's precision: a loop's carry keeps its types.
        regularisation=jnp.full_like(x0[0], settings.regularisation),
        iteration=jnp.zeros((), jnp.int32),
        # An idle optimisation ends before its first iteration.
        status=jnp.where(idle, Status.ITERATION_LIMIT, Status.RUNNING).astype(jnp.int32),
    )


def ilqr_iteration(transition: AbstractTransition, cost: Cost, now: ILQRState, settings: ILQRSettings) -> ILQRState:
    """One iteration: backward pass, forward pass, acceptance, new μ, and whether to go on."""
    policy, expected = backward(transition, cost, now.trajectory, now.regularisation)
    tried = _search(transition, cost, now.trajectory, policy, settings)
    # A trial that diverges has a cost of NaN, and does not improve.
    improved = tried.cost < now.trajectory.cost
    regularisation = now.regularisation * jnp.where(improved, settings.decrease, settings.increase)
    stalled = ~improved & (now.regularisation >= settings.max_regularisation)
    iteration = now.iteration + 1
    # Later lines win: what converges or stalls in the last iteration is said to.
    status = jnp.where(iteration >= settings.max_iterations, Status.ITERATION_LIMIT, Status.RUNNING)
    status = jnp.where(expected < settings.tolerance, Status.CONVERGED, status)
    status = jnp.where(stalled, Status.STALLED, status)
    return ILQRState(
        trajectory=jax.tree.map(lambda new, old: jnp.where(improved, new, old), tried, now.trajectory),
        regularisation=jnp.clip(regularisation, settings.min_regularisation, settings.max_regularisation),
        iteration=iteration,
        status=status.astype(jnp.int32),
    )


def feedback_gains(
    transition: AbstractTransition,
    cost: Cost,
    states: Float[Any, "n+1 4"],
    torque: Float[Any, "n"],
    regularisation: float = 0.0,
) -> Float[Array, "n 4"]:
    """K of a backward pass about a trajectory: LQ-optimal without regularisation, weaker with it."""
    # The backward pass needs no cost.
    trajectory = CostedTrajectory(unpack(states[:-1]), torque, tuple(states[-1]), jnp.zeros(()))
    return jnp.stack(backward(transition, cost, trajectory, regularisation)[0].gains, -1)


def _search(
    transition: AbstractTransition,
    cost: Cost,
    now: CostedTrajectory,
    policy: FeedbackPolicy,
    settings: ILQRSettings,
) -> CostedTrajectory:
    first = tuple(rows[0] for rows in now.x)

    def attempt(size: Scalar | float) -> CostedTrajectory:
        torque = now.u + size * policy.feedforward
        return forward(transition, cost, first, torque, settings.torque_limit, (now.x, policy.gains))

    if len(settings.step_sizes) == 1:
        return attempt(settings.step_sizes[0])
    attempts = jax.vmap(attempt)(jnp.array(settings.step_sizes, now.u.dtype))
    # A step that diverges has a cost of NaN, and loses.
    cheapest = jnp.nanargmin(attempts.cost)
    return jax.tree.map(lambda rows: rows[cheapest], attempts)
