"""The model that baselines are designed with: the plant without the part of its friction that no plan can use.

Coulomb friction's slope at rest would appear in a linear model as a damping of some 10 N m s/rad, by which a
regulator would take the joint for frozen. Rotors and viscous friction stay.
"""

from ...plant.plant import Plant, PlantLike, load_plant
from ...plant.robots import Robot


def model_of(plant: PlantLike, robot: Robot) -> Plant:
    """A robot's plant without Coulomb friction."""
    return load_plant(plant).driven(robot).changed(cf1=0.0, cf2=0.0)
