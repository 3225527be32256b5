"""Base parameters by linear least squares: the change of momentum over 50 ms is the impulse of all torques.

The rows of ``plant.momentum``, summed over a short time, are linear in the base parameters. No acceleration is
needed and no start is guessed, so the same equations tell wrong columns within seconds, before any fit. An error e
of a span's impulse has the covariance of two kinds of noise, of velocities and of torques:

    C = M(q) R σv² Rᵀ M(q)ᵀ + στ²,

with the measured velocities' noise σv, 10 % of their changes, and the torques' στ, 5 % of the torques as they are
read. R maps measured velocities to those of the equations (``ColumnMap``). Weak expectations around the starting
plant decide on what the motion leaves open.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear

from ..plant.base_parameters import BASE, BASE_NAMES, lumped
from ..plant.equations import ARRAYS, mass_entries
from ..plant.momentum import momentum_rows
from .prediction import INDEX, Integration
from .recording import Recording
from .segments import MINIMUM_SPEED, REACH, Layout, Segments, cut
from .unknowns import expectations

SPAN = 0.05  # time over which momenta change (s)
POINTS = 10  # rows that are summed for it
STEP = SPAN / POINTS
"""Time between the states of a span (s): momenta are those of the middles between two of them."""
OFFSETS = STEP * (np.arange(POINTS + 2) - 0.5)
"""Times of its states (s): the first and the last middle are its ends."""
AGES = np.array([0.0, 0.004, 0.008, 0.016])
"""Ages of a command when it acts (s), of which the likeliest is taken."""
MAXIMUM_SPANS = 400
MINIMUM_SPANS = 15  # spans from which columns are judged

VELOCITY_NOISE, TORQUE_NOISE = 0.1, 0.05  # noise as a share of the changes of velocity, and of the torques
MAXIMUM_FACTOR = 10.0  # largest factor between masses and inertias and the starting plant's
MASS_SPREAD = 0.7  # expected deviation of masses and inertias, as a share of the starting plant's
PRIOR = 1e-3  # weight of the expectations, relative to the mean error
ROUNDS = 3


@dataclass(frozen=True)
class ColumnMap:
    """From a log's columns m to the equations: q = angles m + shift, q̇ = angles ṁ and u = torques m."""

    angles: Float[np.ndarray, "2 2"]
    shift: Float[np.ndarray, "2"]
    torques: Float[np.ndarray, "2 2"]

    def then(self, other: "ColumnMap") -> "ColumnMap":
        """This map, then another."""
        return ColumnMap(
            other.angles @ self.angles, other.angles @ self.shift + other.shift, other.torques @ self.torques
        )


AS_IS = ColumnMap(np.eye(2), np.zeros(2), np.eye(2))


@dataclass(frozen=True)
class Solution:
    """A solution of the regression."""

    values: Mapping[str, float]
    unexplained: float  # share of the velocity changes, less what torque noise explains
    cost: float  # twice the negative logarithm of the likelihood, per equation; smaller is better
    bounded: bool  # whether a mass or an inertia ends at its bound


def cut_spans(recording: Recording, minimum_speed: float = MINIMUM_SPEED) -> Segments:
    """Segments of 50 ms in which a joint moves, with the impulse at both ends for each age of the commands."""
    starts = np.arange(2 * REACH, recording.duration - SPAN - REACH, SPAN)
    grid = (np.array([0.0, SPAN]) - AGES[:, None]).ravel()
    spans = cut(recording, starts, Layout(SPAN, OFFSETS, OFFSETS, grid, 0.0), minimum_speed=minimum_speed)
    if len(spans) <= MAXIMUM_SPANS:
        return spans
    return spans.take(np.linspace(0, len(spans) - 1, MAXIMUM_SPANS).astype(int))


def regress(
    setting: Integration,
    spans: Segments,
    start: Float[np.ndarray, "15"],
    driven: bool,
    columns: ColumnMap = AS_IS,
    ages: int = len(AGES),
    maximum_factor: float = MAXIMUM_FACTOR,
) -> Solution:
    """Base parameters, masses and inertias within a factor of the start's; without torques k is the start's."""
    problem = _Problem(setting, spans, start, driven, columns, maximum_factor)
    impulses = np.diff(spans.impulse.reshape(len(spans), len(AGES), 2, 2), axis=2)[:, :, 0] @ columns.torques.T
    # 4 ms first, the most frequent age: where one age is enough, it is this one.
    order = (1, 0, 2, 3)[:ages] if driven else (0,)
    return min((problem.solve(impulses[:, age]) for age in order), key=lambda solution: solution.cost)


def servo_gains(
    setting: Integration, spans: Segments, start: Float[np.ndarray, "15"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Gains kp and kd of both joints with which u = kp e - kd q̇ moves the starting plant as in the log.

    The spans' impulses are those of e, goals minus angles. Of the commands' ages the likeliest is taken.
    """
    q = spans.states[..., :2]
    impulse = regression_matrix(setting, q).reshape(-1, 2, BASE) @ start[[INDEX[name] for name in BASE_NAMES]]
    turned = 0.5 * (q[:, -1] + q[:, -2] - q[:, 1] - q[:, 0])
    errors = np.diff(spans.impulse.reshape(len(spans), len(AGES), 2, 2), axis=2)[:, :, 0]
    gains = np.zeros((2, 2))
    for joint in (0, 1):
        found = (
            np.linalg.lstsq(np.column_stack([errors[:, age, joint], -turned[:, joint]]), impulse[:, joint])
            for age in range(len(AGES))
        )
        gains[:, joint] = min(found, key=lambda each: float(each[1].sum()))[0]
    return gains[0], gains[1]


class _Problem:
    """The equations under one map of the columns, whatever the age of the impulses."""

    def __init__(
        self,
        setting: Integration,
        spans: Segments,
        start: np.ndarray,
        driven: bool,
        columns: ColumnMap,
        maximum_factor: float,
    ) -> None:
        q = spans.states[..., :2]
        change = (q[:, -1] - q[:, -2] - q[:, 1] + q[:, 0]) / STEP
        self.noise = VELOCITY_NOISE * np.sqrt(np.mean(change**2, axis=0)) + 1e-9
        q = q @ columns.angles.T + columns.shift
        self.setting, self.elbow = setting, q[:, POINTS // 2, 1]
        self.rows = regression_matrix(setting, q).reshape(-1, 2, BASE)
        self.columns = columns
        self.low, self.high, self.centre, self.spread = _expected(setting, start, driven, maximum_factor)
        if driven:
            impulse = np.diff(spans.impulse[:, :2], axis=1) @ columns.torques.T
            level = np.sqrt(np.mean(impulse**2))
        else:  # gravity's torque is all that there is
            level = np.sqrt(np.mean((self.rows[..., INDEX["k"]] * self.centre[INDEX["k"]]) ** 2))
        self.level = TORQUE_NOISE * level + 1e-12

    def solve(self, impulse: Float[np.ndarray, "spans 2"]) -> Solution:
        """Iterate between the parameters and the noise's covariance, which depends on them."""
        found, robust, size = self.centre, np.ones(len(impulse)), 1.0
        for _ in range(ROUNDS):
            white, _ = self._whitener(found)
            matrix = (white @ self.rows * robust[:, None, None]).reshape(-1, BASE)
            right = (np.einsum("nij,nj->ni", white, impulse) * robust[:, None]).ravel()
            deviation = self._solve(matrix, right, np.sqrt(PRIOR * len(right) * max(size, 1.0)))
            found = np.clip(self.centre + self.spread * deviation, self.low, self.high)
            errors = np.einsum("nij,nj->ni", white, impulse - self.rows @ found)
            distance = np.sqrt(np.mean(errors**2, axis=1))
            # A span that errs by more than three times the median counts less, such as one with a push.
            robust = 1.0 / np.sqrt(1.0 + (distance / (3.0 * np.median(distance) + 1e-9)) ** 2)
            size = float(np.mean((errors * robust[:, None]) ** 2))
        white, logarithm = self._whitener(found)
        errors = np.einsum("nij,nj->ni", white, impulse - self.rows @ found) * robust[:, None]
        size = float(np.mean(errors**2))
        masses = found[:4] / self.centre[:4]
        return Solution(
            {name: float(value) for name, value in zip(BASE_NAMES, found, strict=True)},
            VELOCITY_NOISE * np.sqrt(size),
            float(np.log(size + 1e-12) + 0.5 * logarithm + PRIOR * deviation @ deviation),
            bool(masses.min() < 1.01 / MAXIMUM_FACTOR or masses.max() > 0.99 * MAXIMUM_FACTOR),
        )

    def _solve(self, matrix: np.ndarray, right: np.ndarray, weight: float) -> np.ndarray:
        """Deviations of the parameters from their expectations, in spreads, within the bounds."""
        rows = np.vstack([matrix * self.spread, weight * np.eye(BASE)])
        left = np.append(right - matrix @ self.centre, np.zeros(BASE))
        deviation: np.ndarray = np.linalg.solve(rows.T @ rows, rows.T @ left)
        low, high = (self.low - self.centre) / self.spread, (self.high - self.centre) / self.spread
        # Bounds rarely matter, and hundreds of maps are tried.
        if np.any(deviation < low) or np.any(deviation > high):
            # The same least squares in as many rows as there are parameters, not in hundreds.
            turned, triangle = np.linalg.qr(rows)
            deviation = lsq_linear(triangle, turned.T @ left, (low, high), method="bvls").x
        return deviation

    def _whitener(self, found: np.ndarray) -> tuple[np.ndarray, float]:
        """C^(-1/2) of each span, and the mean logarithm of |C| over that of the velocities' noise alone."""
        m11, m12, m22 = np.broadcast_arrays(*mass_entries(lumped(found, self.setting.geometry), np.cos(self.elbow)))
        mass = np.stack([np.stack([m11, m12], -1), np.stack([m12, m22], -1)], -2)
        moved = mass @ self.columns.angles * self.noise
        # A mass matrix may come out singular on the way.
        covariance = moved @ np.swapaxes(moved, 1, 2) + (self.level**2 + 1e-18) * np.eye(2)
        root = np.linalg.cholesky(covariance)
        own = 2.0 * np.log(np.abs(np.linalg.det(moved)) + 1e-300)
        logarithm = 2.0 * np.log(root[:, 0, 0] * root[:, 1, 1]) - own
        return np.linalg.inv(root), float(np.mean(logarithm))


def _expected(
    setting: Integration, start: np.ndarray, driven: bool, maximum_factor: float
) -> tuple[np.ndarray, ...]:
    """Bounds, centres and spreads of the base parameters."""
    rows = expectations(setting, start, commanded=True)
    centre, spread = np.array([(rows[name].centre, rows[name].scale) for name in BASE_NAMES]).T
    spread[:4] *= MASS_SPREAD
    # Masses and inertias come first, frictions and rotors after them.
    low, high = np.zeros(BASE), np.full(BASE, np.inf)
    low[:4], high[:4] = centre[:4] / maximum_factor, centre[:4] * maximum_factor
    if not driven:
        # Without torques the equations give ratios alone: this parameter stays. The solver refuses equal bounds.
        k = INDEX["k"]
        low[k], high[k] = 0.999 * centre[k], 1.001 * centre[k]
    return low, high, centre, spread


def regression_matrix(setting: Integration, q: Float[np.ndarray, "spans points 2"]) -> np.ndarray:
    """The matrix Y: both joints of each span in rows, and in columns the impulses for a unit of each parameter."""
    q1, q2 = q[..., 0], q[..., 1]
    before, middle, after = ((q1[:, k : k + POINTS], q2[:, k : k + POINTS]) for k in (0, 1, 2))
    rows = momentum_rows(before, middle, after, (STEP, STEP), setting.geometry, 0.0, ARRAYS)
    columns = [[np.sum(entry, axis=1) * STEP for entry in row[:BASE]] for row in rows]
    return np.transpose(columns, (2, 0, 1)).reshape(-1, BASE)
