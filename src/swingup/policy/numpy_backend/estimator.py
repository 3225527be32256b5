"""The state estimator in NumPy: the steps of ``docs/policy-format.md``, in JAX in ``jax_backend/estimator.py``."""

import itertools
import math

import numpy as np

from ...physics.equations import StateFloats, friction, lump
from ...physics.plant import Plant
from ..identifier_settings import LONGEST_STEP
from ..plant import model_step, torque_response
from ..settings import LOST, PIECES, EstimatorSettings, kalman_gains
from .identifier import NumpyIdentifier
from .network import TURN


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
        self._identifier = identifier
        self._settings, self._plant, self._friction = settings, lump(model), model.friction
        self._driven = (1.0, 0.0) if joint == 0 else (0.0, 1.0)
        self._joint, self._limit = joint, model.limit(joint)
        # From the misses [e_q1, e_q2, e_v1, e_v2] to corrections: the gains of one joint, for both.
        self._gains = np.kron(kalman_gains(settings), np.eye(2)).T
        # What a correction leaves of a deviation, and how deviations move in a step, but for their torques.
        self._kept, self._drift = np.eye(4) - self._gains, np.eye(4)
        self._fading = math.exp(-settings.dt / settings.memory)
        self._lost = LOST * settings.velocity_noise
        self._caution = settings.caution * np.arange(settings.max_delay_steps + 1)
        self.reset()

    def reset(self) -> None:
        """Nothing seen yet."""
        depth = self._settings.max_delay_steps + 1
        self._time = -math.inf
        self._state = np.zeros(4)
        self._torques = np.zeros(depth)
        self._deviations = np.zeros((depth, 4))
        self._surprise = np.zeros(depth)
        self.delay_steps = 0
        """The delay found (steps)."""
        if self._identifier is not None:
            self._identifier.reset()
            self._plant, self._friction = self._identifier.found.plant, self._identifier.found.friction

    def observe(self, t: float, x: np.ndarray) -> np.ndarray:
        """An estimate of the state now, for the state x (4,) (rad, rad/s) measured at time t (s)."""
        pause, self._time = t - self._time, t
        # Negated, so that the first call (an infinite pause) and a clock of NaN are late as well.
        late = not 0 <= pause <= 1.5 * self._settings.dt
        step = pause or self._settings.dt
        measured, x = x, self._without_offsets(x)
        seen = x.copy()
        with np.errstate(all="ignore"):  # what is not finite fails a comparison below
            if not late and self._follow(x, step if self._identifier is None else self._identifier.interval(step)):
                ahead = self._ahead(step)
                seen = ahead if np.isfinite(ahead).all() else seen
            else:
                # The evidence on the delay stays: the delay belongs to the loop, not to the motion.
                self._state, self._torques[:], self._deviations[:] = x.copy(), 0.0, 0.0
            if self._identifier is not None:
                self._identify(self._identifier, measured, pause)
        return seen

    def compensation(self, seen: np.ndarray) -> np.ndarray:
        """Torques (2,) against the friction found (N m), for the state seen (4,); NaN if that is not finite."""
        if self._identifier is None:
            return np.zeros(2)
        if not all(map(math.isfinite, values := seen.tolist())):
            return np.full(2, math.nan)
        (b1, b2), (cf1, cf2) = self._identifier.found.asked
        u = [friction(b1, cf1, values[2], math.atan), friction(b2, cf2, values[3], math.atan)]
        passive, most = 1 - self._joint, self._identifier.settings.passive_limit
        u[passive] = min(max(u[passive], -most), most)
        return np.array(u)

    def remember(self, u: np.ndarray) -> None:
        """Note the torques (2,) that both motors were asked for (N m)."""
        self._torques[1:] = self._torques[:-1]
        asked: list[float] = u.tolist()
        # In this order NaN stays.
        self._torques[0] = driven = min(max(asked[self._joint], -self._limit), self._limit)
        if self._identifier is not None:
            passive = asked[1 - self._joint]
            self._identifier.remember((driven, passive) if self._joint == 0 else (passive, driven))

    def _without_offsets(self, x: np.ndarray) -> np.ndarray:
        """The measurement less the offsets of its angles, as far as they are known."""
        if self._identifier is None:
            return x
        return x - np.array([*self._identifier.found.offsets, 0.0, 0.0])

    def _identify(self, identifier: NumpyIdentifier, x: np.ndarray, pause: float) -> None:
        """Show it the angles measured a pause (s) after the last; its plant is the model from the next call on."""
        # Negated, as above. It knows each step's time: late calls of an uneven loop do not interrupt it.
        if not 0 <= pause <= LONGEST_STEP * self._settings.dt:
            identifier.restart()
        identifier.observe(float(x[0]), float(x[1]), self.delay_steps, pause or self._settings.dt)
        self._plant, self._friction = identifier.found.plant, identifier.found.friction

    def _follow(self, x: np.ndarray, dt: float) -> bool:
        """One step (s) of the filter in charge and of the bank; False, and no change, if the estimate is lost."""
        b1, b2 = self._driven
        state = _floats(self._state)
        torque = float(self._torques[self.delay_steps])
        predicted = np.array(model_step(self._plant, self._friction, state, torque * b1, torque * b2, dt))
        miss = x - predicted
        miss[:2] -= TURN * np.round(miss[:2] / TURN)

        # Filters differ only in their torque. Accelerations are linear in it: a double integrator carries the rest.
        a1, a2 = torque_response(self._plant, state, b1, b2)
        half = 0.5 * dt * dt
        self._drift[2, 0] = self._drift[3, 1] = dt
        drifted = self._deviations.dot(self._drift)
        drifted += (self._torques - torque)[:, None] * np.array([half * a1, half * a2, dt * a1, dt * a2])

        misses = miss[:2] - drifted[:, :2]
        misses *= misses
        surprise = np.log1p((misses[:, 0] + misses[:, 1]) / self._settings.residual_scale**2)
        surprise += self._fading * self._surprise
        # A delay below the angles' own age cannot be.
        least = 0 if self._identifier is None else min(int(self._identifier.state.age), len(surprise) - 1)
        delay_steps = least + int((surprise + self._caution)[least:].argmin())
        deviations = drifted.dot(self._kept)
        estimate = predicted + miss.dot(self._gains) + deviations[delay_steps]
        # What is not finite fails the comparison.
        if not all(abs(off) <= self._lost for off in (x - estimate).tolist()[2:]):
            return False
        # Deviations count from the filter in charge, which may be another one now.
        self._state, self._deviations = estimate, deviations - deviations[delay_steps]
        self._surprise, self.delay_steps = surprise, delay_steps
        return True

    def _ahead(self, dt: float) -> np.ndarray:
        """The state after the delay, steps of dt (s), in pieces with the mean of the torques that act in each."""
        if self.delay_steps == 0:
            return self._state.copy()
        steps, (b1, b2) = self.delay_steps / PIECES, self._driven
        # Sum of the torques commanded in the last n steps, also between whole n.
        sums = np.concatenate([[0.0], np.cumsum(self._torques)])
        to_go = np.interp(steps * np.arange(PIECES, -1, -1), np.arange(len(sums)), sums).tolist()
        x = _floats(self._state)
        for before, after in itertools.pairwise(to_go):
            torque = (before - after) / steps
            x = model_step(self._plant, self._friction, x, torque * b1, torque * b2, steps * dt)
        return np.array(x)


def _floats(x: np.ndarray) -> StateFloats:
    """A state as Python's numbers."""
    q1, q2, dq1, dq2 = x.tolist()
    return q1, q2, dq1, dq2
