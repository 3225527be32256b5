"""The fit: robust least squares on predictions over short windows.

Minimises over z, with r the errors of all windows, output times and states,

    sum over r of rho((r / sigma)²) + sum over z of rho((z / spread)²),   rho(s) = 2 (sqrt(1 + s) - 1).

Each window starts from the smoothed measurement (multiple shooting with fixed starts). sigma is the robust spread
of the errors at each output time, for angles and velocities of each joint, and is estimated between two stages.
Short predictions come first: their errors are nearly linear in the parameters, also far from the solution.

Intervals come from a Bayesian bootstrap (Rubin, Annals of Statistics 9, 1981), each draw solved in one step of
Gauss and Newton. Errors of neighbouring windows are alike: blocks of 1 s get weights from Exp(1). Each log, output
time and state gets a weight with a quarter of its variance: where short and long predictions, or angles and
velocities, disagree on an unknown, the interval is wider. Each draw has its own expectations, so that an unknown
which the logs leave open keeps the width of its expectation. The gradients of few blocks are corrected for their
leverage as in Bell and McCaffrey (Survey Methodology 28, 2002).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares, lsq_linear

from .prediction import INDEX, MAXIMUM_ERROR, Integration, predict_with_jacobian
from .regression import cut_spans, regress
from .segments import Segments, join
from .unknowns import Problem, Unknowns


@dataclass(frozen=True)
class FitStage:
    """One least-squares problem of a fit."""

    outputs: int  # number of output times that count, the first ones
    evaluations: int  # largest number of evaluations of the errors
    coarse: bool  # whether steps of integration are twice as long


FIT_STAGES = (FitStage(2, 12, True), FitStage(5, 20, True), FitStage(5, 8, False))
START_STAGES = (FitStage(5, 15, True),)
WARM_STAGES = (FitStage(5, 10, False),)
MINIMUM_WINDOWS = 10  # windows of a log from which it has a spread of its own
MINIMUM_SPREAD = np.array([1e-4, 1e-4, 1e-2, 1e-2])
"""Least spread of an error of each state (rad, rad/s): some encoders' steps, which no model explains."""


@dataclass(frozen=True)
class Fit:
    """A solution, with what the intervals need."""

    unknowns: Unknowns
    z: Float[np.ndarray, "unknowns"]
    residual: Float[np.ndarray, "windows errors"]  # r / sigma of each window
    jacobian: Float[np.ndarray, "windows errors unknowns"]  # derivatives of ``residual`` with respect to z

    @property
    def models(self) -> Float[np.ndarray, "sessions 15"]:
        """The model's vector of each session."""
        return self.unknowns.models(self.z)


def fit_start(problem: Problem, windows: Segments) -> Float[np.ndarray, "sessions 15"]:
    """Fit delay and lag alone, so that the starting plant is judged by what is wrong with the plant."""
    unknowns = problem.unknowns(plant=False)
    if not len(windows) or not len(unknowns):
        return unknowns.models(unknowns.start)
    return fit(problem.setting, windows, unknowns, unknowns.start, START_STAGES).models


def fit_all(problem: Problem, windows: Segments, start: Float[np.ndarray, "sessions 15"]) -> Fit:
    """Fit all unknowns, from the better of the starting plant and the linear regression."""
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
    """The solution moved back towards the starting plant, to a share of the way."""
    if share == 1.0:
        return found
    return linearise(Evaluator(problem.setting, windows, found.unknowns), between(found, start, share))


def between(found: Fit, start: Float[np.ndarray, "sessions 15"], share: float) -> Float[np.ndarray, "unknowns"]:
    """The position at a share of the way from the starting plant to the solution; what is known stays."""
    return share * found.z + (1.0 - share) * found.unknowns.position(start)


def _regressed(problem: Problem, models: np.ndarray) -> np.ndarray:
    """The start's models with the plant of the linear regression, which needs no start."""
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
    """Errors of all windows and their derivatives. SciPy asks for both apart: the latest evaluation is kept."""

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
        errors[bad], slopes[bad] = MAXIMUM_ERROR, 0.0
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
    """Median errors of a position after 50 ms, each relative to the median motion, summed over the states."""
    states, first = evaluate.windows.states, np.abs(evaluate(z)[0][:, 0])
    moved = np.abs(states[:, 1] - states[:, 0])
    return float(np.sum(np.median(first, axis=0) / np.maximum(np.median(moved, axis=0), 1e-6)))


def spreads(windows: Segments, errors: Float[np.ndarray, "windows outputs 4"]) -> np.ndarray:
    """Spread of each error: that of its time and state over all windows, times a factor of its log."""
    if not len(errors):
        return np.ones_like(errors)
    size = np.abs(errors)
    # The median of |error| is 1/1.48 of the standard deviation of a normal distribution.
    common = np.maximum(1.48 * np.median(size, axis=0), MINIMUM_SPREAD)
    # Errors grow with time: the spread at a later time is never below that at an earlier one.
    common = np.maximum.accumulate(common, axis=0)
    sigma = np.tile(common, (len(windows), 1, 1))
    for log in np.unique(windows.log):
        rows = windows.log == log
        if rows.sum() >= MINIMUM_WINDOWS:
            # Within bounds, so that no log is ignored and none decides alone.
            sigma[rows] *= np.clip(1.48 * np.median(size[rows] / common), 0.5, 3.0)
    return sigma


def _solve(evaluate: Evaluator, z: np.ndarray, stage: FitStage) -> np.ndarray:
    """Solve one stage with the sigma of its start: a sigma that followed the errors would reward large errors."""
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


BLOCK = 1.0  # length of a block (s)
SHAPE = 4.0  # shape of the Gamma distribution of the other weights: their variance is the inverse
DRAWS = 400
WIDENING = 1.75
"""Factor on the draws' distance from the solution. The bootstrap does not see what all windows have in common:
errors of the smoother and of the integration. Chosen on simulated pendulums that are not among those reported."""
MAXIMUM_LEVERAGE = 0.99
"""Largest share of what is known of a direction that counts as one block's. A single block has all of it: without
this bound the correction would divide by the expectation's weight alone."""


def draw_solutions(fit: Fit, windows: Segments, seed: int = 0) -> Float[np.ndarray, "draws unknowns"]:
    """Solutions z for other logs and blocks that might have been recorded."""
    random = np.random.default_rng(seed)
    unknowns, count = fit.unknowns, len(fit.z)
    # One number for each block of each log: no log lasts a million seconds.
    numbers = windows.log * 1_000_000 + np.floor(windows.start / BLOCK).astype(int)
    _, first, blocks = np.unique(numbers, return_index=True, return_inverse=True)
    normal, gradient = _by_block(fit, blocks, len(first))
    logs = windows.log[first]
    weights = random.exponential(size=(DRAWS, len(first)))
    weights *= random.gamma(SHAPE, 1.0 / SHAPE, (DRAWS, int(logs.max(initial=0)) + 1))[:, logs]
    kinds = random.gamma(SHAPE, 1.0 / SHAPE, (DRAWS, fit.residual.shape[1]))
    expected = random.normal(size=(DRAWS, count)) * unknowns.spread
    prior = np.diag(1.0 / unknowns.spread**2)
    gradient = _without_leverage(normal, gradient, prior, prior @ fit.z)
    solutions = np.empty((DRAWS, count))
    for draw in range(DRAWS):
        both = weights[draw][:, None] * kinds[draw]
        matrix = np.tensordot(both, normal, 2) + prior
        slope = np.tensordot(both, gradient, 2) + prior @ (fit.z - expected[draw])
        solutions[draw] = _step(matrix, slope, unknowns.low - fit.z, unknowns.high - fit.z)
    # Delay and lag may exchange, beyond their bounds too: the logs determine their sum.
    loose = np.isin(unknowns.entries, [INDEX["delay"], INDEX["lag"]])
    low, high = np.where(loose, -np.inf, unknowns.low), np.where(loose, np.inf, unknowns.high)
    return np.clip(fit.z + WIDENING * solutions, low, high)


def _by_block(fit: Fit, blocks: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrix and gradient of each block and kind of error, with the weights of the robust loss."""
    _, kinds, unknowns = fit.jacobian.shape
    # rho' of the loss in fit.py: what the fit hardly listened to must not widen the intervals.
    robust = 1.0 / np.sqrt(1.0 + fit.residual**2)
    normal, gradient = np.zeros((count, kinds, unknowns, unknowns)), np.zeros((count, kinds, unknowns))
    for block in range(count):
        rows = blocks == block
        jacobian, weight = fit.jacobian[rows], robust[rows]
        normal[block] = np.einsum("wka,wkb,wk->kab", jacobian, jacobian, weight)
        gradient[block] = np.einsum("wka,wk,wk->ka", jacobian, weight, fit.residual[rows])
    return normal, gradient


def _without_leverage(normal: np.ndarray, gradient: np.ndarray, prior: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Gradients as they would be had each block not drawn the solution towards itself.

    (1 - N_b N⁻¹)⁻¹ g_b for each block b, shifted so that the solution stays where it is. With N = R Rᵀ the
    leverages are the eigenvalues of R⁻¹ N_b R⁻ᵀ.
    """
    if not len(normal):
        return gradient
    root = np.linalg.cholesky(normal.sum(axis=(0, 1)) + prior)
    inverse = np.linalg.inv(root)
    leverage, vectors = np.linalg.eigh(inverse @ normal.sum(axis=1) @ inverse.T)
    factor = 1.0 / (1.0 - np.minimum(leverage, MAXIMUM_LEVERAGE))
    spread = root @ (vectors * factor[:, None]) @ np.swapaxes(vectors, 1, 2) @ inverse
    corrected = np.einsum("bij,bkj->bki", spread, gradient)
    return corrected - (corrected.sum(axis=(0, 1)) + pull) / corrected[..., 0].size


def _step(matrix: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The minimum of ½ δᵀ matrix δ + slopeᵀ δ within bounds."""
    # Most draws keep the bounds by themselves, and this is far faster than the bounded problem.
    step = np.linalg.solve(matrix, -slope)
    if np.all((step >= low) & (step <= high)):
        return step
    root = np.linalg.cholesky(matrix)
    return lsq_linear(root.T, -np.linalg.solve(root, slope), (low, high)).x
