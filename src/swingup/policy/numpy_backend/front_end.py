"""The front end by NumPy: a filter between measurement and policy, and friction compensation before the motors."""

import math

import numpy as np

from ...physics.equations import friction
from ..settings import FrontEndSettings


class NumpyFrontEnd:
    """The front end of one pendulum, one call at a time; ``reset()`` clears its memory.

    At each call :meth:`see` turns the measurement into what the policy sees. Then :meth:`command` turns the
    policy's torque into those of both motors.
    """

    def __init__(self, settings: FrontEndSettings, joint: int) -> None:
        """Prepare.

        Args:
            settings: filter and friction.
            joint: index of the driven joint.
        """
        self._settings, self._joint = settings, joint
        self._damping, self._coulomb = np.array(settings.damping), np.array(settings.coulomb)
        self._bounds = np.full(2, settings.passive_limit)
        self._bounds[joint] = np.inf
        self.reset()

    def reset(self) -> None:
        """Nothing measured yet."""
        self._time = -math.inf
        self._rates, self._seen = np.zeros(2), np.zeros(4)

    def see(self, t: float, x: np.ndarray) -> np.ndarray:
        """The filtered state for the state x (4,) (rad, rad/s) measured at time t (s)."""
        settings = self._settings
        going_on = 0 <= t - self._time <= 1.5 * settings.dt
        # A low-pass that has seen a value that is not finite would never recover.
        restart = not (going_on and np.isfinite(self._seen).all() and np.isfinite(x).all())
        self._time = t
        self._rates = x[2:].copy() if restart else self._rates + settings.velocity_weight * (x[2:] - self._rates)
        rates = np.where(np.abs(self._rates) < settings.dead_band, 0.0, self._rates)
        self._seen = np.concatenate([x[:2], rates])
        return self._seen.copy()

    def command(self, torque: float) -> np.ndarray:
        """The torques [u1, u2] (N m) for the policy's torque (N m)."""
        # The arctangent and the clip could make a finite torque of an infinite velocity.
        rates = np.where(np.isfinite(self._seen[2:]), self._seen[2:], np.nan)
        compensation = friction(self._damping, self._coulomb, rates, np.arctan)
        u = np.clip(compensation, -self._bounds, self._bounds)
        u[self._joint] += torque
        return u
