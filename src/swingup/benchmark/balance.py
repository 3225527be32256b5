"""Energy and momentum of a recording, from its angles and torques.

The velocities of a robot's log are not looked at: noise on them hides nothing. Energy may be lost to friction, and
rises by the work of the torques and no further. Each joint's momentum changes by the impulse of gravity, of its
torque, of friction and of the turning links (Lagrange's equations, dp/dt = ∂L/∂q + u - F).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..plant.equations import friction, gravity, mass_entries
from ..plant.plant import Plant, lump

MOMENTUM_WINDOW = 0.5
"""Time over which a joint's momentum is balanced (s): a push of the robots' boards adds 0.4 N m to its mean."""


class Unexplained(NamedTuple):
    """What no torque explains."""

    work: float
    """Largest rise of the energy since the start beyond the torques' work (J)."""
    torques: Float[np.ndarray, "2"]
    """Largest mean torque that each joint needs within a window beside gravity and its motor (N m)."""


def unexplained(
    time: Float[np.ndarray, "rows"],
    angles: Float[np.ndarray, "rows 2"],
    rates: Float[np.ndarray, "rows 2"],
    u: Float[np.ndarray, "rows 2"],
    plant: Plant,
) -> Unexplained:
    """What is left of energy and momentum on a plant with its friction.

    Args:
        time: s.
        angles: rad; full turns more or less do not matter.
        rates: velocities that belong to the angles (rad/s).
        u: torques from each row to the next (N m).
        plant: the pendulum.
    """
    p, q, (v1, v2), period = lump(plant), np.unwrap(angles, axis=0), rates.T, np.diff(time)
    both = q.sum(axis=1)
    m11, m12, m22 = mass_entries(p, np.cos(q[:, 1]))
    momentum = np.column_stack([m11 * v1 + m12 * v2, m12 * v1 + m22 * v2])
    kinetic = 0.5 * np.sum(momentum * rates, axis=1)
    potential = -p.gravity1 * np.cos(q[:, 0]) - p.gravity2 * np.cos(both)
    surplus = kinetic + potential - running(np.sum(u[:-1] * np.diff(q, axis=0), axis=1))
    pulls, turning = gravity(p, np.sin(q[:, 0]), np.sin(both)), p.coupling * np.sin(q[:, 1]) * v1 * (v1 + v2)
    losses = [friction(b, cf, v, np.arctan) for b, cf, v in ((plant.b1, plant.cf1, v1), (plant.b2, plant.cf2, v2))]
    force = np.column_stack([pulls[0] - losses[0], pulls[1] - turning - losses[1]])
    left = momentum - running((0.5 * (force[1:] + force[:-1]) + u[:-1]) * period[:, None])
    count = rows_in(MOMENTUM_WINDOW, period)
    torque = (left[count:] - left[:-count]) / (time[count:] - time[:-count])[:, None]
    return Unexplained(float(surplus.max() - surplus[0]), np.abs(torque).max(axis=0))


def rows_in(window: float, period: np.ndarray) -> int:
    """As many steps as usually take a time (s), of those that there are."""
    return min(len(period), max(1, round(window / float(np.median(period)))))


def running(steps: np.ndarray) -> np.ndarray:
    """The sum of all steps before each row."""
    return np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
