"""Settings of the baselines, as data: the published ones, ours for the score, and both for another plant's units.

Published are those of the RealAIGym benchmark's baselines (double pendulum, design C.1). Weights are on squared
errors of q1, q2 (rad), dq1, dq2 (rad/s) and the driven torque (N m).

``OPTIMAL_SETTINGS`` are this package's own upper reference: swing-ups that are nearly optimal for the RealAI score.
The score's penalties tanh(π c/n)/5 are replaced by their slopes about the optimum, which makes velocity cost,
torque cost and smoothness quadratic in [q1, q2, dq1, dq2, u] and the torque's rate. A small cost of q1's error
stands for the swing-up time. The energy is left out: near the optimum it is within 2 % of the least possible. The
result is a local optimum for the nominal plant; there may be better ones.
"""

from dataclasses import dataclass, replace

from ...plant.equations import StateFloats
from ..swingups.design import Search, SwingupProblem, TrackingWeights
from ..swingups.ilqr import ILQRSettings
from .upright import LQRSettings


@dataclass(frozen=True)
class TVLQRSettings:
    """A time-varying LQR along a trajectory, in discrete time."""

    final_factor: float | None  # Q_f as a multiple of Q; None takes the S of the LQR at the top
    state_weights: StateFloats = (0.64, 0.56, 0.13, 0.037)
    torque_weight: float = 0.82
    pieces: int = 40  # Cubics of the piecewise fit of the trajectory and the gains


@dataclass(frozen=True)
class MPCSettings:
    """Model predictive control by iLQR along a trajectory."""

    tracking: TrackingWeights
    upright: TrackingWeights  # Used once the horizon reaches the trajectory's end
    settings: ILQRSettings
    dt: float = 0.002  # Length of a step (s)
    horizon: int = 100  # States of a plan, with the present one
    pieces: int = 40


_PUBLISHED_LQR = LQRSettings(state_weights=(0.97, 0.93, 0.39, 0.26), torque_weight=0.11, max_cost_to_go=1000.0)
_MPC = MPCSettings(
    # The final weights are configured as (100, 10, 10, 1); the published code uses the fourth one twice.
    tracking=TrackingWeights(state=(0.1, 0.1, 0.01, 0.1), torque=0.1, final=(100.0, 10.0, 1.0, 1.0)),
    upright=TrackingWeights(state=(0.1, 0.1, 0.01, 0.01), torque=0.1, final=(10.0, 10.0, 1.0, 1.0)),
    settings=ILQRSettings(
        max_iterations=10,
        tolerance=1e-6,
        regularisation=1.0,
        min_regularisation=0.01,
        max_regularisation=1e4,
        torque_limit=6.0,
    ),
)


@dataclass(frozen=True)
class Published:
    """All settings for one robot; the defaults are those that both robots have."""

    swingup: SwingupProblem
    tvlqr: TVLQRSettings
    tvlqr_threshold: StateFloats  # |errors| below which the LQR takes over from the TVLQR (rad, rad/s)
    mpc_threshold: StateFloats
    riccati_threshold: StateFloats = (0.05, 0.05, 0.1, 0.1)
    lqr: LQRSettings = _PUBLISHED_LQR
    mpc: MPCSettings = _MPC


def _swingup(weights: TrackingWeights, iterations: int, gain_regularisation: float) -> SwingupProblem:
    # The published runs were allowed 100,000 iterations and stalled: their derivatives are approximate. Ours are
    # exact and go on along the same path; they are stopped where the trajectory is the published one.
    settings = ILQRSettings(
        max_iterations=iterations,
        tolerance=1e-6,
        regularisation=100.0,
        min_regularisation=0.01,
        max_regularisation=1e6,
        # Never reached: the swing-ups need 2.6 N m (acrobot) and 1.6 N m (pendubot).
        torque_limit=5.0,
    )
    return SwingupProblem(
        weights,
        settings,
        dt=0.001,
        steps=5999,  # the published N = 6,000 counts the states
        # μ of the published gains, read off their last rows: that of the last improvement.
        gain_regularisation=gain_regularisation,
        first_torque=1e-4,
    )


PUBLISHED_SETTINGS = {
    "acrobot": Published(
        swingup=_swingup(
            TrackingWeights(
                state=(20.6969312, 76.9967729, 0.155726136, 5.42226523),
                torque=99.7938814,
                final=(382.623819, 7053.1559, 58.9790058, 90.14595),
            ),
            iterations=840,
            gain_regularisation=9.33e5,
        ),
        tvlqr=TVLQRSettings(final_factor=100.0),
        tvlqr_threshold=(0.1, 0.1, 0.5, 0.5),
        mpc_threshold=(0.14, 0.14, 0.5, 0.5),
    ),
    "pendubot": Published(
        swingup=_swingup(
            TrackingWeights(state=(0.1, 0.2, 0.0, 0.0), torque=1.0, final=(10.0, 20.0, 10.0, 20.0)),
            iterations=3620,
            gain_regularisation=4.078e5,
        ),
        tvlqr=TVLQRSettings(final_factor=None),
        tvlqr_threshold=(0.05, 0.05, 0.1, 0.1),
        mpc_threshold=(0.2, 0.2, 1.0, 1.0),
    ),
}
"""By the robot's name."""


_COARSE = ILQRSettings(
    max_iterations=150,
    tolerance=1e-6,
    regularisation=1e-3,
    min_regularisation=1e-8,
    max_regularisation=1e10,
    torque_limit=1e3,  # N m/s: of the rate, which is the input here; the torques stay below 6 N m by their cost
    decrease=0.5,
    increase=3.0,
    step_sizes=(1.0, 0.3, 0.1, 0.03, 0.01),
)
_FINE = replace(_COARSE, max_iterations=300, tolerance=1e-8, regularisation=1e-6, min_regularisation=1e-10)
_LQR = LQRSettings(state_weights=(0.64, 0.56, 0.13, 0.037), torque_weight=0.82, max_cost_to_go=1000.0)


@dataclass(frozen=True)
class Optimal:
    """All settings for one robot."""

    swingup: SwingupProblem
    lqr: LQRSettings = _LQR
    """Weights of both regulators, along the trajectory and at the top: those of the published TVLQR."""
    threshold: StateFloats = (0.02, 0.02, 0.05, 0.05)
    """|errors| below which the LQR takes over (rad, rad/s). The torque then hardly changes."""
    rows_per_piece: int = 4
    """Rows in a piece of the cubic fit. A cubic meets four rows exactly, so that tracking costs no score."""


def _score(velocity: float, torque: float, rate: float, angle: float, duration: float) -> SwingupProblem:
    """A problem whose weights are the fall of the score per unit.

    Args:
        velocity: per rad²/s of ∫ (dq1² + dq2²) dt.
        torque: per N²m²s of ∫ u² dt.
        rate: per N²m²/s of ∫ (du/dt)² dt: the smoothness is nearly its root, times 2 ms over the root of 10 s.
        angle: per rad² s of ∫ (q1 - π)² dt.
        duration: s
    """
    return SwingupProblem(
        # The final weights are larger than on the coarse grid, because a final error disturbs the hand-over.
        TrackingWeights((angle, 0.0, velocity, velocity), torque, final=(1000.0, 1000.0, 100.0, 100.0)),
        _FINE,
        dt=0.002,  # the judge's
        steps=round(duration / 0.002),
        rate=rate,
        final_torque=1.0,
        search=Search(
            _COARSE,
            steps=round(duration / 0.01),
            starts=48,
            amplitude=1.0,
            waves=(0.6, 1.2, 1.8, 2.4, 3.0),
            sizes=(0.3, 3.0),
            first_torque=1.5,
            spread=1.0,
            final=(50.0, 50.0, 2.0, 2.0),
        ),
    )


OPTIMAL_SETTINGS = {
    "acrobot": Optimal(_score(velocity=1.2e-3, torque=0.029, rate=4e-4, angle=1e-3, duration=1.8)),
    "pendubot": Optimal(_score(velocity=1.36e-3, torque=0.0265, rate=2.3e-4, angle=3e-4, duration=2.0)),
}
"""By the robot's name."""


DURATIONS = (1.0, 1.5, 2.0)  # Multiples of a swing-up's duration on C.1 that are tried in turn

SEARCH = Search(
    ILQRSettings(
        max_iterations=600,
        tolerance=1e-6,
        regularisation=10.0,
        min_regularisation=1e-6,
        max_regularisation=1e8,
        torque_limit=5.0,
        decrease=0.5,
        increase=3.0,
        step_sizes=(1.0, 0.3, 0.1, 0.03, 0.01),
    ),
    steps=300,
    starts=6,
    amplitude=0.3,
    waves=(1.2, 2.4, 3.6, 4.8, 6.0),
    durations=DURATIONS,
)
"""How the published swing-up of another pendulum begins."""

FINE_ITERATIONS = 60  # Most iterations of that swing-up on its fine grid, after the search on a coarse one


def published_for(published: Published, time: float) -> Published:
    """The published settings for a similar pendulum whose unit of time is this multiple of C.1's."""
    # With a line search fewer iterations are enough.
    settings = replace(SEARCH.settings, max_iterations=FINE_ITERATIONS)
    # The loop's period does not scale, and each call has a row: a step keeps its real length.
    problem = published.swingup
    dt, steps = problem.dt / time, round(problem.steps * time)
    problem = replace(problem, settings=settings, dt=dt, steps=steps, search=SEARCH)
    # A plan of as many of the pendulum's own units has another number of steps.
    horizon = max(10, round(published.mpc.horizon * time))
    mpc = replace(published.mpc, dt=published.mpc.dt / time, horizon=horizon)
    return replace(published, swingup=problem, mpc=mpc)


def optimal_for(optimal: Optimal, time: float) -> Optimal:
    """Our settings for the score for a similar pendulum whose unit of time is this multiple of C.1's."""
    problem, search = optimal.swingup, optimal.swingup.search
    assert search is not None
    # A step keeps its real length, and a coarse one is a whole number of them.
    each = max(1, round(problem.steps / search.steps * time))
    coarse = round(problem.steps * time / each)
    search = replace(search, steps=coarse, durations=DURATIONS)
    return replace(optimal, swingup=replace(problem, dt=problem.dt / time, steps=coarse * each, search=search))
