"""The state estimator of ``policy/estimator.py`` in NumPy."""

import math

import numpy as np

from ...plant.equations import lump
from ...plant.maths import NUMPY
from ...plant.plant import Plant
from .. import estimator
from ..estimator import Model
from ..plant import model_step, torque_response
from ..settings import EstimatorSettings, kalman_gains
from .identifier import NumpyIdentifier


class NumpyEstimator:
    """An estimate of the state from measurements and commanded torques.

    Call ``observe`` with each measurement, then ``remember`` with the torques that were commanded.
    """

    def __init__(
        self,
        settings: EstimatorSettings,
        model: Plant,
        joint: int,
        identifier: NumpyIdentifier | None = None,
    ) -> None:
        """Prepare for a loop.

        Args:
            settings: what to expect of measurement and loop.
            model: the plant; commands are clipped to its torque limit.
            joint: index of the driven joint.
            identifier: finds the plant, which is the model then; None for the plant above.
        """
        self.settings, self.joint, self.identifier = settings, joint, identifier
        self.gains = kalman_gains(settings)
        self._nominal, self._driven = (lump(model), model.friction), np.eye(2)[joint].tolist()
        self.limits = np.full(2, math.inf)
        self.limits[joint] = model.limit(joint)
        self.reset()

    def reset(self) -> None:
        """Nothing seen yet."""
        if self.identifier is not None:
            self.identifier.reset()
        self.state = estimator.begin(NUMPY, self)

    def observe(self, t: float, x: np.ndarray) -> np.ndarray:
        """An estimate of the state now, for the state x (4,) (rad, rad/s) measured at time t (s)."""
        identifier, state, found = self.identifier, self.state, None
        if identifier is not None:
            state, found = state._replace(identified=identifier.state), identifier.found
        with np.errstate(all="ignore"):  # what is not finite fails a comparison
            # The caller's array may change: it is copied.
            self.state, seen = estimator.observe(NUMPY, self, state, found, t, np.array(x))
        if identifier is not None and self.state.identified is not None:
            identifier.take(self.state.identified)
        return seen

    def compensation(self, seen: np.ndarray) -> np.ndarray:
        """Torques (2,) against the friction found (N m), for the state seen (4,); NaN if that is not finite."""
        if self.identifier is None:
            return np.zeros(2)
        torques: np.ndarray = estimator.compensation(NUMPY, self, self.identifier.found.asked, seen)
        return torques

    def remember(self, u: np.ndarray) -> None:
        """Note the torques (2,) that both motors were asked for (N m)."""
        self.state = estimator.remember(NUMPY, self, self.state, u)
        if self.identifier is not None and self.state.identified is not None:
            self.identifier.state = self.state.identified

    def step(self, model: Model, x: np.ndarray, torque: float, dt: float) -> np.ndarray:
        """The state (4,) a time dt (s) after x under the driven joint's torque (N m)."""
        (plant, friction), (b1, b2) = model or self._nominal, self._driven
        torque = float(torque)
        return np.array(model_step(plant, friction, x.tolist(), torque * b1, torque * b2, float(dt)))

    def response(self, model: Model, x: np.ndarray) -> np.ndarray:
        """M⁻¹ times the torque of 1 N m on the driven joint (2,) (rad/s²)."""
        plant, _ = model or self._nominal
        return np.array(torque_response(plant, x.tolist(), *self._driven))
