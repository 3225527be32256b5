"""Equations of motion M(q) q̈ = G(q) + u - C(q, q̇) q̇ - F(q̇), and what follows from them.

The state is x = [q1, q2, dq1, dq2] and the torque u = [u1, u2] acts on both joints: who drives only one passes
a zero for the other. Functions carry no batch axis and follow the dtype of their inputs. Source: the public
RealAIGym double-pendulum benchmark (friction as arctan(100 q̇), a smoothed Coulomb law).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..types import Scalar, State, Torque
from .parameters import Parameters, mass_entries
from .trigonometry import sine_cosine

COULOMB_STEEPNESS = 100.0
"""Slope of the smoothed Coulomb friction cf arctan(100 q̇) (s/rad)."""


def mass_matrix(parameters: Parameters, x: State) -> Float[Array, "2 2"]:
    """M(q) (kg m²), with the motors' inertia."""
    m11, m12, m22 = mass_entries(parameters, jnp.cos(x[1]))
    return jnp.array([[m11, m12], [m12, m22]])


def coriolis_torque(parameters: Parameters, x: State) -> Torque:
    """C(q, q̇) q̇ (N m)."""
    p, (_, q2, dq1, dq2) = parameters, x
    h_sin = p.m2 * p.l1 * p.r2 * sine_cosine(q2)[0]
    return jnp.array([-h_sin * dq2 * (2 * dq1 + dq2), h_sin * dq1 * dq1])


def gravity_torque(parameters: Parameters, x: State) -> Torque:
    """G(q) (N m), the torque with which gravity drives each joint."""
    p, (q1, q2, _, _) = parameters, x
    g2 = -p.m2 * p.g * p.r2 * sine_cosine(q1 + q2)[0]
    g1 = -(p.m1 * p.r1 + p.m2 * p.l1) * p.g * sine_cosine(q1)[0] + g2
    return jnp.array([g1, g2])


def friction_torque(parameters: Parameters, x: State) -> Torque:
    """F(q̇) (N m), viscous and Coulomb friction."""
    p, (_, _, dq1, dq2) = parameters, x
    f1 = p.b1 * dq1 + p.cf1 * jnp.arctan(COULOMB_STEEPNESS * dq1)
    f2 = p.b2 * dq2 + p.cf2 * jnp.arctan(COULOMB_STEEPNESS * dq2)
    return jnp.array([f1, f2])


def acceleration(parameters: Parameters, x: State, u: Torque) -> Float[Array, "2"]:
    """q̈ (rad/s²) under the joint torques u (N m)."""
    force = u + gravity_torque(parameters, x) - coriolis_torque(parameters, x) - friction_torque(parameters, x)
    m11, m12, m22 = mass_entries(parameters, sine_cosine(x[1])[1])
    determinant = m11 * m22 - m12 * m12
    return jnp.array([m22 * force[0] - m12 * force[1], m11 * force[1] - m12 * force[0]]) / determinant


def derivative(parameters: Parameters, x: State, u: Torque) -> State:
    """ẋ = [q̇, q̈] under the joint torques u (N m)."""
    return jnp.concatenate([x[2:], acceleration(parameters, x, u)])


def kinetic_energy(parameters: Parameters, x: State) -> Scalar:
    """½ q̇ᵀ M(q) q̇ (J), with the motors' rotors."""
    rates = x[2:]
    return 0.5 * rates @ mass_matrix(parameters, x) @ rates


def potential_energy(parameters: Parameters, x: State) -> Scalar:
    """Energy of the two masses in gravity (J), zero at the height of the shoulder."""
    p, (q1, q2, _, _) = parameters, x
    y1 = -p.r1 * jnp.cos(q1)
    y2 = -p.l1 * jnp.cos(q1) - p.r2 * jnp.cos(q1 + q2)
    return p.g * (p.m1 * y1 + p.m2 * y2)


def total_energy(parameters: Parameters, x: State) -> Scalar:
    """Kinetic and potential energy (J); conserved without friction and torque."""
    return kinetic_energy(parameters, x) + potential_energy(parameters, x)


def tip_height(parameters: Parameters, x: State) -> Scalar:
    """Height of the end effector over the shoulder (m)."""
    return -parameters.l1 * jnp.cos(x[0]) - parameters.l2 * jnp.cos(x[0] + x[1])


def linearise(parameters: Parameters, x: State, u: Torque) -> tuple[Float[Array, "4 4"], Float[Array, "4 2"]]:
    """A = ∂ẋ/∂x and B = ∂ẋ/∂u of the continuous-time dynamics at (x, u)."""
    return jax.jacfwd(derivative, argnums=(1, 2))(parameters, x, u)
