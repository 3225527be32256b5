"""The regulator in NumPy: the steps of ``docs/policy-format.md``, in JAX in ``jax_backend/regulator.py``."""

import math
from collections.abc import Sequence

import numpy as np

from ...physics.base_parameters import base_parameters, geometry_of
from ...physics.plant import Plant
from ..regulator_settings import RegulatorSettings, bounds, fixed_point
from ..upright import upright_step
from .network import nearest


class NumpyRegulator:
    """Takes over from a policy near the top of one pendulum; ``reset()`` clears its memory."""

    def __init__(self, settings: RegulatorSettings, plant: Plant, joint: int, limit: float) -> None:
        """Prepare.

        Args:
            settings: weights, recursion and bounds.
            plant: the plant until another one is told.
            joint: index of the driven joint.
            limit: largest torque (N m).

        Raises:
            SwingupError: no regulator holds the plant.
        """
        self._settings, self._geometry, self._joint, self._limit = settings, geometry_of(plant), joint, limit
        weights, torque_weight = settings.step_weights
        # One product of 5 x 5 matrices takes errors and torque through a step at once: [e, u], P with zeros at u.
        self._weights = np.diag([*weights, torque_weight])
        self._start = np.pad(fixed_point(plant, joint, settings), (0, 1))
        self.tell(base_parameters(plant).tolist())
        self.reset()

    def reset(self) -> None:
        """The policy acts; the plant that was told stays."""
        self._cost_to_go, self.acting = self._start, False

    def tell(self, base: Sequence[float]) -> None:
        """Hold a plant with base parameters θ (9,) from now on."""
        s = self._settings
        a, b = upright_step(base, self._geometry, self._joint, s.coulomb_damping, s.riccati_step)
        self._enter, self._leave = bounds(s, base, self._joint)
        # [A b; 0 0].
        step = [*a[0], b[0], *a[1], b[1], *a[2], b[2], *a[3], b[3], 0.0, 0.0, 0.0, 0.0, 0.0]
        self._step = np.array(step).reshape(5, 5)

    def __call__(self, x: np.ndarray) -> float | None:
        """The torque (N m) for a state (4,) where the regulator acts, NaN if it is not finite; else None."""
        # What overflows is not finite, and starts again.
        with np.errstate(all="ignore"):
            gains = self._advance()
        q1, q2, dq1, dq2 = x.tolist()
        if not math.isfinite(q1 + q2 + dq1 + dq2):
            return math.nan if self.acting else None
        error = np.array([nearest(q1 - math.pi), nearest(q2), dq1, dq2, 0.0])
        with np.errstate(all="ignore"):
            cost, torque = float(self._cost_to_go.dot(error).dot(error)), -float(gains.dot(error))
        self.acting = cost <= self._leave if self.acting else cost < self._enter
        # In this order NaN stays.
        return min(max(torque, -self._limit), self._limit) if self.acting else None

    def _advance(self) -> np.ndarray:
        """The steps of one call of the recursion, and the gains (5,), of which the last has no meaning."""
        step, weights, P = self._step, self._weights, self._cost_to_go
        across = step.T
        for _ in range(self._settings.riccati_steps):
            V = across.dot(P.dot(step))
            V += weights
            coupled = V[4:]
            # Zeros at u again, but for rounding, which the zeros of the step pass over.
            P = V - coupled.T.dot(coupled / coupled.item(4))
        P = 0.5 * (P + P.T)
        if not math.isfinite(P.sum()):
            P = self._start
        self._cost_to_go = P
        coupled = across[4].dot(P).dot(step)
        gains: np.ndarray = coupled / (weights.item(24) + coupled.item(4))
        return gains
