"""Controllers that follow a swing-up: by precomputed feedback gains, or by planning along it anew at every call.

The time alone selects the row of the trajectory: the controllers do not wait for a pendulum that is late.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.types import Flag, Scalar, State, Torque
from ...dynamics.dynamics import UPRIGHT, wrap_difference
from ...plant.plant import Plant, Robot
from ..interface import AbstractController, joint_torques
from ..swingups.ilqr import solve
from ..swingups.reference import Reference
from ..swingups.transition import PendulumTransition
from .settings import MPCSettings
from .upright import AbstractExpensiveController, linearised

KNEE = 10.0
"""Along a swing-up the friction's sign is 2/π arctan of this times the velocity (s/rad), in C.1's units."""
STATE_WEIGHT, TORQUE_WEIGHT = 10.0, 0.1
"""Multiples of a TVLQR's weights: the friction's sign is the plan's, which holds only near the plan."""


class PiecewiseCubic(eqx.Module):
    """One cubic per piece for every channel; its value is constant before the first and after the last sample."""

    starts: Float[Any, "pieces"]  # Time of each piece's first sample (s)
    ends: Float[Any, "pieces"]
    """Time of each piece's last sample (s): a time between two pieces belongs to the later one."""
    coefficients: Float[Any, "pieces 4 channels"]
    """Powers 0 to 3 of the time since the piece's start, in its lengths."""

    def __call__(self, t: Scalar) -> Float[Array, "channels"]:
        """The channels' values at time t (s)."""
        starts, ends = jnp.asarray(self.starts), jnp.asarray(self.ends)
        t = jnp.clip(t, starts[0], ends[-1])
        piece = jnp.searchsorted(ends, t)
        s = (t - starts[piece]) / (ends[piece] - starts[piece])
        return jnp.stack([jnp.ones_like(s), s, s * s, s**3]) @ jnp.asarray(self.coefficients)[piece]


def fit_piecewise_cubic(
    time: Float[np.ndarray, "n"], values: Float[np.ndarray, "n channels"], pieces: int
) -> PiecewiseCubic:
    """The least-squares fit; all pieces have the same number of samples, up to one."""
    starts, ends, coefficients = [], [], []
    for t, y in zip(np.array_split(time, pieces), np.array_split(values, pieces), strict=True):
        # Powers of a time from 0 to 1 keep the least squares well conditioned.
        powers = np.vander((t - t[0]) / (t[-1] - t[0]), 4, increasing=True)
        coefficients.append(np.linalg.lstsq(powers, y)[0])
        starts.append(t[0])
        ends.append(t[-1])
    return PiecewiseCubic(np.array(starts), np.array(ends), np.array(coefficients))


class RiccatiController(AbstractController[None]):
    """u = u_n + K_n (x - x_n), where n is the row nearest in time, or the last one; angles are not wrapped."""

    dt: float  # Time between rows (s)
    states: Float[Any, "rows 4"]
    torque: Float[Any, "rows"]
    gains: Float[Any, "rows 4"]  # K (N m/rad, N m s/rad)
    limit: float  # The motor's (N m)
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


Plan = Float[Array, "n"]  # The driven joint's torques from now on (N m)


class MPC(AbstractExpensiveController[Plan]):
    """The first torque of a plan of 0.2 s that tracks the trajectory, and near its end of one that stays upright.

    Every call plans by iterative LQR, from the plan before, shifted by a step.
    """

    transition: PendulumTransition = eqx.field(static=True)
    states: Float[Any, "rows 4"]
    """The trajectory at the calls' times k dt."""
    torque: Float[Any, "rows"]
    settings: MPCSettings = eqx.field(static=True)
    robot: Robot = eqx.field(static=True)

    def init(self) -> Plan:
        """The first plan: the trajectory's torques."""
        return jnp.asarray(self.torque)[: self.settings.horizon - 1]

    def control(self, carry: Plan, t: Scalar, x: State, idle: Flag) -> tuple[Plan, Torque]:
        """Plan, unless idle."""

        def plan(state: tuple[Plan, Flag]) -> tuple[Plan, Flag]:
            return self.plan(state[0], t, x, idle), jnp.array(True)

        # A loop over a batch runs while any member needs it, or not at all; a branch would always run.
        torque, _ = jax.lax.while_loop(lambda state: ~state[1], plan, (carry, jnp.asarray(idle)))
        # The plan moves on by a step. Its new last torque is the trajectory's, or 0 after the trajectory's end.
        row = self.row(t) + self.settings.horizon - 1
        rows = jnp.asarray(self.torque)
        coming = jnp.where(row < len(rows) - 1, rows[jnp.minimum(row, len(rows) - 1)], 0.0)
        limit = self.transition.parameters.limit(self.robot.joint)
        return jnp.append(torque[1:], coming), joint_torques(torque[0], self.robot, limit)

    def plan(self, guess: Plan, t: Scalar, x: State, idle: Flag) -> Plan:
        """The torques that track the trajectory best from x on."""
        settings, steps = self.settings, self.settings.horizon - 1
        row, last = self.row(t), len(self.torque) - 1
        on_track = row + settings.horizon < last
        # Near the end the slice must stay inside; the cost below then ignores it.
        start = jnp.minimum(row, last - settings.horizon)
        states = jax.lax.dynamic_slice_in_dim(jnp.asarray(self.states), start, settings.horizon + 1)
        torque = jax.lax.dynamic_slice_in_dim(jnp.asarray(self.torque), start, steps)
        # The published code compares the plan's last state with the trajectory a step after it.
        tracking = settings.tracking.cost(states[:-2], torque, states[-1])
        # Both costs are computed: members of a batch may be at different rows.
        upright = settings.upright.cost(np.tile(UPRIGHT, (steps, 1)), np.zeros(steps), UPRIGHT)
        cost = jax.tree.map(lambda a, b: jnp.where(on_track, a, b), tracking, upright)
        return solve(self.transition, cost, x, guess, settings.settings, idle).torque

    def row(self, t: Scalar) -> Array:
        """The trajectory's row at time t (s)."""
        return jnp.round(t / self.settings.dt).astype(jnp.int32)


def mpc(reference: Reference, parameters: Plant, robot: Robot, settings: MPCSettings) -> MPC:
    """An MPC along the fit of a trajectory, with ``parameters`` as its model."""
    rows = np.column_stack([reference.states, reference.torque])
    fit = fit_piecewise_cubic(reference.time, rows, settings.pieces)
    # The published code takes one sample less than the time has steps: its clock runs 0.03 % fast.
    time = np.linspace(0.0, reference.time[-1], round(reference.time[-1] / settings.dt))
    with jax.enable_x64(True):
        fitted = np.asarray(jax.vmap(fit)(jnp.asarray(time)))
    # The faster Jacobian: each call iterates up to ten times.
    transition = PendulumTransition(parameters, robot.joint, settings.dt, exact=False)
    return MPC(transition, fitted[:, :4], fitted[:, 4], settings, robot)


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
