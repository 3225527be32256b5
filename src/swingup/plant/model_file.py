"""URDF and MJCF, read through MuJoCo's compiler, which knows frames, default classes, shapes and units.

MuJoCo sees what acts on a double pendulum, and nothing that takes long: elements that stand for others are refused
first, since a large count occupies MuJoCo for ever, and files have bounds. Springs, equalities, tendons and fluid
would change the motion and are refused. Of a URDF this module itself reads what MuJoCo drops or refuses: inertias
that are zero about an axis, efforts of 0, transmissions, and Drake's rotors and frames.

URDF has no gravity, taken as 9.81 m/s² along -z, and no tip: a frame or a shape may show it. Its friction is taken
as a plant's cf, as RealAIGym's files mean it. MJCF's dry friction has the torque ``frictionloss`` at any speed; a
plant's, cf arctan(100 q̇), tends to cf π/2.
"""

import contextlib
import math
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn
from xml.etree.ElementTree import Element, SubElement, TreeBuilder, tostring
from xml.parsers import expat

import numpy as np

from ..common.checks import LARGEST_NUMBER, one_of
from ..common.errors import SwingupError, needing, one_line, quoted
from ..common.files import read_bytes
from .chain import READINGS, Link, Model, Part, double_pendulum
from .files import CHOSEN_NUMBERS, OUR_ELEMENT

LARGEST_XML = 2_000_000
"""Bytes of a file; meshes lie in files of their own."""
DEEPEST = 60
"""Levels of elements."""
MOST_ELEMENTS = 10_000
"""Elements of a file with all that it includes."""

GRAVITY = 9.81
"""Gravity of a URDF (m/s²)."""

GENERATED_ELEMENTS = ("replicate", "composite", "flexcomp", "attach")
"""Elements of MJCF that stand for others."""
COUPLED_SECTIONS = ("equality", "tendon", "deformable")
"""Sections of MJCF whose elements change the motion."""
MJCF_SECTIONS = ("compiler", "option", "default", "worldbody", "actuator")
"""Sections that MuJoCo is given; what a pendulum looks like or measures has no effect on it."""
DRAWN_ELEMENTS = ("camera", "light", "plugin")
"""Elements of bodies that MuJoCo is not given."""
URDF_ELEMENTS = ("link", "joint", "frame", "transmission", "material", OUR_ELEMENT)
"""Elements of URDF that are read, or say nothing of the motion."""
TEXTS = ("name", "class", "childclass", "joint", "jointinparent", "body", "link", "model", "file")
"""Attributes that are no numbers, whatever they look like."""

AT_SPEED = math.pi / 2
"""What a plant's dry friction tends to, as a multiple of cf."""


@dataclass
class _Source:
    """A model as MuJoCo reads it, and what the file says besides."""

    spec: Any
    gear: float
    gravity: float | None
    """Gravity (m/s²) along -z; None where MuJoCo knows it."""
    coulomb: float
    """A plant's cf as a share of the file's friction."""
    limits: Mapping[str, float | None]
    """Torque limits of the joints (N m); None where the file does not say it."""
    stated: Mapping[str, tuple[float, np.ndarray]] | None
    """Masses (kg) and inertias (3, 3) (kg m²) of bodies; None where MuJoCo knows them."""
    about: str | None = None
    """What the file says that its inertias are about."""


def read_model(path: str | Path, inertia: str | None = None, gear: float | None = None) -> Model:
    """What a URDF or an MJCF, as its content tells, says of a double pendulum.

    The inertias that it states are about the "centre" of mass or the "joint". By default they are about the centre;
    a URDF's that may be about either are refused. The gear ratio is the file's unless given.

    Raises:
        SwingupError: MuJoCo is missing, the file cannot be read, or it is not a double pendulum.
    """
    if inertia is not None:
        one_of("inertia", inertia, READINGS)
    with needing("mujoco", "mujoco", "reading a URDF or an MJCF", " mujoco-core mujoco-studio"):
        import mujoco  # noqa: F401
    notes: list[str] = []
    try:
        root = _tree(path)
        _include(root, Path(path).parent, {Path(path).resolve()}, notes)
        _check_numbers(root)
        # The content decides, since both formats are called .xml.
        if root.tag not in ("robot", "mujoco"):
            raise SwingupError(f"it begins with <{one_line(root.tag, 40)}>: use URDF (<robot>) or MJCF (<mujoco>)")
        is_urdf = root.tag == "robot"
        own = root.find(OUR_ELEMENT if is_urdf else f"custom/numeric[@name='{OUR_ELEMENT}']")
        kept = None if own is None else own.get("data")
        with _heeding_mujoco(notes):
            source = (_urdf if is_urdf else _mjcf)(root, notes)
            links, gravity = _links(source, notes)
        about = inertia or source.about
        model = double_pendulum(links, gravity, gear or source.gear, notes, about, is_asked=is_urdf)
        return model if kept is None else _recalled(model, kept)
    except SwingupError as error:
        unread = [note.removeprefix("not read: ") for note in notes if note.startswith("not read: <include>")]
        lost = f"; its {unread[0]} is not read" if unread else ""
        raise SwingupError(f"model file {one_line(path)}: {error}{lost}") from error


# Expansion of entities makes XML dangerous: a few lines fill the memory, or read other files. Models need none.
def _tree(path: str | Path) -> Element:
    """The elements of an XML file; a document type, and with it all entities, is refused."""
    data, builder, parser, depth = read_bytes(path, LARGEST_XML), TreeBuilder(), expat.ParserCreate(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise SwingupError(f"its elements are deeper than {DEEPEST} levels")
        # A macro's numbers are not known before it is expanded.
        if tag.startswith("xacro:"):
            raise SwingupError("it is xacro: expand it first, with xacro FILE > x.urdf")
        # A large count occupies MuJoCo for ever.
        if tag in GENERATED_ELEMENTS:
            raise SwingupError(f"<{tag}> stands for other elements: save the model with MuJoCo's mj_saveLastXML")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*given: object) -> NoReturn:
        raise SwingupError("it has a document type (<!DOCTYPE>), which may hold entities: remove it")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # a syntax, an encoding that Python lacks
        raise SwingupError(f"it is not XML ({one_line(error)})") from error
    return builder.close()


def _include(root: Element, folder: Path, read: set[Path], notes: list[str]) -> None:
    """Put the elements of included files in the place of each ``<include>``, once each, as MuJoCo does."""
    for parent in [*root.iter()]:
        for element in parent.findall("include"):
            place, file = [*parent].index(element), element.get("file", "")
            parent.remove(element)
            try:
                target = (folder / file).resolve()
                # A pipe or a device would not end.
                if target in read or not target.is_file():
                    raise SwingupError("no such file, or included twice")
                read.add(target)
                included = _tree(target)
                # Paths are relative to the outermost file.
                _include(included, folder, read, notes)
                parent[place:place] = [*included]
            except (SwingupError, OSError, ValueError) as error:
                notes.append(f"not read: <include> of {one_line(file, 80)} ({one_line(error, 80)})")
    if sum(1 for _ in root.iter()) > MOST_ELEMENTS:
        raise SwingupError(f"it has more than {MOST_ELEMENTS:,} elements: it is another kind of model")


def _check_numbers(root: Element) -> None:
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


def _number(element: Element | None, name: str, default: float = 0.0) -> float:
    """A number among an element's attributes."""
    if element is None or name not in element.attrib:
        return default
    try:
        return float(element.attrib[name])
    except ValueError:
        text = quoted(element.attrib[name])
        raise SwingupError(f"{_named(element)} has {name} = {text}: write a number") from None


@contextlib.contextmanager
def _heeding_mujoco(notes: list[str]) -> Iterator[None]:
    """Make our errors of MuJoCo's, and notes of its warnings."""
    import mujoco

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield
        except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
            # MuJoCo counts the lines of another text than the user's file.
            text = re.sub(r",? \b(id|line) -?\d+", "", str(error)).removeprefix("Error: ").strip()
            raise SwingupError(f"MuJoCo refuses it ({one_line(text.replace(chr(10), '; '))})") from error
    notes += [f"MuJoCo: {one_line(each.message)}" for each in caught]


def _recalled(model: Model, kept: str) -> Model:
    """The model with the numbers that a file keeps beside its bodies, as long as both move alike."""
    words = kept.split()
    try:
        facts = model.facts | dict(zip(CHOSEN_NUMBERS, map(float, words), strict=True))
    except ValueError:
        raise SwingupError(
            f"<{OUR_ELEMENT}> has data = {quoted(kept)}: write {len(CHOSEN_NUMBERS)} numbers"
        ) from None
    # Who edits a body edits what the file says: stale numbers beside it must not win.
    if np.allclose(_motion(model.facts), _motion(facts), rtol=1e-9, atol=0.0):
        return Model(facts, model.notes, model.angles)
    note = "not read: swingup's own numbers in the file, whose plant moves otherwise"
    return Model(model.facts, [*model.notes, note], model.angles)


def _motion(plant: Mapping[str, float]) -> list[float]:
    """m1 r1 + m2 l1, m2 r2 and I1 + m2 l1², all that motion tells of masses, centres and link 1's inertia."""
    m1, m2, r1, r2, I1 = (plant[name] for name in CHOSEN_NUMBERS)
    return [m1 * r1 + m2 * plant["l1"], m2 * r2, I1 + m2 * plant["l1"] ** 2]


def _one_gear(gears: Mapping[str, float], notes: list[str]) -> float:
    """The gear ratio that the driven joints have, 1 without any; the last one, and a note, where they differ."""
    if len({*gears.values()}) > 1:
        shown = ", ".join(f"{gear:g} of {quoted(joint)}" for joint, gear in gears.items())
        notes.append(f"left out: all gear ratios but the last ({shown}), unless --set gr=VALUE")
    return [1.0, *gears.values()][-1]


def _urdf(root: Element, notes: list[str]) -> _Source:
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
    limits = {name: _limit(joint, rotors, notes) for name, joint in joints.items() if joint.get("type") != "fixed"}
    if not rotors and limits and all(limit == 0.0 for limit in limits.values()):
        notes.append("not read: efforts of 0, as exporters write them")
        limits = dict.fromkeys(limits)
    stated = {link.get("name", ""): _inertial(link) for link in root.findall("link")}
    # Frames without mass may mark the tip, and so may drawings.
    SubElement(SubElement(root, "mujoco"), "compiler", fusestatic="false", discardvisual="false")
    spec = mujoco.MjSpec.from_string(tostring(root, "unicode"))
    for each in spec.joints:
        each.armature = rotors.get(each.name, 0.0)
    gravity, about = _number(own, "gravity", GRAVITY), None if own is None else own.get("inertia")
    return _Source(spec, _one_gear(gears, notes), gravity, 1.0, limits, stated, about)


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
    if friction := _number(joint.find("dynamics"), "friction"):
        notes.append(
            f"friction of joint {quoted(name)} is taken as cf = {friction:g} N m, of which π/2 times acts at speed"
        )
    if limit is not None:
        joint.remove(limit)
        joint.set("type", "continuous")
        if kind == "revolute":
            low, high = _number(limit, "lower"), _number(limit, "upper")
            notes.append(f"left out: the stops of joint {quoted(name)} at {low:.4g} and {high:.4g} rad")
        if "effort" in limit.attrib:
            return _number(limit, "effort")
    # Where transmissions name the motors, a joint without one is passive.
    return 0.0 if driven and name not in driven else None


def _transmissions(root: Element) -> tuple[dict[str, float], dict[str, float]]:
    """The gear ratio of each driven joint, and what its motor's rotor adds to its inertia (kg m²)."""
    gears, rotors = dict[str, float](), dict[str, float]()
    for element in root.findall("transmission"):
        joint, numbers = element.find("joint"), {}
        for tag in ("mechanicalReduction", "drake:gear_ratio", "drake:rotor_inertia"):
            for each in element.iter(tag):
                given = Element(tag, value=each.get("value", (each.text or "").strip()))
                _check_numbers(given)
                numbers[tag] = _number(given, "value")
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
    mass, origin = _number(link.find("inertial/mass"), "value"), link.find("inertial/origin")
    if mass < 0:
        raise SwingupError(f"mass of link {name} = {mass:g} kg must not be negative")
    if mass > 0 and inertia is None:
        raise SwingupError(f"link {name} has a mass and no <inertia>: add it")
    moments = np.array([[_number(inertia, "i" + min(a + b, b + a)) for a in "xyz"] for b in "xyz"])
    shapes = ("box", "cylinder", "sphere", "capsule")
    link[:] = [each for each in link if any(each.find(f"geometry/{shape}") is not None for shape in shapes)]
    copy, quaternion, turn = SubElement(link, "inertial"), np.zeros(4), np.eye(3)
    copy.extend([] if origin is None else [origin])
    SubElement(copy, "mass", value="1")
    SubElement(copy, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")
    if origin is not None and len(angles := origin.get("rpy", "").split()) == 3:
        rpy = [_number(Element("origin", rpy=angle), "rpy") for angle in angles]
        mujoco.mju_euler2Quat(quaternion, rpy, "XYZ")
        mujoco.mju_quat2Mat(turn.reshape(9), quaternion)
    return mass, turn @ moments @ turn.T


def _mjcf(root: Element, notes: list[str]) -> _Source:
    """An MJCF as MuJoCo reads it, without its motors, whose limits are read here."""
    import mujoco

    for section in COUPLED_SECTIONS:
        for element in root.iterfind(f"{section}/*"):
            if element.get("active", "true") == "true" and element.tag != "skin":
                name = quoted(element.get("name", ""))
                raise SwingupError(
                    f"<{section}> has <{element.tag}> {name}, which has no place in a plant: remove it"
                )
    for parent in [*root.iter()]:
        parent.attrib.pop("material", None)
        unread = [each for each in parent if each.tag in DRAWN_ELEMENTS]
        unread += [each for each in root if parent is root and each.tag not in MJCF_SECTIONS]
        for each in unread:
            parent.remove(each)
    spec = mujoco.MjSpec.from_string(tostring(root, "unicode"))
    for name in ("density", "viscosity"):
        if getattr(spec.option, name) != 0:
            size = getattr(spec.option, name)
            raise SwingupError(f"<option> has {name} = {size:g}, and a plant moves in vacuum: remove it")
    if any(geom.contype or geom.conaffinity for geom in spec.geoms) and _has(spec, "CONTACT", "CONSTRAINT"):
        notes.append("left out: contacts of the links")
    _check_bodies(spec)
    _leave_meshes_out(spec)
    gears, motors = _motors(spec, notes)
    limits = dict[str, float | None]()
    for joint in spec.joints:
        where = f"joint {quoted(joint.name)}"
        # In a file with motors a joint without one is passive; without any the file does not say.
        limit = motors.get(joint.name, 0.0 if motors else math.inf)
        limit = min(limit, _range_end(spec, joint, where, "actfrc", notes))
        limits[joint.name] = limit if limit < math.inf else None
    _check_driven(motors, limits)
    # Of some motors MuJoCo would simulate the range.
    for actuator in [*spec.actuators]:
        spec.delete(actuator)
    return _Source(spec, _one_gear(gears, notes), None, 1 / AT_SPEED, limits, None)


def _check_driven(driven: Mapping[str, Any], joints: Mapping[str, Any]) -> None:
    """Refuse motors of joints that the file does not have."""
    if lost := sorted({*driven} - {*joints}):
        raise SwingupError(
            f"a motor acts on joint {quoted(lost[0])}, which the file does not have: correct its name"
        )


def _has(spec: Any, *flags: str) -> bool:
    """Whether the file leaves parts of the physics on."""
    import mujoco

    off = spec.option.disableflags
    return not any(off & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}", 0)) for flag in flags)


def _check_bodies(spec: Any) -> None:
    """Refuse what changes the motion, and joints that are not hinges."""
    for joint in spec.joints:
        where, kind = f"joint {quoted(joint.name)}", joint.type.name.removeprefix("mjJNT_").lower()
        if kind != "hinge":
            raise SwingupError(f"{where} is {quoted(kind)}: a plant's two joints are hinges")
        if (np.any(joint.stiffness) or np.any(joint.springdamper)) and _has(spec, "PASSIVE", "SPRING"):
            raise SwingupError(f"{where} has a spring, which has no place in a plant: remove it")
        if np.any(np.atleast_1d(joint.damping)[1:]):
            raise SwingupError(f"{where} has damping that is not linear: write one number")
    for body in spec.bodies:
        if body.gravcomp:
            where = f"<body> {quoted(body.name)}"
            raise SwingupError(f"{where} has gravcomp, and gravity pulls all of a plant: remove it")
        if len(body.joints) > 1:
            names = ", ".join(quoted(joint.name) for joint in body.joints)
            raise SwingupError(
                f"<body> {quoted(body.name)} has {len(body.joints)} joints ({names}): a plant's links have one each"
            )


def _leave_meshes_out(spec: Any) -> None:
    """Delete the geoms of meshes, whose files are not read; refuse those that a body's inertia is made of."""
    groups, source = spec.compiler.inertiagrouprange, int(spec.compiler.inertiafromgeom)
    for geom in [*spec.geoms]:
        kind = geom.type.name.removeprefix("mjGEOM_").lower()
        if kind in ("mesh", "sdf", "hfield") or geom.meshname:
            mass = geom.density if math.isnan(geom.mass) else geom.mass
            # 0: never from geoms; 1: always; 2: where no inertia is stated.
            counts = source == 1 or (source == 2 and not geom.parent.explicitinertial)
            if kind != "hfield" and counts and mass and groups[0] <= geom.group <= groups[1]:
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


def _links(source: _Source, notes: list[str]) -> tuple[tuple[Link, Link], np.ndarray]:
    """The two links, and gravity (m/s²), in the frame of what stands still."""
    import mujoco

    spec, names = source.spec, [joint.name for joint in source.spec.joints]
    if len(names) != 2:
        shown = f" ({', '.join(map(quoted, names[:6]))})" if names else ""
        raise SwingupError(
            f"{len(names)} joints move{shown}, and a double pendulum has two: remove or fix the others"
        )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    links = []
    for joint, name in enumerate(names):
        body, dof = int(model.jnt_bodyid[joint]), int(model.jnt_dofadr[joint])
        damping = float(model.dof_damping[dof]) * _has(spec, "PASSIVE", "DAMPER")
        dry = float(model.dof_frictionloss[dof]) * _has(spec, "FRICTIONLOSS", "CONSTRAINT")
        if dry and source.stated is None:
            notes.append(f"dry friction of {dry:g} N m in joint {quoted(name)} is cf = {dry / AT_SPEED:.4g}")
        if model.jnt_limited[joint] and _has(spec, "LIMIT", "CONSTRAINT"):
            low, high = model.jnt_range[joint]
            notes.append(f"left out: the stops of joint {quoted(name)} at {low:.4g} and {high:.4g} rad")
        place = (data.xaxis[joint].copy(), data.xanchor[joint].copy())
        losses = (damping, dry * source.coulomb, float(model.dof_armature[dof]))
        zero = float(model.qpos0[model.jnt_qposadr[joint]])
        links.append(Link(name, model.body(body).name, *place, *losses, source.limits[name], zero))
    carriers = {int(body): link for body, link in zip(model.jnt_bodyid, links, strict=True)}
    # A body is welded to one that a joint carries, or to the world.
    found = [carriers.get(int(weld)) for weld in model.body_weldid]
    # Two links that both hang on the world are two pendulums.
    if found[model.body_parentid[model.jnt_bodyid[1]]] is not links[0]:
        raise SwingupError(f"joint {quoted(names[1])} hangs on what stands still, not on link 1")
    geoms_count = int(spec.compiler.inertiafromgeom) == 1
    explicit = {body.id for body in spec.bodies if body.explicitinertial and not geoms_count}
    for body, link in enumerate(found):
        if link is not None:
            name, turn, is_carried = model.body(body).name, data.ximat[body].reshape(3, 3), body in carriers
            mass, inertia = float(model.body_mass[body]), np.diag(model.body_inertia[body])
            if source.stated is not None:
                (mass, inertia), turn = source.stated[name], data.xmat[body].reshape(3, 3)
            is_stated = is_carried and body in explicit
            link.parts.append(Part(name, mass, data.xipos[body].copy(), turn @ inertia @ turn.T, is_stated))
            # What is fixed to a link may mark its tip.
            link.marks.extend([] if is_carried else [(f"frame {quoted(name)}", data.xpos[body].copy())])
    for site, body in enumerate(model.site_bodyid):
        if (link := found[body]) is not None:
            link.marks.append((f"frame {quoted(model.site(site).name)}", data.site_xpos[site].copy()))
    for geom, body in enumerate(model.geom_bodyid):
        if (link := found[body]) is not None:
            link.ends.extend(_ends(int(model.geom_type[geom]), model.geom_size[geom], data, geom))
    down = model.opt.gravity * _has(spec, "GRAVITY")
    return (links[0], links[1]), down if source.gravity is None else np.array([0.0, 0.0, -source.gravity])


def _ends(kind: int, sizes: np.ndarray, data: Any, geom: int) -> list[np.ndarray]:
    """Points at which a link may end (m): those of a shape's middle line, without caps, or a box's faces."""
    import mujoco

    shapes = mujoco.mjtGeom
    place, turn = data.geom_xpos[geom].copy(), data.geom_xmat[geom].reshape(3, 3)
    if kind == shapes.mjGEOM_SPHERE:
        return [place]
    halves = {shapes.mjGEOM_CAPSULE: (0, 0, sizes[1]), shapes.mjGEOM_CYLINDER: (0, 0, sizes[1])}
    halves |= {shapes.mjGEOM_BOX: tuple(sizes), shapes.mjGEOM_ELLIPSOID: tuple(sizes)}
    lines = turn * halves.get(shapes(kind), (0, 0, 0))  # a half axis in each column
    return [place + sign * line for line in lines.T for sign in (1.0, -1.0)]
