"""The regulator of ``policy/regulator.py`` in NumPy."""

from collections.abc import Sequence

import numpy as np

from ...plant.base_parameters import base_parameters, geometry_of
from ...plant.maths import NUMPY
from ...plant.plant import Plant
from .. import regulator
from ..regulator_settings import RegulatorSettings, fixed_point


class NumpyRegulator:
    """Takes over from a policy near the top of one pendulum; ``reset()`` clears its memory."""

    def __init__(self, settings: RegulatorSettings, plant: Plant, joint: int, limit: float) -> None:
        """Prepare.

        Args:
            settings: weights, recursion and bounds.
            plant: the plant until another one is told.
            joint: index of the driven joint.
            limit: largest torque (N m).
        """
        self.settings, self.geometry, self.joint, self.torque_limit = settings, geometry_of(plant), joint, limit
        weights, torque_weight = settings.step_weights
        # One product of 5 x 5 matrices takes errors and torque through a step at once: [e, u], P with zeros at u.
        self._weights = np.diag([*weights, torque_weight])
        self.start = np.pad(fixed_point(plant, joint, settings), (0, 1))
        self.tell(base_parameters(plant).tolist())
        self.reset()

    def reset(self) -> None:
        """The policy acts; the plant that was told stays."""
        self.state = regulator.begin(NUMPY, self)

    def tell(self, base: Sequence[float]) -> None:
        """Hold a plant with base parameters θ (9,) from now on."""
        found = regulator.held(self, base)
        a, b = found.step
        # [A b; 0 0].
        rows = [*a[0], b[0], *a[1], b[1], *a[2], b[2], *a[3], b[3], 0.0, 0.0, 0.0, 0.0, 0.0]
        self._held = found._replace(step=np.array(rows).reshape(5, 5))

    def __call__(self, x: np.ndarray) -> float | None:
        """The torque (N m) for a state (4,) where the regulator acts, NaN if it is not finite; else None."""
        # What overflows is not finite, and starts again.
        with np.errstate(all="ignore"):
            self.state, torque = regulator.regulate(NUMPY, self, self.state, self._held, x)
        return float(torque) if self.state.acting else None

    def advanced(self, P: np.ndarray, step: np.ndarray) -> np.ndarray:
        """P after the steps of one call."""
        across = step.T
        for _ in range(self.settings.riccati_steps):
            V = across.dot(P.dot(step))
            V += self._weights
            coupled = V[4:]
            # Zeros at u again, but for rounding, which the zeros of the step pass over.
            P = V - coupled.T.dot(coupled / coupled.item(4))
        symmetric: np.ndarray = 0.5 * (P + P.T)
        return symmetric

    def cost(self, P: np.ndarray, e: tuple[float, ...]) -> float:
        """The cost-to-go eᵀ P e."""
        error = np.array([*e, 0.0])
        return float(P.dot(error).dot(error))

    def command(self, P: np.ndarray, step: np.ndarray, e: tuple[float, ...]) -> float:
        """The torque -K e (N m)."""
        coupled = step.T[4].dot(P).dot(step)
        gains = coupled / (self._weights.item(24) + coupled.item(4))
        # The gain of the torque itself has no meaning.
        return -float(gains[:4].dot(e))
