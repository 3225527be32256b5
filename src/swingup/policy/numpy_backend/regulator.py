"""What the regulator of ``policy/regulator/core.py`` needs of NumPy: products of 6 x 6 matrices.

One such product takes errors and torques through a step at once: [e, f, u], and P with zeros at u.
"""

from collections.abc import Sequence

import numpy as np

from ...plant.plant import Plant
from ..regulator import core
from ..regulator.core import Held, Loop
from ..regulator.settings import RICCATI_STEPS, Q, R, RegulatorSettings

WEIGHTS = np.diag([*Q, 0.0, R])
CONSTANT = (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""f stays, and u is chosen anew: the last rows of a step."""


def regulator_loop(settings: RegulatorSettings, plant: Plant, joint: int, limit: float) -> Loop:
    """What a regulator knows of a plant, whose driven joint's torque has a limit (N m)."""
    return core.make_loop(settings, plant, joint, limit, lambda P: np.pad(P, (0, 1)), advanced, cost, command)


def held(loop: Loop, base: Sequence[float]) -> Held:
    """What to hold for base parameters θ (9,): its step is [A d b; 0 1 0; 0 0 0]."""
    found = core.held(loop, base)
    (a1, a2, a3, a4), (d1, d2, d3, d4), (b1, b2, b3, b4) = found.step
    rows = [*a1, d1, b1, *a2, d2, b2, *a3, d3, b3, *a4, d4, b4, *CONSTANT]
    return found._replace(step=np.array(rows).reshape(6, 6))


def advanced(P: np.ndarray, step: np.ndarray) -> np.ndarray:
    """P after the steps of one call."""
    across = step.T
    for _ in range(RICCATI_STEPS):
        V = across.dot(P.dot(step))
        V += WEIGHTS
        coupled = V[5:]
        # Zeros at u again, but for rounding, which the zeros of the step pass over.
        P = V - coupled.T.dot(coupled / coupled.item(5))
        P[4, 4] = 0.0
    symmetric: np.ndarray = 0.5 * (P + P.T)
    return symmetric


def cost(P: np.ndarray, e: tuple[float, ...]) -> float:
    """The cost-to-go eᵀ P e."""
    error = np.array([*e, 0.0, 0.0])
    return float(P.dot(error).dot(error))


def command(P: np.ndarray, step: np.ndarray, e: tuple[float, ...]) -> float:
    """The torque -K [e, f] (N m)."""
    coupled = step.T[5].dot(P).dot(step)
    gains = coupled / (R + coupled.item(5))
    # The gain of the torque itself has no meaning.
    return -float(gains[:5].dot(e))
