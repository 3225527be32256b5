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

from ..log.windows import Windows
from .model import Unknowns
from .prediction import Setting, predict_with_jacobian


@dataclass(frozen=True)
class Stage:
    """One least-squares problem of a fit."""

    outputs: int
    """Number of output times that count, the first ones."""
    evaluations: int
    """The most of them."""
    coarse: bool
    """Whether steps of integration are twice as long."""


STAGES = (Stage(2, 12, True), Stage(5, 20, True), Stage(5, 8, False))
LARGEST_ERROR = 1e3
"""An error that is not finite counts as this (rad, rad/s)."""
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
    stages: Sequence[Stage] = STAGES,
) -> Fit:
    """Fit the unknowns, from a starting position z."""
    z = start
    for stage in stages:
        chosen = setting.coarse if stage.coarse else setting
        z = _solve(Evaluator(chosen, data, unknowns), z, stage)
    return linearise(Evaluator(setting, data, unknowns), z)


class Evaluator:
    """Errors of all windows and their derivatives; the latest evaluation is kept, since SciPy asks twice."""

    def __init__(self, setting: Setting, data: Data, unknowns: Unknowns) -> None:
        self.setting, self.data, self.unknowns = setting, data, unknowns
        self._latest: tuple[bytes, np.ndarray, np.ndarray] = (b"", np.zeros(0), np.zeros(0))

    def __call__(self, z: Float[np.ndarray, "unknowns"]) -> tuple[np.ndarray, np.ndarray]:
        """Errors [windows, outputs, 4] and their derivatives with respect to z."""
        if self._latest[0] != z.tobytes():
            self._latest = (z.tobytes(), *self._evaluate(z))
        return self._latest[1:]

    def _evaluate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        windows, models = self.data.windows, self.unknowns.models(z)
        errors = np.zeros_like(windows.reference)
        slopes = np.zeros((*errors.shape, len(z)))
        for session in np.unique(self.data.session):
            rows = np.flatnonzero(self.data.session == session)
            part = windows.take(rows)
            states, derivatives = predict_with_jacobian(self.setting, models[session], part)
            errors[rows] = states - part.reference
            slopes[rows] = derivatives @ self.unknowns.derivative(int(session))
        bad = ~(np.isfinite(errors) & np.isfinite(slopes).all(axis=-1))
        errors[bad], slopes[bad] = LARGEST_ERROR, 0.0
        return errors, slopes


def linearise(evaluate: Evaluator, z: Float[np.ndarray, "unknowns"]) -> Fit:
    """A solution as it is, with its errors and their derivatives in units of their spreads."""
    errors, slopes = evaluate(z)
    sigma = spreads(evaluate.data.windows, errors)
    shape = (len(errors), errors[0:1].size if len(errors) else 0)
    return Fit(
        evaluate.unknowns, z, (errors / sigma).reshape(shape), (slopes / sigma[..., None]).reshape(*shape, len(z))
    )


def start_cost(evaluate: Evaluator, z: Float[np.ndarray, "unknowns"]) -> float:
    """How badly a position predicts the first 50 ms: median errors, each relative to the median motion."""
    windows, first = evaluate.data.windows, np.abs(evaluate(z)[0][:, 0])
    moved = np.abs(windows.reference[:, 0] - windows.start)
    return float(np.sum(np.median(first, axis=0) / np.maximum(np.median(moved, axis=0), 1e-6)))


def spreads(
    windows: Windows, errors: Float[np.ndarray, "windows outputs 4"]
) -> Float[np.ndarray, "windows outputs 4"]:
    """The spread of each error: of its time and state over all windows, times how much worse its log fits."""
    if not len(errors):
        return np.ones_like(errors)
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


def _solve(evaluate: Evaluator, z: np.ndarray, stage: Stage) -> np.ndarray:
    """One stage: sigma as it is at the start, then the least squares."""
    unknowns, sigma = evaluate.unknowns, spreads(evaluate.data.windows, evaluate(z)[0])
    weight = (np.arange(sigma.shape[1]) < stage.outputs)[:, None] / sigma
    expected = np.diag(1.0 / unknowns.spread)
    solution = least_squares(
        lambda z: np.append((evaluate(z)[0] * weight).ravel(), z / unknowns.spread),
        z,
        lambda z: np.concatenate([(evaluate(z)[1] * weight[..., None]).reshape(-1, len(z)), expected]),
        bounds=(unknowns.low, unknowns.high),
        loss="soft_l1",
        max_nfev=stage.evaluations,
        xtol=1e-4,
        ftol=1e-4,
    )
    inner = 1e-6 * (unknowns.high - unknowns.low)
    found: np.ndarray = np.clip(solution.x, unknowns.low + inner, unknowns.high - inner)
    return found
