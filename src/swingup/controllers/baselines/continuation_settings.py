"""How the plants of a continuation move, and which of its swing-ups count."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...plant.equations import StateFloats
from ..swingups.ilqr import ILQRSettings

_SOLVER = ILQRSettings(
    # A step needs no more precision: the next one starts from its end.
    max_iterations=25,
    tolerance=1e-4,
    regularisation=1e-3,
    min_regularisation=1e-9,
    max_regularisation=1e10,
    torque_limit=2e3,  # N m/s: of the rate, which is the input here
    decrease=0.3,
    increase=4.0,
    step_sizes=(1.0, 0.3, 0.1, 0.03),
)


@dataclass(frozen=True)
class ContinuationSettings:
    """How plants move, and which swing-ups count."""

    extra: float = 0.2
    """Time after the nominal swing-up (s): other plants need longer to come to rest."""
    final: StateFloats = (20.0, 20.0, 1.0, 1.0)
    """On squared errors of the last angles (rad) and velocities (rad/s). They are softer than the problem's own,
    since a regulator takes over there."""
    gain_weights: StateFloats = (0.2, 0.2, 0.02, 0.02)
    """Added to the state's weights for the gains: the cost has no weight on q2, so that its own gains are weak."""
    gain_final: StateFloats = (10.0, 10.0, 1.0, 1.0)
    """Final weights for the gains. Larger ones make the gains near the end so large that steps fail."""
    first_step: float = 0.1
    """First step of λ."""
    largest_step: float = 0.1
    """Longer steps leap to other motions, of twice the cost."""
    smallest_step: float = 0.01
    """A plant whose step falls below this is given up."""
    growth: float = 1.5
    """A step is multiplied by this after a swing-up that counts."""
    shrinkage: float = 0.4
    """A step is multiplied by this after one that does not."""
    rounds: int = 40
    """Most steps of a plant, failed ones included."""
    max_cost: float = 0.25
    """A swing-up of larger cost does not count: it is another motion than the nominal one, whose cost is 0.15."""
    max_speed: float = 14.0
    """A swing-up with a faster joint does not count (rad/s): it spins where the nominal one swings."""
    max_error: StateFloats = (0.15, 0.15, 0.7, 0.7)
    """A swing-up that ends farther from upright at rest does not count (rad, rad/s): no regulator
    reaches it."""
    batch: int = 64
    """Plants side by side in a call. Smaller calls are filled up: all share one compilation."""
    solver: ILQRSettings = _SOLVER


def next_step(step: Float[np.ndarray, "n"], good: np.ndarray, settings: ContinuationSettings) -> np.ndarray:
    """Each plant's next step of λ, after one that was good or not."""
    grown = np.minimum(step * settings.growth, settings.largest_step)
    return np.where(good, grown, step * settings.shrinkage)
