"""The numbers of a double pendulum from two links in space.

Both joints' axes are horizontal and parallel, and the centre of link 1 lies on the line from the shoulder to the
elbow. Offsets along the axes have no effect. All places and directions are in the frame of what stands still, with
the joints where the file draws them.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from ..common.errors import SwingupError, quoted
from .files import TIP_SHARE

Vector: TypeAlias = np.ndarray  # Three numbers

TURNED_ANGLE = 1e-3  # Angles up to this (rad) are roundings of a file

OFF_LINE = 0.02
"""Largest distance of a centre from its link's line that is left out, as a part of the link's length."""

SMALLEST_LENGTH = 1e-6  # Shorter lengths count as 0 (m)

BALANCED_SHARE = 1e-6  # A centre nearer to the elbow than this part of l1 has no direction

EITHER_SHARE = 0.6
"""An inertia above this part of m r² may be about the joint. Rods have a third of it about their centres, and
bodies at least all of it about their joints; RealAIGym's fits go down to 0.77 there."""

READINGS = ("centre", "joint")
"""What the inertias of a file may be about: the centre of mass, as both formats have it, or the joint."""


class Part(NamedTuple):
    """A body of a link."""

    body: str
    mass: float
    centre: Vector  # centre of mass (m)
    inertia: np.ndarray  # (3, 3) (kg m²)
    stated: bool  # whether the file states the inertia of a body with a joint, which may then be about the joint


@dataclass(frozen=True)
class Link:
    """A joint with all that moves with it, up to the next joint."""

    joint: str
    body: str  # the body that the joint carries
    axis: Vector
    anchor: Vector  # a point of the axis (m)
    damping: float
    coulomb: float  # coulomb friction as a plant has it (N m)
    armature: float  # inertia that a motor adds to this joint alone (kg m²)
    limit: float | None  # torque limit (N m); None where the file does not say it
    zero: float  # the joint's own angle where the file draws it (rad)
    parts: list[Part] = field(default_factory=list)
    marks: list[tuple[str, Vector]] = field(default_factory=list)  # named frames, which may be the tip
    ends: list[Vector] = field(default_factory=list)  # ends of shapes, which may be the tip


Relation: TypeAlias = tuple[float, float]  # Sign s and offset o (rad) of a joint: q = o + s (the file's angle)


@dataclass(frozen=True)
class Model:
    """What a model file says of a double pendulum."""

    facts: dict[str, float]  # a plant's numbers by name; without those that the file does not say
    notes: list[str]  # what was left out, or chosen
    angles: tuple[Relation, Relation]  # how q1 and q2 follow from the file's angles


class _Plane(NamedTuple):
    """The vertical plane of the motion."""

    axis: Vector  # the axis of link 1's joint
    down: Vector
    side: Vector  # where a link that hangs moves first, when it turns about the axis

    def flat(self, point: Vector) -> np.ndarray:
        """A point's two coordinates, down and to the side (m)."""
        return np.array([point @ self.down, point @ self.side])


def double_pendulum(
    links: tuple[Link, Link], gravity: Vector, gear: float, notes: list[str], inertia: str | None, is_asked: bool
) -> Model:
    """The plant's numbers of two links, of which the first carries the second, under a gravity (m/s²).

    The gear ratio divides the armature between motors and rotors. Stated inertias are about one of
    :data:`READINGS`; where the user ``is_asked``, inertias that may be about either are refused without it.
    """
    for link in links:
        if min(link.damping, link.coulomb, link.armature) < 0:
            raise SwingupError(f"joint {quoted(link.joint)} has a damping, friction or armature that is negative")
    first, second = links
    for number, link in enumerate(links, 1):
        welded = [
            f"{quoted(part.body)} ({part.mass:.3g} kg)"
            for part in link.parts
            if part.body != link.body and part.mass
        ]
        if welded:
            notes.append(f"counted with link {number}: {', '.join(welded)}, fixed to {quoted(link.body)}")
    plane = _plane(links, gravity)
    arm = plane.flat(second.anchor - first.anchor)
    l1 = float(np.hypot(*arm))
    if not l1 > SMALLEST_LENGTH:
        raise SwingupError(f"joint {quoted(second.joint)} lies on the axis of {quoted(first.joint)}")
    along = arm / l1
    about_joint = _about_joint(links, inertia, is_asked, notes)
    (m1, centre1, I1), (m2, centre2, I2) = (_masses(link, plane, about_joint) for link in links)
    _check_line(first, _cross(along, centre1), l1, notes)
    reach = float(np.hypot(*centre2))
    tip = _tip(second, plane, reach)
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
    facts |= {f"tl{number}": each.limit for number, each in enumerate(links, 1) if each.limit is not None}
    if tip is not None:
        facts["l2"] = float(np.hypot(*tip[1]))
        notes.append(f"l2 = {facts['l2']:.4g} m is the distance of {tip[0]} from the elbow")
    if facts["Ir"] > 0:
        notes.append("the armature is in I1, I2 and Ir, so that the pendulum moves as with it")
    hanging = math.atan2(arm[1], arm[0]), math.atan2(_cross(along, straight), float(along @ straight))
    angles = _angles(links, hanging, notes)
    return Model({name: float(value) for name, value in facts.items()}, notes, angles)


def _plane(links: tuple[Link, Link], gravity: Vector) -> _Plane:
    """The plane of the motion, refused where it is not vertical, or the links move in two."""
    (first, second), (one, other) = (link.axis for link in links), (quoted(link.joint) for link in links)
    if not np.linalg.norm(gravity) > 0:
        raise SwingupError("gravity has a direction of length 0")
    down = gravity / np.linalg.norm(gravity)
    # Rounding may make a product of unit vectors larger than 1.
    lean = math.asin(min(1.0, abs(float(first @ down))))
    if lean > TURNED_ANGLE:
        leans = f"leans {math.degrees(lean):.3g}° from the horizontal"
        raise SwingupError(f"the axis of joint {one} {leans}: a plant swings in a vertical plane")
    turned = math.asin(min(1.0, float(np.linalg.norm(np.cross(first, second)))))
    if turned > TURNED_ANGLE:
        turns = f"is turned by {math.degrees(turned):.3g}° from that of {one}"
        raise SwingupError(f"the axis of joint {other} {turns}: a plant's links swing in one plane")
    down = down - (down @ first) * first
    down /= np.linalg.norm(down)
    return _Plane(first, down, np.cross(first, down))


def _about_joint(links: tuple[Link, Link], inertia: str | None, is_asked: bool, notes: list[str]) -> bool:
    """Whether the stated inertias of both links are about their joints; what was taken is noted."""
    stated = []
    for link in links:
        for part in link.parts:
            arm = np.cross(link.axis, part.centre - link.anchor)
            if part.stated and part.mass > 0:
                own, point = float(link.axis @ part.inertia @ link.axis), part.mass * float(arm @ arm)
                stated.append((quoted(part.body), own, point))
    # Where m r² is nothing, both readings agree.
    unclear = any(own > EITHER_SHARE * point > 1e-6 * own for _, own, point in stated)
    shown = " and ".join(f"{own:.4g} kg m² of {name}" for name, own, _ in stated)
    if inertia == "joint" and not stated:
        notes.append("--inertia joint changes nothing: no link that a joint carries states its inertia itself")
    if inertia is None and unclear and is_asked:
        raise SwingupError(
            f"the inertias, {shown}, may be about the centres of mass, as the format has them, or about the "
            "joints, as in RealAIGym's files: say which, with swingup plant FILE --inertia centre or joint"
        )
    if stated:
        taken = "joints" if inertia == "joint" else "centres of mass"
        notes.append(f"inertias, {shown}, are taken about the {taken}")
    for name, own, point in stated if inertia == "joint" else ():
        if own < point:
            notes.append(
                f"no body has an inertia about its joint below m r² = {point:.4g}: if that of {name} is not from a "
                "fit, it is about the centre"
            )
    return inertia == "joint"


def _masses(link: Link, plane: _Plane, about_joint: bool) -> tuple[float, np.ndarray, float]:
    """Mass (kg), centre of mass from the joint in the plane (m) and inertia about the joint (kg m²)."""
    mass, moment, inertia = 0.0, np.zeros(2), 0.0
    for part in link.parts:
        centre, own = plane.flat(part.centre - link.anchor), float(plane.axis @ part.inertia @ plane.axis)
        mass, moment = mass + part.mass, moment + part.mass * centre
        # A body that is welded to a link has no joint for its inertia to be about.
        inertia += own if about_joint and part.stated else own + part.mass * float(centre @ centre)
    if not mass > 0:
        raise SwingupError(f"link {quoted(link.body)} has no mass")
    return mass, moment / mass, inertia


def _check_line(link: Link, off: float, l1: float, notes: list[str]) -> None:
    """Refuse or note a centre of link 1 that is so far (m) beside the line from joint to joint."""
    beside = f"lies {abs(off):.3g} m beside the line from joint to joint"
    if abs(off) > OFF_LINE * l1:
        name = quoted(link.body)
        raise SwingupError(f"the centre of mass of link {name} {beside}, and a plant has it on that line")
    if abs(off) > TURNED_ANGLE * l1:
        notes.append(f"left out: the centre of mass of link 1 {beside}")


def _tip(link: Link, plane: _Plane, reach: float) -> tuple[str, np.ndarray] | None:
    """What ends link 2 and where from the elbow (m): the farthest frame, or else the farthest end of a shape.

    Frames near the elbow, within half the centre's distance (m), are something else.
    """
    # A named frame is meant; a shape ends where its drawing does.
    for found in (link.marks, [("the end of its shape", point) for point in link.ends]):
        far = [(name, plane.flat(point - link.anchor)) for name, point in found]
        name, at = max(far, key=lambda each: float(np.hypot(*each[1])), default=("", np.zeros(2)))
        if float(np.hypot(*at)) > max(TIP_SHARE * reach, SMALLEST_LENGTH):
            return name, at
    return None


def _angles(links: tuple[Link, Link], hanging: tuple[float, float], notes: list[str]) -> tuple[Relation, Relation]:
    """How q1 and q2 follow from the file's angles; ``hanging``: q1 and q2 as the file draws the links (rad)."""
    found, shown = [], []
    for number, (link, angle) in enumerate(zip(links, hanging, strict=True), 1):
        sign = math.copysign(1.0, float(links[0].axis @ link.axis))
        offset = math.remainder(angle - sign * link.zero, 2 * math.pi)
        offset += 2 * math.pi if offset < TURNED_ANGLE - math.pi else 0.0  # π, also where rounding makes it -π
        plain = "" if sign > 0 else "-"
        start = f"{offset:.4g} {plain or '+'} " if abs(offset) > TURNED_ANGLE else plain
        shown.append(f"q{number} = {start}{quoted(link.joint)}")
        found.append((sign, offset))
    if any(sign < 0 or abs(offset) > TURNED_ANGLE for sign, offset in found):
        notes.append(f"angles: {' and '.join(shown)}")
    return found[0], found[1]


def _with_rotors(I1: float, I2: float, armature1: float, armature2: float, gear: float) -> dict[str, float]:
    """I1, I2 and Ir of the plant that moves as one whose motors add inertia to the diagonal of M alone.

    A plant's rotors add gr² Ir + Ir to M11, gr² Ir to M22, and -gr Ir to M12. With Ir = a2 / (gr (gr + 1)) the part
    gr Ir of a2 is counted as inertia of link 2, which adds it to M12 as well, where both cancel.
    """
    rotor = armature2 / (gear * (gear + 1))
    return {"I1": I1 + armature1 - armature2 - rotor, "I2": I2 + gear * rotor, "Ir": rotor}


def _cross(one: np.ndarray, other: np.ndarray) -> float:
    return float(one[0] * other[1] - one[1] * other[0])
