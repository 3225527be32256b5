"""The rows that an identifier learns from, before its low-passes: the regressor at the last angles and torques."""

from typing import Any

from ...plant.equations import Number, Pair
from ...plant.maths import Maths
from ...plant.momentum import momentum_rows
from . import settings as chosen
from .settings import UNKNOWNS
from .state import Array, IdentifierState, Loop


def columns(maths: Maths, loop: Loop, state: IdentifierState, steps: Array, step: Number) -> Array:
    """The newest rows (2, 14): Y, u̇, -v and u, of the last steps (s), in a loop of a period (s)."""
    joint, most = loop.joint, chosen.span(loop.period)
    ages = maths.xp.concatenate([maths.xp.zeros(1, steps.dtype), maths.xp.cumsum(steps)])
    # A slower loop than the nominal one fills the time of a row with fewer steps.
    span = maths.place(maths.clip(most * loop.period / step, 1, most))
    oldest, middle, newest = (maths.numbers(state.angles[place]) for place in (2 * span, span, 0))
    # The torques of a row begin as old as its angles or older: what acted then was asked for before.
    acting = maths.window(state.torques, state.delay_steps, 2 * most)
    peak, whole = (maths.number(ages[place]) for place in (span, 2 * span))
    # ρ of the nominal plant (``plant/momentum.py``): with the unknowns' own the rows would not be linear.
    ratio = maths.xp.asarray(loop.mean[2] / loop.mean[3], steps.dtype)[()]
    shoulder, elbow = momentum_rows(oldest, middle, newest, (whole - peak, peak), loop.geometry, ratio, maths)
    mean, slope = hat_weights(maths.xp, steps, ages, peak, whole)
    torques, rates = maths.numbers(mean.dot(acting)), maths.numbers(slope.dot(acting))
    # A zero of this kind of number, since JAX stacks the rows.
    none = 0.0 * torques[joint]

    def of_one(at: int, value: Number) -> Pair:
        return (value, none) if at == 0 else (none, value)

    # What both joints' rows have of each unknown, in the unknowns' order; last the right side.
    table = [
        *zip(shoulder, elbow, strict=True),
        of_one(joint, rates[joint]),
        of_one(1 - joint, -torques[1 - joint]),
    ]
    if len(loop.mean) > UNKNOWNS:
        table += [of_one(0, none + 1.0), of_one(1, none + 1.0), of_one(0, middle[0]), of_one(1, middle[1])]
    first, second = zip(*table, of_one(joint, torques[joint]), strict=True)
    return maths.vector([*first, *second]).reshape(2, len(loop.mean) + 1)


def hat_weights(xp: Any, steps: Array, ages: Array, newer: Number, whole: Number) -> tuple[Array, Array]:
    """Weights (n,) of the last n torques, newest first: for the hat's mean, and for its mean rate (1/s).

    The torque is held over each step, and the hat is integrated over it. Durations of the steps (s) come newest
    first; ages (n + 1,) are the times from their ends to the newest. The hat's peak is as old as ``newer``, its
    beginning as ``whole``, which are two of the ages. Older torques have no weight.
    """
    hat = xp.maximum(xp.minimum(ages / newer, (whole - ages) / (whole - newer)), 0.0) / (0.5 * whole)
    return 0.5 * (hat[1:] + hat[:-1]) * steps, hat[1:] - hat[:-1]
