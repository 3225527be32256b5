"""A controller that is told its plant: the plant's own optimal swing-up, then the plant's own LQR.

It follows the swing-up by time and does not recover from throws. It is an upper bound: no adaptive controller knows
more of its plant.
"""

import numpy as np

from ...plant.plant import Plant
from ..swingups.reference import Reference
from .continuation_settings import ContinuationSettings
from .dry_friction import linear_friction
from .lqr import LQR, LQRSettings, upright_lqr
from .switch import LatchingSwitch
from .tracking import riccati_controller

TOP_WEIGHTS = LQRSettings(state_weights=(1.0, 1.0, 0.1, 0.1), torque_weight=1.0, max_cost_to_go=1000.0)
"""The best of those that were tried, with ``dry_friction.linear_friction`` (``benchmarks/README.md``)."""

HAND_OVER = ContinuationSettings().max_error
"""|errors| below which the LQR takes over (rad, rad/s): no accepted swing-up ends farther away. A third and two
thirds of it held one or two plants fewer of 240 drawn ones, of both robots."""


def known_plant_controller(plant: Plant, reference: Reference) -> LatchingSwitch:
    """Follow a swing-up of a plant and hand over to the plant's LQR.

    Args:
        plant: the pendulum, as Python floats.
        reference: a swing-up for it, as ``continuation.SwingUps.reference`` gives it.
    """
    following = riccati_controller(reference, plant)
    return LatchingSwitch(following, plant_lqr(plant, reference), np.array(HAND_OVER), reference.robot)


def plant_lqr(plant: Plant, reference: Reference) -> LQR:
    """The LQR at the top that is designed for a plant with its friction."""
    return upright_lqr(linear_friction(plant), reference.robot, TOP_WEIGHTS)
