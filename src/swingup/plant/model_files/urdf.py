"""URDF, ROS's format: links, joints, transmissions; and Drake's rotors.

URDF has no gravity, taken as 9.81 m/s² along -z, and no tip: a frame or a shape may show it. Its friction is taken
as a plant's cf, as RealAIGym's files mean it.
"""

from collections.abc import Mapping
from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np

from ...common.errors import SwingupError, quoted
from ...common.xml_tree import Attributes, attributes_of
from .bodies import Body, Hinge, Model, Part, check_driven, double_pendulum, one_gear
from .frames import Frame, rpy_frame, unit
from .shapes import SIZES, ends

GRAVITY = 9.81
"""m/s²."""

OUR_ELEMENT = "swingup"
"""The element for what this package writes beside a URDF's own."""

KNOWN_ELEMENTS = ("link", "joint", "frame", "transmission", "material", OUR_ELEMENT)
"""Elements that are read, or say nothing of the motion."""


def read_urdf(root: Element, inertia: str | None, gear: float | None) -> Model:
    """The double pendulum of a URDF.

    Inertias are about what ``inertia`` says, "centre" or "joint"; None asks where both may be. The gear ratio is
    the file's if none is given.
    """
    links = _named(root, "link")
    joints = _named(root, "joint")
    carried: dict[str, Element] = {}
    for name, each in joints.items():
        child = _end(each, "child")
        # The joints of a closed loop do not move on their own.
        if child in carried:
            raise SwingupError(f"joint {quoted(name)} closes a loop: {quoted(child)} hangs on two joints")
        carried[child] = each
    order = _order(carried, links)
    gears, driven = _transmissions(root)
    check_driven(driven, joints)
    notes = [f"not read: <{tag}>" for tag in dict.fromkeys(each.tag for each in root) if tag not in KNOWN_ELEMENTS]
    found_gear, bodies = one_gear(gears, notes), []
    for name in order:
        joint = carried.get(name)
        hinge = None if joint is None else _hinge(joint, driven, notes)
        parent = None if joint is None else order.index(_end(joint, "parent"))
        frame = Frame() if joint is None else rpy_frame(_child(joint, "origin"))
        # A link that is welded on is often a named frame alone, such as a tool's.
        marks = [] if joint is None or hinge is not None else [(name, np.zeros(3))]
        link = links.get(name, Element("link"))
        bodies.append(Body(name, parent, frame, hinge, _parts(link), marks, _shape_ends(link)))
    for element in root.findall("frame"):  # Drake's
        given = attributes_of(element)
        if given.text("link") in order:
            bodies[order.index(given.text("link"))].marks.append((given.text("name"), rpy_frame(given).origin))
    hinges = [body.hinge for body in bodies if body.hinge]
    if not driven and hinges and all(hinge.limit == 0.0 for hinge in hinges):
        notes.append("not read: efforts of 0, as exporters write them")
        bodies = [replace(body, hinge=body.hinge and replace(body.hinge, limit=None)) for body in bodies]
    own = _child(root, OUR_ELEMENT)
    gravity = np.array([0.0, 0.0, -own.number("gravity", GRAVITY)])
    about = inertia or own.text("inertia") or None
    return double_pendulum(bodies, gravity, gear or found_gear, notes, about, asked=True)


def _named(root: Element, tag: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in root.findall(tag):
        name = element.get("name", "")
        if name in found:
            raise SwingupError(f"there are two <{tag}> {quoted(name)}")
        found[name] = element
    return found


def _child(element: Element, tag: str) -> Attributes:
    """The attributes of the element's first child of this tag; none where it has no such child."""
    found = element.find(tag)
    where = f"{tag}> of <{element.tag} {element.get('name', '')}"
    return attributes_of(Element(tag) if found is None else found, where)


def _end(joint: Element, tag: str) -> str:
    """The link that a joint names as its parent or child."""
    link = _child(joint, tag).text("link")
    if not link:
        raise SwingupError(f"joint {quoted(joint.get('name', ''))} has no <{tag} link>")
    return link


def _order(carried: Mapping[str, Element], links: Mapping[str, Element]) -> list[str]:
    """Names of the links, each after the one that carries it."""
    children: dict[str, list[str]] = {}
    for child, joint in carried.items():
        children.setdefault(_end(joint, "parent"), []).append(child)
    # A parent that is nowhere a link, such as Drake's world, stands still as well.
    order = [name for name in dict.fromkeys((*links, *children)) if name not in carried]
    for name in order:
        order += children.get(name, [])
    if len(order) < len({*links, *carried}):
        raise SwingupError("joints hang on one another in a circle: no link stands still")
    return order


def _hinge(joint: Element, driven: Mapping[str, float], notes: list[str]) -> Hinge | None:
    """The hinge of a joint; None for one that is fixed."""
    name, kind = joint.get("name", ""), joint.get("type", "")
    if kind == "fixed":
        return None
    if kind not in ("revolute", "continuous"):
        raise SwingupError(f"joint {quoted(name)} is {quoted(kind)}: a plant's are revolute, continuous or fixed")
    if joint.find("mimic") is not None:
        raise SwingupError(f"joint {quoted(name)} mimics another one: a plant's joints move on their own")
    axis, limit, dynamics = (_child(joint, tag) for tag in ("axis", "limit", "dynamics"))
    if limit.values and kind == "revolute":
        low, high = limit.number("lower", 0.0), limit.number("upper", 0.0)
        notes.append(f"left out: the stops of joint {quoted(name)} at {low:.4g} and {high:.4g} rad")
    effort = limit.number("effort", 0.0) if "effort" in limit.values else None
    # Where transmissions name the motors, a joint without one is passive.
    if effort is None and driven and name not in driven:
        effort = 0.0  # other joints have motors
    if friction := dynamics.number("friction", 0.0):
        notes.append(
            f"friction of joint {quoted(name)} is taken as cf = {friction:g} N m, of which π/2 times acts at speed"
        )
    direction = unit(axis.numbers("xyz", (1, 0, 0)), f"joint {quoted(name)}")
    damping = dynamics.number("damping", 0.0)
    return Hinge(name, direction, np.zeros(3), damping, friction, driven.get(name, 0.0), effort)


def _transmissions(root: Element) -> tuple[dict[str, float], dict[str, float]]:
    """The gear ratio of each driven joint, and what its motor's rotor adds to its inertia (kg m²)."""
    gears, driven = dict[str, float](), dict[str, float]()
    for element in root.findall("transmission"):
        joint, numbers = element.find("joint"), {}
        for tag in ("mechanicalReduction", "drake:gear_ratio", "drake:rotor_inertia"):
            for each in element.iter(tag):
                text = each.get("value", (each.text or "").strip())
                numbers[tag] = Attributes({"value": text}, f"<{tag}>").number("value", 1.0)
        # Its sign says which way the motor turns, which a symmetric limit does not show.
        gear = abs(numbers.get("drake:gear_ratio", numbers.get("mechanicalReduction", 1.0))) or 1.0
        if joint is not None:
            name = joint.get("name", "")
            gears[name], driven[name] = gear, gear**2 * numbers.get("drake:rotor_inertia", 0.0)
    return gears, driven


def _parts(link: Element) -> list[Part]:
    """The mass of a link, if it has any."""
    inertial, where = link.find("inertial"), f"link {quoted(link.get('name', ''))}"
    if inertial is None:
        return []
    mass = Attributes(_child(inertial, "mass").values, f"mass of {where}").number("value", 0.0)
    if mass < 0:
        raise SwingupError(f"mass of {where} = {mass:g} kg must not be negative")
    if mass > 0 and inertial.find("inertia") is None:
        raise SwingupError(f"{where} has a mass and no <inertia>: add it")
    moments = Attributes(_child(inertial, "inertia").values, f"inertia of {where}")
    tensor = np.array([[moments.number("i" + min(a + b, b + a), 0.0) for a in "xyz"] for b in "xyz"])
    frame = rpy_frame(_child(inertial, "origin"))
    return [Part(mass, frame.origin, frame.rotation @ tensor @ frame.rotation.T)]


def _shape_ends(link: Element) -> list[np.ndarray]:
    """Ends of the shapes by which a link is drawn or collides."""
    found: list[np.ndarray] = []
    for element in (*link.findall("visual"), *link.findall("collision")):
        frame = rpy_frame(_child(element, "origin"))
        for shape in element.iterfind("geometry/*"):
            given = attributes_of(shape)
            if shape.tag == "box":
                found += map(frame.point, ends("box", 0.5 * given.numbers("size", (0, 0, 0))))
            elif shape.tag in SIZES:
                sizes = np.array([given.number("radius", 0.0), 0.5 * given.number("length", 0.0)])
                found += map(frame.point, ends(shape.tag, sizes[: SIZES[shape.tag]]))
    return found
