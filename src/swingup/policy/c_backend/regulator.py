"""What a C header has of the regulator: its numbers."""

import numpy as np

from ...physics.base_parameters import base_parameters
from ..pendulum import PendulumPolicy
from ..regulator_settings import RegulatorSettings, fixed_point, known_of
from .numbers import braces


def regulator_values(settings: RegulatorSettings, policy: PendulumPolicy) -> dict[str, str]:
    """The gaps of the regulator's program, for the plant of the policy's file."""
    known, (weights, torque_weight) = known_of(policy.plant), settings.step_weights
    numbers = {
        "GRAVITY": known.g,
        "GEAR": known.gr,
        "L1": known.l1,
        "COULOMB": settings.coulomb_damping,
        "STEP": settings.riccati_step,
        "HALF": 0.5 * settings.riccati_step * settings.riccati_step,
        "TORQUE_WEIGHT": torque_weight,
        "ENTER": settings.enter,
        "BEYOND": settings.leave - settings.enter,
        "ENTER_COULOMB": settings.enter_coulomb,
        "LEAVE_COULOMB": settings.leave_coulomb,
    }
    arrays = {
        "WEIGHTS": np.array(weights),
        "START": fixed_point(policy.plant, policy.robot.joint, settings).reshape(-1),
    }
    texts = {name: repr(float(value)) for name, value in numbers.items()}
    texts |= {name: braces(values) for name, values in arrays.items()}
    texts["STEPS"] = str(settings.riccati_steps)
    texts["THETA"] = f"    static const double base[9] = {braces(base_parameters(policy.plant))};\n"
    return texts
