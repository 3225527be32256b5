"""The benchmark's rules, version by version, as data."""

from dataclasses import dataclass

from ..errors import SwingupError


@dataclass(frozen=True)
class Normalisers:
    """What each criterion is divided by in the RealAI score."""

    swingup_time: float
    """s"""
    energy: float
    """J"""
    torque_cost: float
    """N² m² s"""
    torque_smoothness: float
    """N m"""
    velocity_cost: float
    """rad²/s"""


@dataclass(frozen=True)
class PerformanceRules:
    """How one swing-up from hanging at rest is simulated and scored."""

    name: str
    normalisers: Normalisers
    duration: float = 10.0
    """Length of a run (s)."""
    dt: float = 0.002
    """Time of one control and simulation step (s): 500 Hz."""
    height: float = 0.9
    """Fraction of l1 + l2 above which the tip counts as up."""

    @property
    def steps(self) -> int:
        """Steps of a run."""
        return round(self.duration / self.dt)


PERFORMANCE_RULES = {
    rules.name: rules
    for rules in (
        PerformanceRules("v2", Normalisers(20.0, 60.0, 20.0, 0.1, 400.0)),
        PerformanceRules("hardware", Normalisers(20.0, 60.0, 100.0, 4.0, 400.0)),
    )
}
"""``v2``: the simulation leaderboard of IROS 2024. ``hardware``: the real robot's of the same year."""

DEFAULT_RULES = "v2"


def get_performance_rules(name: str | PerformanceRules) -> PerformanceRules:
    """Look rules up by their name; rules are returned as they are.

    Raises:
        SwingupError: there are no such rules.
    """
    if isinstance(name, PerformanceRules):
        return name
    if name not in PERFORMANCE_RULES:
        raise SwingupError(f"unknown rules {name!r}: use one of {', '.join(PERFORMANCE_RULES)}")
    return PERFORMANCE_RULES[name]
