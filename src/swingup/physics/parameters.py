"""The double pendulum's parameters, their files, and the two robots that are made from them.

The file format is a flat YAML map with the key names of RealAIGym's ``model_parameters.yml``.
"""

import dataclasses
import math
from importlib import resources
from pathlib import Path
from typing import Any

import equinox as eqx
import yaml

from ..errors import SwingupError
from ..files import write_atomically
from ..robots import ROBOTS as ROBOTS
from ..robots import TORQUE_LIMIT as TORQUE_LIMIT
from ..robots import Robot as Robot
from ..robots import get_robot as get_robot
from ..types import Scalar
from .equations import lump, mass_entries

Real = float | Scalar

IDENTIFIED_MODEL = "design_C.1_model_1.0.yml"
LARGEST = 1e9
"""No parameter of a pendulum in SI units comes near this; squares of larger ones might overflow."""


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
    limits = {"tl1": TORQUE_LIMIT * robot.actuation[0], "tl2": TORQUE_LIMIT * robot.actuation[1]}
    return dataclasses.replace(identified_parameters(), b1=0.0, b2=0.0, cf1=0.0, cf2=0.0, Ir=0.0, **limits)


def load_parameters(path: str | Path) -> Parameters:
    """Read parameters from a flat YAML map with RealAIGym's key names; other keys are ignored.

    Raises:
        SwingupError: the file cannot be read, lacks a key, or its values make no pendulum.
    """
    data = read_map(path, "parameter")
    missing = [name for name in NAMES if name not in data]
    if missing:
        raise SwingupError(f"parameter file {path} lacks {', '.join(missing)}: add them in SI units")
    return validated(Parameters(**{name: _real(name, data[name]) for name in NAMES}))


def read_map(path: str | Path, kind: str) -> dict[str, Any]:
    """Read a flat YAML map; ``kind`` of file is named in errors.

    Raises:
        SwingupError: the file cannot be read, is no map, or gives a name twice.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        data, tree = yaml.safe_load(text), yaml.compose(text, yaml.SafeLoader)
    except OSError as error:
        raise SwingupError(f"cannot read {kind} file {path}: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise SwingupError(f"{kind} file {path} is not UTF-8 text: write one 'name: value' a line") from error
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise SwingupError(f"{kind} file {path} is not YAML ({reason}): write one 'name: value' a line") from error
    if not isinstance(data, dict):
        raise SwingupError(f"{kind} file {path} is not a map: write one 'name: value' a line")
    assert tree is not None
    names = [key.value for key, _ in tree.value]
    for name in names:
        if names.count(name) > 1:
            raise SwingupError(f"{kind} file {path} gives {name} {names.count(name)} times: keep one of its values")
    return data


def save_parameters(parameters: Parameters, path: str | Path) -> None:
    """Write parameters as a flat YAML map with RealAIGym's key names, exactly and atomically.

    Raises:
        SwingupError: the file cannot be written.
    """
    values = {name: float(getattr(parameters, name)) for name in NAMES}
    write_atomically(path, yaml.safe_dump(values, sort_keys=False).encode())


def validated(parameters: Parameters) -> Parameters:
    """Return the parameters if they describe a pendulum.

    Negative friction and inertias below m r² are allowed: the robustness benchmark contains both.

    Raises:
        SwingupError: a value is not finite, a mass, length or g is not positive, a torque limit is negative, or
            the mass matrix is not positive definite in every configuration.
    """
    values = {name: _real(name, getattr(parameters, name)) for name in NAMES}
    for name in ("m1", "m2", "l1", "l2", "g"):
        if values[name] <= 0:
            raise SwingupError(f"parameter {name} = {values[name]:g} must be positive")
    for name in ("tl1", "tl2"):
        if values[name] < 0:
            raise SwingupError(f"parameter {name} = {values[name]:g} must not be negative")
    # det M is concave in cos(q2), so that its least value lies at cos(q2) = 1 or -1.
    for cos_q2 in (1.0, -1.0):
        m11, m12, m22 = mass_entries(lump(Parameters(**values)), cos_q2)
        if not (m22 > 0 and m11 * m22 - m12 * m12 > 0):
            raise SwingupError(
                f"mass matrix is not positive definite at cos(q2) = {cos_q2:g}: "
                f"raise I1 = {values['I1']:g} or I2 = {values['I2']:g}"
            )
    return parameters


def _real(name: str, value: Any) -> float:
    if isinstance(value, bool):
        raise SwingupError(f"parameter {name} = {value} is not a number: write its value in SI units")
    try:
        real = float(value)
    except (TypeError, ValueError):
        raise SwingupError(f"parameter {name} = {value!r} is not a number: write its value in SI units") from None
    except OverflowError:
        real = math.inf
    if not abs(real) < LARGEST:
        raise SwingupError(f"parameter {name} = {real:g} must be finite and below {LARGEST:g}: use SI units")
    return real
