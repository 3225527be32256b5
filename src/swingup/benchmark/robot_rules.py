"""Rules of swing-ups on the simulated robot, as data: plain success, and trials as on a real robot's board."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from ..loop.supervisors.limits import Limits
from ..plant.units import VELOCITY
from .rules import PERFORMANCE_RULES, PerformanceRules, PushRules, Timing, look_up

STOP_SPEED = 20.0
"""Speed of a joint at which the robot stops (rad/s). Source: the AI Olympics' loop on the robot."""
STOP_ANGLE = 4 * math.pi
"""Angle of a joint at which it stops (rad). Source: the same."""
STOP = Limits(angle=STOP_ANGLE, speed=STOP_SPEED)


@dataclass(frozen=True, kw_only=True)
class Sim2RealRules(Timing):
    """What counts as success on the simulated robot."""

    performance: PerformanceRules = PERFORMANCE_RULES["hardware"]
    """How its costs are scored."""
    hold: float = 2.0
    """Last part of the run in which the tip must be up (s). Chosen."""
    speed: Annotated[float, VELOCITY] = STOP_SPEED
    """Speed of a joint at which the robot stops (rad/s)."""
    angle: float = STOP_ANGLE
    """Angle of a joint at which it stops (rad)."""


SIM2REAL_RULES = Sim2RealRules(name="sim2real")
"""Success in :func:`swingup.benchmark.sim2real.sim2real`."""


@dataclass(frozen=True, kw_only=True)
class TrialRules(Timing):
    """Trials on the simulated robot by the rules of a real one's board: what the robot records is scored."""

    performance: PerformanceRules = PERFORMANCE_RULES["hardware"]
    """How a recorded run is scored."""
    pushes: Mapping[str, PushRules] = field(default_factory=dict)
    """Pushes on both joints by the robot's name, with as many profiles as trials; none for calm trials."""
    stop: Limits = STOP
    """Beyond these the robot stops, and the run fails."""
    domain: str = "recorded"
    """Plants and loops are drawn from this domain, unless from another."""
    trials: int = 10
    """Runs of a controller on the board."""


TRIAL_RULES = {
    rules.name: rules
    for rules in (
        TrialRules(
            name="iros-real",
            pushes={
                "acrobot": PushRules(profiles=10, pushes=2, amplitude=(0.5, 0.75)),
                "pendubot": PushRules(profiles=10, pushes=2, amplitude=(0.2, 0.5)),
            },
        ),
        TrialRules(name="v2-real"),
    )
}
"""``iros-real``: the real robot of IROS 2024, with pushes. ``v2-real``: the same robot's board without."""

DEFAULT_TRIAL_RULES = "iros-real"


def get_trial_rules(name: str | TrialRules) -> TrialRules:
    """Look rules of trials on a robot up by their name; rules are returned as they are.

    Raises:
        SwingupError: there are no such rules.
    """
    return look_up("trial", TRIAL_RULES, name)
