"""What the regulator of ``policy/regulator/core.py`` needs of NumPy: products of 5 x 5 matrices.

One such product takes errors and torque through a step at once: [e, u], and P with zeros at u.
"""

from collections.abc import Sequence

import numpy as np

from ...plant.plant import Plant
from ..regulator import core
from ..regulator.core import Held, Loop
from ..regulator.settings import RICCATI_STEPS, Q, R, RegulatorSettings

WEIGHTS = np.diag([*Q, R])


def regulator_loop(settings: RegulatorSettings, plant: Plant, joint: int, limit: float) -> Loop:
    """What a regulator knows of a plant, whose driven joint's torque has a limit (N m)."""
    return core.make_loop(settings, plant, joint, limit, lambda P: np.pad(P, (0, 1)), advanced, cost, command)


def held(loop: Loop, base: Sequence[float]) -> Held:
    """What to hold for base parameters θ (9,): its step is [A b; 0 0]."""
    found = core.held(loop, base)
    a, b = found.step
    rows = [*a[0], b[0], *a[1], b[1], *a[2], b[2], *a[3], b[3], 0.0, 0.0, 0.0, 0.0, 0.0]
    return found._replace(step=np.array(rows).reshape(5, 5))


def advanced(P: np.ndarray, step: np.ndarray) -> np.ndarray:
    """P after the steps of one call."""
    across = step.T
    for _ in range(RICCATI_STEPS):
        V = across.dot(P.dot(step))
        V += WEIGHTS
        coupled = V[4:]
        # Zeros at u again, but for rounding, which the zeros of the step pass over.
        P = V - coupled.T.dot(coupled / coupled.item(4))
    symmetric: np.ndarray = 0.5 * (P + P.T)
    return symmetric


def cost(P: np.ndarray, e: tuple[float, ...]) -> float:
    """The cost-to-go eᵀ P e."""
    error = np.array([*e, 0.0])
    return float(P.dot(error).dot(error))


def command(P: np.ndarray, step: np.ndarray, e: tuple[float, ...]) -> float:
    """The torque -K e (N m)."""
    coupled = step.T[4].dot(P).dot(step)
    gains = coupled / (R + coupled.item(4))
    # The gain of the torque itself has no meaning.
    return -float(gains[:4].dot(e))
