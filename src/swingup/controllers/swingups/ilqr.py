"""Iterative LQR: the torques of a trajectory, improved until the cost falls no further.

The cost is quadratic in the tracking errors of x_{i+1} = f(x_i, u_i), where u is the driven joint's torque:

    J = (1/n) Σ_{i<n} [Σ_j q_j (x_ij - r_ij)² + p (u_i - s_i)²] + Σ_j f_j (x_nj - g_j)².

A backward pass, with μ added to Q_uu, proposes a feedback policy, and a forward pass tries it. μ falls after an
improvement and rises otherwise. The dynamics' second derivatives are left out. The result is a local optimum near
the first torques. Torques are clipped to their limit, which the planning ignores; states have no limits, and angles
are not wrapped. States and Jacobians are tuples of scalars, see ``transition``.

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
from ...plant.equations import Number
from .transition import AbstractTransition, Matrix, Vector, add_scaled, diagonal, dot, symmetric_times, unpack


class Cost(eqx.Module):
    """Weights and targets of J."""

    state_weights: Float[Any, "4"]
    """q"""
    torque_weight: Number
    """p"""
    final_weights: Float[Any, "4"]
    """f"""
    states: Float[Any, "n 4"]
    """r"""
    torque: Float[Any, "n"]
    """s"""
    final_state: Float[Any, "4"]
    """g"""


class CostedTrajectory(eqx.Module):
    """A trajectory and its cost; rows i < n."""

    x: Vector
    u: Number
    last: Vector  # x_n
    cost: Scalar  # J


class FeedbackPolicy(eqx.Module):
    """u = u_i + k_i + K_i (x - x_i); rows i < n."""

    feedforward: Number  # k
    gains: Vector  # K


def backward(
    transition: AbstractTransition, cost: Cost, trajectory: CostedTrajectory, regularisation: Number
) -> tuple[FeedbackPolicy, Scalar]:
    """The policy with k = -(Q_uu + μ)⁻¹ Q_u and K = -(Q_uu + μ)⁻¹ Q_ux, and the fall of the cost that it promises.

    Q is the cost from a step on, to second order with the dynamics linearised; μ is the regularisation.
    """
    n = trajectory.u.shape[0]
    q, f = unpack(2.0 / n * jnp.asarray(cost.state_weights)), unpack(2.0 * jnp.asarray(cost.final_weights))
    p = 2.0 / n * cost.torque_weight
    states = range(len(q))
    zero = jnp.zeros_like(trajectory.u[0])
    last_error = add_scaled(trajectory.last, -1.0, unpack(jnp.asarray(cost.final_state)))
    v_x = tuple(w * e for w, e in zip(f, last_error, strict=True))
    # Literal zeros become arrays here: the carry of a scan keeps its types.
    v_xx = tuple(tuple(value + zero for value in row) for row in diagonal(f))

    def step(
        carry: tuple[Vector, Matrix, Number], row: Any
    ) -> tuple[tuple[Vector, Matrix, Number], FeedbackPolicy]:
        v_x, v_xx, expected = carry
        x, u, (*a, b), r, s = row
        v_a, v_b = [symmetric_times(v_xx, column) for column in a], symmetric_times(v_xx, b)
        q_x = tuple(w * (e - t) + dot(column, v_x) for w, e, t, column in zip(q, x, r, a, strict=True))
        q_u = p * (u - s) + dot(b, v_x)
        q_ux = tuple(dot(b, column) for column in v_a)
        q_uu = p + dot(b, v_b)
        inverse = -1.0 / (q_uu + regularisation)
        k, gains = inverse * q_u, tuple(inverse * value for value in q_ux)
        # V is Q at u = k + K x. The regularisation changes k and K; it is not part of the cost.
        slope = tuple(value + q_uu * gain for value, gain in zip(q_ux, gains, strict=True))
        v_x = tuple(q_x[i] + gains[i] * q_u + slope[i] * k for i in states)
        v_xx = tuple(
            tuple(
                dot(a[i], v_a[j]) + (q[i] if i == j else 0.0) + q_ux[i] * gains[j] + gains[i] * slope[j]
                for j in states[i:]
            )
            for i in states
        )
        return (v_x, v_xx, expected - k * (q_u + 0.5 * q_uu * k)), FeedbackPolicy(k, gains)

    # The Jacobians of all steps are computed at once: only the value function needs the step after.
    jacobian, targets = transition.jacobian(trajectory.x, trajectory.u), unpack(jnp.asarray(cost.states))
    rows = (trajectory.x, trajectory.u, jacobian, targets, jnp.asarray(cost.torque))
    (_, _, expected), policy = jax.lax.scan(step, (v_x, v_xx, zero), rows, reverse=True)
    return policy, expected


def forward(
    transition: AbstractTransition,
    cost: Cost,
    start: Vector,
    torque: Float[Array, "n"],
    limit: Number,
    about: tuple[Vector, Vector] | None = None,
) -> CostedTrajectory:
    """Simulate torques, with the feedback of ``about`` = (states, gains) if given, clipped to the limit."""

    def step(x: Vector, row: Any) -> tuple[Vector, Any]:
        u, feedback = row
        if feedback is not None:
            middle, gains = feedback
            u = u + dot(gains, add_scaled(x, -1.0, middle))
        u = jnp.clip(u, -limit, limit)
        return transition.step(x, u), (x, u)

    last, (x, u) = jax.lax.scan(step, start, (torque, about))
    # The costs of all steps are computed at once: only the states need the step before.
    stages = cost.torque_weight * (u - jnp.asarray(cost.torque)) ** 2
    stages = stages + _square(cost.state_weights, x, cost.states)
    total = jnp.sum(stages) / torque.shape[0] + _square(cost.final_weights, last, cost.final_state)
    return CostedTrajectory(x=x, u=u, last=last, cost=total)


def _square(weights: Float[Any, "4"], x: Vector, target: Float[Any, "*n 4"]) -> Any:
    parts = zip(unpack(jnp.asarray(weights)), x, unpack(jnp.asarray(target)), strict=True)
    return sum(weight * (value - aim) ** 2 for weight, value, aim in parts)


class Status(enum.IntEnum):
    """How an optimisation ended, as a value of its result."""

    RUNNING = 0  # It has not ended
    CONVERGED = 1  # The backward pass expects less than the tolerance: use the result
    STALLED = 2
    """Nothing improves at the largest regularisation: at an optimum to rounding, or the derivatives are wrong."""
    ITERATION_LIMIT = 3  # The cost may still fall: allow more iterations


@dataclasses.dataclass(frozen=True)
class ILQRSettings:
    """The iteration's limits, and how it adapts the regularisation."""

    max_iterations: int
    tolerance: float  # Stop when the backward pass expects the cost to fall by less than this
    regularisation: float  # μ at the start
    min_regularisation: float
    max_regularisation: float
    torque_limit: float  # N m
    decrease: float = 0.7  # μ is multiplied by this after an improvement
    increase: float = 2.0  # μ is multiplied by this after an iteration without improvement
    step_sizes: tuple[float, ...] = (1.0,)
    """Factors of the feedforward that a line search tries side by side; (1.0,) searches nothing."""


class Solution(eqx.Module):
    """The trajectory that an optimisation found, and how it ended."""

    states: Float[Array, "n+1 4"]
    torque: Float[Array, "n"]
    cost: Scalar
    iterations: Count
    regularisation: Scalar  # μ after the last iteration
    status: Count
    """A :class:`Status`."""


class ILQRState(eqx.Module):
    """An optimisation between two iterations."""

    trajectory: CostedTrajectory  # The best trajectory so far
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
