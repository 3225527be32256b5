"""The identifier in NumPy: the steps of ``docs/policy-format.md``, in JAX in ``jax_backend/identifier.py``.

Rows of the equations of motion are computed in Python's floats, the rest in small arrays.
"""

import math

import numpy as np

from ...physics.base_parameters import BASE, Known, friction_of, lumped, share_allowed
from ...physics.equations import Lumped, Pair
from ...physics.momentum import Maths, momentum_rows
from ...physics.plant import Plant
from ..compensation import compensation, predicted
from ..identifier_settings import (
    AGE_CAUTION,
    FARTHEST,
    GAIN,
    LAG,
    MOST_DEVIATION,
    POLES,
    SHORTEST_STEP,
    STUDENT,
    TILT1,
    TILT2,
    UNEVEN_FADING,
    UNEVEN_STEP,
    UNKNOWNS,
    IdentifierSettings,
    offsets,
    prior,
)
from ..plant import sine_cosine
from .network import nearest

COLUMNS = UNKNOWNS + 1
"""Of a joint's row: one for each unknown, and the torque."""


def _where(condition: bool, yes: float, no: float) -> float:
    return yes if condition else no


MATHS = Maths(sine_cosine, math.atan, math.log1p, _where)


class NumpyIdentifier:
    """Finds the plant of one loop from measured angles and commanded torques.

    Call ``observe`` with each measurement, then ``remember`` with the torques that were commanded.
    """

    def __init__(self, settings: IdentifierSettings, plant: Plant, joint: int) -> None:
        """Prepare for a loop.

        Args:
            settings: what to expect of the plant, the measurement and the torques.
            plant: the nominal plant.
            joint: index of the driven joint.
        """
        s = self._settings = settings
        self._joint, self._known = joint, Known(plant.l1, plant.g, plant.gr)
        self.passive_limit = s.passive_limit
        """Largest torque that compensates the undriven joint's friction (N m)."""
        self._mean, self._prior = prior(plant, settings)
        self._nominal: list[float] = self._mean[:BASE].tolist()
        self._most = self._prior.diagonal().copy()
        self._drift = s.walk**2 * s.dt * self._most
        passive, driven = (s.passive_deviation, s.passive_floor), (s.driven_deviation, s.driven_floor)
        self._firsts, self._floors = zip(*((driven, passive) if joint == 0 else (passive, driven)), strict=True)
        self._rise, self._fall = (1.0 - math.exp(-s.dt / time) for time in (s.rise, s.fall))
        self._cascade = _cascade(s.pole)
        self.reset()

    def reset(self) -> None:
        """Nothing seen yet."""
        self._angles = [(0.0, 0.0)] * (2 * self._settings.span + 1)
        self._delay_steps, self._missed = 0, [0.0, 0.0]
        self.age = 0
        """1 if the angles are those of the call before, else 0."""
        self._unknowns, self._covariance = self._mean.copy(), self._prior.copy()
        self._variance, self._held = [first**2 for first in self._firsts], [0.0, 0.0]
        self.restart()
        self._project()

    def restart(self) -> None:
        """After a pause: what was found stays, the motion before is forgotten."""
        past = self._settings.past
        self._torques: list[Pair] = [(0.0, 0.0)] * past
        # Time for which each pair was held (s).
        self._steps = [self._settings.dt] * past
        self._calls = 0
        # The newest columns in the last row, behind the low-passes that they enter one after the other.
        self._stages = np.zeros((POLES + 1, 2 * COLUMNS))

    def remember(self, u: Pair) -> None:
        """Note the torques that both motors were asked for, the driven one within its limit (N m)."""
        self._torques.insert(0, u)
        self._torques.pop()

    def observe(self, q1: float, q2: float, delay_steps: int, step: float) -> None:
        """Learn from measured angles.

        Args:
            q1: angle of the shoulder (rad), whole turns aside.
            q2: angle of the elbow.
            delay_steps: how old they are (steps).
            step: time since the last call (s); of no meaning after a restart.
        """
        # Negated, so that NaN is far as well: such an angle would stay in the differences.
        if not (abs(q1) < FARTHEST and abs(q2) < FARTHEST):
            self.restart()
            return
        last1, last2 = self._angles[0]
        newest = last1 + nearest(q1 - last1), last2 + nearest(q2 - last2)
        self._angles = [newest, *self._angles[:-1]] if self._calls else [(q1, q2)] * len(self._angles)
        dt = self._settings.dt
        self._steps.insert(0, max(step, SHORTEST_STEP * dt) if self._calls else dt)
        self._steps.pop()
        age = self._weigh_ages()
        delay_steps = max(delay_steps, age)
        if (age, delay_steps) != (self.age, self._delay_steps):
            # The lag counts from the delay: their sum is what was found. The old columns belong to the old delay.
            self._unknowns[LAG] += sum(self._steps[: self._delay_steps]) - sum(self._steps[:delay_steps])
            self.age, self._delay_steps = age, delay_steps
            self._stages[:] = 0.0
        self._calls += 1
        # The torques before a restart are not known.
        if self._calls >= len(self._angles) + delay_steps:
            self._learn()

    def interval(self, step: float) -> float:
        """Time between the angles observed last and the next ones (s), for a call a step (s) after the last one."""
        return self._steps[0] if self.age else step

    @property
    def unknowns(self) -> np.ndarray:
        """θ as it was found, κ1 and κ2 (kg m), the lag (s), and the gain of the undriven joint's motor."""
        return self._unknowns.copy()

    def _weigh_ages(self) -> int:
        """The angles' age (calls): a longer step shows as a longer way in the same call, or in the next."""
        whole = 2 * self._settings.span
        (a1, a2), (b1, b2), (c1, c2) = self._angles[:3]
        (z1, z2), time = self._angles[whole], sum(self._steps[:whole])
        rate1, rate2 = (a1 - z1) / time, (a2 - z2) / time
        first, second, third = self._steps[:3]
        for age, longer in enumerate((first - second, second - third)):
            miss = (a1 - 2 * b1 + c1 - rate1 * longer) ** 2 + (a2 - 2 * b2 + c2 - rate2 * longer) ** 2
            now = math.log1p(miss / UNEVEN_STEP**2) if self._calls > whole else 0.0
            self._missed[age] = UNEVEN_FADING * self._missed[age] + now
        more = self._missed[0] - self._missed[1]
        return 1 if more > AGE_CAUTION else 0 if more < -AGE_CAUTION else self.age

    def _learn(self) -> None:
        """The low-passes, both rows, and the drift."""
        self._stages[POLES] = columns = self._columns()
        # A torque that is not finite would stay in the low-passes.
        if not math.isfinite(sum(columns)):
            return
        kept = self._stages.copy(), self._unknowns.copy(), self._covariance.copy(), [*self._variance], [*self._held]
        self._stages[:POLES] = stages = self._cascade.dot(self._stages)
        last = stages[-1]
        self._update(0, last[:UNKNOWNS], last.item(UNKNOWNS))
        self._update(1, last[COLUMNS:-1], last.item(-1))
        diagonal = self._covariance.reshape(-1)[:: UNKNOWNS + 1]
        # No less sure than at the start: the drift must not exceed the prior.
        diagonal += (diagonal < self._most) * self._drift
        if not math.isfinite(self._unknowns.sum() + self._covariance.sum()):
            self._stages, self._unknowns, self._covariance, self._variance, self._held = kept
        self._project()

    def _columns(self) -> list[float]:
        """The newest rows: Y, u̇, -v and u of the shoulder, then of the elbow."""
        span = self._settings.span
        oldest, middle, newest = self._angles[2 * span], self._angles[span], self._angles[0]
        acting = self._torques[self._delay_steps : self._delay_steps + 2 * span]
        steps = self._steps[self.age : self.age + 2 * span]
        ratio, halves = self._nominal[2] / self._nominal[3], (sum(steps[span:]), sum(steps[:span]))
        shoulder, elbow = momentum_rows(oldest, middle, newest, halves, self._known, ratio, MATHS)
        torques, rates = _hat_means(steps, acting, halves)
        driven, passive = (rates[self._joint], 0.0, torques[self._joint]), (0.0, -torques[1 - self._joint], 0.0)
        first, second = (driven, passive) if self._joint == 0 else (passive, driven)
        return [*shoulder, *first, *elbow, *second]

    def _update(self, joint: int, row: np.ndarray, target: float) -> None:
        """One joint's row: the variance of its errors, and what it tells of the unknowns."""
        s = self._settings
        known = self._covariance.dot(row)
        unsure, error = float(row.dot(known)), target - float(row.dot(self._unknowns))
        terms = zip(row[:4].tolist(), self._unknowns[:4].tolist(), strict=True)
        size = abs(target) + sum(abs(entry * value) for entry, value in terms)
        r = max(self._variance[joint], self._floors[joint] ** 2 + (s.relative_floor * size) ** 2)
        distance = error * error / (unsure + r)
        held = s.hold if distance > s.gate**2 else self._held[joint] - s.dt
        if not held > 0:
            heavy = r * s.alike * max(1.0, (STUDENT + distance) / (STUDENT + 1.0))
            gain = known / (unsure + heavy)
            self._unknowns += gain * error
            self._covariance -= gain[:, None] * known
        # A spoilt angle must not blind the identifier for seconds.
        seen = min(distance * r, (MOST_DEVIATION * self._firsts[joint]) ** 2)
        weight = self._rise if seen > self._variance[joint] else self._fall
        self._variance[joint] += weight * (seen - self._variance[joint])
        self._held[joint] = max(held, 0.0)

    def _project(self) -> None:
        """What other parts need of the unknowns."""
        x, nominal, joint = self._unknowns.tolist(), self._nominal, self._joint
        found = x[:BASE]
        share = share_allowed(found, nominal, self._known, self._settings.margin, min, math.sqrt)
        self.theta: list[float] = [n + share * (one - n) for one, n in zip(found, nominal, strict=True)]
        """Base parameters of a pendulum: those found, or as near to them as the mass matrix allows."""
        self.plant: Lumped = lumped(self.theta, self._known)
        """The identified plant to predict with."""
        self.offsets: Pair = offsets(x[TILT1], x[TILT2], self.theta, _clip)
        """How much the measured angles are too large (rad)."""
        friction = friction_of(self.theta)
        self.asked, left = compensation(friction, x[GAIN], joint, self.passive_limit, max)
        """Friction whose counterpart the motors are asked for."""
        self.told = [*self.theta[:4], *left.damping, *left.coulomb, self.theta[8]]
        """θ as a policy and a regulator are told it: with the friction that the compensation leaves."""
        self.friction = predicted(friction, left, joint, max)
        """The plant's friction, of the undriven joint what its compensation leaves: that torque is not counted."""


def _cascade(pole: float) -> np.ndarray:
    """One step of the low-passes as a matrix (poles, poles + 1), from their states and the input to their states.

    Each takes the new value of the one before: F_k ← F_k + w (F_{k-1} - F_k), and the first one the input.
    """
    rows = [np.eye(POLES + 1)[POLES]]
    for state in np.eye(POLES + 1)[:POLES]:
        rows.append(state + pole * (rows[-1] - state))
    return np.array(rows[1:])


def _hat_means(steps: list[float], torques: list[Pair], halves: Pair) -> tuple[Pair, Pair]:
    """The last torques' means under the hat, and the means' rates (1/s), both as pairs (N m, N m/s).

    Args:
        steps: times for which they were held (s), newest first.
        torques: shoulder's and elbow's (N m).
        halves: sums (s) of the earlier half of the steps, and of the later one.
    """
    start = mean1 = mean2 = rate1 = rate2 = 0.0
    # Up to the hat's peak on the way back in time, then down.
    slopes = [1.0 / halves[1]] * (len(steps) // 2) + [-1.0 / halves[0]] * (len(steps) // 2)
    for step, slope, (u1, u2) in zip(steps, slopes, torques, strict=True):
        change = slope * step
        weight = (start + 0.5 * change) * step
        start += change
        mean1, mean2 = mean1 + weight * u1, mean2 + weight * u2
        rate1, rate2 = rate1 + change * u1, rate2 + change * u2
    share = 2.0 / (halves[0] + halves[1])
    return (share * mean1, share * mean2), (share * rate1, share * rate2)


def _clip(value: float, least: float, most: float) -> float:
    return min(max(value, least), most)
