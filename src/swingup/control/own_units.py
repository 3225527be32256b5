"""The baselines' settings in a pendulum's own units: each number times the scale of its unit, exactly 1 for C.1.

Torques scale with the torque limit, times with the pendulum's own, so that a similar pendulum gets the same
controller, step for step. Ratios are not scaled away: a weaker pendulum needs another swing-up, which is searched.
"""

from dataclasses import replace

from ..physics.equations import StateFloats
from ..physics.units import Scales
from .ilqr import ILQRSettings
from .lqr import LQRSettings
from .optimal import Optimal, ScoreProblem
from .published import MPCSettings, Published, SwingupProblem, TrackingWeights, TVLQRSettings
from .search import SEARCH

FINE_ITERATIONS = 60
"""Most iterations of a swing-up on its fine grid, after the search on a coarse one."""


def scaled_published(published: Published, scales: Scales) -> Published:
    """The published settings for another pendulum."""
    return Published(
        swingup=scaled_swingup(published.swingup, scales),
        lqr=_lqr(published.lqr, scales),
        tvlqr=_tvlqr(published.tvlqr, scales),
        mpc=_mpc(published.mpc, scales),
        tvlqr_threshold=_threshold(published.tvlqr_threshold, scales),
        riccati_threshold=_threshold(published.riccati_threshold, scales),
        mpc_threshold=_threshold(published.mpc_threshold, scales),
    )


def scaled_swingup(problem: SwingupProblem, scales: Scales) -> SwingupProblem:
    """The published trajectory optimisation for another pendulum, which begins with a search."""
    limit = problem.settings.torque_limit * scales.torque_limit
    # The search's settings for both grids: with a line search fewer iterations are enough.
    settings = replace(_ilqr(SEARCH.settings, scales.torque_limit), torque_limit=limit)
    return replace(
        problem,
        weights=_tracking(problem.weights, scales),
        settings=replace(settings, max_iterations=FINE_ITERATIONS),
        gain_regularisation=problem.gain_regularisation / scales.torque_limit**2,
        # The loop's period stays, which is a multiple of dt: a row for each call.
        steps=round((problem.steps + 1) * scales.time) - 1,
        first_torque=problem.first_torque * scales.torque_limit,
        search=replace(SEARCH, settings=settings, amplitude=SEARCH.amplitude * scales.torque_limit),
    )


def scaled_optimal(optimal: Optimal, scales: Scales) -> Optimal:
    """Our settings for the score for another pendulum."""
    return replace(
        optimal,
        swingup=scaled_score(optimal.swingup, scales),
        lqr=_lqr(optimal.lqr, scales),
        threshold=_threshold(optimal.threshold, scales),
    )


def scaled_score(problem: ScoreProblem, scales: Scales) -> ScoreProblem:
    """Our trajectory optimisation for another pendulum."""
    T, U = scales.time, scales.torque_limit
    # The fine step is the judge's and stays. The coarse one is a multiple of it, and the duration one of that.
    coarse_dt = problem.fine_dt * max(1, round(problem.coarse_dt / problem.fine_dt * T))
    return replace(
        problem,
        velocity=problem.velocity * T,
        torque=problem.torque / (U**2 * T),
        rate=problem.rate * T / U**2,
        angle=problem.angle / T,
        duration=coarse_dt * round(problem.duration * T / coarse_dt),
        coarse_final=_state_weights(problem.coarse_final, scales),
        fine_final=_state_weights(problem.fine_final, scales),
        final_torque=problem.final_torque / U**2,
        coarse_dt=coarse_dt,
        # Their input is the torque's rate.
        coarse=_ilqr(problem.coarse, U / T),
        fine=_ilqr(problem.fine, U / T),
        first_torque=problem.first_torque * U,
        amplitude=problem.amplitude * U,
        spread=problem.spread * U,
    )


def stretched(problem: ScoreProblem, factor: float) -> ScoreProblem:
    """The problem with a longer duration, in whole coarse steps."""
    return replace(problem, duration=problem.coarse_dt * round(factor * problem.duration / problem.coarse_dt))


def _ilqr(settings: ILQRSettings, unit: float) -> ILQRSettings:
    """Settings of an iteration whose input has a unit: μ is a cost per square of it."""
    return replace(
        settings,
        regularisation=settings.regularisation / unit**2,
        min_regularisation=settings.min_regularisation / unit**2,
        max_regularisation=settings.max_regularisation / unit**2,
        torque_limit=settings.torque_limit * unit,
    )


def _lqr(settings: LQRSettings, scales: Scales) -> LQRSettings:
    return LQRSettings(
        state_weights=_state_weights(settings.state_weights, scales),
        torque_weight=settings.torque_weight / scales.torque_limit**2,
        # An integral over time.
        max_cost_to_go=settings.max_cost_to_go * scales.time,
    )


def _tvlqr(settings: TVLQRSettings, scales: Scales) -> TVLQRSettings:
    return replace(
        settings,
        state_weights=_state_weights(settings.state_weights, scales),
        torque_weight=settings.torque_weight / scales.torque_limit**2,
    )


def _mpc(settings: MPCSettings, scales: Scales) -> MPCSettings:
    return replace(
        settings,
        tracking=_tracking(settings.tracking, scales),
        upright=_tracking(settings.upright, scales),
        settings=_ilqr(settings.settings, scales.torque_limit),
        # The loop's period stays: a plan of as many of the pendulum's own units has another number of steps.
        horizon=max(10, round(settings.horizon * scales.time)),
    )


def _tracking(weights: TrackingWeights, scales: Scales) -> TrackingWeights:
    return TrackingWeights(
        state=_state_weights(weights.state, scales),
        torque=weights.torque / scales.torque_limit**2,
        final=_state_weights(weights.final, scales),
    )


def _state_weights(weights: StateFloats, scales: Scales) -> StateFloats:
    angle1, angle2, rate1, rate2 = weights
    return angle1, angle2, rate1 * scales.time**2, rate2 * scales.time**2


def _threshold(threshold: StateFloats, scales: Scales) -> StateFloats:
    angle1, angle2, rate1, rate2 = threshold
    return angle1, angle2, rate1 * scales.velocity, rate2 * scales.velocity
