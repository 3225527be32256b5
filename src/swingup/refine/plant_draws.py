"""Plants to learn on, drawn about the leaderboards' and the robot's: none of them is on the board's grid."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..benchmark.robustness_board import MODEL_SWEEPS, ModelSweep
from ..benchmark.runner import stack
from ..common.errors import SwingupError
from ..loop.domain import Domain, load_domain
from ..plant.plant import LEADERBOARD, NAMES, Plant, Robot, validated
from ..plant.units import TORQUE, Scales, arm_scales, similar_plant

RECORDED = "recorded"
"""The domain of the robot's plants."""
GEAR = LEADERBOARD.gr
"""Gear ratio of the motors of design C.1."""
LEFT = {"b1": 0.004, "b2": 0.004, "cf1": 0.04, "cf2": 0.04}
"""Most friction that the compensation of the recorded robot's leaves (N m s/rad, N m)."""
OVERDONE = 0.5
"""Part of that by which compensation overdoes it at most."""
LEFT_SHARE = 0.24
"""Part of larger frictions that their compensation leaves; those of the recorded robot are the former's."""
ROTOR = 3e-4
"""Largest rotor's inertia of the robot's plants behind that gear (kg m²): one session's fit has 2.8e-4, beyond the
domain."""
ROTORS = 4
"""Every so many of the robot's plants has any rotor up to that, the others have those of the domain.
Recordings tell the sum of a rotor's and the upper link's inertia best: what a rotor gains, the link loses."""


@dataclass(frozen=True)
class PlantDraws:
    """How many plants of each kind are drawn."""

    single: int = 160
    """One parameter is off, anywhere in its range."""
    joint: int = 160
    """All are off, each within ``share`` of its range."""
    friction: int = 120
    """The passive joint has friction, up to the end of its range: Coulomb friction in two of three, damping in the
    third. In half of them all parameters are off as well, each within ``friction_share`` of its range."""
    robot: int = 400
    """As recordings show the robot, with what the compensation leaves of its friction. All of the plant is larger
    by what the motor does not deliver."""
    share: float = 0.5
    """Share of the range about the nominal value."""
    friction_share: float = 0.35
    """Share of the range where the passive joint has friction."""
    margin: float = 0.03
    """Part of a range by which a single parameter and the friction may lie beyond it."""
    robot_margin: float = 0.1
    """The same of the robot's plants. The fits of single sessions lie at corners of the ranges, and beyond."""


def draw_plants(
    random: np.random.Generator,
    robot: Robot,
    draws: PlantDraws,
    nominal: Plant = LEADERBOARD,
    domain: Domain | None = None,
) -> Plant:
    """Plants with leaves of shape (n,): single ones, joint ones, those with friction, the robot's, in this order.

    The nominal plant, in C.1's units, is what all but the robot's are about; the robot's are of the domain.
    """
    nominal, names, domain = nominal.driven(robot), list(MODEL_SWEEPS), domain or load_domain(RECORDED)

    def single(_: int) -> Plant:
        sweep = MODEL_SWEEPS[names[random.integers(len(names))]]
        return sweep.varied(nominal, _anywhere(random, sweep, draws.margin))

    def joint(_: int) -> Plant:
        return _all_off(random, nominal, draws.share)

    def with_friction(index: int) -> Plant:
        # Friction where no motor acts is what fails most.
        name = f"{'b' if index % 3 == 2 else 'cf'}{2 - robot.joint}"
        sweep = MODEL_SWEEPS[name]
        plant = nominal if index % 2 else _all_off(random, nominal, draws.friction_share)
        most = sweep.sweep.high * (1 + draws.margin)
        return sweep.varied(plant, random.uniform(0.0, most) - getattr(plant, name))

    def robots(index: int) -> Plant:
        plant = _robots(random, robot, domain, nominal, draws.robot_margin)
        return plant if (index + 1) % ROTORS else _any_rotor(random, plant)

    kinds = ((single, draws.single), (joint, draws.joint), (with_friction, draws.friction), (robots, draws.robot))
    plants = [_pendulum(kind, index) for kind, number in kinds for index in range(number)]
    return stack(plants)


def plants_of(batch: Plant) -> list[Plant]:
    """The plants of a batch, leaves of shape (n,), one by one."""
    return [Plant(*values) for values in zip(*(getattr(batch, name).tolist() for name in NAMES), strict=True)]


def _pendulum(kind: Callable[[int], Plant], index: int) -> Plant:
    """The first draw of a kind that is a pendulum: with a mass matrix as nearly singular as B.0's some are none."""
    while True:
        plant = kind(index)
        with suppress(SwingupError):
            return validated(plant)


def _all_off(random: np.random.Generator, nominal: Plant, share: float) -> Plant:
    plant = nominal
    for sweep in MODEL_SWEEPS.values():
        middle = 1.0 if sweep.relative else 0.0
        drawn = middle + share * (random.uniform(sweep.sweep.low, sweep.sweep.high) - middle)
        plant = sweep.varied(plant, drawn)
    return plant


def _robots(random: np.random.Generator, robot: Robot, domain: Domain, nominal: Plant, margin: float) -> Plant:
    drawn = {}
    for name, low, high in domain.ranges:
        beyond = margin * (high - low)
        drawn[name] = random.uniform(low - beyond, high + beyond)
    scales = arm_scales(domain.design.driven(robot))
    plant = domain.nominal_plant.changed(**{name: value for name, value in drawn.items() if name in NAMES})
    left = {name: random.uniform(*ends) for name, ends in _left(robot, domain, scales).items()}
    plant = similar_plant(plant, scales).changed(**left, tl1=nominal.tl1, tl2=nominal.tl2)
    return behind_motor(plant, drawn.get(f"gain{robot.joint + 1}", 1.0))


def behind_motor(plant: Plant, gain: float) -> Plant:
    """What a motor that delivers this part of its command moves as if it were: a heavier plant."""
    return replace(plant, **{name: getattr(plant, name) / gain for name in ("m1", "m2", "I1", "I2", "Ir")})


def _left(robot: Robot, domain: Domain, scales: Scales) -> dict[str, tuple[float, float]]:
    """Least and most friction that is left, in C.1's units: all of a passive joint's where no motor is."""
    other = 2 - robot.joint
    coulomb, damping, limit = f"cf{other}", f"b{other}", scales.similar(domain.low.loop.passive_limit, TORQUE)
    most = {name: getattr(similar_plant(domain.high.plant, scales), name) for name in (coulomb, damping)}
    share, over = (LEFT_SHARE, OVERDONE) if limit else (1.0, 0.0)
    left = {name: max(LEFT[name], share * value) for name, value in most.items()}
    left[coulomb] = max(left[coulomb], most[coulomb] - limit)
    ends = {name: (-OVERDONE * value, value) for name, value in LEFT.items()}
    return ends | {name: (-over * value, value) for name, value in left.items()}


def _any_rotor(random: np.random.Generator, plant: Plant) -> Plant:
    rotor = random.uniform(0.0, ROTOR * (GEAR / plant.gr) ** 2)
    return replace(plant, Ir=rotor, I1=plant.I1 + plant.gr**2 * (plant.Ir - rotor))


def _anywhere(random: np.random.Generator, sweep: ModelSweep, margin: float) -> float:
    low, high = sweep.sweep.low, sweep.sweep.high
    beyond = margin * (high - low)
    # A range that begins at 0 ends there: a rotor's inertia is never negative.
    return random.uniform(low - beyond if low else low, high + beyond)
