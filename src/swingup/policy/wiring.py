"""Whether encoders, motors and clock are as the policy's plant has them: the guard's look at the first second.

Three angles 30 ms apart (of C.1's time) give an acceleration a, and the model of the policy's plant, without
friction, gives that of each wiring w under the torques between them: as it should be, an encoder or the motors
reversed, encoders or motors or both those of the other joint, and no torque at all. Torques act 6 ms late, with the
hat of area 1 over both times (``plant.momentum``). Blocks count in which the driven joint has a torque and no joint
is fast. After four of them, the wiring is wrong where

    S_0 > 1.2  and  S_w < 0.4 S_0 for another w,    S_w = Σ_j (Σ |a_j - a_wj|²) / (Σ |a_j|² + Σ |a_0j|²),

and after ten where S_w < 0.6 S_0. A reversed joint has 2 in S_0 instead of 0; plants with other masses and twice
the friction stay below 1. Where no torque explains all but 0.16 S_0, none arrives, or the other joint's weaker
motor takes it: of a pendubot whose joints are swapped nothing else shows. Friction may hold the joints as well, so
that this takes twelve blocks with strong torques; below 0.02 S_0 nothing else is told. The clock is wrong where
half a second has fewer or more calls than the policy's estimator bears.
"""

from typing import NamedTuple

from ..plant.base_parameters import base_parameters, geometry_of, lumped
from ..plant.equations import NUMPY, TURN, acceleration, sine_cosine
from ..plant.plant import Plant
from ..plant.units import TORQUE, arm_scales, similar_plant

BLOCK, LATE = 0.03, 0.006  # Time between two angles, and until torques act (s of C.1, s)
CLOCK_TIME = 0.5  # Time from the first call after which its calls count (s)
MIN_BLOCKS = 4
MANY_BLOCKS, STRONG_BLOCKS = 10, 12
PUSH_SHARE, STRONG_SHARE = 0.05, 0.12  # Shares of the limit from which a block counts, and is strong
BETTER_SHARE, MANY_SHARE = 0.4, 0.6  # Shares of S_0 that another wiring has, with many blocks
STILL_SHARE, HELD_SHARE = 0.16, 0.02  # That no torque has where none arrives, where friction may hold the joints
WRONG = 1.2  # Least S_0 of a wrong wiring
FAST = 10.0  # Speed of a joint from which a block is left out (rad/s of C.1)
MIN_PERIOD, MAX_PERIOD = 0.4, 2.6  # Multiples of the period between which the estimator works


class Wiring(NamedTuple):
    """From measured angles to true ones: signs, and whether they are the other joint's; the same of the torques."""

    signs: tuple[float, float] = (1.0, 1.0)
    crossed: bool = False
    torque: float = 1.0  # Acting over commanded
    exchanged: bool = False


WIRINGS = (
    Wiring(),
    Wiring(signs=(-1.0, 1.0)),
    Wiring(signs=(1.0, -1.0)),
    Wiring(torque=-1.0),
    Wiring(crossed=True, exchanged=True),
    Wiring(crossed=True),
    Wiring(exchanged=True),
    Wiring(torque=0.0),
)
"""The right one, then those that are wrong, in the order of C's table."""


class WiringWatch:
    """What the guard knows of the first second of a run."""

    def __init__(self, plant: Plant, joint: int, limit: float, period: float | None) -> None:
        """Take the policy's plant, its driven joint with the torque limit (N m), and its period (s)."""
        scales = arm_scales(plant)
        own = similar_plant(plant, scales)
        self._plant = lumped(base_parameters(own).tolist(), geometry_of(own))
        self._joint, self._limit, self._period = joint, limit, period
        self._time_unit, self._torque_unit = scales.time, scales.of(TORQUE)
        self.reset()

    def reset(self) -> None:
        """Begin a run."""
        self._first: float | None = None
        self._calls: int | None = 0  # None once they were looked at
        self._begin()
        self._sums = [[0.0, 0.0] for _ in WIRINGS]
        self._energies, self._blocks, self._strong = [0.0, 0.0], 0, 0

    def _begin(self) -> None:
        """Forget the angles so far."""
        self._angles: list[tuple[float, float, float]] = []  # Time and both angles at the ends of blocks
        self._impulses: list[tuple[list[float], list[float]]] = []  # Of a block: ∫ u dt, ∫ u t dt
        self._impulse, self._moment = [0.0, 0.0], [0.0, 0.0]

    def wrong_period(self, t: float, pause: float) -> float | None:
        """The mean period (s) once half a second has passed, if it is wrong; a pause (s) since the last call."""
        if self._calls is None or self._period is None:
            return None
        if self._first is None:
            self._first = t
        elif pause > 0.0:  # a loop may call twice for one measurement
            self._calls += 1
        if self._calls == 0 or t - self._first < CLOCK_TIME:
            return None
        mean, self._calls = (t - self._first) / self._calls, None
        return None if MIN_PERIOD < mean / self._period < MAX_PERIOD else mean

    def wrong_wiring(self, t: float, q: tuple[float, float], torques: tuple[float, float], pause: float) -> int:
        """The place of the wiring that explains the motion, 0 while that is the right one.

        Angles (rad) are measured at time t (s); the torques (N m) acted since the last call, for a pause (s).
        """
        block = BLOCK * self._time_unit
        if self._angles:
            middle = t - self._angles[-1][0] - 0.5 * pause + LATE
            for joint in (0, 1):
                self._impulse[joint] += pause * torques[joint]
                self._moment[joint] += pause * torques[joint] * middle
        if self._angles and t - self._angles[-1][0] < block:
            return 0
        if self._angles and t - self._angles[-1][0] > 3.0 * block:
            self._begin()
        self._angles.append((t, *q))
        self._impulses.append((self._impulse, self._moment))
        self._impulse, self._moment = [0.0, 0.0], [0.0, 0.0]
        if len(self._angles) < 3:
            return 0
        del self._angles[:-3], self._impulses[:-2]
        return self._judge()

    def _judge(self) -> int:
        (t0, *q0), (t1, *q1), (t2, *q2) = self._angles
        first, second, whole = t1 - t0, t2 - t1, t2 - t0
        (_, rising), (impulse, falling) = self._impulses
        u = [2.0 / whole * (rising[j] / first + impulse[j] - falling[j] / second) for j in (0, 1)]
        push = abs(u[self._joint]) / self._limit
        if push < PUSH_SHARE:
            return 0
        before = [turned(b - a) / first for a, b in zip(q0, q1, strict=True)]
        after = [turned(b - a) / second for a, b in zip(q1, q2, strict=True)]
        v = [0.5 * self._time_unit * (a + b) for a, b in zip(before, after, strict=True)]
        if max(abs(v[0]), abs(v[1])) > FAST:
            return 0
        found = [2.0 * self._time_unit**2 * (b - a) / whole for a, b in zip(before, after, strict=True)]
        self._blocks += 1
        self._strong += push > STRONG_SHARE
        for place, wiring in enumerate(WIRINGS):
            angles, rates, own = (_wired(each, wiring) for each in (q1, v, found))
            torques = [wiring.torque * each / self._torque_unit for each in u]
            torques = torques[::-1] if wiring.exchanged else torques
            (sin1, _), (sin2, cos2) = sine_cosine(angles[0]), sine_cosine(angles[1])
            sines = sin1, sin2, sine_cosine(angles[0] + angles[1])[0]
            a1, a2 = acceleration(self._plant, sines, cos2, (rates[0], rates[1]), torques)
            errors = (own[0] - a1, own[1] - a2)
            for joint in (0, 1):
                self._sums[place][joint] += errors[1 - joint if wiring.crossed else joint] ** 2
            if place == 0:
                sizes = (found[0] ** 2 + a1 * a1, found[1] ** 2 + a2 * a2)
                self._energies = [self._energies[0] + sizes[0], self._energies[1] + sizes[1]]
        first_energy, second_energy = self._energies
        if not min(self._energies) > 0.0:
            return 0
        shares = [each[0] / first_energy + each[1] / second_energy for each in self._sums]
        wrong = shares[0] > WRONG
        if wrong and shares[-1] < STILL_SHARE * shares[0] and self._strong >= STRONG_BLOCKS:
            return len(WIRINGS) - 1
        if shares[-1] < HELD_SHARE * shares[0]:
            return 0
        best = min(range(len(WIRINGS) - 1), key=shares.__getitem__)
        least = (MANY_SHARE if self._blocks >= MANY_BLOCKS else BETTER_SHARE) * shares[0]
        return best if wrong and shares[best] < least and self._blocks >= MIN_BLOCKS else 0


def _wired(pair: list[float], wiring: Wiring) -> list[float]:
    signed = [sign * each for sign, each in zip(wiring.signs, pair, strict=True)]
    return signed[::-1] if wiring.crossed else signed


def turned(angle: float) -> float:
    """An angle's distance (rad) without whole turns: encoders may wrap."""
    return float(NUMPY.nearest(angle)) if abs(angle) > 0.5 * TURN else angle
