"""URDF and MJCF as MuJoCo is given them, and what is read of them beside MuJoCo.

MuJoCo is given what acts on a double pendulum. Springs, equalities, tendons and fluid would change the motion and
are refused. Of a URDF this module itself reads what MuJoCo drops or refuses: inertias that are zero about an axis,
efforts of 0, transmissions, and Drake's rotors and frames.

URDF has no gravity, taken as 9.81 m/s² along -z, and no tip: a frame or a shape may show it. Its friction is taken
as a plant's cf, as RealAIGym's files mean it. MJCF's dry friction has the torque ``frictionloss`` at any speed; a
plant's, cf arctan(100 q̇), tends to cf π/2.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from ..common.checks import LARGEST_NUMBER
from ..common.errors import SwingupError, one_line, quoted
from .files import OUR_ELEMENT

GRAVITY = 9.81  # Gravity of a URDF (m/s²)

COUPLED_SECTIONS = ("equality", "tendon", "deformable")  # Sections of MJCF whose elements change the motion
MJCF_SECTIONS = ("compiler", "option", "default", "worldbody", "actuator")
"""Sections that MuJoCo is given; what a pendulum looks like or measures has no effect on it."""
DRAWN_ELEMENTS = ("camera", "light", "plugin")  # Elements of bodies that MuJoCo is not given
URDF_ELEMENTS = ("link", "joint", "frame", "transmission", "material", OUR_ELEMENT)
"""Elements of URDF that are read, or say nothing of the motion."""
TEXTS = ("name", "class", "childclass", "joint", "jointinparent", "body", "link", "model", "file")
"""Attributes that are no numbers, whatever they look like."""

AT_SPEED = math.pi / 2  # What a plant's dry friction tends to, as a multiple of cf


@dataclass
class Source:
    """A model as MuJoCo reads it, and what the file says besides."""

    spec: Any  # an MjSpec without motors
    gear: float
    gravity: float | None  # along -z (m/s²); None where MuJoCo knows it
    coulomb: float  # a plant's cf as a share of the file's friction
    limits: list[float | None]  # torque limits of the spec's joints (N m); None where the file does not say it
    stated: Mapping[str, tuple[float, np.ndarray]] | None  # masses (kg) and inertias (3, 3) of bodies (kg m²);
    # None where MuJoCo knows them
    about: str | None = None  # what the file says that its inertias are about
    welds: Mapping[str, str] = field(default_factory=dict)  # names of a URDF's fixed joints by their links


def check_numbers(root: Element) -> None:
    """Refuse numbers that are not finite, or so large that their squares overflow."""
    for element in root.iter():
        for name, text in element.attrib.items():
            for word in () if name in TEXTS else text.split()[:100]:
                try:
                    size = abs(float(word))
                except ValueError:  # a word, or a mistake that MuJoCo names
                    continue
                if not size < LARGEST_NUMBER:
                    shown = f"{_named(element)} has {one_line(name, 40)} = {quoted(word)}"
                    raise SwingupError(f"{shown}: write a finite number below {LARGEST_NUMBER:g}")


def _named(element: Element) -> str:
    name = element.get("name") or element.get("joint")
    return f"<{one_line(element.tag, 60)}{f' {quoted(name)}' if name else ''}>"


def number_of(element: Element | None, name: str, default: float = 0.0) -> float:
    """A number among an element's attributes."""
    if element is None or name not in element.attrib:
        return default
    try:
        return float(element.attrib[name])
    except ValueError:
        text = quoted(element.attrib[name])
        raise SwingupError(f"{_named(element)} has {name} = {text}: write a number") from None


def _one_gear(gears: Mapping[str, float], notes: list[str]) -> float:
    """The gear ratio that the driven joints have, 1 without any; the last one, and a note, where they differ."""
    if len({*gears.values()}) > 1:
        shown = ", ".join(f"{gear:g} of {quoted(joint)}" for joint, gear in gears.items())
        notes.append(f"left out: all gear ratios but the last ({shown}), unless --set gr=VALUE")
    return [1.0, *gears.values()][-1]


def urdf(root: Element, notes: list[str]) -> Source:
    """Leave frames, axes and shapes to MuJoCo, in bodies of 1 kg; the rest of a URDF is read here."""
    import mujoco

    notes += [f"not read: <{tag}>" for tag in dict.fromkeys(each.tag for each in root) if tag not in URDF_ELEMENTS]
    own, (gears, rotors) = root.find(OUR_ELEMENT), _transmissions(root)
    for frame in root.findall("frame"):  # Drake's, as a link that is welded on
        _weld(root, frame)
    root[:] = [each for each in root if each.tag in ("link", "joint")]
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    _check_driven(rotors, joints)
    # A parent that is nowhere a link, such as Drake's world, stands still.
    names = {link.get("name", "") for link in root.findall("link")}
    for parent in dict.fromkeys(each.get("link", "") for each in root.findall("joint/parent")):
        if parent not in names:
            SubElement(root, "link", name=parent)
    efforts = {name: _limit(joint, rotors, notes) for name, joint in joints.items() if joint.get("type") != "fixed"}
    if not rotors and efforts and all(effort == 0.0 for effort in efforts.values()):
        notes.append("not read: efforts of 0, as exporters write them")
        efforts = dict.fromkeys(efforts)
    stated = {link.get("name", ""): _inertial(link) for link in root.findall("link")}
    # Frames without mass may mark the tip, and so may drawings.
    SubElement(SubElement(root, "mujoco"), "compiler", fusestatic="false", discardvisual="false")
    spec = mujoco.MjSpec.from_string(tostring(root, "unicode"))
    for each in spec.joints:
        each.armature = rotors.get(each.name, 0.0)
    gravity, about = number_of(own, "gravity", GRAVITY), None if own is None else own.get("inertia")
    limits = [efforts[joint.name] for joint in spec.joints]
    fixed = [(joint.find("child"), name) for name, joint in joints.items() if joint.get("type") == "fixed"]
    welds = {child.get("link", ""): name for child, name in fixed if child is not None}
    return Source(spec, _one_gear(gears, notes), gravity, 1.0, limits, stated, about, welds)


def _weld(root: Element, frame: Element) -> None:
    name = frame.get("name", "")
    joint = SubElement(root, "joint", name=f"frame {name}", type="fixed")
    for tag, link in (("parent", frame.get("link", "")), ("child", name)):
        SubElement(joint, tag, link=link)
    SubElement(joint, "origin", {each: frame.attrib[each] for each in ("xyz", "rpy") if each in frame.attrib})
    SubElement(root, "link", name=name)


def _limit(joint: Element, driven: Mapping[str, float], notes: list[str]) -> float | None:
    """The torque limit of a joint that moves (N m); None if unknown. Its stops are left out."""
    name, kind, limit = joint.get("name", ""), joint.get("type", ""), joint.find("limit")
    if kind not in ("revolute", "continuous"):
        raise SwingupError(f"joint {quoted(name)} is {quoted(kind)}: a plant's are revolute, continuous or fixed")
    if joint.find("mimic") is not None:
        raise SwingupError(f"joint {quoted(name)} mimics another one: a plant's joints move on their own")
    if friction := number_of(joint.find("dynamics"), "friction"):
        notes.append(
            f"friction of joint {quoted(name)} is taken as cf = {friction:g} N m, of which π/2 times acts at speed"
        )
    if limit is not None:
        joint.remove(limit)
        joint.set("type", "continuous")
        if kind == "revolute":
            low, high = number_of(limit, "lower"), number_of(limit, "upper")
            notes.append(f"left out: the stops of joint {quoted(name)} at {low:.4g} and {high:.4g} rad")
        if "effort" in limit.attrib:
            return number_of(limit, "effort")
    # Where transmissions name the motors, a joint without one is passive.
    return 0.0 if driven and name not in driven else None


def _transmissions(root: Element) -> tuple[dict[str, float], dict[str, float]]:
    """The gear ratio of each driven joint, and what its motor's rotor adds to its inertia (kg m²)."""
    gears, rotors = dict[str, float](), dict[str, float]()
    for element in root.findall("transmission"):
        joint, numbers = element.find("joint"), {}
        for tag in ("mechanicalReduction", "drake:gear_ratio", "drake:rotor_inertia"):
            for each in element.iter(tag):
                number = Element(tag, value=each.get("value", (each.text or "").strip()))
                check_numbers(number)
                numbers[tag] = number_of(number, "value")
        # Its sign says which way the motor turns, which a symmetric limit does not show.
        gear = abs(numbers.get("drake:gear_ratio", numbers.get("mechanicalReduction", 1.0))) or 1.0
        if joint is not None:
            name = joint.get("name", "")
            gears[name], rotors[name] = gear, gear**2 * numbers.get("drake:rotor_inertia", 0.0)
    return gears, rotors


# MuJoCo refuses inertias that are zero about an axis; a plant needs the one about the joint's axis alone.
def _inertial(link: Element) -> tuple[float, np.ndarray]:
    """Mass (kg) and inertia (3, 3) in the link's axes (kg m²); leaves MuJoCo a body of 1 kg with its shapes."""
    import mujoco

    name, inertia = quoted(link.get("name", "")), link.find("inertial/inertia")
    mass, origin = number_of(link.find("inertial/mass"), "value"), link.find("inertial/origin")
    if mass < 0:
        raise SwingupError(f"mass of link {name} = {mass:g} kg must not be negative")
    if mass > 0 and inertia is None:
        raise SwingupError(f"link {name} has a mass and no <inertia>: add it")
    moments = np.array([[number_of(inertia, "i" + min(a + b, b + a)) for a in "xyz"] for b in "xyz"])
    shapes = ("box", "cylinder", "sphere", "capsule")
    link[:] = [each for each in link if any(each.find(f"geometry/{shape}") is not None for shape in shapes)]
    copy, quaternion, turn = SubElement(link, "inertial"), np.zeros(4), np.eye(3)
    copy.extend([] if origin is None else [origin])
    SubElement(copy, "mass", value="1")
    SubElement(copy, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")
    if origin is not None and len(angles := origin.get("rpy", "").split()) == 3:
        rpy = [number_of(Element("origin", rpy=angle), "rpy") for angle in angles]
        mujoco.mju_euler2Quat(quaternion, rpy, "XYZ")
        mujoco.mju_quat2Mat(turn.reshape(9), quaternion)
    return mass, turn @ moments @ turn.T


def mjcf(root: Element, notes: list[str]) -> Source:
    """An MJCF as MuJoCo reads it, without its motors, whose limits are read here."""
    import mujoco

    for section in COUPLED_SECTIONS:
        for element in root.iterfind(f"{section}/*"):
            if element.get("active", "true") == "true" and element.tag != "skin":
                shown = f"<{element.tag}> {quoted(element.get('name', ''))}"
                raise SwingupError(f"<{section}> has {shown}, which has no place in a plant: remove it")
    for parent in [*root.iter()]:
        parent.attrib.pop("material", None)
        unread = [each for each in parent if each.tag in DRAWN_ELEMENTS]
        unread += [each for each in root if parent is root and each.tag not in MJCF_SECTIONS]
        for each in unread:
            parent.remove(each)
    spec = mujoco.MjSpec.from_string(tostring(root, "unicode"))
    for name in ("density", "viscosity"):
        if (size := getattr(spec.option, name)) != 0:
            raise SwingupError(f"<option> has {name} = {size:g}, and a plant moves in vacuum: remove it")
    if any(geom.contype or geom.conaffinity for geom in spec.geoms) and has_physics(spec, "CONTACT", "CONSTRAINT"):
        notes.append("left out: contacts of the links")
    _check_bodies(spec)
    _leave_meshes_out(spec)
    gears, motors = _motors(spec, notes)
    _check_driven(motors, [joint.name for joint in spec.joints])
    limits = list[float | None]()
    for joint in spec.joints:
        # In a file with motors a joint without one is passive; without any the file does not say.
        limit = motors.get(joint.name, 0.0 if motors else math.inf)
        limit = min(limit, _range_end(spec, joint, f"joint {quoted(joint.name)}", "actfrc", notes))
        limits.append(limit if limit < math.inf else None)
    # Of some motors MuJoCo would simulate the range.
    for actuator in [*spec.actuators]:
        spec.delete(actuator)
    return Source(spec, _one_gear(gears, notes), None, 1 / AT_SPEED, limits, None)


def _check_driven(driven: Mapping[str, Any], joints: Iterable[str]) -> None:
    if unknown := sorted({*driven} - {*joints}):
        raise SwingupError(
            f"a motor acts on joint {quoted(unknown[0])}, which the file does not have: correct its name"
        )


def has_physics(spec: Any, *flags: str) -> bool:
    """Whether the file leaves parts of the physics on."""
    import mujoco

    off = spec.option.disableflags
    return not any(off & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}", 0)) for flag in flags)


def _check_bodies(spec: Any) -> None:
    for joint in spec.joints:
        where, kind = f"joint {quoted(joint.name)}", joint.type.name.removeprefix("mjJNT_").lower()
        if kind != "hinge":
            raise SwingupError(f"{where} is {quoted(kind)}: a plant's two joints are hinges")
        if (np.any(joint.stiffness) or np.any(joint.springdamper)) and has_physics(spec, "PASSIVE", "SPRING"):
            raise SwingupError(f"{where} has a spring, which has no place in a plant: remove it")
        if np.any(np.atleast_1d(joint.damping)[1:]):
            raise SwingupError(f"{where} has damping that is not linear: write one number")
    for body in spec.bodies:
        where, names = f"<body> {quoted(body.name)} has", ", ".join(quoted(joint.name) for joint in body.joints)
        # MuJoCo takes a negative one for 0.
        if body.mass < 0:
            raise SwingupError(f"{where} mass = {body.mass:g}, which must not be negative")
        if body.gravcomp:
            raise SwingupError(f"{where} gravcomp, and gravity pulls all of a plant: remove it")
        if len(body.joints) > 1:
            raise SwingupError(f"{where} {len(body.joints)} joints ({names}): a plant's links have one each")


def _leave_meshes_out(spec: Any) -> None:
    """Delete the geoms of meshes, whose files are not read; refuse those that a body's inertia is made of."""
    groups, source = spec.compiler.inertiagrouprange, int(spec.compiler.inertiafromgeom)
    for geom in [*spec.geoms]:
        kind = geom.type.name.removeprefix("mjGEOM_").lower()
        if kind in ("mesh", "sdf", "hfield") or geom.meshname:
            mass = geom.density if math.isnan(geom.mass) else geom.mass
            # 0: never from geoms; 1: always; 2: where no inertia is stated.
            counts = source == 1 or (source == 2 and not geom.parent.explicitinertial)
            counts = counts and groups[0] <= geom.group <= groups[1]
            if counts and mass and kind != "hfield" and geom.parent.name != "world":
                name = f"<geom> {quoted(geom.name)} of {quoted(geom.parent.name)}"
                raise SwingupError(f"{name} is a mesh: give its body an <inertial>")
            spec.delete(geom)


def _motors(spec: Any, notes: list[str]) -> tuple[dict[str, float], dict[str, float]]:
    """Gear ratio and torque limit (N m) of each joint on which a motor acts."""
    gears, limits = dict[str, float](), dict[str, float]()
    for motor in spec.actuators:
        where, joint = f"actuator {quoted(motor.name)}", motor.target
        if motor.trntype.name not in ("mjTRN_JOINT", "mjTRN_JOINTINPARENT"):
            notes.append(f"not read: {where}, which acts on no joint")
            continue
        plain = (motor.gaintype.name, motor.biastype.name) == ("mjGAIN_FIXED", "mjBIAS_NONE")
        if not plain:
            notes.append(f"of {where}, a servo, only the force range is read")
        if motor.dyntype.name != "mjDYN_NONE":
            notes.append(f"left out: the dynamics of {where}")
        # The sign of a gear says which way the motor turns, which a symmetric limit does not show.
        gears[joint] = abs(float(motor.gear[0])) or 1.0
        limit = _range_end(spec, motor, where, "force", notes)
        if plain:
            limit = min(limit, abs(float(motor.gainprm[0])) * _range_end(spec, motor, where, "ctrl", notes))
        # Several motors may act on a joint: their torques add.
        limits[joint] = limits.get(joint, 0.0) + gears[joint] * limit
    return gears, limits


def _range_end(spec: Any, element: Any, where: str, kind: str, notes: list[str]) -> float:
    """The smaller end of a range, in which a motor acts both ways; infinite without one."""
    name, chosen = f"{kind}range", int(getattr(element, f"{kind}limited"))
    low, high = (float(end) for end in getattr(element, name))
    # 0: no; 1: yes; 2: where there is a range.
    if not (chosen == 1 or (chosen == 2 and spec.compiler.autolimits and low != high)):
        return math.inf
    if not low < 0 < high:
        raise SwingupError(f"{where} has {name} = {low:g} {high:g}: a plant's motors act both ways")
    if low != -high:
        notes.append(f"{where} has {name} from {low:g} to {high:g}: a plant's limits are the same both ways")
    return min(-low, high)
