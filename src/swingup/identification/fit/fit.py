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
from jaxtyping import Float
from scipy.optimize import least_squares

from ..log.segments import Segments, join
from .prediction import INDEX, LARGEST_ERROR, Integration, predict_with_jacobian
from .regression import cut_spans, regress
from .unknowns import Problem, Unknowns


@dataclass(frozen=True)
class FitStage:
    """One least-squares problem of a fit."""

    outputs: int
    """Number of output times that count, the first ones."""
    evaluations: int
    """Largest number of evaluations of the errors."""
    coarse: bool
    """Whether steps of integration are twice as long."""


FIT_STAGES = (FitStage(2, 12, True), FitStage(5, 20, True), FitStage(5, 8, False))
START_STAGES = (FitStage(5, 15, True),)
WARM_STAGES = (FitStage(5, 10, False),)
LEAST_WINDOWS = 10
"""Windows of a log from which it has a spread of its own."""
LEAST_SPREAD = np.array([1e-4, 1e-4, 1e-2, 1e-2])
"""Least spread of an error of each state (rad, rad/s): some encoders' steps, which no model explains."""


@dataclass(frozen=True)
class Fit:
    """A solution, with what the intervals need."""

    unknowns: Unknowns
    z: Float[np.ndarray, "unknowns"]
    residual: Float[np.ndarray, "windows errors"]
    """r / sigma of each window."""
    jacobian: Float[np.ndarray, "windows errors unknowns"]
    """Derivatives of ``residual`` with respect to z."""

    @property
    def models(self) -> Float[np.ndarray, "sessions 15"]:
        """The model's vector of each session."""
        return self.unknowns.models(self.z)


def fit_start(problem: Problem, windows: Segments) -> Float[np.ndarray, "sessions 15"]:
    """The starting plant with the delay and lag that predict best."""
    unknowns = problem.unknowns(plant=False)
    if not len(windows) or not len(unknowns):
        return unknowns.models(unknowns.start)
    return fit(problem.setting, windows, unknowns, unknowns.start, START_STAGES).models


def fit_all(problem: Problem, windows: Segments, start: Float[np.ndarray, "sessions 15"]) -> Fit:
    """All unknowns, from the better of the starting plant and the linear regression."""
    unknowns = problem.unknowns(plant=True)
    if not len(windows):
        return linearise(Evaluator(problem.setting, windows, unknowns), unknowns.start)
    candidates = [unknowns.position(models) for models in (start, _regressed(problem, start))]
    evaluate = Evaluator(problem.setting.coarse, windows, unknowns)
    costs = [start_cost(evaluate, z) for z in candidates]
    return fit(problem.setting, windows, unknowns, candidates[int(np.argmin(costs))])


def pulled(
    problem: Problem, windows: Segments, found: Fit, start: Float[np.ndarray, "sessions 15"], share: float
) -> Fit:
    """The point at a share of the way from the starting plant to a solution."""
    if share == 1.0:
        return found
    z = share * found.z + (1.0 - share) * found.unknowns.position(start)
    return linearise(Evaluator(problem.setting, windows, found.unknowns), z)


def _regressed(problem: Problem, models: np.ndarray) -> np.ndarray:
    """The start's models with the plant that linear least squares find."""
    spans = join([cut_spans(recording) for recording in problem.recordings])
    if not len(spans):
        return models
    found, changed = regress(problem.setting, spans, problem.start, problem.driven), models.copy()
    for name, value in found.values.items():
        changed[:, INDEX[name]] = value
    return changed


def fit(
    setting: Integration,
    windows: Segments,
    unknowns: Unknowns,
    start: Float[np.ndarray, "unknowns"],
    stages: Sequence[FitStage] = FIT_STAGES,
) -> Fit:
    """Fit the unknowns, from a starting position z."""
    z = start
    for stage in stages:
        chosen = setting.coarse if stage.coarse else setting
        z = _solve(Evaluator(chosen, windows, unknowns), z, stage)
    return linearise(Evaluator(setting, windows, unknowns), z)


class Evaluator:
    """Errors of all windows and their derivatives; the latest evaluation is kept, since SciPy asks twice."""

    def __init__(self, setting: Integration, windows: Segments, unknowns: Unknowns) -> None:
        self.setting, self.windows, self.unknowns = setting, windows, unknowns
        self._latest: tuple[bytes, np.ndarray, np.ndarray] = (b"", np.zeros(0), np.zeros(0))

    def __call__(self, z: Float[np.ndarray, "unknowns"]) -> tuple[np.ndarray, np.ndarray]:
        """Errors [windows, outputs, 4] and their derivatives with respect to z."""
        if self._latest[0] == z.tobytes():
            return self._latest[1:]
        windows, models = self.windows, self.unknowns.models(z)
        owners = self.unknowns.sessions[windows.log]
        errors = np.zeros_like(windows.states[:, 1:])
        slopes = np.zeros((*errors.shape, len(z)))
        for session in np.unique(owners):
            rows = owners == session
            states, derivatives = predict_with_jacobian(self.setting, models[session], windows.take(rows))
            errors[rows] = states - windows.states[rows, 1:]
            slopes[rows] = derivatives @ self.unknowns.derivative(int(session))
        # A window that diverges is bad, but has no direction in which it would be better.
        bad = ~(np.isfinite(errors) & np.isfinite(slopes).all(axis=-1))
        errors[bad], slopes[bad] = LARGEST_ERROR, 0.0
        self._latest = z.tobytes(), errors, slopes
        return errors, slopes


def linearise(evaluate: Evaluator, z: Float[np.ndarray, "unknowns"]) -> Fit:
    """A solution as it is, with its errors and their derivatives in units of their spreads."""
    errors, slopes = evaluate(z)
    sigma, (count, outputs, states) = spreads(evaluate.windows, errors), errors.shape
    residual, jacobian = errors / sigma, slopes / sigma[..., None]
    shape = count, outputs * states
    return Fit(evaluate.unknowns, z, residual.reshape(shape), jacobian.reshape(*shape, len(z)))


def start_cost(evaluate: Evaluator, z: Float[np.ndarray, "unknowns"]) -> float:
    """How badly a position predicts the first 50 ms: median errors, each relative to the median motion."""
    states, first = evaluate.windows.states, np.abs(evaluate(z)[0][:, 0])
    moved = np.abs(states[:, 1] - states[:, 0])
    return float(np.sum(np.median(first, axis=0) / np.maximum(np.median(moved, axis=0), 1e-6)))


def spreads(windows: Segments, errors: Float[np.ndarray, "windows outputs 4"]) -> np.ndarray:
    """The spread of each error: of its time and state over all windows, times how much worse its log fits."""
    if not len(errors):
        return np.ones_like(errors)
    size = np.abs(errors)
    # The median of |error| is 1/1.48 of the standard deviation of a normal distribution.
    common = np.maximum(1.48 * np.median(size, axis=0), LEAST_SPREAD)
    # Errors grow with time: the spread at a later time is never below that at an earlier one.
    common = np.maximum.accumulate(common, axis=0)
    sigma = np.tile(common, (len(windows), 1, 1))
    for log in np.unique(windows.log):
        rows = windows.log == log
        if rows.sum() >= LEAST_WINDOWS:
            # Within bounds, so that no log is ignored and none decides alone.
            sigma[rows] *= np.clip(1.48 * np.median(size[rows] / common), 0.5, 3.0)
    return sigma


def _solve(evaluate: Evaluator, z: np.ndarray, stage: FitStage) -> np.ndarray:
    """One stage: sigma as it is at the start, then the least squares."""
    unknowns, sigma = evaluate.unknowns, spreads(evaluate.windows, evaluate(z)[0])
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
    # The next stage has to start strictly within the bounds.
    inner = 1e-6 * (unknowns.high - unknowns.low)
    return np.clip(solution.x, unknowns.low + inner, unknowns.high - inner)
