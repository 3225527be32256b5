"""The two robots of one double pendulum, which differ in the joint that is driven."""

from dataclasses import dataclass

from ..common.checks import one_of


@dataclass(frozen=True)
class Robot:
    """An underactuated double pendulum: which of the two joints is driven."""

    name: str
    """``acrobot`` or ``pendubot``."""
    joint: int
    """Index of the driven joint: 0 is the shoulder, 1 the elbow."""

    @property
    def actuation(self) -> tuple[float, float]:
        """Diagonal of B: 1 for the driven joint, 0 for the passive one."""
        return (1.0, 0.0) if self.joint == 0 else (0.0, 1.0)


ROBOTS = {robot.name: robot for robot in (Robot("acrobot", joint=1), Robot("pendubot", joint=0))}

TORQUE_LIMIT = 6.0
"""Torque limit of the driven joint on the leaderboards (N m)."""


def get_robot(name: str | Robot) -> Robot:
    """Find a robot by its name; a ``Robot`` is returned as it is."""
    if isinstance(name, Robot):
        return name
    return ROBOTS[one_of("robot", name, ROBOTS)]
