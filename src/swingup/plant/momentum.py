"""The equations of motion as a regression on base parameters, from angles alone: no rate and no acceleration.

With the momenta p = M(q) q̇ the equations of motion are

    dp1/dt = G1 + u1 - F1,    dp2/dt = -h sin(q2) q̇1 (q̇1 + q̇2) + G2 + u2 - F2,    h = l1 m2 r2.

Three angles qa, qb, qc, the times h0 and h1 apart, give the rates v0 = (qb - qa)/h0, v1 = (qc - qb)/h1 at the
midpoints. The change of p from one midpoint to the other over (h0 + h1)/2, with the mean of the other terms, is the
discrete Euler-Lagrange equation of Marsden and West (Acta Numerica 10, 2001), second order in h for equal times:

    Y(qa, qb, qc) θ = ∫ w(t) u dt,    w the hat of area 1 over both times, with its peak at qb.

If the measured angles are the true ones plus small offsets o1 and o2, gravity's part of Y θ is too large by
g cos(q1) κ1 in the shoulder's row and by g cos(q1 + q2) κ2 in both, with κ1 = k o1 and κ2 = m2 r2 (o1 + o2): two
more unknowns in which the rows are linear. The elbow's offset also bends the links' coupling, which is too large by
its derivative by q2 times m2 r2 o2 = κ2 - ρ κ1, ρ = m2 r2 / k. The rows take ρ from the nominal plant.

For unequal times the mean of the other terms belongs to (h1 - h0)/4 after qb, the hat to (h1 - h0)/3 after it: the
difference is of either sign and fades in a low-pass.

Y is linear in the second difference of the angles. A low-pass on both sides keeps the equation and removes what
encoders and noise add there. Like ``equations`` this is arithmetic for any kind of number.
"""

from typing import Any, NamedTuple

from .base_parameters import Geometry
from .equations import COULOMB_STEEPNESS, ArrayOps, Number, Pair

CLOSE_RATES = 1e-3
"""Rates closer than this (rad/s) have one arctangent: the mean by the antiderivative would lose its digits."""


def momentum_rows(
    before: Pair, middle: Pair, after: Pair, steps: Pair, geometry: Geometry, ratio: Number, ops: ArrayOps
) -> tuple[Any, Any]:
    """Y (2, 11): the rows of shoulder and elbow: a number for each base parameter, and for κ1 and κ2.

    qa, qb and qc are pairs (q1, q2) (rad), the steps h0 and h1 (s). The ratio is ρ = m2 r2 / k of the nominal
    plant.
    """
    first = _half(before, middle, steps[0], geometry, ops)
    second = _half(middle, after, steps[1], geometry, ops)
    step = 0.5 * (steps[0] + steps[1])  # from midpoint to midpoint
    (v1, v2), (w1, w2) = first.rates, second.rates
    a1, a2 = (w1 - v1) / step, (w2 - v2) / step
    pull1, pull2 = 0.5 * (first.pull1 + second.pull1), 0.5 * (first.pull2 + second.pull2)
    turning = 0.5 * (first.turning + second.turning)
    coupling1 = (second.momentum1 - first.momentum1) / step + pull2
    coupling2 = (second.momentum2 - first.momentum2) / step + turning + pull2
    f1, f2 = mean_arctan(v1, w1, ops), mean_arctan(v2, w2, ops)
    # A zero of this kind of number, since JAX stacks the rows.
    none, gr = 0.0 * v1, geometry.gr
    rotor1, rotor2 = (gr * gr + 1) * a1 - gr * a2, gr * gr * a2 - gr * a1
    slope1, slope2 = 0.5 * (first.slope1 + second.slope1), 0.5 * (first.slope2 + second.slope2)
    bend1 = (second.bend1 - first.bend1) / step
    bend2 = (second.bend2 - first.bend2) / step + 0.5 * (first.bending + second.bending)
    # The elbow's offset acts by κ2 - ρ κ1, so that κ1 and κ2 share the coupling's derivative.
    tilts1, tilts2 = (ratio * bend1 - slope1, -bend1 - slope2), (ratio * bend2, -bend2 - slope2)
    shoulder = a1, a2, coupling1, pull1, 0.5 * (v1 + w1), none, f1, none, rotor1, *tilts1
    elbow = none, a1 + a2, coupling2, none, none, 0.5 * (v2 + w2), none, f2, rotor2, *tilts2
    return shoulder, elbow


def inertial_row(joint: int, acceleration: Pair, cos2: Number, geometry: Geometry) -> tuple[Number, ...]:
    """The part of a joint's row of Y that accelerations (rad/s²) cause, for the base parameters (9,)."""
    (a1, a2), gr, along = acceleration, geometry.gr, geometry.l1 * cos2
    none = 0.0 * a1
    if joint == 0:
        columns, rotor = (a1, a2, along * (2 * a1 + a2)), (gr * gr + 1) * a1 - gr * a2
    else:
        columns, rotor = (none, a1 + a2, along * a1), gr * gr * a2 - gr * a1
    return *columns, none, none, none, none, none, rotor


def mean_arctan(start: Number, end: Number, ops: ArrayOps) -> Number:
    """The mean of arctan(100 v) while a rate v goes straight from start to end (rad/s)."""
    far = abs(end - start) > CLOSE_RATES
    # Both branches are computed, so that neither may divide by 0.
    span = ops.where(far, end - start, 1.0)
    mean = (_antiderivative(end, ops) - _antiderivative(start, ops)) / span
    return ops.where(far, mean, ops.arctan(0.5 * COULOMB_STEEPNESS * (start + end)))


def _antiderivative(rate: Number, ops: ArrayOps) -> Number:
    steep = COULOMB_STEEPNESS * rate
    return rate * ops.arctan(steep) - ops.log1p(steep * steep) / (2 * COULOMB_STEEPNESS)


class _Half(NamedTuple):
    """Half of the equation, at the midpoint of one step."""

    rates: Pair
    momentum1: Number  # p1 / (m2 r2) without the parts of A and B
    momentum2: Number  # the same of p2
    turning: Number  # l1 sin(q2) q̇1 (q̇1 + q̇2)
    pull1: Number  # g sin(q1)
    pull2: Number  # g sin(q1 + q2)
    slope1: Number  # g cos(q1)
    slope2: Number  # g cos(q1 + q2)
    bend1: Number  # ∂ momentum1 / ∂ q2
    bend2: Number  # ∂ momentum2 / ∂ q2
    bending: Number  # ∂ turning / ∂ q2


def _half(start: Pair, end: Pair, step: Number, geometry: Geometry, ops: ArrayOps) -> _Half:
    rate1, rate2 = (end[0] - start[0]) / step, (end[1] - start[1]) / step
    q1, q2 = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
    (sin1, cos1), (sin2, cos2) = ops.sine_cosine(q1), ops.sine_cosine(q2)
    along, across = geometry.l1 * cos2, geometry.l1 * sin2
    return _Half(
        rates=(rate1, rate2),
        momentum1=along * (2 * rate1 + rate2),
        momentum2=along * rate1,
        turning=across * rate1 * (rate1 + rate2),
        pull1=geometry.g * sin1,
        # The addition theorem costs less than another sine.
        pull2=geometry.g * (sin1 * cos2 + cos1 * sin2),
        slope1=geometry.g * cos1,
        slope2=geometry.g * (cos1 * cos2 - sin1 * sin2),
        bend1=-across * (2 * rate1 + rate2),
        bend2=-across * rate1,
        bending=along * rate1 * (rate1 + rate2),
    )
