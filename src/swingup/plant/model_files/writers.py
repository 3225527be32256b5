"""URDF and MJCF of a plant's numbers, in which it hangs at rest where the joints' angles are 0.

The files beside this one are the formats' texts, with gaps ``$like_this`` for numbers. A URDF's joint needs a speed
limit: 1000 rad/s is beyond what a pendulum reaches. MuJoCo takes foreign numbers in ``<custom>`` alone.
"""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from string import Template
from xml.sax.saxutils import quoteattr

from ...common.errors import SwingupError
from ...common.files import write_atomically
from ...common.version import __version__
from .bodies import without_rotors
from .mjcf import AT_SPEED
from .urdf import OUR_ELEMENT

TEMPLATES = {".urdf": "pendulum.urdf", ".xml": "pendulum.xml", ".mjcf": "pendulum.xml"}
"""Texts by the ends of file names."""

LEAST_GEAR = 1e-6
"""Least gear ratio: the square of a smaller one divides no inertia."""
CHOSEN_NUMBERS = ("m1", "m2", "r1", "r2", "I1")
"""Numbers that another plant, which moves alike, may have otherwise."""


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
