"""What a plant's teacher does: the best torque known for a plant that is known, in any state; and schools of them.

Near the plant's own optimal swing-up it is that swing-up with its feedback gains, about the nearest of its rows: no
time enters. At the top it is the plant's LQR. Elsewhere it is a policy that recovers from anywhere on the nominal
plant, with its torque changed so that the plant moves as the nominal one would.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.types import Scalar, State
from ..controllers.baselines.continuation import (
    ContinuationSettings,
    SwingUps,
    continue_swingups,
    nominal_swingups,
)
from ..controllers.baselines.upright import passive_friction
from ..controllers.stack.estimator import JAX
from ..controllers.stack.policy import PolicyController, plant_of
from ..dynamics.dynamics import UPRIGHT, acceleration, upright_error
from ..plant.base_parameters import base_parameters
from ..plant.plant import LEADERBOARD, Plant, validated
from ..plant.units import C1, scaled, scales_of, similar_plant
from ..policy.regulator import DRY_KNEE, DRY_SHARE, fixed_point
from .analytic_policy_gradient import single_precision
from .plant_draws import plants_of

APART = 4
"""Rows of a swing-up among which the nearest is sought, to one of these: 8 ms."""
WEIGHTS = (1.0, 1.0, 0.12, 0.12)
"""Weights of errors in a distance (1, s): a velocity of 1 rad/s is as far as an angle of 0.12 rad."""
TOP_COST = 1.5
"""Cost-to-go of the LQR below which it teaches. With 0.5 more than a third of the acrobot's robot plants fell from
the top once under weak noise of the torques, with this a fifth."""
TOP_COULOMB = 0.1
"""Coulomb friction of the undriven joint (N m) that halves ``TOP_COST``."""
ARRIVED = 0.5
"""Cost-to-go where swing-ups end: their rows from there on do not teach."""
COST_WHEN_OVER = 1e6
"""Added to the squared distances from rows that do not teach."""
EDGE = 0.2
"""The teachers change over between this share below and above the tube's radius."""


class Teachers(eqx.Module):
    """A teacher for each of n plants, in single precision."""

    plant: Plant
    """Leaves of shape (n,)."""
    base: Float[Array, "n 9"]
    """Base parameters of the plants."""
    nominal: Float[Array, "n 9"]
    """Those of the nominal plant."""
    states: Float[Array, "n rows 4"]
    """Swing-ups (rad, rad/s)."""
    at_rest: Float[Array, "n rows"]
    """``COST_WHEN_OVER`` where a swing-up is over, else 0."""
    torque: Float[Array, "n rows"]
    """N m"""
    gains: Float[Array, "n rows 4"]
    """K of u + K (x - x_i) (N m/rad, N m s/rad)."""
    top_gains: Float[Array, "n 5"]
    """K of u = -K [e, f], as of the regulator."""
    dry: Float[Array, "n"]
    """Coulomb friction of the undriven joint (N m)."""
    cost_to_go: Float[Array, "n 4 4"]
    """P of eᵀ P e."""

    @property
    def number(self) -> int:
        """Number of plants."""
        return len(self.torque)


def make_teachers(swingups: SwingUps, nominal: Plant = LEADERBOARD) -> Teachers:
    """Teachers for the plants that the swing-ups are of, about a nominal one."""
    plants = [validated(plant) for plant in plants_of(swingups.plants)]
    held = [fixed_point(plant, swingups.robot.joint) for plant in plants]
    cost_to_go, gains = np.stack([P[:4, :4] for P, _ in held]), np.stack([K for _, K in held])
    dry = np.array([passive_friction(plant, swingups.robot) for plant in plants])
    centre = base_parameters(nominal.driven(swingups.robot))
    bases = np.stack([base_parameters(plant) for plant in plants])
    states = swingups.states[:, :-1:APART]
    errors = upright_error(states)
    costs = np.einsum("nri,nij,nrj->nr", errors, cost_to_go, errors)
    at_rest = np.where(costs < ARRIVED, COST_WHEN_OVER, 0.0)
    rows = states, at_rest, swingups.torque[:, ::APART], swingups.gains[:, ::APART]
    arrays = bases, np.tile(centre, (len(bases), 1)), *rows, gains, dry, cost_to_go
    teachers: Teachers = single_precision(Teachers(swingups.plants, *arrays))  # type: ignore[arg-type]  # NumPy's
    return teachers


class School(NamedTuple):
    """Teachers for plants about a nominal one, and the policy that recovers from anywhere on that one."""

    teachers: Teachers
    recovery: PolicyController
    """In single precision, in C.1's units; its plant is the nominal one."""


def make_school(
    recovery: PolicyController, targets: Plant, copies: int, progress: Callable[[int, int], None] = lambda *_: None
) -> School:
    """Teachers for drawn plants, as far as their swing-ups are reached, and for the nominal one.

    Args:
        recovery: the policy that recovers, in C.1's units.
        targets: the drawn plants, in these units, leaves of shape (n,).
        copies: number of the nominal plant's teachers.
        progress: called with the number of swing-ups that are done, and of all.
    """
    robot, nominal = recovery.robot, plant_of(recovery)
    # The continuation's settings suit swing-ups of the same duration in T.
    own = scales_of(nominal)
    begin = similar_plant(nominal, own)
    if begin.values() == LEADERBOARD.driven(robot).values():
        begin = LEADERBOARD
    found = continue_swingups(robot, similar_plant(targets, own), progress=progress, nominal=begin)
    more = nominal_swingups(robot, copies, ContinuationSettings(), begin)
    both: SwingUps = jax.tree.map(lambda *parts: np.concatenate(parts), found, more)
    swingups = replace(scaled(both, own), plants=similar_plant(both.plants, C1.over(own)))
    return School(make_teachers(swingups, nominal), single_precision(recovery))


def taught(one: Teachers, recovery: PolicyController, tube: float | Scalar, x: State) -> tuple[Scalar, Scalar]:
    """A teacher's torque (N m) in a state, and the distance from its plant's swing-up.

    Args:
        one: one plant's teacher, leaves without the leading axis.
        recovery: the policy that recovers, in single precision.
        tube: distance from the swing-up within which it teaches.
        x: the state (rad, rad/s).
    """
    limit = recovery.torque_limit
    off = x - one.states
    off = off.at[:, :2].set(JAX.nearest(off[:, :2]))
    squares = jnp.sum((off * jnp.array(WEIGHTS, x.dtype)) ** 2, axis=1) + one.at_rest
    row = jnp.argmin(squares)
    distance = jnp.sqrt(squares[row])
    along = one.torque[row] + one.gains[row] @ off[row]
    outside = jnp.clip((distance / tube - 1 + EDGE) / (2 * EDGE), 0, 1)
    u = (1 - outside) * along + outside * matched_torque(recovery, one.plant, x)
    friction = -DRY_SHARE * one.dry * jnp.arctan(DRY_KNEE * x[3 - recovery.robot.joint])
    at_top = -one.top_gains @ jnp.append(_from_upright(x), friction)
    u = jnp.where(top_cost(one, x) < TOP_COST / (1 + jnp.abs(one.dry) / TOP_COULOMB), at_top, u)
    return jnp.clip(u, -limit, limit), distance


def top_cost(one: Teachers, x: State) -> Scalar:
    """Cost-to-go of a plant's LQR in a state (rad, rad/s)."""
    error = _from_upright(x)
    return error @ one.cost_to_go @ error


def _from_upright(x: State) -> State:
    error = x - jnp.asarray(UPRIGHT, x.dtype)
    return error.at[:2].set(JAX.nearest(error[:2]))


def matched_torque(policy: PolicyController, plant: Plant, x: State) -> Scalar:
    """The torque (N m) with which a plant moves as nearly as it can as the nominal plant does under a policy.

    One torque has two accelerations to match: least squares.
    """
    driven, limit = jnp.array(policy.robot.actuation, x.dtype), policy.torque_limit
    nominal = single_precision(plant_of(policy))
    wanted = acceleration(nominal, x, policy(None, jnp.zeros(()), x)[1])
    without = acceleration(plant, x, jnp.zeros_like(driven))
    effect = acceleration(plant, x, driven) - without
    return jnp.clip(effect @ (wanted - without) / (effect @ effect), -limit, limit)
