"""Model predictive control by iLQR along a swing-up trajectory: every call plans the coming 0.2 s.

Planning starts from the previous plan, shifted by a step. The row of the trajectory follows from the time alone.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.types import Flag, Scalar, State, Torque
from ...dynamics.dynamics import UPRIGHT
from ...plant.plant import Plant, Robot
from ..interface import joint_torques
from ..swingups.ilqr import solve
from ..swingups.reference import Reference
from ..swingups.transition import PendulumTransition
from .piecewise_cubic import fit_piecewise_cubic
from .published import MPCSettings
from .switch import AbstractExpensiveController

Plan = Float[Array, "n"]
"""The driven joint's torques from now on (N m)."""


class MPC(AbstractExpensiveController[Plan]):
    """The first torque of a plan that tracks the trajectory, and near its end of a plan that stays upright."""

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
