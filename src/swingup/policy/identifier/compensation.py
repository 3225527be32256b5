"""Compensation of the friction that an identifier finds: what the motors are asked for, and what is left.

The driven motor delivers what it is asked for: the estimator counts its torque, and the policy is told the rest.
How much the undriven joint's motor delivers is found: in a simulation where it is dead, nothing. Its compensation
is therefore a part of the plant.
"""

from typing import Any, NamedTuple

from ...plant.damped import Friction
from ...plant.equations import Pair

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

    def times(self, shares: Pair) -> "Load":
        """Parts of them."""
        (c1, c2), (k1, k2), (one, other) = self.constant, self.spring, shares
        return Load((one * c1, other * c2), (one * k1, other * k2))


class Compensation(NamedTuple):
    """Friction of both joints, as pairs (N m s/rad; N m) for ``plant.equations.friction``."""

    asked: Friction
    """The friction whose counterpart the motors are asked for: never negative."""
    left: Friction
    """What remains; negative friction is not compensated."""


def compensation(found: Friction, gain: Any, joint: int, passive_limit: float, maximum: Any) -> Compensation:
    """Share the friction found out. Arithmetic for any kind of number.

    Args:
        found: friction of both joints.
        gain: part of its command that the undriven joint's motor delivers, in units of what the driven one does.
        joint: index of the driven joint.
        passive_limit: largest compensation of the undriven joint (N m); 0 for none.
        maximum: the larger one of two numbers.
    """
    shares, parts = asked_shares(gain, joint, passive_limit, maximum)
    asked = Friction(_asked(found.damping, shares, maximum), _asked(found.coulomb, shares, maximum))
    damping, coulomb = _left(found.damping, asked.damping, parts), _left(found.coulomb, asked.coulomb, parts)
    return Compensation(asked, Friction(damping, coulomb))


def asked_shares(gain: Any, joint: int, passive_limit: float, maximum: Any) -> tuple[Pair, Pair]:
    """Parts of what is found that both motors are asked for, and parts of these that they deliver."""
    delivered = maximum(gain, 0.0)
    asks = 1.0 / maximum(delivered, LEAST_GAIN) if passive_limit else 0.0
    return ((1.0, asks), (1.0, delivered)) if joint == 0 else ((asks, 1.0), (delivered, 1.0))


def shared_load(found: Load, gain: Any, joint: int, passive_limit: float, maximum: Any) -> tuple[Load, Load]:
    """The load that the motors are asked to carry, and the load to predict with."""
    asked, delivered = asked_shares(gain, joint, passive_limit, maximum)
    left = (1.0, 1.0 - asked[1] * delivered[1]) if joint == 0 else (1.0 - asked[0] * delivered[0], 1.0)
    return found.times(asked), found.times(left)


def _asked(found: Pair, shares: Pair, maximum: Any) -> Pair:
    return maximum(found[0], 0.0) * shares[0], maximum(found[1], 0.0) * shares[1]


def _left(found: Pair, asked: Pair, delivered: Pair) -> Pair:
    return found[0] - delivered[0] * asked[0], found[1] - delivered[1] * asked[1]


def predicted(found: Friction, left: Friction, joint: int, maximum: Any) -> Friction:
    """Friction to predict with: the driven joint's, whose torque is counted, and what is left of the other one's.

    Negative parts count as zero: the implicit step near rest would be singular with them.

    Args:
        found: friction of both joints.
        left: what the compensation leaves of it.
        joint: index of the driven joint.
        maximum: the larger one of two numbers.
    """
    (b1, _), (cf1, _) = found if joint == 0 else left
    (_, b2), (_, cf2) = left if joint == 0 else found
    return Friction((maximum(b1, 0.0), maximum(b2, 0.0)), (maximum(cf1, 0.0), maximum(cf2, 0.0)))
