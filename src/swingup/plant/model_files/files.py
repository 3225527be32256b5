"""Model files: read by their content, and written from a plant's numbers.

A plant that is written hangs at rest where the joints' angles are 0. The files beside this one are the formats'
texts, with gaps ``$like_this`` for numbers. A URDF's joint needs a speed limit: 1000 rad/s is beyond what a
pendulum reaches. MuJoCo takes foreign numbers in ``<custom>`` alone.
"""

from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from string import Template
from xml.etree.ElementTree import Element
from xml.sax.saxutils import quoteattr

import numpy as np

from ...common import __version__
from ...common.checks import one_of
from ...common.errors import SwingupError, one_line
from ...common.files import write_atomically
from ...common.xml_tree import attributes_of, read_tree
from .bodies import READINGS, Model, without_rotors
from .mjcf import AT_SPEED, read_mjcf
from .urdf import OUR_ELEMENT, read_urdf

READERS = {"robot": read_urdf, "mujoco": read_mjcf}
"""Readers by the tag of the outermost element."""

TEMPLATES = {".urdf": "pendulum.urdf", ".xml": "pendulum.xml", ".mjcf": "pendulum.xml"}
"""Texts by the ends of file names."""

LEAST_GEAR = 1e-6
"""Least gear ratio: the square of a smaller one divides no inertia."""
CHOSEN_NUMBERS = ("m1", "m2", "r1", "r2", "I1")
"""Numbers that another plant, which moves alike, may have otherwise."""


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


def write_model(path: str | Path, name: str, bodies: Mapping[str, float], plant: Mapping[str, float]) -> None:
    """Write a URDF (.urdf) or an MJCF (.xml, .mjcf).

    The bodies' numbers are written. The plant moves alike, and its numbers are those that ``read_model`` reads.
    """
    for fact in ("Ir", "b1", "b2", "cf1", "cf2"):
        if bodies[fact] < 0:
            raise SwingupError(
                f"cannot write {path}: {fact} = {bodies[fact]:g} is negative, which model files may not have"
            )
    if not bodies["gr"] >= LEAST_GEAR:
        raise SwingupError(f"cannot write {path}: gr = {bodies['gr']:g} must be at least {LEAST_GEAR:g}")
    if not is_buildable(bodies):
        raise SwingupError(
            f"cannot write {path}: no bodies move as this plant does, whose inertias are below m r²; raise I2"
        )
    # Numbers of no body would be lost in the bodies that move alike.
    kept = "" if bodies == plant else f' data="{" ".join(repr(plant[fact]) for fact in CHOSEN_NUMBERS)}"'
    write_atomically(path, model_text(Path(path).suffix.lower(), name, bodies, kept).encode())


def is_buildable(plant: Mapping[str, float]) -> bool:
    """Whether both links' inertias about their centres are positive, without the rotors."""
    inertias = without_rotors(plant)[:2]
    return all(inertias[link - 1] > plant[f"m{link}"] * plant[f"r{link}"] ** 2 for link in (1, 2))


def model_text(suffix: str, name: str, plant: Mapping[str, float], kept: str = "") -> str:
    """A file's text, for the end of its name; ``kept`` is an attribute of the element of our own."""
    (I1, I2, *armatures), gear, numbers = without_rotors(plant), plant["gr"], {**plant, "fall": -plant["g"]}
    motors = ""
    for link, inertia, armature in zip((1, 2), (I1, I2), armatures, strict=True):
        m, l, r, cf, tl = (plant[f"{each}{link}"] for each in ("m", "l", "r", "cf", "tl"))  # noqa: E741
        # Both formats have inertias about the centre of mass, a plant about the joint.
        own = {"about": inertia - m * r**2, "armature": armature, "rotor": armature / gear**2, "thick": l / 40}
        own |= {"at_l": -l, "at_r": -r, "half": -l / 2, "loss": AT_SPEED * cf}
        numbers |= {f"{each}{link}": value for each, value in own.items()}
        # MuJoCo refuses a motor whose range is empty.
        if tl > 0:
            joint, most = ("shoulder", "elbow")[link - 1], tl / gear
            motors += f'<motor name="{joint}" joint="{joint}" gear="{gear!r}" ctrlrange="{-most!r} {most!r}"/>'
    custom = f'<numeric name="{OUR_ELEMENT}"{kept}/>' if kept else ""
    texts = {"name": quoteattr(name), "version": __version__, "kept": kept, "own": custom, "motors": motors}
    template = (resources.files(__package__) / TEMPLATES[suffix]).read_text(encoding="utf-8")
    return Template(template).substitute({key: repr(value) for key, value in numbers.items()} | texts)
