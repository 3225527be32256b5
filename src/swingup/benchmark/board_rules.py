"""Versions of the rules: the boards that each has."""

from dataclasses import dataclass

from ..common.checks import one_of
from .robot_rules import TRIAL_RULES, TrialRules
from .rules import PERFORMANCE_RULES, ROBUSTNESS_RULES, UPTIME_RULES, PerformanceRules, RobustnessRules, UptimeRules


@dataclass(frozen=True)
class BoardRules:
    """The rules of all boards of one version; None for a board that the version lacks."""

    name: str
    performance: PerformanceRules | None = None
    robustness: RobustnessRules | None = None
    uptime: UptimeRules | None = None
    trials: TrialRules | None = None

    @property
    def for_recordings(self) -> PerformanceRules | UptimeRules | None:
        """The rules that score a recorded run, if any."""
        return self.performance or self.uptime or (self.trials.performance if self.trials else None)


BOARD_RULES = {
    rules.name: rules
    for rules in (
        BoardRules("v2", PERFORMANCE_RULES["v2"], ROBUSTNESS_RULES["v2"]),
        BoardRules("hardware", PERFORMANCE_RULES["hardware"]),
        BoardRules("hardware-perturbed", PERFORMANCE_RULES["hardware-perturbed"]),
        BoardRules("v3", uptime=UPTIME_RULES["v3"]),
        BoardRules("icra-real", uptime=UPTIME_RULES["icra-real"]),
        BoardRules("cloudpendulum", uptime=UPTIME_RULES["cloudpendulum"]),
        BoardRules("iros-real", trials=TRIAL_RULES["iros-real"]),
        BoardRules("v2-real", trials=TRIAL_RULES["v2-real"]),
    )
}
"""``v2`` and ``v3``: IROS 2024 and ICRA 2025 in simulation. ``hardware``: the real robot of IROS 2024, on the
simulation's plant. ``hardware-perturbed``: that robot's board of runs with pushes. ``iros-real`` and ``icra-real``:
the real robots' boards on the simulated robot; ``v2-real``: without pushes. ``cloudpendulum``: ours, in the shape
of its public example."""


def get_board_rules(name: str | BoardRules) -> BoardRules:
    """Look a version of the rules up by its name; rules are returned as they are.

    Raises:
        SwingupError: there is no such version.
    """
    return BOARD_RULES[one_of("rules", name, BOARD_RULES)] if isinstance(name, str) else name
