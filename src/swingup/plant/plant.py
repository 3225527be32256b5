"""A plant: the facts about one double pendulum, with a name; those that the package ships; and their files.

The file format is a flat YAML map with the key names of RealAIGym's ``model_parameters.yml``; ``model_files`` reads
URDF and MJCF. NumPy and Python's standard library suffice here, since robots run policies without JAX and PyYAML.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

from ..common.checks import LARGEST_NUMBER, one_of
from ..common.errors import SwingupError, naming, one_line, quoted
from .damped import Friction
from .equations import Number, lump, mass_entries
from .robots import TORQUE_LIMIT, Robot, get_robot
from .units import torque_over_gravity

FRICTIONLESS_SUFFIX = ", frictionless"
"""Ends the name of a plant whose friction was left out."""


@dataclass(frozen=True)
class Plant:
    """The facts about one double pendulum, by RealAIGym's names in SI units, inertias about the joints.

    ``dynamics`` registers it with JAX as a pytree of its numbers: batch it with ``vmap`` to vary the plant. The
    tree leaves the name out, so that plants of all names share compiled code; what ``jit`` and ``tree.map`` return
    has none. Numbers are not checked here, since they may be traced: see :func:`validated`.
    """

    m1: Number
    """Mass of link 1 (kg)."""
    m2: Number
    """Mass of link 2 (kg)."""
    l1: Number
    """Length of link 1 (m)."""
    l2: Number
    """Length of link 2 (m)."""
    r1: Number
    """Distance of the centre of mass of link 1 from the shoulder (m)."""
    r2: Number
    """Distance of the centre of mass of link 2 from the elbow (m)."""
    I1: Number
    """Inertia of link 1 about the shoulder (kg m²)."""
    I2: Number
    """Inertia of link 2 about the elbow (kg m²)."""
    Ir: Number
    """Inertia of a motor's rotor (kg m²)."""
    gr: Number
    """Gear ratio of the motors."""
    b1: Number
    """Viscous damping of the shoulder (N m s/rad)."""
    b2: Number
    """Viscous damping of the elbow (N m s/rad)."""
    cf1: Number
    """Coulomb friction of the shoulder (N m)."""
    cf2: Number
    """Coulomb friction of the elbow (N m)."""
    g: Number
    """Gravity (m/s²)."""
    tl1: Number
    """Torque limit of the shoulder's motor (N m); 0 once a robot is chosen that drives the elbow alone."""
    tl2: Number
    """Torque limit of the elbow's motor (N m); 0 once a robot is chosen that drives the shoulder alone."""
    name: str = field(default="", compare=False)
    """A shipped plant's name, or the file that it was read from. Not compared."""

    def __str__(self) -> str:
        return self.name or "unnamed"

    @property
    def length(self) -> Number:
        """Height of the tip above the shoulder when upright, l1 + l2 (m)."""
        return self.l1 + self.l2

    @property
    def friction(self) -> Friction | None:
        """Friction of the joints; None if there is none."""
        found = Friction((self.b1, self.b2), (self.cf1, self.cf2))
        # None, not zeros: programs for a plant without friction then have no arctangents.
        return found if any(any(pair) for pair in found) else None

    def limit(self, joint: int) -> Number:
        """Torque limit of a joint (N m)."""
        return (self.tl1, self.tl2)[joint]

    def values(self) -> dict[str, Number]:
        """The numbers by name."""
        return {name: getattr(self, name) for name in NAMES}

    def changed(self, **values: Number) -> "Plant":
        """The plant with some other numbers."""
        return dataclasses.replace(self, **values)

    def driven(self, robot: Robot | str) -> "Plant":
        """The plant with a torque limit of 0 on the joint that the robot does not drive."""
        first, second = get_robot(robot).actuation
        return self.changed(tl1=self.tl1 * first, tl2=self.tl2 * second)

    def frictionless(self) -> "Plant":
        """The plant without friction and rotors' inertia, idealised as the leaderboards idealise C.1."""
        without = dataclasses.replace(self, b1=0.0, b2=0.0, cf1=0.0, cf2=0.0, Ir=0.0)
        name = self.name if without == self else f"{self}{FRICTIONLESS_SUFFIX}"
        return validated(dataclasses.replace(without, name=name))

    def summary(self, robot: Robot | str) -> dict[str, Any]:
        """What a result says of its plant, ready for JSON."""
        return {"plant": str(self), "torque_over_gravity": torque_over_gravity(self.driven(robot))}


NAMES = tuple(each.name for each in dataclasses.fields(Plant) if each.name != "name")
"""Names of the numbers."""

PlantLike: TypeAlias = Plant | str | Path
"""A plant, a shipped plant's name, or a file."""

PARAMETER_FILES, MODEL_FILES = (".yml", ".yaml"), (".urdf", ".xml", ".mjcf")
"""Ends of the names of parameter files, and of files in other programs' formats."""

PLANT_FILES = "a parameter file (.yml), a URDF (.urdf) or an MJCF (.xml)"
"""The files of plants, for messages."""

LEADERBOARD = Plant(
    m1=0.5234602302310271, m2=0.6255677234174437, l1=0.2, l2=0.3, r1=0.2, r2=0.25569305436052964,
    I1=0.031887199591513114, I2=0.05086984812807257, Ir=0.0, gr=6.0,
    b1=0.0, b2=0.0, cf1=0.0, cf2=0.0, g=9.81, tl1=TORQUE_LIMIT, tl2=TORQUE_LIMIT, name="leaderboard",
)  # fmt: skip
"""The plant of the leaderboards: C.1 without friction and rotors' inertia. It needs no file, and so no PyYAML."""

SHIPPED_PLANTS = ("A.0", "B.0", "C.0", "C.1", "cloudpendulum", "cloudpendulum-rods", LEADERBOARD.name)
"""Plants that the package ships: RealAIGym's designs, a CloudPendulum as identified and as two rods, and the
leaderboards'. All but the last are files in ``plant/shipped``, with their sources."""


def load_plant(source: PlantLike) -> Plant:
    """Find a plant by its name, or read it from a file.

    Args:
        source: one of :data:`SHIPPED_PLANTS`, a YAML file with RealAIGym's names (its ``model_parameters.yml``, or
            what ``swingup identify`` wrote), a URDF or an MJCF that says all of a plant, or a plant, which is
            checked. A YAML file with an entry ``plant`` has that plant's values where it gives none itself.

    Raises:
        SwingupError: there is no such plant, or the file cannot be read, lacks a value, has a range, or makes no
            pendulum.
    """
    if isinstance(source, Plant):
        return validated(source)
    name = str(source)
    if name in SHIPPED_PLANTS:
        return _shipped_plant(name)
    if not is_plant_name(name):
        one_of("plant", name, SHIPPED_PLANTS, f" or {PLANT_FILES}")
    with naming(f"plant {one_line(name)}"):
        return _model_plant(name, name) if is_model_file(name) else _read_plant(name)


def is_plant_name(name: str) -> bool:
    """Whether a name is a shipped plant's or a file's, as the command line takes them."""
    return name in SHIPPED_PLANTS or name.endswith(PARAMETER_FILES) or is_model_file(name)


def is_model_file(name: str | Path) -> bool:
    """Whether a name is that of a URDF or an MJCF; of xacro, the reader says what to do."""
    return str(name).lower().endswith((*MODEL_FILES, ".xacro"))


def base_plant(source: object, folder: str | Path) -> Plant:
    """The plant that a file's entry ``plant`` names: a shipped one, or a file with all values."""
    if isinstance(source, str) and source in SHIPPED_PLANTS:
        return _shipped_plant(source)
    if not isinstance(source, str) or not is_plant_name(source):
        raise SwingupError(
            f"plant = {quoted(source)} is not a plant: use {', '.join(SHIPPED_PLANTS)} or {PLANT_FILES}"
        )
    path = Path(folder) / source
    if is_model_file(path):
        return _model_plant(path, source)
    return make_plant(_entries(path), f"parameter file {path}", source)


def make_plant(values: Mapping[str, Any], source: str, name: str = "") -> Plant:
    """A plant from values by name; other names are ignored. Errors name the ``source``."""
    missing = [each for each in NAMES if each not in values]
    if missing:
        raise SwingupError(f"{source} lacks {', '.join(missing)}: add them in SI units")
    return validated(Plant(**{each: values[each] for each in NAMES}, name=name))


def validated(plant: Plant) -> Plant:
    """The plant with Python's floats, if they describe a pendulum.

    Negative friction and inertias below m r² are allowed: the robustness benchmark contains both.
    """
    found = plant.changed(**{name: _real(name, value) for name, value in plant.values().items()})
    for name in ("m1", "m2", "l1", "l2", "g"):
        if getattr(found, name) <= 0:
            raise SwingupError(f"parameter {name} = {getattr(found, name):g} must be positive")
    for name in ("tl1", "tl2"):
        if getattr(found, name) < 0:
            raise SwingupError(f"parameter {name} = {getattr(found, name):g} must not be negative")
    # det M is concave in cos(q2), so that its least value lies at cos(q2) = 1 or -1.
    for cos_q2 in (1.0, -1.0):
        m11, m12, m22 = mass_entries(lump(found), cos_q2)
        if not (m22 > 0 and m11 * m22 - m12 * m12 > 0):
            raise SwingupError(
                f"mass matrix is not positive definite at cos(q2) = {cos_q2:g}: "
                f"raise I1 = {found.I1:g} or I2 = {found.I2:g}"
            )
    return found


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
    if not abs(real) < LARGEST_NUMBER:
        raise SwingupError(f"parameter {name} = {real:g} must be finite and below {LARGEST_NUMBER:g}: use SI units")
    return real


def _shipped_plant(name: str) -> Plant:
    if name == LEADERBOARD.name:
        return LEADERBOARD
    with resources.as_file(resources.files(__package__) / "shipped" / f"{name}.yml") as path:
        return make_plant(_entries(path), f"parameter file {path}", name)


def _model_plant(path: str | Path, name: str) -> Plant:
    # Here, since a folder for a robot is without these readers.
    from .model_files.files import read_model

    facts = read_model(path).facts
    missing = [each for each in NAMES if each not in facts]
    if missing:
        given = " ".join(f"{each}=..." for each in missing)
        raise SwingupError(
            f"it does not say {', '.join(missing)}: swingup plant {one_line(path)} --set {given} --out mine.yml"
        )
    return make_plant(facts, f"model file {path}", name)


def _read_plant(file: str) -> Plant:
    entries = _entries(file)
    base = base_plant(entries["plant"], Path(file).parent).values() if "plant" in entries else {}
    for name in NAMES:
        if isinstance(entries.get(name), list):
            raise SwingupError(
                f"{name} = {quoted(entries[name])} is a range, and a plant has facts: "
                "give one value, or use the file as a domain"
            )
    return make_plant(base | entries, f"parameter file {file}", file)


def _entries(file: str | Path) -> dict[str, Any]:
    # Here, since a robot that runs a policy may lack PyYAML.
    from ..common.yaml_map import read_map

    return read_map(file, "parameter")
