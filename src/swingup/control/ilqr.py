"""Iterative LQR: minimise a quadratic tracking cost over a driven scalar, x_{i+1} = f(x_i, u_i).

J = (1/n) Σ_{i<n} [Σ_j q_j (x_ij - r_ij)² + p (u_i - s_i)²] + Σ_j f_j (x_nj - g_j)².

A backward pass with μ added to Q_uu gives u_i + k_i + K_i (x_i - x̄_i), a forward pass tries it; μ falls when the cost did and
rises when not. The dynamics' second derivatives are left out. It finds a local optimum near its first torques, respects
torque limits by clipping (without planning for them) and knows no limits on states. Source: Tassa, Erez and Todorov, IROS 2012.
"""

import dataclasses
import enum
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..types import Count, Flag, Scalar
from .algebra import Matrix, Real, Vector, add_scaled, diagonal, dot, entry, symmetric_times, unpack
from .transition import AbstractTransition


class Status(enum.IntEnum):
    """How an optimisation ended; while it runs, RUNNING."""

    RUNNING = 0
    CONVERGED = 1
    """The backward pass expects less than the tolerance: use the result."""
    STALLED = 2
    """Nothing improves at the largest regularisation: a local optimum to rounding, or a hard problem."""
    ITERATION_LIMIT = 3
    """The cost still falls: allow more iterations."""


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
    """Factors of k_i that a line search tries, all at once, keeping the cheapest; (1.0,) is none."""


class Cost(eqx.Module):
    """Weights and targets of the tracking cost J."""

    state_weights: Float[Any, "4"]
    torque_weight: Real
    final_weights: Float[Any, "4"]
    states: Float[Any, "n 4"]
    """r"""
    torque: Float[Any, "n"]
    """s"""
    final_state: Float[Any, "4"]
    """g"""


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


class Rollout(eqx.Module):
    """Rows i < n of a trajectory with the Jacobian of each step; scalars are entries, see ``algebra``."""

    x: Vector
    u: Real
    jacobian: Matrix
    """Columns."""
    last: Vector
    """x_n"""
    cost: Scalar


class Policy(eqx.Module):
    """Rows of the backward pass."""

    step: Real
    """k"""
    gains: Vector
    """K"""


class _Iterate(eqx.Module):
    rollout: Rollout
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
    """Optimise the torques from a first guess; where ``idle``, only roll the guess out."""
    rollout = forward(transition, cost, x0, torque, settings)
    first = _Iterate(
        rollout=rollout,
        regularisation=jnp.full_like(x0[0], settings.regularisation),
        iteration=jnp.zeros((), jnp.int32),
        status=jnp.where(idle, Status.ITERATION_LIMIT, Status.RUNNING).astype(jnp.int32),
    )
    last = jax.lax.while_loop(
        lambda it: it.status == Status.RUNNING, lambda it: improve(transition, cost, it, settings), first
    )
    states = jnp.concatenate([jnp.stack(last.rollout.x, -1), jnp.stack(last.rollout.last)[None]])
    return Solution(
        states=states,
        torque=last.rollout.u,
        cost=last.rollout.cost,
        iterations=last.iteration,
        regularisation=last.regularisation,
        status=last.status,
    )


def feedback_gains(
    transition: AbstractTransition, cost: Cost, solution: Solution, regularisation: float
) -> Float[Array, "n 4"]:
    """K of a backward pass about a solution: without regularisation the LQ-optimal feedback, with it a weaker one."""
    x, u = unpack(solution.states[:-1]), solution.torque
    rollout = Rollout(x, u, transition.jacobian(x, u), tuple(solution.states[-1]), solution.cost)
    return jnp.stack(backward(cost, rollout, regularisation)[0].gains, -1)


def improve(transition: AbstractTransition, cost: Cost, now: _Iterate, settings: Settings) -> _Iterate:
    """One iteration: backward pass, forward pass, accept or not, adapt μ, decide whether to go on."""
    policy, expected = backward(cost, now.rollout, now.regularisation)
    tried = _search(transition, cost, now.rollout, policy, settings)
    improved = tried.cost < now.rollout.cost
    kept = jax.tree.map(lambda new, old: jnp.where(improved, new, old), tried, now.rollout)
    regularisation = now.regularisation * jnp.where(improved, settings.decrease, settings.increase)
    iteration = now.iteration + 1
    stalled = ~improved & (now.regularisation >= settings.max_regularisation)
    status = jnp.where(iteration >= settings.max_iterations, Status.ITERATION_LIMIT, Status.RUNNING)
    status = jnp.where(expected < settings.tolerance, Status.CONVERGED, status)
    return _Iterate(
        rollout=kept,
        regularisation=jnp.clip(regularisation, settings.min_regularisation, settings.max_regularisation),
        iteration=iteration,
        status=jnp.where(stalled, Status.STALLED, status).astype(jnp.int32),
    )


def backward(cost: Cost, rollout: Rollout, regularisation: Real) -> tuple[Policy, Scalar]:
    """k = -(Q_uu + μ)⁻¹ Q_u and K = -(Q_uu + μ)⁻¹ Q_ux of every step, and the expected fall of the cost."""
    n = rollout.u.shape[0]
    q, f = unpack(2.0 / n * jnp.asarray(cost.state_weights)), unpack(2.0 * jnp.asarray(cost.final_weights))
    p = 2.0 / n * cost.torque_weight
    last_error = add_scaled(rollout.last, -1.0, unpack(jnp.asarray(cost.final_state)))
    zero = jnp.zeros_like(rollout.u[0])
    v_x = tuple(w * e for w, e in zip(f, last_error, strict=True))
    v_xx = tuple(tuple(value + zero for value in row) for row in diagonal(f))

    def step(carry: tuple[Vector, Matrix, Real], row: Any) -> tuple[tuple[Vector, Matrix, Real], Policy]:
        v_x, v_xx, expected = carry
        x, u, jacobian, r, s = row
        *a, b = jacobian
        v_a, v_b = [symmetric_times(v_xx, column) for column in a], symmetric_times(v_xx, b)
        q_x = tuple(w * (e - t) + dot(column, v_x) for w, e, t, column in zip(q, x, r, a, strict=True))
        q_u = p * (u - s) + dot(b, v_x)
        q_ux = tuple(dot(b, column) for column in v_a)
        q_uu = p + dot(b, v_b)
        inverse = 1.0 / (q_uu + regularisation)
        k, gains = -inverse * q_u, tuple(-inverse * entry for entry in q_ux)
        # V = Q with u = k + K x put in; the regularisation is no part of the cost.
        slope = q_u + q_uu * k
        v_x = tuple(e + gain * slope + c * k for e, gain, c in zip(q_x, gains, q_ux, strict=True))
        v_xx = tuple(
            tuple(
                dot(a[i], v_a[j]) + (q[i] if i == j else 0.0) + q_ux[i] * gains[j] + gains[i] * (q_ux[j] + q_uu * gains[j])
                for j in range(i, 4)
            )
            for i in range(4)
        )
        return (v_x, v_xx, expected - k * (q_u + 0.5 * q_uu * k)), Policy(k, gains)

    rows = (rollout.x, rollout.u, rollout.jacobian, unpack(cost.states), cost.torque)
    (_, _, expected), policy = jax.lax.scan(step, (v_x, v_xx, zero), rows, reverse=True)
    return policy, expected


def forward(
    transition: AbstractTransition,
    cost: Cost,
    x0: Float[Array, "4"] | Vector,
    torque: Float[Array, "n"],
    settings: Settings,
    about: tuple[Vector, Vector] | None = None,
) -> Rollout:
    """Roll torques out, with feedback ``about`` = (states, gains) if any, clipped to the limit; sum up the cost."""
    n = torque.shape[0]
    q, p = unpack(jnp.asarray(cost.state_weights) / n), cost.torque_weight / n
    start = x0 if isinstance(x0, tuple) else unpack(x0)

    def step(x: Vector, row: Any) -> tuple[Vector, Any]:
        u, feedback = row
        if feedback is not None:
            middle, gains = feedback
            u = u + dot(gains, add_scaled(x, -1.0, middle))
        u = jnp.clip(u, -settings.torque_limit, settings.torque_limit)
        return transition.step(x, u), (x, u)

    last, (x, u) = jax.lax.scan(step, start, (torque, about))
    stage = p * (u - cost.torque) ** 2
    for weight, entry, target in zip(q, x, unpack(jnp.asarray(cost.states)), strict=True):
        stage = stage + weight * (entry - target) ** 2
    final = zip(unpack(jnp.asarray(cost.final_weights)), last, unpack(jnp.asarray(cost.final_state)), strict=True)
    total = jnp.sum(stage) + sum(w * (e - g) ** 2 for w, e, g in final)
    return Rollout(x=x, u=u, jacobian=transition.jacobian(x, u), last=last, cost=total)


def _search(transition: AbstractTransition, cost: Cost, now: Rollout, policy: Policy, settings: Settings) -> Rollout:
    def attempt(size: Real) -> Rollout:
        start = tuple(e[0] for e in now.x)
        return forward(transition, cost, start, now.u + size * policy.step, settings, (now.x, policy.gains))

    if len(settings.step_sizes) == 1:
        return attempt(settings.step_sizes[0])
    attempts = jax.vmap(attempt)(jnp.array(settings.step_sizes, now.u.dtype))
    best = jnp.nanargmin(attempts.cost)
    return jax.tree.map(lambda rows: rows[best], attempts)
