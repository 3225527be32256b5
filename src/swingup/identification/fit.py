"""The fit: robust least squares on predictions over short windows.

Minimises over z, with r the errors of all windows, output times and states,

    sum over r of rho((r / sigma)²) + sum over z of rho((z / spread)²),   rho(s) = 2 (sqrt(1 + s) - 1).

Each window starts from the smoothed measurement (multiple shooting with fixed starts). sigma is the robust spread
of the errors at each output time, for angles and velocities of each joint, and is estimated between two stages.
Short predictions come first: their errors are nearly linear in the parameters, also far from the solution.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares

from .model import Unknowns
from .prediction import Setting, predict, predict_with_jacobian
from .windows import INTERVAL, Windows

STAGES = ((2, 12), (5, 12), (5, 25))
"""Output times that count, and the most evaluations, of each stage."""
LARGEST_ERROR = 1e3
"""Errors that are not finite count as this many sigma."""
LEAST_WINDOWS = 10
"""Windows of a log from which it has a spread of its own."""


@dataclass(frozen=True)
class Data:
    """Windows of all logs, and the session of each."""

    windows: Windows
    session: Int[np.ndarray, "windows"]


@dataclass(frozen=True)
class Fit:
    """A solution, with what the intervals need."""

    unknowns: Unknowns
    z: Float[np.ndarray, "unknowns"]
    residual: Float[np.ndarray, "windows errors"]
    """r / sigma of each window."""
    jacobian: Float[np.ndarray, "windows errors unknowns"]
    """Of ``residual`` with respect to z."""

    @property
    def models(self) -> Float[np.ndarray, "sessions 15"]:
        """The model's vector of each session."""
        return self.unknowns.models(self.z)


def fit(
    setting: Setting,
    data: Data,
    unknowns: Unknowns,
    start: Float[np.ndarray, "unknowns"],
    stages: Sequence[tuple[int, int]] = STAGES,
) -> Fit:
    """Fit the unknowns, from a starting position z."""
    z = start
    for outputs, evaluations in stages:
        z = _solve(setting, data, unknowns, z, outputs, evaluations)
    return linearise(setting, data, unknowns, z)


def linearise(setting: Setting, data: Data, unknowns: Unknowns, z: Float[np.ndarray, "unknowns"]) -> Fit:
    """A solution as it is, with its errors and their derivatives."""
    sigma = spreads(data.windows, _errors(setting, data, unknowns, z))
    return Fit(unknowns, z, *_linearise(setting, data, unknowns, z, 1.0 / sigma))


def start_cost(setting: Setting, data: Data, unknowns: Unknowns, z: Float[np.ndarray, "unknowns"]) -> float:
    """How badly a position predicts the first 50 ms: median errors, each relative to the median motion."""
    first = np.abs(_errors(setting, data, unknowns, z)[:, 0])
    moved = np.abs(data.windows.reference[:, 0] - data.windows.start)
    return float(np.sum(np.median(first, axis=0) / np.maximum(np.median(moved, axis=0), 1e-6)))


def soft_l1(residual: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """The loss rho of each residual."""
    return 2.0 * (np.sqrt(1.0 + residual**2) - 1.0)


def spreads(
    windows: Windows, errors: Float[np.ndarray, "windows outputs 4"]
) -> Float[np.ndarray, "windows outputs 4"]:
    """The spread of each error: of its time and state over all windows, times how much worse its log fits."""
    size = np.abs(errors)
    floor = np.array([1e-4, 1e-4, 1e-2, 1e-2])
    common = np.maximum(1.48 * np.median(size, axis=0), floor)
    # Errors grow with time: the spread at a later time is never below that at an earlier one.
    common = np.maximum.accumulate(common, axis=0)
    sigma = np.tile(common, (len(windows), 1, 1))
    for log in np.unique(windows.log):
        rows = windows.log == log
        if rows.sum() >= LEAST_WINDOWS:
            sigma[rows] *= np.clip(1.48 * np.median(size[rows] / common), 0.5, 3.0)
    return sigma


def _errors(setting: Setting, data: Data, unknowns: Unknowns, z: np.ndarray) -> np.ndarray:
    models = unknowns.models(z)
    errors = np.zeros_like(data.windows.reference)
    for session in np.unique(data.session):
        rows = np.flatnonzero(data.session == session)
        part = data.windows.take(rows)
        errors[rows] = predict(setting, models[session], part) - part.reference
    return np.nan_to_num(errors, nan=LARGEST_ERROR, posinf=LARGEST_ERROR, neginf=-LARGEST_ERROR)


def _linearise(
    setting: Setting, data: Data, unknowns: Unknowns, z: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted errors and their derivatives with respect to z, by windows."""
    models, count = unknowns.models(z), len(data.windows)
    residual = np.zeros((count, weight.shape[1], 4))
    jacobian = np.zeros((*residual.shape, len(z)))
    for session in np.unique(data.session):
        rows = np.flatnonzero(data.session == session)
        part = data.windows.take(rows)
        states, slopes = predict_with_jacobian(setting, models[session], part)
        residual[rows] = (states - part.reference) * weight[rows]
        jacobian[rows] = (slopes @ unknowns.derivative(int(session))) * weight[rows][..., None]
    bad = ~(np.isfinite(residual) & np.isfinite(jacobian).all(axis=-1)) | (np.abs(residual) > LARGEST_ERROR)
    residual[bad], jacobian[bad] = LARGEST_ERROR, 0.0
    return residual.reshape(count, -1), jacobian.reshape(count, -1, len(z))


def _solve(
    setting: Setting, data: Data, unknowns: Unknowns, z: np.ndarray, outputs: int, evaluations: int
) -> np.ndarray:
    """One stage: sigma as it is at the start, then the least squares."""
    sigma = spreads(data.windows, _errors(setting, data, unknowns, z))
    counts = INTERVAL * (np.arange(sigma.shape[1]) + 0.5) < INTERVAL * outputs
    weight = counts[:, None] / sigma
    latest: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def linearise(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # SciPy asks for the errors and then for their derivatives at the same point.
        if z.tobytes() not in latest:
            latest.clear()
            latest[z.tobytes()] = _linearise(setting, data, unknowns, z, weight)
        return latest[z.tobytes()]

    expected = np.diag(1.0 / unknowns.spread)
    solution = least_squares(
        lambda z: np.append(linearise(z)[0].ravel(), z / unknowns.spread),
        z,
        lambda z: np.concatenate([linearise(z)[1].reshape(-1, len(z)), expected]),
        bounds=(unknowns.low, unknowns.high),
        loss="soft_l1",
        max_nfev=evaluations,
        xtol=1e-4,
        ftol=1e-4,
    )
    inner = 1e-6 * (unknowns.high - unknowns.low)
    found: np.ndarray = np.clip(solution.x, unknowns.low + inner, unknowns.high - inner)
    return found
