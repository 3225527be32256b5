"""The figures of trajectories and of results, in one place."""

from .plot_motion import plot_phase, plot_trajectories
from .plot_results import plot_curves, plot_robustness

__all__ = ["plot_curves", "plot_phase", "plot_robustness", "plot_trajectories"]
