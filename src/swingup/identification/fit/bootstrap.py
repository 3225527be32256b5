"""Intervals: a Bayesian bootstrap over logs and blocks, each draw solved in one step of Gauss and Newton.

Errors of neighbouring windows are alike, so that windows are drawn in blocks of 1 s. A draw gives each block a
weight from Exp(1). Each log, and each output time and state of the predictions, gets a weight with a quarter of its
variance: where short and long predictions, or angles and velocities, disagree on an unknown, the model is not exact
and the interval is wider. Each draw also has its own expectation of each unknown, so that an unknown
which the logs leave open keeps the width of its expectation. Sources: Rubin, The Bayesian bootstrap (Annals of
Statistics 9, 1981); the gradients of few blocks are corrected for their leverage as in Bell and McCaffrey (Survey
Methodology 28, 2002).
"""

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear

from ..log.segments import Segments
from .fit import Fit
from .prediction import INDEX

BLOCK = 1.0
"""Length of a block (s)."""
SHAPE = 4.0
"""Shape of the Gamma distribution of the other weights: their variance is the inverse."""
DRAWS = 400
WIDENING = 1.75
"""Factor on the draws' distance from the solution. The bootstrap does not see what all windows have in common:
errors of the smoother and of the integration. Chosen on simulated pendulums that are not among those reported."""
LARGEST_LEVERAGE = 0.99
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
    # Delay and lag may exchange, beyond their bounds too: their sum is what the logs tell.
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
    factor = 1.0 / (1.0 - np.minimum(leverage, LARGEST_LEVERAGE))
    spread = root @ (vectors * factor[:, None]) @ np.swapaxes(vectors, 1, 2) @ inverse
    corrected = np.einsum("bij,bkj->bki", spread, gradient)
    return corrected - (corrected.sum(axis=(0, 1)) + pull) / corrected[..., 0].size


def _step(matrix: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The least of ½ δᵀ matrix δ + slopeᵀ δ within bounds."""
    # Most draws keep the bounds by themselves, and this is far faster than the bounded problem.
    step = np.linalg.solve(matrix, -slope)
    if np.all((step >= low) & (step <= high)):
        return step
    root = np.linalg.cholesky(matrix)
    return lsq_linear(root.T, -np.linalg.solve(root, slope), (low, high)).x
