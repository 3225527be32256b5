"""Controllers that follow a swing-up trajectory by linear feedback with precomputed gains.

The time alone selects the row of the trajectory: the controllers do not wait for a pendulum that is late.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...common.types import Scalar, State, Torque
from ...dynamics.dynamics import wrap_difference
from ...plant.plant import Plant, Robot
from ..interface import AbstractController, joint_torques
from ..swingups.reference import Reference
from .dry_friction import KNEE, STATE_WEIGHT, TORQUE_WEIGHT
from .lqr import linearised, riccati_recursion
from .piecewise_cubic import PiecewiseCubic, fit_piecewise_cubic


class RiccatiController(AbstractController[None]):
    """u = u_n + K_n (x - x_n), where n is the row nearest in time, or the last one; angles are not wrapped."""

    dt: float
    """Time between rows (s)."""
    states: Float[Any, "rows 4"]
    torque: Float[Any, "rows"]
    gains: Float[Any, "rows 4"]
    """K (N m/rad, N m s/rad)."""
    limit: float
    """The motor's (N m)."""
    robot: Robot = eqx.field(static=True)

    def init(self) -> None:
        """Nothing to remember."""

    def __call__(self, carry: None, t: Scalar, x: State) -> tuple[None, Torque]:
        """The trajectory's torque and feedback on the driven joint (N m)."""
        row = jnp.clip(jnp.round(t / self.dt), 0, len(self.torque) - 1).astype(jnp.int32)
        states, torque, gains = (jnp.asarray(rows)[row] for rows in (self.states, self.torque, self.gains))
        # The published controller does not wrap this error.
        return None, joint_torques(torque + gains @ (x - states), self.robot, self.limit)


class TVLQR(AbstractController[None]):
    """u = u(t) - K(t) (x - x(t)), angle errors wrapped; x, u and K are piecewise cubics, held after their end."""

    fit: PiecewiseCubic
    """Channels: four of the state, the torque, four gains."""
    limit: float
    """The motor's (N m)."""
    robot: Robot = eqx.field(static=True)

    def init(self) -> None:
        """Nothing to remember."""

    def __call__(self, carry: None, t: Scalar, x: State) -> tuple[None, Torque]:
        """The trajectory's torque and feedback on the driven joint (N m)."""
        now = self.fit(t)
        error = x - now[:4]
        error = jnp.concatenate([wrap_difference(error[:2]), error[2:]])
        return None, joint_torques(now[4] - now[5:] @ error, self.robot, self.limit)


def riccati_controller(reference: Reference, plant: Plant) -> RiccatiController:
    """Follow a trajectory with its own gains, within the limit of the plant's motor."""
    r, limit = reference, float(plant.limit(reference.robot.joint))
    return RiccatiController(r.dt, r.states, r.torque, r.gains, limit, r.robot)


def tvlqr(
    reference: Reference,
    parameters: Plant,
    robot: Robot,
    weights: tuple[np.ndarray, float, np.ndarray],
    pieces: int,
    friction: float = 0.0,
) -> TVLQR:
    """Design a TVLQR along a trajectory.

    The model is linearised at every row. Weights are Q, R and Q_f of the discrete-time regulator, pieces the cubics
    of the fit. Coulomb friction of the passive joint (N m), which the trajectory lacks, counts as a disturbance
    whose sign is that of the trajectory's velocity.
    """
    A, B, D = linearised(parameters, robot, reference.states, reference.torque)
    # Forward Euler, as the published TVLQR discretises.
    dt, u, disturbances, (Q, R, Qf) = reference.dt, reference.torque, None, weights
    if friction:
        # Firmer than the published ones, whose trajectory friction would leave.
        Q, R = STATE_WEIGHT * Q, TORQUE_WEIGHT * R
        rates = reference.states[:, 3 - robot.joint]
        # Friction is cf π/2 at most, and so is this.
        disturbances = -dt * friction * np.arctan(KNEE * rates)[:, None] * D
    gains, against = riccati_recursion(np.eye(4) + dt * A, dt * B, Q, R, Qf, disturbances)
    rows = np.column_stack([reference.states, u - against, gains])
    return TVLQR(fit_piecewise_cubic(reference.time, rows, pieces), float(parameters.limit(robot.joint)), robot)
