"""Versions of the rules: the boards that each has."""

from dataclasses import dataclass

from ..checks import one_of
from .rules import (
    PERFORMANCE_RULES,
    ROBUSTNESS_RULES,
    UPTIME_RULES,
    PerformanceRules,
    RobustnessRules,
    UptimeRules,
)


@dataclass(frozen=True)
class BoardRules:
    """The rules of all boards of one version; None for a board that the version lacks."""

    name: str
    performance: PerformanceRules | None = None
    robustness: RobustnessRules | None = None
    uptime: UptimeRules | None = None


BOARD_RULES = {
    rules.name: rules
    for rules in (
        BoardRules("v2", PERFORMANCE_RULES["v2"], ROBUSTNESS_RULES["v2"]),
        BoardRules("hardware", PERFORMANCE_RULES["hardware"]),
        BoardRules("v3", uptime=UPTIME_RULES["v3"]),
    )
}
"""``v2``: IROS 2024 in simulation. ``hardware``: its real robot. ``v3``: ICRA 2025."""


def get_board_rules(name: str | BoardRules) -> BoardRules:
    """Look a version of the rules up by its name; rules are returned as they are.

    Raises:
        SwingupError: there is no such version.
    """
    return BOARD_RULES[one_of("rules", name, BOARD_RULES)] if isinstance(name, str) else name
