"""The benchmark's rules, version by version, as data; those of runs on a simulated robot are in ``robot_rules``."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, TypeVar

import numpy as np

from ..common.checks import one_of
from ..loop.supervisors.cell import CellSettings
from ..loop.supervisors.limits import Limits
from ..loop.supervisors.throws import THROWER, Thrower
from ..plant.robots import Robot
from ..plant.units import NUMBER, PLANT_UNITS, STATE, TIME, TORQUE, VELOCITY, Scales, scaled


@dataclass(frozen=True)
class Normalisers:
    """The divisor of each criterion in the RealAI score."""

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


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How long a run lasts, and in which steps."""

    name: str
    duration: float = 10.0
    """Length of a run (s)."""
    dt: float = 0.002
    """Time of one control and simulation step (s): 500 Hz."""

    @property
    def steps(self) -> int:
        """Steps of a run."""
        # Rounded: a quotient of decimals need not be whole.
        return round(self.duration / self.dt)


@dataclass(frozen=True, kw_only=True)
class PerformanceRules(Timing):
    """How one swing-up from hanging at rest is simulated and scored."""

    normalisers: Normalisers
    for_robots: Mapping[str, Normalisers] = field(default_factory=dict)
    """Normalisers of single robots, by the robot's name, where they are others."""
    height: float = 0.9
    """Fraction of l1 + l2 above which the tip counts as up."""

    def of(self, robot: Robot) -> "PerformanceRules":
        """The rules with the normalisers of one robot."""
        return replace(self, normalisers=self.for_robots.get(robot.name, self.normalisers), for_robots={})


@dataclass(frozen=True)
class Sweep:
    """Evenly spaced values of one quantity, both ends included, each simulated ``repetitions`` times."""

    low: float
    high: float
    count: int = 21
    repetitions: int = 1

    def values(self) -> list[float]:
        """The values."""
        return np.linspace(self.low, self.high, self.count).tolist()

    def __mul__(self, factor: float) -> "Sweep":
        """The sweep of values that are so many times as large."""
        return replace(self, low=self.low * factor, high=self.high * factor)


@dataclass(frozen=True)
class ModelSweep:
    """Values of one parameter of the plant; the controller keeps the nominal model."""

    parameter: str
    """Field of :class:`~swingup.plant.plant.Plant` that changes."""
    sweep: Sweep
    relative: bool = False
    """The values are factors on the nominal one; otherwise they are added to it."""
    mass: str | None = None
    """If given, the sweep is of the product of this mass and the parameter: m1 r1 or m2 r2."""

    def in_units(self, scales: Scales) -> "ModelSweep":
        """The sweep for another pendulum: factors stay."""
        unit = NUMBER if self.relative else PLANT_UNITS[self.parameter]
        return replace(self, sweep=self.sweep * scales.of(unit))


@dataclass(frozen=True)
class PushRules:
    """Random profiles of Gaussian pushes, as many on each joint.

    The time between them is real for every pendulum, as the length of a run is.
    """

    profiles: int = 50
    pushes: int = 3
    """Pushes on each joint."""
    apart: float = 1.0
    """Least time between the centres of any two (s)."""
    width: Annotated[tuple[float, float], TIME] = (0.05, 0.1)
    """Range of the standard deviations (s)."""
    amplitude: Annotated[tuple[float, float], TORQUE] = (0.5, 5.0)
    """Range of the absolute amplitudes (N m)."""


_QUARTER = Sweep(0.75, 1.25)
# Absolute values, because the nominal friction is 0. The negative ones drive the joint; the benchmark has them.
_DAMPING, _COULOMB = Sweep(-0.1, 0.1), Sweep(-0.2, 0.2)

MODEL_SWEEPS = {
    # Absolute for the same reason: the leaderboards' plant has no motor inertia.
    "Ir": ModelSweep("Ir", Sweep(0.0, 1e-4)),
    "m1r1": ModelSweep("r1", _QUARTER, relative=True, mass="m1"),
    "I1": ModelSweep("I1", _QUARTER, relative=True),
    "b1": ModelSweep("b1", _DAMPING),
    "cf1": ModelSweep("cf1", _COULOMB),
    "m2r2": ModelSweep("r2", _QUARTER, relative=True, mass="m2"),
    # r2 stays, so that the product m2 r2 varies with m2.
    "m2": ModelSweep("m2", _QUARTER, relative=True),
    "I2": ModelSweep("I2", _QUARTER, relative=True),
    "b2": ModelSweep("b2", _DAMPING),
    "cf2": ModelSweep("cf2", _COULOMB),
}
"""The criterion "model": errors of one parameter at a time (kg m², kg m, kg, N m s/rad, N m, or a factor)."""

SWEPT = ("velocity_noise", "torque_noise", "torque_response", "delay")
"""Criteria that sweep one number of the disturbance (rad/s, N m, -, s)."""

CRITERIA = ("model", *SWEPT, "perturbations")
"""The six criteria of the robustness score."""

RANDOM = ("velocity_noise", "torque_noise", "perturbations")
"""Criteria that depend on the seed."""


@dataclass(frozen=True, kw_only=True)
class RobustnessRules(Timing):
    """The grid of simulations of the robustness score, and the condition of success."""

    model: Mapping[str, ModelSweep] = field(default_factory=lambda: dict(MODEL_SWEEPS))
    velocity_noise: Annotated[Sweep, VELOCITY] = Sweep(0.0, 0.5, repetitions=10)
    torque_noise: Annotated[Sweep, TORQUE] = Sweep(0.0, 1.1, repetitions=10)
    torque_response: Sweep = Sweep(0.1, 2.0)
    delay: Annotated[Sweep, TIME] = Sweep(0.0, 0.04)
    perturbations: PushRules = PushRules()
    tolerance: Annotated[tuple[float, ...], *STATE] = (0.35, 0.35, 1.0, 1.0)
    """Success: the last state is strictly within this of upright at rest (rad, rad, rad/s, rad/s)."""

    def in_units(self, scales: Scales) -> "RobustnessRules":
        """The grid for another pendulum; responses and all counts stay."""
        model = {name: each.in_units(scales) for name, each in self.model.items()}
        return replace(scaled(self, scales), model=model)


@dataclass(frozen=True, kw_only=True)
class UptimeRules(Timing):
    """The global-policy score: throws by a PID on both joints, and the share of time that the tip is up."""

    duration: float = 60.0
    height: float = 0.9
    """Fraction of l1 + l2 above which the tip counts as up."""
    throws: int = 15
    first: float = 3.75
    """Mean time of the first throw (s). The mean time of the last throw is as long before the end."""
    jitter: float = 1.0
    """Throws come at uniform random times within this of their mean times (s)."""
    throw_duration: Annotated[float, TIME] = 0.2
    """s"""
    thrower: Thrower = THROWER
    """The PID that throws."""
    limits: Limits | None = None
    """Beyond these the pendulum is thrown at once; None for planned throws alone."""
    clean: int = 10
    """Samples in a row that have to be within these limits before a throw ends."""
    goals: int | None = None
    """Number of targets that are drawn, for throws by plan and at limits; None for one a planned throw."""
    stop: Limits | None = None
    """Beyond these the run stops; None for runs that nothing stops."""
    domain: str | None = None
    """Plants and loops are drawn from this domain, or from another; None for the leaderboards' perfect plant."""
    cell: CellSettings | None = None
    """Disturbances of a CloudPendulum cell, in place of throws; None for throws."""
    trials: int = 1
    """Runs of a controller on the board."""
    note: str | None = None
    """What readers of a result should know."""


PERFORMANCE_RULES = {
    rules.name: rules
    for rules in (
        PerformanceRules(name="v2", normalisers=Normalisers(20.0, 60.0, 20.0, 0.1, 400.0)),
        PerformanceRules(name="hardware", normalisers=Normalisers(20.0, 60.0, 100.0, 4.0, 400.0)),
        PerformanceRules(
            name="hardware-perturbed",
            normalisers=Normalisers(20.0, 60.0, 100.0, 4.0, 400.0),
            for_robots={"acrobot": Normalisers(20.0, 60.0, 20.0, 1.0, 400.0)},
        ),
    )
}
"""``v2``: the simulation leaderboard of IROS 2024. ``hardware``: the real robot's of the same year.
``hardware-perturbed``: the real robot's board of runs with pushes, whose normalisers differ by robot."""


ROBUSTNESS_RULES = {"v2": RobustnessRules(name="v2")}
"""``v2``: the robustness leaderboard of IROS 2024."""

ROBOT_THROWER = Thrower(kp=2.0, ki=0.0, kd=0.3, proportional_limit=3.0)
"""The PID that throws the real robot."""

UPTIME_RULES = {
    rules.name: rules
    for rules in (
        UptimeRules(name="v3"),
        UptimeRules(
            name="icra-real",
            throws=10,
            first=60.0 / 11,
            throw_duration=1.0,
            thrower=ROBOT_THROWER,
            limits=Limits(angle=3.5 * math.pi, speed=20.0),
            goals=101,
            stop=Limits(angle=4 * math.pi, speed=25.0),
            domain="recorded",
            trials=3,
        ),
        UptimeRules(
            name="cloudpendulum",
            duration=30.0,
            cell=CellSettings(),
            stop=Limits(angle=math.inf, speed=50.0),
            domain="cells",
            trials=4,
            note="Ours, in the shape of CloudPendulum's public example; official scores are not public.",
        ),
    )
}
"""``v3``: the global-policy leaderboard of ICRA 2025 in simulation. ``icra-real``: that of its real robot.
``cloudpendulum``: four drawn cells of CloudPendulum, in the shape of its public example."""

DEFAULT_RULES = "v2"
DEFAULT_UPTIME_RULES = "v3"

RulesT = TypeVar("RulesT", bound=Timing)


def get_performance_rules(name: str | PerformanceRules) -> PerformanceRules:
    """Look rules of the performance board up by their name; rules are returned as they are.

    Raises:
        SwingupError: there are no such rules.
    """
    return look_up("performance", PERFORMANCE_RULES, name)


def get_robustness_rules(name: str | RobustnessRules) -> RobustnessRules:
    """Look rules of the robustness board up by their name; rules are returned as they are.

    Raises:
        SwingupError: there are no such rules.
    """
    return look_up("robustness", ROBUSTNESS_RULES, name)


def get_uptime_rules(name: str | UptimeRules) -> UptimeRules:
    """Look rules of the global-policy board up by their name; rules are returned as they are.

    Raises:
        SwingupError: there are no such rules.
    """
    return look_up("uptime", UPTIME_RULES, name)


def look_up(kind: str, known: Mapping[str, RulesT], name: str | RulesT) -> RulesT:
    """Look rules of a kind up by their name; rules are returned as they are.

    Raises:
        SwingupError: there are no such rules.
    """
    if not isinstance(name, str):
        return name
    return known[one_of(f"{kind} rules", name, known)]
