"""Files of plants, read and written: parameter files in YAML, URDF and MJCF; and the plants that the package ships.

The parameter file's format is a flat YAML map with the key names of RealAIGym's ``model_parameters.yml``. Robots
run policies without PyYAML and MuJoCo: their readers are imported where a file needs them.
"""

import html
import math
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from ..common import __version__
from ..common.checks import LARGEST_NUMBER, one_of
from ..common.errors import SwingupError, naming, one_line, quoted
from ..common.files import has_suffix, write_atomically, write_map
from .base_parameters import BASE_NAMES, base_parameters
from .plant import LEADERBOARD, NAMES, RANGE_REFUSED, ZEROS, Plant, PlantLike, make_plant, validated

PARAMETER_FILES, MODEL_FILES = (".yml", ".yaml"), (".urdf", ".xml", ".mjcf")
"""Ends of the names of parameter files, and of files in other programs' formats."""

PLANT_FILES = "a parameter file (.yml), a URDF (.urdf) or an MJCF (.xml)"  # The files of plants, for messages

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
    return name in SHIPPED_PLANTS or has_suffix(name, *PARAMETER_FILES) or is_model_file(name)


def is_model_file(name: str | Path) -> bool:
    """Whether a name is that of a URDF or an MJCF; of xacro, the reader says what to do."""
    return has_suffix(name, *MODEL_FILES, ".xacro")


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


def _shipped_plant(name: str) -> Plant:
    if name == LEADERBOARD.name:
        return LEADERBOARD
    with resources.as_file(resources.files(__package__) / "shipped" / f"{name}.yml") as path:
        return make_plant(_entries(path), f"parameter file {path}", name)


def _model_plant(path: str | Path, name: str) -> Plant:
    # Here, since a folder for a robot is without this reader.
    from .model_file import read_model

    facts = read_model(path).facts
    missing = [each for each in NAMES if each not in facts and each not in ZEROS]
    if missing:
        words = " ".join(f"{each}=..." for each in missing)
        raise SwingupError(
            f"it does not say {', '.join(missing)}: swingup plant {one_line(path)} --set {words} --out mine.yml"
        )
    return make_plant(facts, f"model file {path}", name)


_PLAIN_NAMES = {name.lower(): name for name in NAMES}


def _read_plant(file: str) -> Plant:
    entries = _entries(file)
    base = base_plant(entries["plant"], Path(file).parent).values() if "plant" in entries else {}
    for entry in entries if base else ():  # a misspelt name would leave the other plant's number
        if entry not in NAMES and (meant := _PLAIN_NAMES.get(entry.lower().replace("_", ""))):
            raise SwingupError(f"unknown name {quoted(entry)}: write {meant}")
    for name in NAMES:
        if isinstance(entries.get(name), list):
            raise SwingupError(f"{name} = {quoted(entries[name])} {RANGE_REFUSED}")
    return make_plant(base | entries, f"parameter file {file}", file)


def _entries(file: str | Path) -> dict[str, Any]:
    # Here, since a robot that runs a policy may lack PyYAML.
    from ..common.yaml_map import read_map

    return with_both_limits(read_map(file, "parameter"))


def with_both_limits(entries: dict[str, Any]) -> dict[str, Any]:
    """Entries of a plant's or a domain's file, where ``torque_limit`` stands for the limits of both motors."""
    if (both := "torque_limit") not in entries:
        return entries
    motors = ("tl1", "tl2")
    if twice := [name for name in motors if name in entries]:
        raise SwingupError(f"{', '.join(twice)} and {both} say the same: give one of them")
    return entries | dict.fromkeys(motors, entries[both])


TEMPLATES = {".urdf": "pendulum.urdf", ".xml": "pendulum.xml", ".mjcf": "pendulum.xml"}
"""Texts by the ends of file names, with gaps ``$like_this`` for numbers."""

SMALLEST_FACT = 1e-6
"""Smallest gear ratio, whose square divides an inertia, and smallest length (m) in a model file."""

TIP_SHARE = 0.5  # What ends nearer to the elbow than this part of its centre's distance is not the tip of link 2

SMALLEST_BODY = 1e-14
"""MuJoCo takes masses (kg) and inertias (kg m²) below a tenth of it for 0, and refuses them."""

LINK_NUMBERS = ("m1", "m2", "r1", "r2", "I1")
CHOSEN_NUMBERS = (*LINK_NUMBERS, *ZEROS)
"""Numbers that another plant, which moves alike, may have otherwise."""

OUR_ELEMENT = "swingup"
"""The element for what this package writes beside a format's own; MuJoCo takes foreign numbers in ``<custom>``."""

INERTIA_MARGIN = 1.05  # Inertia above that of a point mass, m r²


def save_plant(path: str | Path, plant: Plant, comments: Sequence[str] = ()) -> None:
    """Write a plant to a file, whose name says the format: YAML, URDF or MJCF.

    ``load_plant`` reads the same numbers from it. Where they are those of no body, a URDF or an MJCF has bodies
    that move alike, and the numbers beside them. Comments are lines of text above a YAML file's values.

    Raises:
        SwingupError: the file cannot be written, or no body moves as the plant does.
    """
    plant = validated(plant)
    values = plant.values()
    if has_suffix(path, *MODEL_FILES):
        base = dict(zip(BASE_NAMES, base_parameters(plant).tolist(), strict=True))
        alike = plant if _is_buildable(values) else representative(base, plant)
        # Links hang at 0 in these formats.
        _write_model(path, Path(plant.name or path).name, alike.values() | ZEROS, values)
        return
    if not has_suffix(path, *PARAMETER_FILES):
        raise SwingupError(f"cannot write {path}: name {PLANT_FILES}")
    write_map(path, values, *comments)


def representative(base: Mapping[str, float], start: Plant) -> Plant:
    """A pendulum with these base parameters and frictions, whose links could be built if such a pendulum exists.

    Its masses are near those of the start, whose lengths, gravity and limits it has.
    """
    l1, shoulder = float(start.l1), base["A"] - base["B"]
    if not (shoulder > 0 and base["k"] > 0 and base["B"] != float(start.gr) * base["Ir"]):
        raise SwingupError("no pendulum has these base parameters: raise I1+m2l1^2 or I2")
    # Bodies in a simulation have no geared rotors: a part of the elbow's inertia is theirs (``_without_rotors``).
    lightest = INERTIA_MARGIN * base["m2r2"] ** 2 / (base["B"] - float(start.gr) * base["Ir"])
    # Link 1 keeps a part of the inertia and of the moment, so that both stay positive.
    if not l1**2 > 0:
        raise SwingupError(f"l1 = {l1:g} m is too short to divide by: give it in metres")
    heaviest = min(0.95 * shoulder / l1**2, 0.98 * base["k"] / l1)
    # Where link 2 is too heavy for its inertia, the masses cannot be consistent: the equations still hold.
    m2 = float(np.clip(start.m2, lightest, heaviest)) if 0 < lightest < heaviest else heaviest
    rest, I1 = base["k"] - m2 * l1, shoulder - m2 * l1**2
    # At a given m1 r1, m1 r1² falls with m1: heavy enough, link 1 can be built.
    m1 = max(float(start.m1), INERTIA_MARGIN * rest**2 / I1)
    links = {"m1": m1, "m2": m2, "r1": rest / m1, "r2": base["m2r2"] / m2, "I1": I1, "I2": base["B"]}
    others = {name: base[name] for name in ("Ir", "b1", "b2", "cf1", "cf2")}
    return validated(start.changed(**links, **others, name=""))


def _write_model(path: str | Path, name: str, bodies: Mapping[str, float], plant: Mapping[str, float]) -> None:
    """Write a URDF (.urdf) or an MJCF (.xml, .mjcf).

    The bodies' numbers are written. The plant moves alike, and its numbers are those that ``read_model`` reads.
    """
    for fact in ("Ir", "b1", "b2", "cf1", "cf2"):
        if bodies[fact] < 0:
            raise SwingupError(
                f"cannot write {path}: {fact} = {bodies[fact]:g} is negative, which model files may not have"
            )
    minima = {"gr": SMALLEST_FACT, "l1": SMALLEST_FACT, "l2": max(SMALLEST_FACT, TIP_SHARE * abs(bodies["r2"]))}
    for fact, minimum in minima.items():
        # Above, with a margin for the reader's rounding.
        if not bodies[fact] > minimum * (1 + 1e-6):
            raise SwingupError(f"cannot write {path}: {fact} = {bodies[fact]:g} must be above {minimum:g}")
    if not _is_buildable(bodies):
        raise SwingupError(
            f"cannot write {path}: no bodies move as this plant does, whose inertias are below m r²; raise I2"
        )
    is_mjcf = Path(path).suffix.lower() != ".urdf"
    if is_mjcf and not (plant["tl1"] or plant["tl2"]):  # a motor alone has the gear ratio there
        raise SwingupError(f"cannot write {path}: it would lose gr of a plant without motors; use .urdf or .yml")
    # Numbers of no body would be lost in the bodies that move alike.
    kept = "" if bodies == plant else f' data="{" ".join(repr(plant[fact]) for fact in CHOSEN_NUMBERS)}"'
    with naming(f"cannot write {path}"):
        text = model_text(Path(path).suffix.lower(), name, bodies, kept)
    write_atomically(path, text.encode())


def _is_buildable(plant: Mapping[str, float]) -> bool:
    """Whether both links' inertias about their centres are positive, without the rotors."""
    inertias = _without_rotors(plant)[:2]
    centred = (inertias[link - 1] - plant[f"m{link}"] * plant[f"r{link}"] ** 2 for link in (1, 2))
    return min(*centred, plant["m1"], plant["m2"]) > SMALLEST_BODY


def _without_rotors(plant: Mapping[str, float]) -> tuple[float, float, float, float]:
    """I1, I2 and the armature of both joints (kg m²) with which bodies without rotors move as a plant does.

    Simulations of bodies have the motors' inertia on the diagonal of M alone. A plant's rotors add -gr Ir to M12 as
    well: without it in I2, where it is a part of M12, the same motion is left.
    """
    geared = plant["gr"] * plant["Ir"]
    armature = geared + plant["gr"] * geared
    return plant["I1"], plant["I2"] - geared, armature + plant["Ir"], armature


def model_text(suffix: str, name: str, plant: Mapping[str, float], kept: str = "") -> str:
    """A file's text, for the end of its name; ``kept`` is an attribute of the element of our own."""
    (I1, I2, *armatures), gear, numbers = _without_rotors(plant), plant["gr"], {**plant, "fall": -plant["g"]}
    motors = ""
    for link, inertia, armature in zip((1, 2), (I1, I2), armatures, strict=True):
        m, l, r, cf, tl = (plant[f"{each}{link}"] for each in ("m", "l", "r", "cf", "tl"))  # noqa: E741
        # Both formats have inertias about the centre of mass, a plant about the joint.
        own = {"about": inertia - m * r**2, "armature": armature, "rotor": armature / gear**2, "thick": l / 40}
        own |= {"at_l": -l, "at_r": -r, "half": -l / 2, "loss": math.pi / 2 * cf, "command": tl / gear}
        numbers |= {f"{each}{link}": value for each, value in own.items()}
        # MuJoCo refuses a motor whose range is empty.
        if tl > 0:
            joint, end = ("shoulder", "elbow")[link - 1], tl / gear
            motors += f'<motor name="{joint}" joint="{joint}" gear="{gear!r}" ctrlrange="{-end!r} {end!r}"/>'
    for fact, value in numbers.items():
        if not abs(value) < LARGEST_NUMBER:
            raise SwingupError(f"{fact} = {value:g} would stand in it, and readers take numbers below 1e9")
    custom = f'<numeric name="{OUR_ELEMENT}"{kept}/>' if kept else ""
    texts = {"name": f'"{html.escape(one_line(name))}"', "version": __version__}
    texts |= {"kept": kept, "own": custom, "motors": motors}
    template = (resources.files(__package__) / TEMPLATES[suffix]).read_text(encoding="utf-8")
    return Template(template).substitute({key: repr(value) for key, value in numbers.items()} | texts)
