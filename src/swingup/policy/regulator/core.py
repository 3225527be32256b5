"""A regulator that takes over from a policy near the top, for the plant as it is known now, in Python.

``upright`` has the linear equations e ← A e + b u of a step h, e = (q1 - π, q2, q̇1, q̇2) with angles to the nearest
turn, for the plant's base parameters θ: the file's plant, or what an identifier tells. With Q = h diag(q), R = h r
each call does a few steps of the Riccati equation's recursion,

    P ← Q + Aᵀ P A - (Aᵀ P b)(Aᵀ P b)ᵀ / (R + bᵀ P b),

so that the cost-to-go P follows θ within a tenth of a second. P starts at the fixed point for the file's plant, and
starts again if it is not finite. Neither time nor the number of calls enters.

Dry friction of the undriven joint would make it hunt in growing cycles. It counts as a torque f that stays as it is
now, and f as a fifth error, with its row and column in A and P: e ← A e + d f + b u. What f² alone costs has no
bound and moves no torque: that entry of P stays 0.

The regulator takes over where eᵀ P e is below a first bound, and acts while it is at most a second one
(``held``) and gravity pushes the undriven joint outwards; a state that is not finite changes nothing. Its torque is
u = -K e within the limit, K = bᵀ P A / (R + bᵀ P b), and NaN if the state is not finite.

Far from upright e is replaced by the errors (``as_if_linear``) with which the linear plant would have the same
angle and rate of the driven joint, and of the undriven one the same momentum and torque of gravity. An
acrobot's motor changes this momentum through gravity alone, so that these numbers tell how far it falls: it bears
0.1 N m s at its shoulder in place of 0.04.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ...plant.base_parameters import Geometry, friction_of, geometry_of, lumped
from ...plant.equations import ArrayOps, Lumped, Number, mass_entries
from ...plant.plant import Plant
from ...plant.units import C1, TORQUE, arm_scales, scaled, similar_plant
from .settings import COULOMB_DAMPING, DRY_KNEE, DRY_SHARE, RICCATI_STEP, RegulatorSettings, fixed_point
from .upright import Discrete, upright_step


class RegulatorState(NamedTuple):
    """What is remembered from call to call."""

    cost_to_go: Any
    """P, as the loop keeps it."""
    acting: Any
    """Whether the regulator acts."""


class Held(NamedTuple):
    """The plant that is held."""

    lumps: Lumped
    """θ as the equations of motion have it."""
    step: Any
    """A, d and b: ``Discrete``, or what the loop makes of it."""
    dry: Number
    """What counts of the undriven joint's Coulomb friction (N m)."""
    enter: Number
    """Cost-to-go below which the regulator takes over."""
    leave: Number
    """Cost-to-go above which it gives up."""


class Loop(NamedTuple):
    """What a regulator knows, and products of small matrices as they are fast for a kind of number."""

    settings: RegulatorSettings
    geometry: Geometry
    """What is known of the plant besides θ."""
    joint: int
    """Index of the driven joint."""
    torque_limit: float
    """Largest torque (N m)."""
    start: Any
    """P at first."""
    advanced: Callable[[Any, Any], Any]
    """P after the steps of one call, from P and the held step."""
    cost: Callable[[Any, tuple[Number, ...]], Number]
    """The cost-to-go eᵀ P e, from P and e, without f."""
    command: Callable[[Any, Any, tuple[Number, ...]], Number]
    """The torque -K [e, f] (N m), from P, the held step, and e with f."""


def make_loop(
    settings: RegulatorSettings,
    plant: Plant,
    joint: int,
    limit: float,
    pack: Callable[[np.ndarray], Any],
    *products: Any,
) -> Loop:
    """What a regulator knows of a plant, in C.1's units.

    ``pack`` keeps P (5, 5) as the loop does, whose last entries are the products.
    """
    scales = arm_scales(plant)
    own, plant = scaled(settings, C1.over(scales)), similar_plant(plant, scales)
    start = pack(fixed_point(plant, joint)[0])
    return Loop(own, geometry_of(plant), joint, scales.similar(limit, TORQUE), start, *products)


def begin(maths: ArrayOps, loop: Loop) -> RegulatorState:
    """The policy acts."""
    return RegulatorState(maths.xp.asarray(loop.start), maths.xp.array(False))


def held(loop: Loop, theta: Any) -> Held:
    """What to hold for base parameters θ (9,)."""
    step: Discrete = upright_step(theta, loop.geometry, loop.joint, COULOMB_DAMPING, RICCATI_STEP)
    s, coulomb = loop.settings, friction_of(theta).coulomb[1 - loop.joint]
    # Dry friction of the undriven joint makes a linear regulator hunt about the top in growing cycles.
    enter = s.enter / (1.0 + abs(coulomb) / s.enter_coulomb)
    leave = enter + (s.leave - s.enter) / (1.0 + abs(coulomb) / s.leave_coulomb)
    return Held(lumped(theta, loop.geometry), step, DRY_SHARE * coulomb, enter, leave)


def regulate(
    maths: ArrayOps, loop: Loop, state: RegulatorState, plant: Held, x: Any
) -> tuple[RegulatorState, Number]:
    """The torque (N m) for a state x (4,), of meaning while the regulator acts."""
    # It follows the plant also while the policy acts, so that it can take over at once.
    P = loop.advanced(state.cost_to_go, plant.step)
    P = maths.choose(maths.finite(P), lambda: P, maths.xp.asarray(loop.start, P.dtype))
    e, outwards = as_if_linear(maths, plant.lumps, loop.joint, x)
    cost, finite, limit = loop.cost(P, e), maths.finite(x), loop.torque_limit
    within = maths.where(state.acting, cost <= plant.leave, cost < plant.enter) & (outwards > 0.0)
    friction = -plant.dry * maths.arctan(DRY_KNEE * maths.numbers(x)[3 - loop.joint])
    torque = maths.clip(loop.command(P, plant.step, (*e, friction)), -limit, limit)
    # The clip would make an infinite rate the largest torque.
    torque = maths.where(finite, torque, math.nan)
    return RegulatorState(P, maths.where(finite, within, state.acting)), torque


def as_if_linear(maths: ArrayOps, plant: Lumped, driven: int, x: Any) -> tuple[tuple[Number, ...], Number]:
    """The errors (rad, rad/s) with which a linear plant has the pendulum's numbers, and gravity's slope (N m/rad).

    The numbers in a state x (4,) are the driven joint's angle and rate, and the undriven one's momentum and torque
    of gravity.
    """
    q1, q2, *rates = maths.numbers(x)
    angles, undriven = [maths.nearest(q1 - math.pi), maths.nearest(q2)], 1 - driven
    (sin1, cos1), (sin12, cos12) = maths.sine_cosine(angles[0]), maths.sine_cosine(angles[0] + angles[1])
    # Gravity's torque on the elbow is that on link 2; on the shoulder it is that on both links.
    first, second = (0.0 if undriven else plant.gravity1), plant.gravity2
    straight, bent = mass_entries(plant, 1.0), mass_entries(plant, maths.sine_cosine(angles[1])[1])
    of_driven, of_undriven = ((first + second, second)[joint] for joint in (driven, undriven))
    angles[undriven] = (first * sin1 + second * sin12 - of_driven * angles[driven]) / of_undriven
    momentum = bent[2 * undriven] * rates[undriven] + bent[1] * rates[driven]
    rates[undriven] = (momentum - straight[1] * rates[driven]) / straight[2 * undriven]
    return (*angles, *rates), first * cos1 + second * cos12
