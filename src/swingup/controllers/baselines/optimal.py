"""Swing-ups that are nearly optimal for the RealAI score: this package's own upper reference, not a published one.

The score's penalties tanh(π c/n)/5 are replaced by their slopes about the optimum, which makes velocity cost,
torque cost and smoothness quadratic in [q1, q2, dq1, dq2, u] and the torque's rate. A small cost of q1's
error stands for the swing-up time. The energy is left out: near the optimum it is within 2 % of the least possible.
The result is a local optimum for the nominal plant; there may be better ones.
"""

from dataclasses import dataclass, replace

from ...plant.equations import StateFloats
from ..swingups.design import Search, SwingupProblem, TrackingWeights
from ..swingups.ilqr import ILQRSettings
from .lqr import LQRSettings

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
