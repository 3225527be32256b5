"""A regulator that takes over from a policy near the top, for the plant as it is known now, in Python.

``upright`` has the linear equations e ← A e + b u of a step h, e = (q1 - π, q2, q̇1, q̇2) with angles to the nearest
turn, for the plant's base parameters θ: the file's plant, or what an identifier tells. With Q = h diag(q), R = h r
each call does a few steps of the Riccati equation's recursion,

    P ← Q + Aᵀ P A - (Aᵀ P b)(Aᵀ P b)ᵀ / (R + bᵀ P b),

so that the cost-to-go P follows θ within a tenth of a second. P starts at the fixed point for the file's plant, and
starts again if it is not finite. Neither time nor the number of calls enters.

Dry friction of the undriven joint would make it hunt in growing cycles. It counts twice (``dry_friction``): as
damping, and as a torque f that stays as it is now, with f as a fifth error, with its row and column in A and P:
e ← A e + d f + b u. What f² alone costs has no bound and moves no torque: that entry of P stays 0.

At one damping d* of the undriven joint u does not move the growing motion e^λt, λ² = Γ12 / M12, with gravity's
slopes Γ and masses M upright: gains grow without bound towards it, and all four have the other sign beyond. Dry
friction cf acts as more damping than d* while the joint is slower than some 2 cf / d*, and as less while it is
faster. So strong friction has two designs: one below d* far from the top, which catches the pendulum, and one
beyond d* near the top, which brings it to rest, where the first would keep it swinging by a third of a radian.

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
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from ..common.errors import SwingupError
from ..common.riccati import solve_riccati
from ..common.settings import Range, Settings
from ..plant.base_parameters import Geometry, base_parameters, friction_of, geometry_of, lumped
from ..plant.equations import NUMPY, ArrayOps, Friction, Lumped, Number, Pair, mass_entries
from ..plant.plant import Plant
from ..plant.units import C1, TORQUE, arm_scales, scaled, similar_plant

STATE_WEIGHTS = (1.0, 1.0, 0.1, 0.1)
"""q, of the errors of q1, q2 (1/rad²), dq1 and dq2 (s²/rad²) in the costs ∫ eᵀ diag(q) e + r u² dt."""
TORQUE_WEIGHT = 1.0  # r (1/N²m²)
COULOMB_DAMPING = 0.012
"""Weak Coulomb friction cf (N m) counts as damping cf + cf² / this (N m s/rad), one that drives, below 0, as cf."""
WEAK = (0.7, 10.0)
"""The undriven joint's counts besides as a torque that stays, share · cf arctan(knee q̇): share, and knee (s/rad).
With damping of cf alone and half of the torque it fells half of the acrobots that have it (``lab/adaptive.md``)."""
STRONG = 1.0 / 3.0
"""Friction of the undriven joint is strong above this share of d* (times 1 rad/s). Below it the loop's delay and
the estimate's errors decide, and the law of weak friction was chosen in that loop."""
NEAR_DAMPING, NEAR = 3.0, (1.0, 20.0)
"""Near the top strong friction counts as this multiple of d*, and with this share and knee."""
FAR_DAMPING, FAR = 0.4, (0.5, 8.0)
"""Damping, share and knee far from the top. Friction above d* has no such design: none that was tried catches."""
FAR_ABOVE, NEAR_BELOW = 1.0, 0.3  # Costs-to-go above and below which the two designs change over
TINY = 1e-12  # Least square of a denominator
RICCATI_STEP = 0.005  # Step h of the recursion (s)
RICCATI_STEPS = 4  # Steps of the recursion at each call
Q, R = tuple(RICCATI_STEP * weight for weight in STATE_WEIGHTS), RICCATI_STEP * TORQUE_WEIGHT
"""h q and h r: Q's diagonal and R of one step."""


@dataclass(frozen=True)
class RegulatorSettings(Settings):
    """Where the regulator acts."""

    PART: ClassVar[str] = "regulator"
    enter: Annotated[float, Range(1e-6, 1e6)] = 1.0
    """The regulator takes over where its cost-to-go eᵀPe is below this."""
    leave: Annotated[float, Range(1e-6, 1e6)] = 10.0
    """The policy takes over where the cost-to-go is above this."""
    enter_coulomb: Annotated[float, Range(1e-12, 1e12), TORQUE] = 1e6
    """Coulomb friction of the undriven joint (N m) that halves ``enter``."""
    leave_coulomb: Annotated[float, Range(1e-12, 1e12), TORQUE] = 1e6
    """Coulomb friction (N m) that halves the distance between ``enter`` and ``leave``."""

    def __post_init__(self) -> None:
        super().__post_init__()
        # Else it would give up as soon as it has taken over.
        if self.leave < self.enter:
            raise SwingupError(
                f"regulator setting leave = {self.leave:g} is below enter = {self.enter:g}: use one from there on"
            )


def fixed_point(plant: Plant, driven: int) -> tuple[np.ndarray, np.ndarray]:
    """The cost-to-go P (5, 5) of [e, f] at which the recursion for a plant stays, and K (5,) of u = -K [e, f].

    Of two designs it is the one near the top.
    """
    lumps = lumped(base_parameters(plant), geometry_of(plant))
    a, d, b = map(np.array, upright_step(lumps, driven, near_the_top(plant, driven).damping))
    with np.errstate(all="ignore"):
        try:
            found = np.pad(solve_riccati(a, np.outer(b, b) / R, np.diag(Q)), (0, 1))
            P = found[:4, :4]
            weight = R + b @ P @ b
            gains = b @ P @ a / weight
            closed = a - np.outer(b, gains)
            found[:4, 4] = found[4, :4] = np.linalg.solve(np.eye(4) - closed.T, closed.T @ P @ d)
            against = b @ (P @ d + found[:4, 4]) / weight
        except np.linalg.LinAlgError:
            # Both ways in which a plant has no fixed point get the same sentence.
            found = np.full((5, 5), np.nan)
    if not np.isfinite(found).all():
        raise SwingupError("the regulator cannot hold its plant upright: correct the plant, or leave it out")
    return found, np.append(gains, against)


class DryFriction(NamedTuple):
    """How the undriven joint's Coulomb friction counts."""

    damping: Pair  # Damping of both joints, b and what Coulomb friction counts as (N m s/rad)
    torque: Number  # Share of the friction times the friction (N m); the torque is -torque · arctan(knee q̇)
    knee: Number  # s/rad
    two: Any  # Whether there are two designs, near the top and far from it


def dry_friction(ops: ArrayOps, plant: Lumped, friction: Friction, driven: int, far: Any) -> DryFriction:
    """What the friction of a plant counts as, far from the top or near it."""
    (b1, b2), (cf1, cf2) = friction
    # (cf + |cf|) cf is 2 cf² for friction that resists, and 0 for one that drives.
    damping1 = b1 + cf1 + (cf1 + abs(cf1)) * cf1 / (2.0 * COULOMB_DAMPING)
    damping2 = b2 + cf2 + (cf2 + abs(cf2)) * cf2 / (2.0 * COULOMB_DAMPING)
    m11, m12, m22 = mass_entries(plant, 1.0)
    gravity = plant.gravity2
    b, cf, slope, mass = (b1, cf1, plant.gravity1 + gravity, m11) if driven else (b2, cf2, gravity, m22)
    # d* = (Γ_jj - M_jj λ²) / λ of the undriven joint j, less its damping. Where it is not positive, no damping
    # takes the control.
    lost = (slope * m12 - mass * gravity) / ops.root(ops.maximum(gravity * m12, TINY)) - b
    strong = (lost > 0.0) & (cf > STRONG * lost)
    two = strong & (cf < lost)
    far = far & two
    where = ops.where
    counted = b + lost * where(far, FAR_DAMPING, NEAR_DAMPING)
    damping = (
        (where(strong, counted, damping1), damping2) if driven else (damping1, where(strong, counted, damping2))
    )
    share = where(far, FAR[0], where(strong, NEAR[0], WEAK[0]))
    knee = where(far, FAR[1], where(strong, NEAR[1], WEAK[1]))
    return DryFriction(damping, share * cf, knee, two)


def near_the_top(plant: Plant, driven: int) -> DryFriction:
    """What the friction of a plant counts as near the top."""
    theta = base_parameters(plant).tolist()
    return dry_friction(NUMPY, lumped(theta, geometry_of(plant)), friction_of(theta), driven, False)


class Discrete(NamedTuple):
    """e ← A e + d f + b u over one step."""

    a: tuple[tuple[Number, ...], ...]  # Rows of A (4, 4)
    d: tuple[Number, ...]  # (4,), of a torque f on the undriven joint
    b: tuple[Number, ...]  # (4,), of the torque u on the driven joint


def upright_step(plant: Lumped, driven: int, damping: Pair) -> Discrete:
    """A = I + h A_c + h² A_c² / 2, b = h b_c + h² A_c b_c / 2 and d, alike, of the linear equations.

    The plant's mass matrix is positive definite; ``damping`` is that of both joints (N m s/rad).
    """
    (damping1, damping2), h = damping, RICCATI_STEP
    m11, m12, m22 = mass_entries(plant, 1.0)
    scale = 1.0 / (m11 * m22 - m12 * m12)
    i11, i12, i22 = m22 * scale, -m12 * scale, m11 * scale
    # A_c = [[0, I], [X, Y]] with X = M⁻¹ G and Y = -M⁻¹ D; b_c = [0, w].
    second, first = plant.gravity2, plant.gravity1 + plant.gravity2
    x11, x12 = i11 * first + i12 * second, (i11 + i12) * second
    x21, x22 = i12 * first + i22 * second, (i12 + i22) * second
    y11, y12, y21, y22 = -i11 * damping1, -i12 * damping2, -i12 * damping1, -i22 * damping2
    s = 0.5 * h * h
    # The lower rows are those of I + h A_c, and of h²/2 times A_c² = [[X, Y], [Y X, X + Y²]].
    rates1 = (
        h * x11 + s * (y11 * x11 + y12 * x21),
        h * x12 + s * (y11 * x12 + y12 * x22),
        1.0 + h * y11 + s * (x11 + y11 * y11 + y12 * y21),
        h * y12 + s * (x12 + y11 * y12 + y12 * y22),
    )
    rates2 = (
        h * x21 + s * (y21 * x11 + y22 * x21),
        h * x22 + s * (y21 * x12 + y22 * x22),
        h * y21 + s * (x21 + y21 * y11 + y22 * y21),
        1.0 + h * y22 + s * (x22 + y21 * y12 + y22 * y22),
    )
    angles1, angles2 = (
        (1.0 + s * x11, s * x12, h + s * y11, s * y12),
        (s * x21, 1.0 + s * x22, s * y21, h + s * y22),
    )
    moved = [
        (s * w1, s * w2, h * w1 + s * (y11 * w1 + y12 * w2), h * w2 + s * (y21 * w1 + y22 * w2))
        for w1, w2 in ((i11, i12), (i12, i22))
    ]
    return Discrete((angles1, angles2, rates1, rates2), moved[1 - driven], moved[driven])


class RegulatorState(NamedTuple):
    """What is remembered from call to call."""

    cost_to_go: Any  # P, as the loop keeps it
    acting: Any  # Whether the regulator acts
    far: Any  # Whether the state is far from the top: which of two designs counts, where friction has two


class Held(NamedTuple):
    """The plant that is held."""

    lumps: Lumped  # θ as the equations of motion have it
    step: Any  # A, d and b: Discrete, or what the loop makes of it
    dry: DryFriction  # How the undriven joint's Coulomb friction counts
    enter: Number  # Cost-to-go below which the regulator takes over
    leave: Number  # Cost-to-go above which it gives up


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
    return RegulatorState(maths.xp.asarray(loop.start), maths.xp.array(False), maths.xp.array(False))


def held(maths: ArrayOps, loop: Loop, theta: Any, far: Any) -> Held:
    """What to hold for base parameters θ (9,), far from the top or near it (``RegulatorState.far``)."""
    plant, friction = lumped(theta, loop.geometry), friction_of(theta)
    dry = dry_friction(maths, plant, friction, loop.joint, far)
    step = upright_step(plant, loop.joint, dry.damping)
    s, coulomb = loop.settings, friction.coulomb[1 - loop.joint]
    # Dry friction of the undriven joint makes a linear regulator hunt about the top in growing cycles.
    enter = s.enter / (1.0 + abs(coulomb) / s.enter_coulomb)
    leave = enter + (s.leave - s.enter) / (1.0 + abs(coulomb) / s.leave_coulomb)
    return Held(plant, step, dry, enter, leave)


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
    friction = -plant.dry.torque * maths.arctan(plant.dry.knee * maths.numbers(x)[3 - loop.joint])
    torque = maths.clip(loop.command(P, plant.step, (*e, friction)), -limit, limit)
    # The clip would make an infinite rate the largest torque.
    torque = maths.where(finite, torque, math.nan)
    far = maths.where(state.far, cost > NEAR_BELOW, cost > FAR_ABOVE) & plant.dry.two
    acting, far = (maths.where(finite, *each) for each in ((within, state.acting), (far, state.far)))
    return RegulatorState(P, acting, far), torque


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
