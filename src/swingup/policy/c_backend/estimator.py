"""What a C header has of the estimator: its numbers and its model."""

import re

import numpy as np

from ...physics.equations import COULOMB_STEEPNESS, lump
from ...physics.plant import Plant
from ..pendulum import PendulumPolicy
from ..settings import LOST, PIECES, EstimatorSettings, kalman_gains
from ..template import asset, fill
from .identifier import identified_model
from .numbers import braces


def estimator_values(settings: EstimatorSettings, policy: PendulumPolicy) -> dict[str, str]:
    """The gaps of ``assets/estimator.h`` but those of an identifier."""
    gains = kalman_gains(settings)
    numbers = {
        "DT": settings.dt,
        "MOTOR_LIMIT": policy.plant.limit(policy.robot.joint),
        "GAIN_QQ": gains[0, 0],
        "GAIN_QV": gains[0, 1],
        "GAIN_VQ": gains[1, 0],
        "GAIN_VV": gains[1, 1],
        "FADING": np.exp(-settings.dt / settings.memory),
        "SCALE2": settings.residual_scale**2,
        "CAUTION": settings.caution,
        "LOST": LOST * settings.velocity_noise,
    }
    texts = {name: repr(float(value)) for name, value in numbers.items()}
    found, model = policy.identifier, policy.plant
    return texts | {
        "MODEL": _model(model) if found is None else identified_model(found, model, policy.robot.joint),
        "DEPTH": str(settings.max_delay_steps + 1),
        "PIECES": str(PIECES),
    }


def _model(plant: Plant) -> str:
    lumped = lump(plant)
    numbers = {
        "COUPLING": lumped.coupling,
        "M11": lumped.shoulder + lumped.reflected + lumped.rotor,
        "M12": lumped.elbow - lumped.geared,
        "M22": lumped.elbow + lumped.reflected,
        "GRAVITY1": lumped.gravity1,
        "GRAVITY2": lumped.gravity2,
        "STEEPNESS": COULOMB_STEEPNESS,
    }
    values = {name: repr(float(value)) for name, value in numbers.items()}
    # A name may be anything: no end of a comment may come from a file.
    values["PLANT"] = re.sub(r"[^\w. -]", "_", plant.name)[:60] or "the plant of the policy"
    if plant.friction is None:
        return fill(asset(__package__, "model.h"), values)
    pairs = {"DAMPING": plant.friction.damping, "COULOMB": plant.friction.coulomb}
    values |= {name: braces(np.array(pair)) for name, pair in pairs.items()}
    return fill(asset(__package__, "damped_model.h"), values)
