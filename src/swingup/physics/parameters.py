"""The double pendulum's parameters and their files, and the plant of the leaderboards.

The file format is a flat YAML map with the key names of RealAIGym's ``model_parameters.yml``.
"""

import dataclasses
import math
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import equinox as eqx

from ..checks import LARGEST
from ..errors import SwingupError
from ..robots import ROBOTS as ROBOTS
from ..robots import TORQUE_LIMIT as TORQUE_LIMIT
from ..robots import Robot as Robot
from ..robots import get_robot as get_robot
from ..text import quoted
from ..types import Scalar
from ..yaml_map import read_map, write_map
from .validity import check_pendulum

Real = float | Scalar

IDENTIFIED_MODEL = "design_C.1_model_1.0.yml"


class Parameters(eqx.Module):
    """Parameters of the double pendulum, a pytree of reals: batch it with ``vmap`` to vary the model.

    Source: identified model 1.0 of design C.1 in the public RealAIGym benchmark.
    """

    m1: Real
    """Mass of link 1 (kg)."""
    m2: Real
    """Mass of link 2 (kg)."""
    l1: Real
    """Length of link 1 (m)."""
    l2: Real
    """Length of link 2 (m)."""
    r1: Real
    """Distance of the centre of mass of link 1 from the shoulder (m)."""
    r2: Real
    """Distance of the centre of mass of link 2 from the elbow (m)."""
    I1: Real
    """Inertia of link 1 about the shoulder (kg m²)."""
    I2: Real
    """Inertia of link 2 about the elbow (kg m²)."""
    Ir: Real
    """Inertia of a motor's rotor (kg m²)."""
    gr: Real
    """Gear ratio of the motors."""
    b1: Real
    """Viscous damping of the shoulder (N m s/rad)."""
    b2: Real
    """Viscous damping of the elbow (N m s/rad)."""
    cf1: Real
    """Coulomb friction of the shoulder (N m)."""
    cf2: Real
    """Coulomb friction of the elbow (N m)."""
    g: Real
    """Gravity (m/s²)."""
    tl1: Real
    """Torque limit of the shoulder (N m)."""
    tl2: Real
    """Torque limit of the elbow (N m)."""

    @property
    def length(self) -> Real:
        """Height of the tip above the shoulder when upright, l1 + l2 (m)."""
        return self.l1 + self.l2


NAMES = tuple(field.name for field in dataclasses.fields(Parameters))


def identified_parameters() -> Parameters:
    """The identified plant, with its frictions and motor inertia (design C.1, model 1.0)."""
    with resources.as_file(resources.files(__package__) / "models" / IDENTIFIED_MODEL) as path:
        return load_parameters(path)


def leaderboard_parameters(robot: Robot) -> Parameters:
    """The plant of the leaderboards: no friction, no motor inertia, 6 N m on the driven joint alone."""
    # The file's own limits are wider; its gear ratio has no effect without the rotors' inertia.
    limits = {"tl1": TORQUE_LIMIT * robot.actuation[0], "tl2": TORQUE_LIMIT * robot.actuation[1]}
    return dataclasses.replace(identified_parameters(), b1=0.0, b2=0.0, cf1=0.0, cf2=0.0, Ir=0.0, **limits)


def load_parameters(path: str | Path) -> Parameters:
    """Read parameters from a flat YAML map with RealAIGym's key names; other keys are ignored.

    Raises:
        SwingupError: the file cannot be read, lacks a key, or its values make no pendulum.
    """
    return make_parameters(read_map(path, "parameter"), f"parameter file {path}")


def make_parameters(values: Mapping[str, Any], source: str) -> Parameters:
    """Parameters from values by name; other names are ignored. Errors name the ``source``.

    Raises:
        SwingupError: a value is missing, or the values make no pendulum.
    """
    missing = [name for name in NAMES if name not in values]
    if missing:
        raise SwingupError(f"{source} lacks {', '.join(missing)}: add them in SI units")
    return validated(Parameters(**{name: _real(name, values[name]) for name in NAMES}))


def save_parameters(parameters: Parameters, path: str | Path) -> None:
    """Write parameters as a flat YAML map with RealAIGym's key names, exactly and atomically.

    Raises:
        SwingupError: the file cannot be written.
    """
    values = {name: float(getattr(parameters, name)) for name in NAMES}
    write_map(path, values)


def validated(parameters: Parameters) -> Parameters:
    """Return the parameters if they describe a pendulum.

    Negative friction and inertias below m r² are allowed: the robustness benchmark contains both.

    Raises:
        SwingupError: a value is not finite, a mass, length or g is not positive, a torque limit is negative, or
            the mass matrix is not positive definite in every configuration.
    """
    values = {name: _real(name, getattr(parameters, name)) for name in NAMES}
    check_pendulum(values)
    return parameters


def _real(name: str, value: Any) -> float:
    """A parameter as a float: a number, an array of one, or a text that is one, as YAML's 4e-5 is."""
    try:
        # float(True) would be 1.
        if isinstance(value, bool):
            raise TypeError("a truth value")
        real = float(value)
    # An integer beyond floating point: the check below names it.
    except OverflowError:
        real = math.inf
    except (TypeError, ValueError):
        raise SwingupError(
            f"parameter {name} = {quoted(value)} is not a number: write its value in SI units"
        ) from None
    if not abs(real) < LARGEST:
        raise SwingupError(f"parameter {name} = {real:g} must be finite and below {LARGEST:g}: use SI units")
    return real
