"""Linear quadratic regulators: at upright in continuous time, along a trajectory in discrete time.

They are designed on the host in NumPy, and hold near the point of linearisation: the controller gives no torque
where its cost-to-go, and with it the error, is large.
"""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_continuous_are

from ...common.types import Scalar, State, Torque
from ...dynamics.dynamics import UPRIGHT, linearise, wrap
from ...plant.plant import Plant, Robot
from ..interface import AbstractController, joint_torques


@dataclass(frozen=True)
class LQRSettings:
    """Weights of ∫ xᵀQx + R u² dt, and the largest cost-to-go at which the LQR acts."""

    state_weights: tuple[float, float, float, float]
    """Diagonal of Q (1/rad², s²/rad²)."""
    torque_weight: float
    """R (1/N²m²)."""
    max_cost_to_go: float
    """No torque where xᵀSx is above this."""


class LQR(AbstractController[None]):
    """u = -K (wrap(x) - goal), or 0 where the cost-to-go is too large; it remembers nothing."""

    gains: Float[Any, "4"]
    """K (N m/rad, N m s/rad)."""
    cost_to_go: Float[Any, "4 4"]
    """S"""
    max_cost_to_go: float
    limit: float
    """The motor's (N m)."""
    robot: Robot = eqx.field(static=True)
    friction: float | None = None
    """Added to u: this times arctan of ``knee`` times the passive joint's velocity (N m), against its friction."""
    knee: float | None = None
    """s/rad"""

    def init(self) -> None:
        """Nothing to remember."""

    def __call__(self, carry: None, t: Scalar, x: State) -> tuple[None, Torque]:
        """The regulator's torque on the driven joint (N m)."""
        error = wrap(x) - jnp.asarray(UPRIGHT, x.dtype)
        within = error @ jnp.asarray(self.cost_to_go) @ error <= self.max_cost_to_go
        u = -jnp.asarray(self.gains) @ error
        if self.friction is not None and self.knee is not None:
            u = u + self.friction * jnp.arctan(self.knee * x[3 - self.robot.joint])
        u = jnp.where(within, u, 0.0)
        return None, joint_torques(u, self.robot, self.limit)


def upright_lqr(parameters: Plant, robot: Robot, settings: LQRSettings) -> LQR:
    """The regulator of the pendulum linearised upright at rest."""
    A, B, _ = linearised(parameters, robot, UPRIGHT[None], np.zeros(1))
    S = solve_continuous_are(A[0], B[0][:, None], np.diag(settings.state_weights), [[settings.torque_weight]])
    limit = float(parameters.limit(robot.joint))
    return LQR(B[0] @ S / settings.torque_weight, S, settings.max_cost_to_go, limit, robot)


def disturbance_gain(parameters: Plant, regulator: LQR) -> float:
    """κ of u = -K e - κ f, the optimal regulator where a constant torque f acts on the undriven joint.

    With ė = A e + B u + D f the costate is S e + s f, (A - B K)ᵀ s = -S D, and κ the gain of s as K is that of S.
    """
    (A,), (B,), (D,) = linearised(parameters, regulator.robot, UPRIGHT[None], np.zeros(1))
    K, S = regulator.gains, regulator.cost_to_go
    # r, from K = Bᵀ S / r: a regulator does not keep the weights that it was designed with.
    weight = (B @ S @ B) / (K @ B)
    return float(B @ np.linalg.solve((A - np.outer(B, K)).T, -S @ D) / weight)


def linearised(
    parameters: Plant, robot: Robot, states: Float[np.ndarray, "n 4"], torque: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n 4"], Float[np.ndarray, "n 4"]]:
    """Continuous-time A = ∂ẋ/∂x, B = ∂ẋ/∂u and D = ∂ẋ/∂f of rows of states and torques.

    u is the driven joint's torque, f a torque on the undriven one.
    """
    with jax.enable_x64(True):
        u = jnp.asarray(torque)[:, None] * jnp.array(robot.actuation)
        A, B = map(np.asarray, _linearise_rows(parameters, jnp.asarray(states), u))
        return A, B[:, :, robot.joint], B[:, :, 1 - robot.joint]


# One function for all plants, which JAX compiles once for each number of rows.
_linearise_rows = jax.jit(jax.vmap(linearise, in_axes=(None, 0, 0)))


def riccati_recursion(
    A: Float[np.ndarray, "n 4 4"],
    B: Float[np.ndarray, "n 4"],
    Q: Float[np.ndarray, "4 4"],
    R: float,
    Qf: Float[np.ndarray, "4 4"],
    d: Float[np.ndarray, "n 4"] | None = None,
) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n"]]:
    """Gains K_i and torques k_i of u_i = -K_i x_i - k_i that minimise Σ_{i<n} (xᵢᵀQxᵢ + R uᵢ²) + x_nᵀ Qf x_n.

    The system is x_{i+1} = A_i x_i + B_i u_i + d_i; without disturbances d_i the k_i are 0. Backwards from P = Qf
    and s = 0: with h = R + B_iᵀ P B_i, K_i = h⁻¹ B_iᵀ P A_i and k_i = h⁻¹ B_iᵀ (P d_i + s). Then s becomes
    (A_i - B_i K_i)ᵀ (P d_i + s) and P becomes Q + A_iᵀ P (A_i - B_i K_i).
    """
    P, s, gains, torques = Qf, np.zeros(4), np.empty_like(B), np.zeros(len(B))
    for i in reversed(range(len(B))):
        PB = P @ B[i]
        gains[i] = (PB @ A[i]) / (R + PB @ B[i])
        if d is not None:
            costate = P @ d[i] + s
            torques[i] = (B[i] @ costate) / (R + PB @ B[i])
            s = (A[i] - np.outer(B[i], gains[i])).T @ costate
        P = Q + A[i].T @ (P @ A[i] - np.outer(PB, gains[i]))
        # Rounding would make P asymmetric over thousands of steps.
        P = 0.5 * (P + P.T)
    return gains, torques
