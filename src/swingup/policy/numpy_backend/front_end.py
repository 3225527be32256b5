"""What stands between measurement, policy and motors on a robot: filter, memory and friction compensation.

Its settings stand in a policy file's metadata. :class:`NumpyFrontEnd` is what runs on the robot;
``jax_backend/front_end.py`` has the same in JAX, for training and judging.
"""

import math

import numpy as np

from ..settings import STEEPNESS, FrontEndSettings


class NumpyFrontEnd:
    """The front end of one pendulum, one call at a time; ``reset()`` clears its memory.

    At each call :meth:`see` takes the measurement and gives what the policy is shown, then :meth:`command` takes
    the policy's torque and gives those of both motors.
    """

    def __init__(
        self, settings: FrontEndSettings, torques: int, history: int, joint: int, torque_limit: float
    ) -> None:
        """Prepare.

        Args:
            settings: filter, spacing and friction.
            torques: how many past torques the policy is shown.
            history: how many earlier measurements it is shown.
            joint: index of the driven joint.
            torque_limit: torque of an action of 1 (N m).
        """
        self._settings, self._joint, self._limit = settings, joint, torque_limit
        self._damping, self._coulomb = np.array(settings.damping), np.array(settings.coulomb)
        self._past_torques = np.zeros(torques * settings.spacing)
        self._past = np.zeros((history * settings.spacing + 1, 4))
        self._windows = (torques, settings.spacing)
        bounds = np.full(2, settings.passive_limit)
        bounds[joint] = np.inf
        self._bounds = bounds
        self.reset()

    def reset(self) -> None:
        """Nothing measured yet."""
        self._time = -math.inf
        self._rates = np.zeros(2)

    def see(self, t: float, x: np.ndarray) -> np.ndarray:
        """What the policy is shown for the state x (4,) (rad, rad/s) measured at time t (s).

        The filtered state, the past torques in units of the limit, newest first, then the earlier states.
        """
        settings = self._settings
        going_on = 0 <= t - self._time <= 1.5 * settings.dt
        anew = not (going_on and np.isfinite(self._past[0]).all() and np.isfinite(x).all())
        self._time = t
        self._rates = x[2:].copy() if anew else self._rates + settings.velocity_weight * (x[2:] - self._rates)
        seen = np.concatenate([x[:2], np.where(np.abs(self._rates) < settings.dead_band, 0.0, self._rates)])
        if anew:
            self._past_torques[:] = 0.0
            self._past[:] = seen
        else:
            self._past[1:] = self._past[:-1].copy()
            self._past[0] = seen
        means = self._past_torques.reshape(self._windows).mean(axis=1)
        return np.concatenate([seen, means, self._past[settings.spacing :: settings.spacing].ravel()])

    def command(self, torque: float) -> np.ndarray:
        """The torques [u1, u2] (N m) for the policy's torque (N m), which is remembered."""
        if self._past_torques.size:
            self._past_torques[1:] = self._past_torques[:-1].copy()
            self._past_torques[0] = torque / self._limit
        rates = np.where(np.isfinite(self._past[0, 2:]), self._past[0, 2:], np.nan)
        friction = friction_torque(rates, self._damping, self._coulomb)
        u = np.clip(friction, -self._bounds, self._bounds)
        u[self._joint] += torque
        return u


def friction_torque(rates: np.ndarray, damping: np.ndarray, coulomb: np.ndarray) -> np.ndarray:
    """The friction b q̇ + cf arctan(100 q̇) of both joints (N m), as RealAIGym has it; all of shape (2,)."""
    return damping * rates + coulomb * np.arctan(STEEPNESS * rates)
