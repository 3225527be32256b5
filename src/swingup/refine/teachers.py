"""Plants to learn on, about the leaderboards' and the robot's, and a teacher for each: a torque in any state.

Near its plant's optimal swing-up a teacher follows the nearest row of that swing-up with its feedback gains: no
time enters. At the top it is the plant's LQR. Elsewhere a policy that recovers on the nominal plant acts, with its
torque changed so that the plant moves as the nominal one would.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..benchmark.robustness_board import MODEL_SWEEPS
from ..common.errors import SwingupError
from ..common.types import Key, Scalar, State
from ..controllers.baselines.continuation import ContinuationSettings, SwingUps, continue_swingups, nominal_swingups
from ..controllers.baselines.upright import passive_friction
from ..controllers.stack.estimator import JAX
from ..controllers.stack.policy import PolicyController, plant_of
from ..dynamics.dynamics import UPRIGHT, acceleration, upright_error
from ..loop.domain import Domain
from ..loop.draw import draw_values
from ..plant.base_parameters import base_parameters
from ..plant.plant import LEADERBOARD, NAMES, Plant, Robot, validated
from ..plant.units import C1, TORQUE, Scales, arm_scales, scaled, scales_of, similar_plant
from ..policy.regulator import fixed_point, near_the_top
from .gradient import single_precision

GEAR = LEADERBOARD.gr  # gear ratio of the motors of design C.1
SHARE, FRICTION_SHARE = 0.5, 0.35
"""Shares of the ranges about the nominal values, where all parameters are off: alone, and beside friction."""
MARGIN, ROBOT_MARGIN = 0.03, 0.1
"""Parts of a range by which draws may lie beyond it: a single parameter or the friction, and the robot's plants.
The fits of single sessions lie at corners of the domain's ranges, and beyond."""
RESIDUAL_FRICTION = {"b1": 0.004, "b2": 0.004, "cf1": 0.04, "cf2": 0.04}
"""Maximum friction left after compensation, on the recorded robot (N m s/rad, N m)."""
MAX_OVERCOMPENSATION = 0.5  # Compensation exceeds the friction by at most this fraction of what it may leave
RESIDUAL_SHARE = 0.24
"""Share of larger frictions that compensation leaves; the recorded robot's frictions use ``RESIDUAL_FRICTION``."""
MAX_ROTOR = 3e-4
"""Maximum inertia of a rotor of the robot's plants behind that gear (kg m²): one session's fit has 2.8e-4, beyond
the domain."""
ROTORS = 4
"""Every fourth of the robot's plants has any rotor up to that, the others have those of the domain. Recordings
determine the sum of a rotor's and the upper link's inertia best: what a rotor gains, the link loses."""

ROW_STRIDE = 4  # the nearest row of a swing-up is sought among every fourth one: they are 8 ms apart
DISTANCE_WEIGHTS = (1.0, 1.0, 0.12, 0.12)
"""Weights of errors in a distance (1, s): a velocity of 1 rad/s is as far as an angle of 0.12 rad."""
TUBE = 0.5  # distance from a plant's swing-up within which the swing-up teaches
TUBE_EDGE = 0.2  # the teachers change over between this share below and above the tube's radius
TOP_COST = 1.5
"""Cost-to-go of the LQR below which it teaches. With 0.5 more than a third of the acrobot's robot plants fell from
the top once under weak noise of the torques, with this a fifth."""
TOP_COULOMB = 0.1  # Coulomb friction of the undriven joint (N m) that halves TOP_COST
ARRIVED_COST = 0.5  # cost-to-go where swing-ups end: their rows from there on do not teach
EXCLUDED = 1e6  # added to the squared distances from rows that do not teach


@dataclass(frozen=True)
class PlantDraws:
    """How many plants of each kind are drawn."""

    single: int  # Plants with one parameter off, anywhere in its range
    joint: int  # Plants with all parameters off, each within SHARE of its range
    friction: int
    """The passive joint has friction, up to the end of its range: Coulomb friction in two of three, damping in the
    third. In half of them all parameters are off as well, each within ``FRICTION_SHARE`` of its range."""
    robot: int
    """Plants of the recorded robot, with what the compensation leaves of its friction. Everything in the plant is
    heavier by what the motor does not deliver."""


def draw_plants(
    random: np.random.Generator, robot: Robot, draws: PlantDraws, nominal: Plant, domain: Domain
) -> Plant:
    """Plants with leaves of shape (n,): single ones, joint ones, those with friction, the robot's, in this order.

    The nominal plant, in C.1's units, is what all but the robot's are about; the robot's are of the domain.
    """
    nominal, names = nominal.driven(robot), list(MODEL_SWEEPS)

    def single(_: int) -> Plant:
        sweep = MODEL_SWEEPS[names[random.integers(len(names))]]
        low, high = sweep.sweep.low, sweep.sweep.high
        margin = MARGIN * (high - low)
        # A range that begins at 0 ends there: a rotor's inertia is never negative.
        return sweep.varied(nominal, random.uniform(low - margin if low else low, high + margin))

    def joint(_: int) -> Plant:
        return _all_off(random, nominal, SHARE)

    def with_friction(index: int) -> Plant:
        # Friction where no motor acts is what fails most.
        name = f"{'b' if index % 3 == 2 else 'cf'}{2 - robot.joint}"
        sweep = MODEL_SWEEPS[name]
        plant = nominal if index % 2 else _all_off(random, nominal, FRICTION_SHARE)
        maximum = sweep.sweep.high * (1 + MARGIN)
        return sweep.varied(plant, random.uniform(0.0, maximum) - getattr(plant, name))

    def of_robot(index: int) -> Plant:
        plant = _of_robot(random, robot, domain, nominal)
        if (index + 1) % ROTORS:
            return plant
        rotor = random.uniform(0.0, MAX_ROTOR * (GEAR / plant.gr) ** 2)
        return replace(plant, Ir=rotor, I1=plant.I1 + plant.gr**2 * (plant.Ir - rotor))

    kinds = ((single, draws.single), (joint, draws.joint), (with_friction, draws.friction), (of_robot, draws.robot))
    return batch_of([_pendulum(kind, index) for kind, number in kinds for index in range(number)])


def batch_of(plants: Sequence[Plant]) -> Plant:
    """Plants in one, leaves of shape (n,)."""
    leaves: dict[str, Any] = {name: np.array([getattr(plant, name) for plant in plants]) for name in NAMES}
    return Plant(**leaves)


def plants_of(batch: Plant) -> list[Plant]:
    """The plants of a batch, leaves of shape (n,), one by one."""
    return [Plant(*values) for values in zip(*(getattr(batch, name).tolist() for name in NAMES), strict=True)]


def _pendulum(kind: Callable[[int], Plant], index: int) -> Plant:
    # The first draw that is a pendulum: with a mass matrix as nearly singular as B.0's, some draws are not.
    while True:
        plant = kind(index)
        with suppress(SwingupError):
            return validated(plant)


def _all_off(random: np.random.Generator, nominal: Plant, share: float) -> Plant:
    plant = nominal
    for sweep in MODEL_SWEEPS.values():
        middle = 1.0 if sweep.relative else 0.0
        drawn = middle + share * (random.uniform(sweep.sweep.low, sweep.sweep.high) - middle)
        plant = sweep.varied(plant, drawn)
    return plant


def _of_robot(random: np.random.Generator, robot: Robot, domain: Domain, nominal: Plant) -> Plant:
    with jax.enable_x64(True):
        drawn = jax.tree.map(float, _draw_values(domain, draw_key(random), ROBOT_MARGIN))
    scales = arm_scales(domain.design.driven(robot))
    left = {name: random.uniform(*ends) for name, ends in _residual_friction(robot, domain, scales).items()}
    plant = similar_plant(drawn.plant, scales).changed(**left, tl1=nominal.tl1, tl2=nominal.tl2)
    return behind_motor(plant, getattr(drawn.loop, f"gain{robot.joint + 1}"))


_draw_values = jax.jit(draw_values, static_argnums=(0, 2))


def draw_key(random: np.random.Generator) -> Key:
    """JAX's key for the next random numbers."""
    return jax.random.key(int(random.integers(2**31)))


def behind_motor(plant: Plant, gain: float) -> Plant:
    """What a motor that delivers this part of its command moves as if it were: a heavier plant."""
    return replace(plant, **{name: getattr(plant, name) / gain for name in ("m1", "m2", "I1", "I2", "Ir")})


def _residual_friction(robot: Robot, domain: Domain, scales: Scales) -> dict[str, tuple[float, float]]:
    # Ranges in C.1's units. Where no motor acts on the passive joint, all of its friction is left.
    other = 2 - robot.joint
    coulomb, damping, limit = f"cf{other}", f"b{other}", scales.similar(domain.low.passive_limit(robot), TORQUE)
    maximum = {name: getattr(similar_plant(domain.high.plant, scales), name) for name in (coulomb, damping)}
    share, over = (RESIDUAL_SHARE, MAX_OVERCOMPENSATION) if limit else (1.0, 0.0)
    left = {name: max(RESIDUAL_FRICTION[name], share * value) for name, value in maximum.items()}
    # The motor cannot compensate more than its limit.
    left[coulomb] = max(left[coulomb], maximum[coulomb] - limit)
    ends = {name: (-MAX_OVERCOMPENSATION * value, value) for name, value in RESIDUAL_FRICTION.items()}
    return ends | {name: (-over * value, value) for name, value in left.items()}


class Teachers(eqx.Module):
    """A teacher for each of n plants, in single precision."""

    plant: Plant  # leaves of shape (n,)
    base: Float[Array, "n 9"]  # base parameters of the plants
    nominal: Float[Array, "n 9"]  # base parameters of the nominal plant
    states: Float[Array, "n rows 4"]  # swing-ups (rad, rad/s)
    excluded: Float[Array, "n rows"]  # EXCLUDED where a swing-up is over, else 0
    torque: Float[Array, "n rows"]  # N m
    gains: Float[Array, "n rows 4"]  # K of u + K (x - x_i) (N m/rad, N m s/rad)
    top_gains: Float[Array, "n 5"]  # K of u = -K [e, f], as of the regulator
    coulomb: Float[Array, "n"]  # Coulomb friction of the undriven joint (N m)
    dry_torque: Float[Array, "n"]  # torque that it counts as at the top (N m), times arctan(knee q̇)
    dry_knee: Float[Array, "n"]  # that knee (s/rad)
    cost_to_go: Float[Array, "n 4 4"]  # P of eᵀ P e

    @property
    def number(self) -> int:
        """Number of plants."""
        return len(self.torque)


class TrainingSet(NamedTuple):
    """Teachers for plants about a nominal one, and the policy that recovers from anywhere on that one."""

    teachers: Teachers
    recovery: PolicyController  # In single precision, in C.1's units; its plant is the nominal one


def make_training_set(
    recovery: PolicyController, targets: Plant, copies: int, progress: Callable[[int, int], None] = lambda *_: None
) -> TrainingSet:
    """Teachers for drawn plants, as far as their swing-ups are reached, and several for the nominal one.

    The policy that recovers and the drawn plants, with leaves of shape (n,), are in C.1's units. ``progress`` is
    called with the number of swing-ups that are done, and of all.
    """
    robot, nominal = recovery.robot, plant_of(recovery)
    # The continuation's settings suit swing-ups of the same duration in T.
    own = scales_of(nominal)
    begin = similar_plant(nominal, own)
    if begin.values() == LEADERBOARD.driven(robot).values():
        begin = LEADERBOARD  # whose swing-up is shipped
    found = continue_swingups(robot, similar_plant(targets, own), progress=progress, nominal=begin)
    more = nominal_swingups(robot, copies, ContinuationSettings(), begin)
    both: SwingUps = jax.tree.map(lambda *parts: np.concatenate(parts), found, more)
    swingups = replace(scaled(both, own), plants=similar_plant(both.plants, C1.over(own)))
    return TrainingSet(make_teachers(swingups, nominal), single_precision(recovery))


def make_teachers(swingups: SwingUps, nominal: Plant = LEADERBOARD) -> Teachers:
    """Teachers for the plants that the swing-ups are of, about a nominal one."""
    plants = [validated(plant) for plant in plants_of(swingups.plants)]
    held = [fixed_point(plant, swingups.robot.joint) for plant in plants]
    cost_to_go, gains = np.stack([P[:4, :4] for P, _ in held]), np.stack([K for _, K in held])
    coulomb = np.array([passive_friction(plant, swingups.robot) for plant in plants])
    dry = np.array([near_the_top(plant, swingups.robot.joint)[1:3] for plant in plants])
    centre = base_parameters(nominal.driven(swingups.robot))
    bases = np.stack([base_parameters(plant) for plant in plants])
    states = swingups.states[:, :-1:ROW_STRIDE]
    errors = upright_error(states)
    costs = np.einsum("nri,nij,nrj->nr", errors, cost_to_go, errors)
    excluded = np.where(costs < ARRIVED_COST, EXCLUDED, 0.0)
    rows = states, excluded, swingups.torque[:, ::ROW_STRIDE], swingups.gains[:, ::ROW_STRIDE]
    arrays = bases, np.tile(centre, (len(bases), 1)), *rows, gains, coulomb, *dry.T, cost_to_go
    teachers: Teachers = single_precision(Teachers(swingups.plants, *arrays))
    return teachers


def teacher_torque(one: Teachers, recovery: PolicyController, x: State) -> tuple[Scalar, Scalar]:
    """One plant's teacher: its torque (N m) in a state (rad, rad/s), and the distance from the plant's swing-up."""
    limit = recovery.torque_limit
    off = x - one.states
    off = off.at[:, :2].set(JAX.nearest(off[:, :2]))
    squares = jnp.sum((off * jnp.array(DISTANCE_WEIGHTS, x.dtype)) ** 2, axis=1) + one.excluded
    row = jnp.argmin(squares)
    distance = jnp.sqrt(squares[row])
    along = one.torque[row] + one.gains[row] @ off[row]
    outside = jnp.clip((distance / TUBE - 1 + TUBE_EDGE) / (2 * TUBE_EDGE), 0, 1)
    u = (1 - outside) * along + outside * matched_torque(recovery, one.plant, x)
    friction = -one.dry_torque * jnp.arctan(one.dry_knee * x[3 - recovery.robot.joint])
    at_top = -one.top_gains @ jnp.append(_from_upright(x), friction)
    u = jnp.where(top_cost(one, x) < TOP_COST / (1 + jnp.abs(one.coulomb) / TOP_COULOMB), at_top, u)
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
