"""What keeping a pendulum upright asks of its loop: poles, delay, rate, encoders and the torque's reach.

Linearised about the upright, frictionless, M q̈ = K q + B u has the poles ±λ with λ² the eigenvalues of M⁻¹ K.
Delay and hold limit what any controller can do about unstable poles: with a robustness of Ms = 2, λ (delay + half a
period) is at most 0.33 for one pole (Åström, Limitations on Control System Performance, European Journal of Control
6, 2000); the sum of both poles is taken for λ. A torque of at most u catches a state x only where
|w x| < |w b| u / λ for each unstable mode with left eigenvector w: no controller does better in the linear model.
"""

import math
from typing import NamedTuple

import numpy as np

from .equations import mass_entries
from .plant import Plant, Robot, lump

LARGEST_PRODUCT = 0.33  # of the poles' sum and the dead time
HOLD_SHARE = 0.25  # part of the dead time that half a period may take
FINE_SHARE = 0.01  # part of the largest tilt that an encoder's step may be


class Upright(NamedTuple):
    """What a robot's upright asks for."""

    poles: tuple[float, float]  # 1/s, the slower first
    dead_time: float  # largest delay, lag and half period together (s)
    rate: float  # slowest rate of calls (Hz)
    tilt: float  # largest lean at rest of the stretched arm that the motor catches (rad)
    counts: int  # fewest counts a turn of the encoders, a power of 2


def upright_needs(plant: Plant, robot: Robot) -> Upright | None:
    """The needs of a robot at the top; None where gravity does not pull both links down."""
    lumped = lump(plant)
    m11, m12, m22 = mass_entries(lumped, 1.0)
    mass = np.array([[m11, m12], [m12, m22]])
    pull = np.array([[lumped.gravity1 + lumped.gravity2, lumped.gravity2], [lumped.gravity2, lumped.gravity2]])
    squares, modes = np.linalg.eig(np.linalg.solve(mass, pull).T)
    if not (squares.real > 0).all():
        return None
    poles = np.sqrt(squares.real)
    entry, lean = np.linalg.solve(mass, np.eye(2)[robot.joint]), np.array([1.0, 0.0])
    # The left eigenvector of [q, q̇] for the pole λ is [λ v, v] with v one of M⁻¹ K.
    reach = np.abs(modes.real.T @ entry) * float(plant.limit(robot.joint)) / poles
    tilt = float(np.min(reach / (poles * np.maximum(np.abs(modes.real.T @ lean), 1e-12))))
    dead_time = LARGEST_PRODUCT / float(poles.sum())
    counts = 2 ** math.ceil(math.log2(2 * math.pi / (FINE_SHARE * max(tilt, 1e-6))))
    low, high = sorted(poles.tolist())
    return Upright((low, high), dead_time, 0.5 / (HOLD_SHARE * dead_time), tilt, counts)
