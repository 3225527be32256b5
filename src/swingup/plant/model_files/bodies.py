"""From bodies and hinges in space to the numbers of a double pendulum.

A plant swings in one vertical plane: both hinges' axes are horizontal and parallel, and the centre of link 1 lies
on the line from the shoulder to the elbow. Bodies without a hinge belong to the link that carries them. Offsets
along the axes have no effect.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from ...common.errors import SwingupError, quoted
from .frames import Frame, Vector, unit

TURNED_ANGLE = 1e-3
"""Angles up to this (rad) are roundings of a file."""

OFF_LINE = 0.02
"""Largest distance of a centre from its link's line that is left out, as a part of the link's length."""

SMALLEST_LENGTH = 1e-6
"""Shorter lengths count as 0 (m)."""

BALANCED_SHARE = 1e-6
"""A centre nearer to the elbow than this part of l1 has no direction."""

EITHER_SHARE = 0.6
"""An inertia above this part of m r² may be about the joint. Rods have a third of it about their centres, and
bodies at least all of it about their joints; RealAIGym's fits go down to 0.77 there."""

READINGS = ("centre", "joint")
"""What the inertias of a file may be about: the centre of mass, as both formats have it, or the joint."""


@dataclass(frozen=True)
class Part:
    """A mass of a body."""

    mass: float
    centre: Vector
    """In the body's frame (m)."""
    inertia: np.ndarray
    """(3, 3), in the axes of the body's frame (kg m²)."""
    stated: bool = True
    """Whether the file says the inertia, which may then be about the joint; a shape's is about its centre."""


@dataclass(frozen=True)
class Hinge:
    """The joint that carries a body."""

    name: str
    axis: Vector
    """In the body's frame."""
    anchor: Vector
    """In the body's frame (m)."""
    damping: float
    coulomb: float
    """Coulomb friction as a plant has it (N m)."""
    armature: float = 0.0
    """Inertia that a motor adds to this joint alone (kg m²)."""
    limit: float | None = None
    """Torque limit (N m); None where the file does not say it."""
    zero: float = 0.0
    """The joint's own angle where the file's frames stand (rad)."""


@dataclass(frozen=True)
class Body:
    """A body in the frame of the body that carries it."""

    name: str
    parent: int | None
    """Place of the body that carries it; None for one that stands still."""
    frame: Frame
    hinge: Hinge | None = None
    parts: list[Part] = field(default_factory=list)
    marks: list[tuple[str, Vector]] = field(default_factory=list)
    """Named frames, which may be the tip."""
    ends: list[Vector] = field(default_factory=list)
    """Ends of its shapes, which may be the tip."""


Relation: TypeAlias = tuple[float, float]
"""Sign s and offset o (rad) of a joint: q = o + s (the file's angle)."""


@dataclass(frozen=True)
class Model:
    """What a model file says of a double pendulum."""

    facts: dict[str, float]
    """A plant's numbers by name; without those that the file does not say."""
    notes: list[str]
    """What was left out, or chosen."""
    angles: tuple[Relation, Relation]
    """How q1 and q2 follow from the file's angles."""


class _Link(NamedTuple):
    """A hinge with all that moves with it, up to the next hinge."""

    hinge: Hinge
    bodies: list[tuple[Body, Frame]]
    """The hinge's own body first, each with its frame in that of what stands still."""

    @property
    def axis(self) -> Vector:
        return self.bodies[0][1].rotation @ self.hinge.axis


class _Plane(NamedTuple):
    """The vertical plane of the motion."""

    axis: Vector
    """The axis of link 1's joint."""
    down: Vector
    side: Vector
    """Where a link that hangs moves first, when it turns about the axis."""

    def flat(self, point: Vector) -> np.ndarray:
        """A point's two coordinates, down and to the side (m)."""
        return np.array([point @ self.down, point @ self.side])

    def joint(self, link: _Link) -> np.ndarray:
        """Where a link's joint is (m)."""
        return self.flat(link.bodies[0][1].point(link.hinge.anchor))


def double_pendulum(
    bodies: Sequence[Body], gravity: Vector, gear: float, notes: Sequence[str], inertia: str | None, asked: bool
) -> Model:
    """The plant's numbers of a chain of two hinges.

    Each body comes after the one that carries it. Gravity (m/s²) is in the frame of what stands still. The armature
    is divided between motors and rotors by the gear ratio. Stated inertias are about what ``inertia`` names, one of
    :data:`READINGS`, or else as the format has it; where ``asked``, those that may be about either are refused
    without it.
    """
    notes, links = list(notes), _links(bodies)
    plane = _plane(links, unit(gravity, "gravity"))
    first, second = (link.hinge for link in links)
    arm = plane.joint(links[1]) - plane.joint(links[0])
    l1 = float(np.hypot(*arm))
    if not l1 > SMALLEST_LENGTH:
        raise SwingupError(f"joint {quoted(second.name)} lies on the axis of {quoted(first.name)}")
    along = arm / l1
    about_joint = _about_joint(links, inertia, asked, notes)
    (m1, centre1, I1), (m2, centre2, I2) = (_masses(link, plane, about_joint) for link in links)
    _check_line(links[0], _cross(along, centre1), l1, notes)
    reach = float(np.hypot(*centre2))
    tip = _tip(links[1], plane, reach)
    # A plant's centre of mass 2 lies on its straight link 2 by definition: the angle q2 is that of the centre.
    straight, r2 = centre2, reach
    if not reach > BALANCED_SHARE * l1:
        straight = along if tip is None else tip[1]
    elif tip is not None and float(tip[1] @ centre2) < 0:  # a counterweight on the other side of the elbow
        straight, r2 = -centre2, -reach
    facts = {"m1": m1, "m2": m2, "l1": l1, "r1": float(centre1 @ along), "r2": r2}
    facts |= {"g": float(np.linalg.norm(gravity)), "gr": gear, "b1": first.damping, "b2": second.damping}
    facts |= {"cf1": first.coulomb, "cf2": second.coulomb}
    facts |= _with_rotors(I1, I2, first.armature, second.armature, gear)
    # An unknown limit stays unknown: 0 would be a joint without a motor.
    facts |= {f"tl{number}": each.limit for number, each in enumerate((first, second), 1) if each.limit is not None}
    if tip is not None:
        facts["l2"] = float(np.hypot(*tip[1]))
        notes.append(f"l2 = {facts['l2']:.4g} m is the distance of {tip[0]} from the elbow")
    if facts["Ir"] > 0:
        notes.append("the armature is in I1, I2 and Ir, so that the pendulum moves as with it")
    hanging = math.atan2(arm[1], arm[0]), math.atan2(_cross(along, straight), float(along @ straight))
    angles = _angles(links, hanging, notes)
    return Model({name: float(value) for name, value in facts.items()}, notes, angles)


def check_driven(driven: Iterable[str], joints: Iterable[str]) -> None:
    """Refuse motors of joints that the file does not have."""
    if lost := sorted({*driven} - {*joints}):
        raise SwingupError(
            f"a motor acts on joint {quoted(lost[0])}, which the file does not have: correct its name"
        )


def one_gear(gears: Mapping[str, float], notes: list[str]) -> float:
    """The gear ratio that the driven joints have, 1 without any; the last one, and a note, where they differ."""
    if len({*gears.values()}) > 1:
        told = ", ".join(f"{gear:g} of {quoted(joint)}" for joint, gear in gears.items())
        notes.append(f"left out: all gear ratios but the last ({told}), unless --set gr=VALUE")
    return [1.0, *gears.values()][-1]


def _links(bodies: Sequence[Body]) -> tuple[_Link, _Link]:
    """The two links, refused where they are not two that hang on one another."""
    places: list[Frame] = []
    carriers: list[_Link | None] = []  # of each body; None for what stands still
    links: list[_Link] = []
    for body in bodies:
        places.append(body.frame if body.parent is None else body.frame.within(places[body.parent]))
        carrier = None if body.parent is None else carriers[body.parent]
        if (hinge := body.hinge) is not None:
            # Two links that both hang on the world are two pendulums.
            if len(links) == 1 and carrier is not links[0]:
                raise SwingupError(f"joint {quoted(hinge.name)} hangs on what stands still, not on link 1")
            if min(hinge.damping, hinge.coulomb, hinge.armature) < 0:
                raise SwingupError(
                    f"joint {quoted(hinge.name)} has a damping, friction or armature that is negative"
                )
            carrier = _Link(hinge, [])
            links.append(carrier)
        if carrier is not None:
            carrier.bodies.append((body, places[-1]))
        carriers.append(carrier)
    if len(links) != 2:
        names = f" ({', '.join(quoted(link.hinge.name) for link in links[:6])})" if links else ""
        raise SwingupError(
            f"{len(links)} joints move{names}, and a double pendulum has two: remove or fix the others"
        )
    return links[0], links[1]


def _plane(links: tuple[_Link, _Link], down: Vector) -> _Plane:
    """The plane of the motion, refused where it is not vertical, or the links move in two."""
    (first, second), (one, other) = (link.axis for link in links), (quoted(link.hinge.name) for link in links)
    # Rounding may make a product of unit vectors larger than 1.
    lean = math.asin(min(1.0, abs(float(first @ down))))
    if lean > TURNED_ANGLE:
        raise SwingupError(
            f"the axis of joint {one} leans {math.degrees(lean):.3g}° from the horizontal: a plant swings in a "
            "vertical plane"
        )
    turned = math.asin(min(1.0, float(np.linalg.norm(np.cross(first, second)))))
    if turned > TURNED_ANGLE:
        raise SwingupError(
            f"the axis of joint {other} is turned by {math.degrees(turned):.3g}° from that of {one}: a plant's "
            "links swing in one plane"
        )
    down = unit(down - (down @ first) * first, "gravity")
    return _Plane(first, down, np.cross(first, down))


def _about_joint(links: Sequence[_Link], inertia: str | None, asked: bool, notes: list[str]) -> bool:
    """Whether the stated inertias of both links are about their joints; what was taken is noted."""
    readings = []
    for hinge, ((body, _), *_) in links:
        for part in body.parts:
            arm = np.cross(hinge.axis, part.centre - hinge.anchor)
            if part.stated and part.mass > 0:
                own, point = float(hinge.axis @ part.inertia @ hinge.axis), part.mass * float(arm @ arm)
                readings.append((quoted(body.name), own, point))
    # Where m r² is nothing, both readings agree.
    unclear = any(own > EITHER_SHARE * point > 1e-6 * own for _, own, point in readings)
    shown = " and ".join(f"{own:.4g} kg m² of {name}" for name, own, _ in readings)
    if inertia == "joint" and not readings:
        notes.append("--inertia joint changes nothing: no link that a joint carries states its inertia itself")
    if inertia is None and unclear and asked:
        raise SwingupError(
            f"the inertias, {shown}, may be about the centres of mass, as the format has them, or about the "
            "joints, as in RealAIGym's files: say which, with swingup plant FILE --inertia centre or joint"
        )
    if readings:
        notes.append(
            f"inertias, {shown}, are taken about the {'joints' if inertia == 'joint' else 'centres of mass'}"
        )
    for name, own, point in readings if inertia == "joint" else ():
        if own < point:
            notes.append(
                f"no body has an inertia about its joint below m r² = {point:.4g}: if that of {name} is not from a "
                "fit, it is about the centre"
            )
    return inertia == "joint"


def _masses(link: _Link, plane: _Plane, about_joint: bool) -> tuple[float, np.ndarray, float]:
    """Mass (kg), centre of mass from the joint in the plane (m) and inertia about the joint (kg m²)."""
    mass, moment, inertia = 0.0, np.zeros(2), 0.0
    for body, place in link.bodies:
        axis = place.rotation.T @ plane.axis
        for part in body.parts:
            centre = plane.flat(place.point(part.centre)) - plane.joint(link)
            own = float(axis @ part.inertia @ axis)
            # A body that is welded to a link has no joint for its inertia to be about.
            stated = about_joint and part.stated and body.hinge is not None
            mass, moment = mass + part.mass, moment + part.mass * centre
            inertia += own if stated else own + part.mass * float(centre @ centre)
    if not mass > 0:
        raise SwingupError(f"link {quoted(link.bodies[0][0].name)} has no mass")
    return mass, moment / mass, inertia


def _check_line(link: _Link, off: float, l1: float, notes: list[str]) -> None:
    """Refuse or note a centre of link 1 that is so far (m) beside the line from joint to joint."""
    beside = f"lies {abs(off):.3g} m beside the line from joint to joint"
    if abs(off) > OFF_LINE * l1:
        name = quoted(link.bodies[0][0].name)
        raise SwingupError(f"the centre of mass of link {name} {beside}, and a plant has it on that line")
    if abs(off) > TURNED_ANGLE * l1:
        notes.append(f"left out: the centre of mass of link 1 {beside}")


def _tip(link: _Link, plane: _Plane, reach: float) -> tuple[str, np.ndarray] | None:
    """What ends link 2 and where from the elbow (m): the farthest frame, or else the farthest end of a shape.

    Frames near the elbow, within half the centre's distance (m), are something else.
    """
    # A named frame is meant; a shape ends where its drawing does.
    marks = [(f"frame {quoted(name)}", place.point(at)) for body, place in link.bodies for name, at in body.marks]
    ends = [("the end of its shape", place.point(at)) for body, place in link.bodies for at in body.ends]
    for found in (marks, ends):
        far = [(name, plane.flat(at) - plane.joint(link)) for name, at in found]
        name, at = max(far, key=lambda each: float(np.hypot(*each[1])), default=("", np.zeros(2)))
        if float(np.hypot(*at)) > max(0.5 * reach, SMALLEST_LENGTH):
            return name, at
    return None


def _angles(
    links: tuple[_Link, _Link], hanging: tuple[float, float], notes: list[str]
) -> tuple[Relation, Relation]:
    """How q1 and q2 follow from the file's angles, of which those that the frames show are given for q (rad)."""
    found, told = [], []
    for number, (link, angle) in enumerate(zip(links, hanging, strict=True), 1):
        sign = math.copysign(1.0, float(links[0].axis @ link.axis))
        offset = math.remainder(angle - sign * link.hinge.zero, 2 * math.pi)
        offset += 2 * math.pi if offset < TURNED_ANGLE - math.pi else 0.0  # π, also where rounding makes it -π
        plain = "" if sign > 0 else "-"
        shown = f"{offset:.4g} {plain or '+'} " if abs(offset) > TURNED_ANGLE else plain
        told.append(f"q{number} = {shown}{quoted(link.hinge.name)}")
        found.append((sign, offset))
    if any(sign < 0 or abs(offset) > TURNED_ANGLE for sign, offset in found):
        notes.append(f"angles: {' and '.join(told)}")
    return found[0], found[1]


def _with_rotors(I1: float, I2: float, armature1: float, armature2: float, gear: float) -> dict[str, float]:
    """I1, I2 and Ir of the plant that moves as one whose motors add inertia to the diagonal of M alone.

    A plant's rotors add gr² Ir + Ir to M11, gr² Ir to M22, and -gr Ir to M12. With Ir = a2 / (gr (gr + 1)) the part
    gr Ir of a2 is counted as inertia of link 2, which adds it to M12 as well, where both cancel.
    """
    rotor = armature2 / (gear * (gear + 1))
    return {"I1": I1 + armature1 - armature2 - rotor, "I2": I2 + gear * rotor, "Ir": rotor}


def without_rotors(plant: Mapping[str, float]) -> tuple[float, float, float, float]:
    """The inverse: I1, I2 and the armature of both joints (kg m²)."""
    geared = plant["gr"] * plant["Ir"]
    armature = geared + plant["gr"] * geared
    return plant["I1"], plant["I2"] - geared, armature + plant["Ir"], armature


def _cross(one: np.ndarray, other: np.ndarray) -> float:
    return float(one[0] * other[1] - one[1] * other[0])
