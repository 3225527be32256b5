"""The published settings of the RealAIGym benchmark's baselines (double pendulum, design C.1), as data.

Weights are on squared errors of q1, q2 (rad), dq1, dq2 (rad/s) and the driven torque (N m).
"""

from dataclasses import dataclass

from ...plant.equations import StateFloats
from ..swingups.design import SwingupProblem, TrackingWeights
from ..swingups.ilqr import ILQRSettings
from .lqr import LQRSettings


@dataclass(frozen=True)
class TVLQRSettings:
    """A time-varying LQR along a trajectory, in discrete time."""

    final_factor: float | None
    """Q_f as a multiple of Q; None takes the S of the LQR at the top."""
    state_weights: StateFloats = (0.64, 0.56, 0.13, 0.037)
    torque_weight: float = 0.82
    pieces: int = 40
    """Cubics of the piecewise fit of the trajectory and the gains."""


@dataclass(frozen=True)
class MPCSettings:
    """Model predictive control by iLQR along a trajectory."""

    tracking: TrackingWeights
    upright: TrackingWeights
    """Used once the horizon reaches the trajectory's end."""
    settings: ILQRSettings
    dt: float = 0.002
    """Length of a step (s)."""
    horizon: int = 100
    """States of a plan, with the present one."""
    pieces: int = 40


_LQR = LQRSettings(state_weights=(0.97, 0.93, 0.39, 0.26), torque_weight=0.11, max_cost_to_go=1000.0)
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
    tvlqr_threshold: StateFloats
    """|errors| below which the LQR takes over from the TVLQR (rad, rad/s)."""
    mpc_threshold: StateFloats
    riccati_threshold: StateFloats = (0.05, 0.05, 0.1, 0.1)
    lqr: LQRSettings = _LQR
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
