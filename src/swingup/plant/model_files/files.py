"""Model files by their content and by their names."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np

from ...common.checks import one_of
from ...common.errors import SwingupError
from ...common.files import write_atomically
from ...common.text import one_line
from ...common.version import __version__
from ...common.xml_tree import attributes_of, read_tree
from .bodies import READINGS, Model, without_rotors
from .mjcf import read_mjcf
from .urdf import OURS, read_urdf
from .writers import write_mjcf, write_urdf

READERS = {"robot": read_urdf, "mujoco": read_mjcf}
"""Readers by the tag of the outermost element."""

WRITERS = {".urdf": write_urdf, ".xml": write_mjcf, ".mjcf": write_mjcf}
"""Writers by the ends of file names."""

CHOSEN = ("m1", "m2", "r1", "r2", "I1")
"""Numbers that another plant, which moves alike, may have otherwise."""


def read_model(path: str | Path, inertia: str | None = None, gear: float | None = None) -> Model:
    """What a URDF or an MJCF says of a double pendulum.

    Args:
        path: the file; its content tells which of the two it is.
        inertia: whether the inertias that it states are about the "centre" of mass or about the "joint". By default
            they are about the centre; a URDF's that may be about either are refused.
        gear: gear ratio of the motors; by default the file's.

    Raises:
        SwingupError: the file cannot be read, or does not describe a double pendulum in a vertical plane.
    """
    if inertia is not None:
        one_of("inertia", inertia, READINGS)
    root = read_tree(path, "model")
    try:
        if any(each.tag.startswith("xacro:") for each in root.iter()):
            raise SwingupError("it is xacro: expand it first, with xacro FILE > x.urdf")
        if root.tag not in READERS:
            raise SwingupError(f"it begins with <{one_line(root.tag, 40)}>: use URDF (<robot>) or MJCF (<mujoco>)")
        found = READERS[root.tag](root, inertia, gear)
        return _recalled(found, root)
    except SwingupError as error:
        included = next(
            (
                f"; its <include> of {one_line(each.get('file', ''), 80)} is not read"
                for each in root.iter("include")
            ),
            "",
        )
        raise SwingupError(f"model file {one_line(path)}: {error}{included}") from error


def write_model(path: str | Path, name: str, bodies: Mapping[str, float], plant: Mapping[str, float]) -> None:
    """Write a URDF (.urdf) or an MJCF (.xml, .mjcf), in which the pendulum hangs where its angles are 0.

    Args:
        path: the file.
        name: of the model.
        bodies: numbers of the plant that is written.
        plant: numbers of one that moves alike, and that :func:`read_model` reads from the file.

    Raises:
        SwingupError: no body has these numbers, or the file cannot be written.
    """
    for fact in ("Ir", "b1", "b2", "cf1", "cf2"):
        if bodies[fact] < 0:
            raise SwingupError(
                f"cannot write {path}: {fact} = {bodies[fact]:g} is negative, which model files may not have"
            )
    if not bodies["gr"] > 0:
        raise SwingupError(f"cannot write {path}: gr = {bodies['gr']:g} must be positive")
    if not is_buildable(bodies):
        raise SwingupError(
            f"cannot write {path}: no bodies move as this plant does, whose inertias are below m r²; raise I2"
        )
    root = WRITERS[Path(path).suffix.lower()](name, bodies)
    if bodies != plant:
        own = root.find(OURS)
        if own is None:  # MuJoCo takes foreign numbers in <custom> alone
            own = SubElement(SubElement(root, "custom"), "numeric", name=OURS)
        own.set("data", " ".join(repr(plant[fact]) for fact in CHOSEN))
    root.insert(0, Comment(f" Written by swingup {__version__}. Angles: q1 from hanging, q2 relative to link 1. "))
    indent(root)
    write_atomically(path, tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")


def is_buildable(plant: Mapping[str, float]) -> bool:
    """Whether both links' inertias about their centres are positive, without the rotors."""
    inertias = without_rotors(plant)[:2]
    return all(inertias[link - 1] > plant[f"m{link}"] * plant[f"r{link}"] ** 2 for link in (1, 2))


def _recalled(model: Model, root: Element) -> Model:
    """The model with the numbers that a file keeps beside its bodies, as long as both move alike."""
    element = root.find(OURS) if root.tag == "robot" else root.find(f"custom/numeric[@name='{OURS}']")
    if element is None or "data" not in element.attrib:
        return model
    kept = dict(zip(CHOSEN, attributes_of(element).numbers("data", (0.0,) * len(CHOSEN)).tolist(), strict=True))
    ours, theirs = _motion(model.facts), _motion(model.facts | kept)
    if not np.allclose(ours, theirs, rtol=1e-9, atol=0.0):
        return replace(
            model, notes=[*model.notes, "not read: swingup's own numbers in the file, whose plant moves otherwise"]
        )
    return replace(model, facts=model.facts | kept)


def _motion(plant: Mapping[str, float]) -> list[float]:
    """m1 r1 + m2 l1, m2 r2 and I1 + m2 l1², all that motion tells of masses, centres and link 1's inertia."""
    m1, m2, r1, r2, I1 = (plant[name] for name in CHOSEN)
    return [m1 * r1 + m2 * plant["l1"], m2 * r2, I1 + m2 * plant["l1"] ** 2]
