"""Model files by their content."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ...common.checks import one_of
from ...common.errors import SwingupError
from ...common.text import one_line
from ...common.xml_tree import attributes_of, read_tree
from .bodies import READINGS, Model
from .mjcf import read_mjcf
from .urdf import OUR_ELEMENT, read_urdf
from .writers import CHOSEN_NUMBERS

READERS = {"robot": read_urdf, "mujoco": read_mjcf}
"""Readers by the tag of the outermost element."""


def read_model(path: str | Path, inertia: str | None = None, gear: float | None = None) -> Model:
    """What a URDF or an MJCF, as its content tells, says of a double pendulum.

    The inertias that it states are about the "centre" of mass or the "joint". By default they are about the centre;
    a URDF's that may be about either are refused. The gear ratio is the file's unless given.
    """
    if inertia is not None:
        one_of("inertia", inertia, READINGS)
    root = read_tree(path, "model")
    try:
        # A macro's numbers are not known before it is expanded.
        if any(each.tag.startswith("xacro:") for each in root.iter()):
            raise SwingupError("it is xacro: expand it first, with xacro FILE > x.urdf")
        if root.tag not in READERS:
            raise SwingupError(f"it begins with <{one_line(root.tag, 40)}>: use URDF (<robot>) or MJCF (<mujoco>)")
        # The content decides, since both formats are called .xml.
        return _recalled(READERS[root.tag](root, inertia, gear), root)
    except SwingupError as error:
        files = [one_line(each.get("file", ""), 80) for each in root.iter("include")]
        included = f"; its <include> of {files[0]} is not read" if files else ""
        raise SwingupError(f"model file {one_line(path)}: {error}{included}") from error


def _recalled(model: Model, root: Element) -> Model:
    """The model with the numbers that a file keeps beside its bodies, as long as both move alike."""
    element = root.find(OUR_ELEMENT) if root.tag == "robot" else root.find(f"custom/numeric[@name='{OUR_ELEMENT}']")
    if element is None or "data" not in element.attrib:
        return model
    numbers = attributes_of(element).numbers("data", (0.0,) * len(CHOSEN_NUMBERS)).tolist()
    kept = dict(zip(CHOSEN_NUMBERS, numbers, strict=True))
    # Who edits a body edits what the file says: stale numbers beside it must not win.
    if np.allclose(_motion(model.facts), _motion(model.facts | kept), rtol=1e-9, atol=0.0):
        return replace(model, facts=model.facts | kept)
    note = "not read: swingup's own numbers in the file, whose plant moves otherwise"
    return replace(model, notes=[*model.notes, note])


def _motion(plant: Mapping[str, float]) -> list[float]:
    """m1 r1 + m2 l1, m2 r2 and I1 + m2 l1², all that motion tells of masses, centres and link 1's inertia."""
    m1, m2, r1, r2, I1 = (plant[name] for name in CHOSEN_NUMBERS)
    return [m1 * r1 + m2 * plant["l1"], m2 * r2, I1 + m2 * plant["l1"] ** 2]
