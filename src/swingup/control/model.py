"""The model that baselines are designed with: the plant without the part of its friction that no plan can use.

Coulomb friction's slope at rest would appear in a linear model as a damping of some 10 N m s/rad, by which a
regulator would take the joint for frozen. Rotors and viscous friction stay.
"""

import dataclasses

import jax

from ..physics.plant import Plant, PlantLike, robot_parameters
from ..robots import Robot


def model_of(plant: PlantLike | None, robot: Robot) -> Plant:
    """A robot's parameters without Coulomb friction, as Python floats; the leaderboards' for None.

    Raises:
        SwingupError: there is no such plant.
    """
    model: Plant = jax.tree.map(float, robot_parameters(plant, robot))
    return dataclasses.replace(model, cf1=0.0, cf2=0.0)
