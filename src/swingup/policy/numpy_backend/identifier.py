"""The identifier of ``policy/identifier.py`` in NumPy."""

import numpy as np

from ...plant.base_parameters import geometry_of
from ...plant.equations import Pair
from ...plant.maths import NUMPY
from ...plant.plant import Plant
from .. import identifier
from ..identifier import Found, IdentifierState
from ..identifier_settings import IdentifierSettings, prior


class NumpyIdentifier:
    """Finds the plant of one loop from measured angles and commanded torques.

    Call ``observe`` with each measurement, then ``remember`` with the torques that were commanded.
    """

    found: Found
    """What it has found of the plant."""

    def __init__(self, settings: IdentifierSettings, plant: Plant, joint: int) -> None:
        """Prepare for a loop.

        Args:
            settings: what to expect of the plant, the measurement and the torques.
            plant: the nominal plant.
            joint: index of the driven joint.
        """
        self.settings, self.joint, self.geometry = settings, joint, geometry_of(plant)
        self.mean, self.covariance = prior(plant, settings)
        self.reset()

    def reset(self) -> None:
        """Nothing seen yet."""
        self.take(identifier.begin(NUMPY, self))

    def take(self, state: IdentifierState) -> None:
        """Go on from a state."""
        self.state, self.found = state, identifier.found(NUMPY, self, state)

    def restart(self) -> None:
        """After a pause: what was found stays, the motion before is forgotten."""
        self.state = identifier.restart(NUMPY, self, self.state)

    def remember(self, u: Pair) -> None:
        """Note the torques that both motors were asked for, the driven one within its limit (N m)."""
        self.state = identifier.remember(NUMPY, self.state, np.array(u))

    def observe(self, q1: float, q2: float, delay_steps: int, step: float) -> None:
        """Learn from measured angles.

        Args:
            q1: angle of the shoulder (rad), whole turns aside.
            q2: angle of the elbow.
            delay_steps: how old they are (steps).
            step: time since the last call (s); of no meaning after a restart.
        """
        # What is not finite is left out at the end.
        with np.errstate(all="ignore"):
            self.take(identifier.observe(NUMPY, self, self.state, np.array([q1, q2]), delay_steps, step))

    def interval(self, step: float) -> float:
        """Time between the angles observed last and the next ones (s), for a call a step (s) after the last one."""
        return float(identifier.interval(NUMPY, self.state, step))
