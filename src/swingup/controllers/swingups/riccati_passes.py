"""The two passes of iterative LQR: backward along a trajectory for a feedback policy, forward to try it.

The cost is quadratic in the tracking errors of x_{i+1} = f(x_i, u_i), where u is the driven joint's torque:

    J = (1/n) Σ_{i<n} [Σ_j q_j (x_ij - r_ij)² + p (u_i - s_i)²] + Σ_j f_j (x_nj - g_j)².

Angles are not wrapped. States and Jacobians are tuples of scalars, see ``scalar_algebra``.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.types import Scalar
from ...plant.equations import Number
from .scalar_algebra import Matrix, Vector, add_scaled, diagonal, dot, symmetric_times, unpack
from .transition import AbstractTransition


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
    last: Vector
    """x_n"""
    cost: Scalar
    """J"""


class FeedbackPolicy(eqx.Module):
    """u = u_i + k_i + K_i (x - x_i); rows i < n."""

    feedforward: Number
    """k"""
    gains: Vector
    """K"""


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
