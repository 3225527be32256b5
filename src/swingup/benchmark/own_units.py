"""Disturbances in the units of the pendulum that is judged: noise, friction, pushes and throws, exactly as on C.1.

Torques scale with the torque limit, velocities and times with the pendulum's own unit of time. The period of the
loop, the length of a run, the costs' normalisers and all shares stay as the rules have them.
"""

from dataclasses import replace

from ..loop.domain import Domain
from ..plant.plant import LEADERBOARD, PlantLike, load_plant
from ..plant.robots import Robot
from ..plant.units import PLANT_UNITS, Scales, scaled, scales_of
from .robot_rules import Sim2RealRules
from .rules import ModelSweep, PushRules, RobustnessRules, Sweep, UptimeRules


def robustness_in_own_units(
    rules: RobustnessRules, robot: Robot, plant: PlantLike = LEADERBOARD
) -> RobustnessRules:
    """The grid with its noise, delay, friction, pushes and tolerance scaled.

    Raises:
        SwingupError: there is no such plant, or it has no units.
    """
    scales = scales_of(load_plant(plant).driven(robot))
    angle1, angle2, rate1, rate2 = rules.tolerance
    return replace(
        rules,
        model={name: _model(model, scales) for name, model in rules.model.items()},
        velocity_noise=_sweep(rules.velocity_noise, scales.velocity),
        torque_noise=_sweep(rules.torque_noise, scales.torque),
        delay=_sweep(rules.delay, scales.time),
        perturbations=scaled_pushes(rules.perturbations, scales),
        tolerance=(angle1, angle2, rate1 * scales.velocity, rate2 * scales.velocity),
    )


def uptime_in_own_units(rules: UptimeRules, robot: Robot, plant: PlantLike = LEADERBOARD) -> UptimeRules:
    """The throws by a PID with the pendulum's own strength and speed.

    Raises:
        SwingupError: there is no such plant, or it has no units.
    """
    scales = scales_of(load_plant(plant).driven(robot))
    # The loop's period does not scale, and so the PID's own period does not either.
    return replace(
        rules,
        throw_duration=rules.throw_duration * scales.time,
        thrower=scaled(rules.thrower, scales),
    )


def sim2real_in_own_units(rules: Sim2RealRules, domain: Domain, robot: Robot) -> Sim2RealRules:
    """The speed that stops a robot, for the plant in the middle of a domain that names one.

    Raises:
        SwingupError: that plant has no units.
    """
    plant = domain.known_plant(robot)
    return rules if plant is None else replace(rules, speed=rules.speed * scales_of(plant).velocity)


def scaled_pushes(pushes: PushRules, scales: Scales) -> PushRules:
    """Pushes with another size and width; the time between them stays, as the length of a run does."""
    least, most = pushes.amplitude
    short, long = pushes.width
    return replace(
        pushes,
        width=(short * scales.time, long * scales.time),
        amplitude=(least * scales.torque, most * scales.torque),
    )


def _model(model: ModelSweep, scales: Scales) -> ModelSweep:
    if model.relative:
        return model
    return replace(model, sweep=_sweep(model.sweep, scales.of(PLANT_UNITS[model.parameter])))


def _sweep(sweep: Sweep, scale: float) -> Sweep:
    return replace(sweep, low=sweep.low * scale, high=sweep.high * scale)
