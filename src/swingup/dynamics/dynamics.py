"""The double pendulum's dynamics in JAX: equations of motion, energy, tip height, linearisation, angles, the goal.

The state is x = [q1, q2, dq1, dq2] and the torque u = [u1, u2] acts on both joints; a joint without a motor gets a
zero. Functions carry no batch axis and follow the dtype of their inputs. The equations are in ``equations``.

Here plants become pytrees: whoever traces one computes its motion.
"""

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.types import Scalar, State, Torque
from ..plant import equations
from ..plant.plant import NAMES, Plant, lump
from .trigonometry import arctan, sine_cosine

Angle = TypeVar("Angle", Array, np.ndarray)

UPRIGHT = np.array([np.pi, 0.0, 0.0, 0.0])  # The goal g = [q1, q2, dq1, dq2] (rad, rad/s)

# Without the name, by which plants of equal structure would differ.
jax.tree_util.register_dataclass(Plant, data_fields=NAMES, meta_fields=(), drop_fields=("name",))


def mass_matrix(plant: Plant, x: State) -> Float[Array, "2 2"]:
    """M(q) (kg m²), with the motors' inertia."""
    m11, m12, m22 = equations.mass_entries(lump(plant), jnp.cos(x[1]))
    return jnp.array([[m11, m12], [m12, m22]])


def gravity_torque(plant: Plant, x: State) -> Torque:
    """G(q) (N m), the torque with which gravity drives each joint."""
    sin1, sin12 = sine_cosine(x[0])[0], sine_cosine(x[0] + x[1])[0]
    return jnp.array(equations.gravity(lump(plant), sin1, sin12))


def friction_torques(plant: Plant, x: State) -> tuple[Scalar, Scalar]:
    """F(q̇) (N m) of shoulder and elbow, viscous and Coulomb friction."""
    p, (_, _, dq1, dq2) = plant, x
    return equations.friction(p.b1, p.cf1, dq1, arctan), equations.friction(p.b2, p.cf2, dq2, arctan)


def acceleration(plant: Plant, x: State, u: Torque) -> Float[Array, "2"]:
    """q̈ (rad/s²) under the joint torques u (N m)."""
    q1, q2, dq1, dq2 = x
    sin2, cos2 = sine_cosine(q2)
    sines, losses = (sine_cosine(q1)[0], sin2, sine_cosine(q1 + q2)[0]), friction_torques(plant, x)
    # A vector: for two scalars XLA computes all sines twice, which doubles the time in double precision.
    return equations.acceleration(lump(plant), sines, cos2, (dq1, dq2), u, losses, stack=jnp.array)


def derivative(plant: Plant, x: State, u: Torque) -> State:
    """ẋ = [q̇, q̈] under the joint torques u (N m)."""
    return jnp.concatenate([x[2:], acceleration(plant, x, u)])


def total_energy(plant: Plant, x: State) -> Scalar:
    """Energy of the motion, with the motors' rotors, and of the masses (J); conserved without friction and torque.

    That of a mass in gravity is zero at the height of the shoulder.
    """
    p, (q1, q2, _, _), rates = plant, x, x[2:]
    y1 = -p.r1 * jnp.cos(q1)
    y2 = -p.l1 * jnp.cos(q1) - p.r2 * jnp.cos(q1 + q2)
    return 0.5 * rates @ mass_matrix(plant, x) @ rates + p.g * (p.m1 * y1 + p.m2 * y2)


def tip_height(plant: Plant, x: State) -> Scalar:
    """Height of the end effector over the shoulder (m)."""
    return -plant.l1 * jnp.cos(x[0]) - plant.l2 * jnp.cos(x[0] + x[1])


def linearise(plant: Plant, x: State, u: Torque) -> tuple[Float[Array, "4 4"], Float[Array, "4 2"]]:
    """A = ∂ẋ/∂x and B = ∂ẋ/∂u of the continuous-time dynamics at (x, u)."""
    return jax.jacfwd(derivative, argnums=(1, 2))(plant, x, u)


def wrap(x: State) -> State:
    """The state with q1 in [0, 2π) and q2 in [-π, π): both angles are continuous around upright."""
    return jnp.concatenate([jnp.array([jnp.mod(x[0], 2 * jnp.pi), wrap_difference(x[1])]), x[2:]])


def upright_error(x: Float[np.ndarray, "*n 4"]) -> Float[np.ndarray, "*n 4"]:
    """How far states are off upright at rest (rad, rad/s), angles to the nearest turn."""
    error = np.asarray(x, np.float64) - UPRIGHT
    error[..., :2] = wrap_difference(error[..., :2])
    return error


def wrap_difference(angle: Angle) -> Angle:
    """Wrap differences of angles (rad) to [-π, π). Small ones lose digits, unlike in ``ArrayOps.nearest``."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
