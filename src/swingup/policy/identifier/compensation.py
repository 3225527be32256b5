"""Compensation of the friction and the load that an identifier finds: what the motors are commanded, what is left.

The driven motor delivers its command: the estimator counts that torque, and the policy is told the rest. The
identifier estimates which share of its command the undriven joint's motor delivers, 0 where that motor is dead.
This motor's torque therefore belongs to the plant.
"""

from typing import Any, NamedTuple

from ...plant.equations import Friction, Lumped, Number, Pair

LEAST_GAIN = 0.6
"""The undriven joint's motor is asked for as much as if it delivered at least this share."""


class Load(NamedTuple):
    """Torques c + k q against both joints: of cables, of springs."""

    constant: Pair
    """c (N m)."""
    spring: Pair
    """k (N m/rad)."""

    def at(self, q1: Any, q2: Any) -> Pair:
        """The torques (N m) at angles (rad)."""
        return self.constant[0] + self.spring[0] * q1, self.constant[1] + self.spring[1] * q2


class Model(NamedTuple):
    """A plant to predict with, its friction if it has any, and the load on its joints if there is any."""

    plant: Lumped
    friction: Friction | None
    load: Load | None


class Compensation(NamedTuple):
    """Parts of a :class:`Friction` or a :class:`Load`."""

    commanded: Any
    """What the motors are commanded; never negative friction."""
    residual: Any
    """What remains; negative friction is not compensated."""
    predicted: Any
    """What to predict with: all of the driven joint's, whose torque is counted, and what is left of the other's.
    Negative friction counts as zero: the implicit step near rest would be singular with it."""


def compensation(found: Any, gain: Number, joint: int, passive_limit: float, maximum: Any) -> Compensation:
    """Share out what is found. Arithmetic for any kind of number.

    The gain is the part of its command that the undriven joint's motor delivers, in units of what the driven one
    does. Its compensation is at most ``passive_limit`` (N m), 0 for none.
    """
    kind, delivered = type(found), maximum(gain, 0.0)
    # A weak motor's command must not grow without bound: what it does not deliver stays in the plant.
    factor = 1.0 / maximum(delivered, LEAST_GAIN) if passive_limit else 0.0
    parts = []
    for values in found:
        commanded, residual, predicted = [], [], []
        for index, value in enumerate(values):
            # The gain counts in units of the driven motor's, whose own is 1 therefore.
            share, part = (1.0, 1.0) if index == joint else (factor, delivered)
            commanded.append(share * (maximum(value, 0.0) if kind is Friction else value))
            residual.append(value - part * commanded[index])
            # The estimator adds the driven motor's whole command, so that its model must hold the whole friction.
            seen = value if index == joint else residual[index]
            predicted.append(maximum(seen, 0.0) if kind is Friction else seen)
        parts.append((tuple(commanded), tuple(residual), tuple(predicted)))
    return Compensation(*(kind(*pairs) for pairs in zip(*parts, strict=True)))
