"""MJCF, MuJoCo's format: bodies, joints, geoms, motors, with default classes.

What is read is what acts on a double pendulum. Other elements are named in a note, or in an error where they would
change the motion: springs, equalities, tendons, fluid. MuJoCo's dry friction has the torque ``frictionloss`` at any
speed; a plant's, cf arctan(100 q̇), tends to cf π/2.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

import numpy as np

from ...common.errors import SwingupError, one_line, quoted
from ...common.xml_tree import Attributes
from .bodies import Body, Hinge, Model, Part, check_driven, double_pendulum, one_gear
from .frames import TURNS, Frame, mjcf_rotation, turn_onto, unit
from .shapes import SIZES, ends, inertia, volume

GENERATED_ELEMENTS = ("replicate", "composite", "flexcomp", "attach")
"""Elements that stand for others."""

COUPLED_SECTIONS = ("equality", "tendon", "deformable")
"""Sections whose elements change the motion."""

NOT_APPLIED = ("boundmass", "boundinertia", "balanceinertia")
"""The compiler's repairs of small masses, which a real pendulum does not need."""

AT_SPEED = math.pi / 2
"""What a plant's dry friction tends to, as a multiple of cf."""

MOTORS = ("motor", "general")
SERVOS = ("position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion", "dcmotor")
"""Kinds of actuators."""

FLAT_SHAPES = ("plane", "hfield")
"""Kinds of geoms that have no mass."""

MAIN, ACTUATOR = "main", "actuator"
"""The outermost class of defaults, and the tag under which all actuators have theirs."""


@dataclass
class _Reading:
    """What holds for the whole file."""

    compiler: Attributes
    option: Attributes
    flags: Mapping[str, str]
    defaults: Mapping[str, Mapping[str, Mapping[str, str]]]
    """Attributes by class and tag."""
    limits: dict[str, float] = field(default_factory=dict)
    """Torque limits of the joints that motors act on (N m)."""
    notes: list[str] = field(default_factory=list)
    bodies: list[Body] = field(default_factory=list)
    collides: bool = False

    @property
    def degree(self) -> float:
        """The unit of angles (rad)."""
        return 1.0 if self.compiler.text("angle", "degree") == "radian" else math.pi / 180

    def has(self, *flags: str) -> bool:
        """Whether the file leaves parts of the physics on."""
        return all(self.flags.get(flag, "enable") == "enable" for flag in flags)

    def attributes(self, element: Element, within: str, kind: str = "") -> Attributes:
        """An element's attributes, with those of its default class."""
        # A class of its own replaces the one that its body gives.
        usual = self.defaults.get(element.get("class", within), {}).get(kind or element.tag, {})
        if any(each in element.attrib for each in (*TURNS, "fromto")):  # one way to turn replaces the default's
            usual = {name: text for name, text in usual.items() if name not in (*TURNS, "fromto")}
        name = element.get("name", "")
        return Attributes({**usual, **element.attrib}, f"<{element.tag}{f' {quoted(name)}' if name else ''}>")

    def frame(self, given: Attributes) -> Frame:
        """Where an element lies in what holds it."""
        rotation = mjcf_rotation(given, self.degree, self.compiler.text("eulerseq", "xyz"))
        return Frame(rotation, given.numbers("pos", (0, 0, 0)))


def read_mjcf(root: Element, about: str | None, gear: float | None) -> Model:
    """The double pendulum of an MJCF.

    Inertias are about the centre, as MuJoCo has them, unless ``about`` says "joint". The gear ratio is the file's
    if none is given.
    """
    flags = {name: text for flag in root.iterfind("option/flag") for name, text in flag.attrib.items()}
    reading = _Reading(_merged(root, "compiler"), _merged(root, "option"), flags, _defaults(root))
    _check_elements(root, reading)
    found_gear = _read_motors(root, reading)
    for world in root.findall("worldbody"):
        _walk(world, None, Frame(), MAIN, reading)
    check_driven(reading.limits, (body.hinge.name for body in reading.bodies if body.hinge))
    if reading.collides and reading.has("contact", "constraint"):
        reading.notes.append("left out: contacts of the links")
    gravity = reading.option.numbers("gravity", (0, 0, -9.81)) * reading.has("gravity")
    return double_pendulum(reading.bodies, gravity, gear or found_gear, reading.notes, about, asked=False)


def _check_elements(root: Element, reading: _Reading) -> None:
    """Note what is not read, and refuse what changes the motion."""
    for element in root.iter():
        if element.tag in GENERATED_ELEMENTS:
            raise SwingupError(
                f"<{element.tag}> stands for other elements: save the model with MuJoCo's mj_saveLastXML"
            )
        if element.tag == "include":
            reading.notes.append(f"not read: <include> of {one_line(element.get('file', ''), 80)}")
    for section in COUPLED_SECTIONS:
        for element in root.iterfind(f"{section}/*"):
            if element.get("active", "true") == "true" and element.tag != "skin":
                name = quoted(element.get("name", ""))
                raise SwingupError(
                    f"<{section}> has <{element.tag}> {name}, which has no place in a plant: remove it"
                )
    for name in ("density", "viscosity"):
        if reading.option.number(name, 0.0) != 0:
            raise SwingupError(
                f"<option> has {name} = {reading.option.text(name)}, and a plant moves in vacuum: remove it"
            )
    if reading.compiler.number("settotalmass", -1.0) > 0:
        raise SwingupError("<compiler> has settotalmass, which is not read: write each mass")
    reading.notes += [
        f"not applied: {each} of <compiler>" for each in NOT_APPLIED if each in reading.compiler.values
    ]


def _merged(root: Element, tag: str) -> Attributes:
    """The attributes of all elements of a tag, of which a file may have several."""
    return Attributes({name: text for each in root.findall(tag) for name, text in each.attrib.items()}, f"<{tag}>")


def _defaults(root: Element) -> dict[str, dict[str, dict[str, str]]]:
    """Attributes by class and tag, with those of the classes around; all actuators share theirs."""
    found: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}

    def read(element: Element, inherited: dict[str, dict[str, str]], names: tuple[str, ...]) -> None:
        own = dict(inherited)
        for each in element:
            tag = ACTUATOR if each.tag in (*MOTORS, *SERVOS) else each.tag
            if tag != "default":
                own[tag] = {**own.get(tag, {}), **each.attrib}
        found.update(dict.fromkeys(names, own))
        for each in element.findall("default"):
            read(each, own, (each.get("class", ""),))

    for top in root.findall("default"):
        # The outermost class is called main, beside its own name.
        read(top, found[MAIN], (MAIN, top.get("class", MAIN)))
    return found


def _read_motors(root: Element, reading: _Reading) -> float:
    """Put the motors' torque limits into the reading; returns their gear ratio, 1 without any."""
    ratios = {}
    for element in root.iterfind("actuator/*"):
        given = reading.attributes(element, MAIN, ACTUATOR)
        name, joint = quoted(element.get("name", "")), given.text("joint", given.text("jointinparent"))
        if not joint:
            reading.notes.append(f"not read: <{element.tag}> {name}, which acts on no joint")
            continue
        plain = element.tag == "motor" or (
            element.tag == "general"
            and given.text("gaintype", "fixed") == "fixed"
            and given.text("biastype", "none") == "none"
        )
        if not plain:
            reading.notes.append(f"of <{element.tag}> {name} only the force range is read")
        if given.text("dyntype", "none") != "none":
            reading.notes.append(f"left out: the dynamics of <{element.tag}> {name}")
        # MuJoCo has ten parameters, of which the first is 1 by default; so it is with the gear.
        gain = float(given.numbers("gainprm", np.eye(1, 10)[0], 1)[0]) if element.tag == "general" else 1.0
        # The sign of a gear says which way the motor turns, which a symmetric limit does not show.
        ratio = ratios[joint] = abs(float(given.numbers("gear", np.eye(1, 6)[0], 1)[0])) or 1.0
        most = _end_of(given, "force", reading)
        most = min(most, abs(gain) * _end_of(given, "ctrl", reading)) if plain else most
        # Several motors may act on a joint: their torques add.
        reading.limits[joint] = reading.limits.get(joint, 0.0) + ratio * most
    return one_gear(ratios, reading.notes)


def _end_of(given: Attributes, kind: str, reading: _Reading) -> float:
    """The smaller end of a range, in which a motor acts both ways; infinite without one."""
    name = f"{kind}range"
    if not _is_limited(given, f"{kind}limited", name, reading):
        return math.inf
    low, high = given.numbers(name, (0, 0))
    if not low < 0 < high:
        raise SwingupError(f"{given.where} has {name} = {quoted(given.text(name))}: a plant's motors act both ways")
    if low != -high:
        reading.notes.append(
            f"{given.where} has {name} from {low:g} to {high:g}: a plant's limits are the same both ways"
        )
    return float(min(-low, high))


def _is_limited(given: Attributes, flag: str, name: str, reading: _Reading) -> bool:
    """Whether a range has an effect: where the flag is set, or the range is there and the flag says nothing."""
    chosen = given.text(flag, "auto")
    if chosen != "auto":
        return chosen == "true"
    return name in given.values and reading.compiler.text("autolimits", "true") == "true"


def _walk(element: Element, parent: int | None, frame: Frame, usual: str, reading: _Reading) -> None:
    """Read the bodies inside of an element, each before those that it carries."""
    for child, within, named in _contents(element, frame, usual, reading):
        if child.tag == "body":
            given = Attributes(child.attrib, f"<body {quoted(child.get('name', ''))}>")
            if given.number("gravcomp", 0.0) != 0:
                raise SwingupError(f"{given.where} has gravcomp, and gravity pulls all of a plant: remove it")
            own = child.get("childclass", named)
            reading.bodies.append(_body(child, parent, reading.frame(given).within(within), own, reading))
            _walk(child, len(reading.bodies) - 1, Frame(), own, reading)


def _contents(
    element: Element, frame: Frame, usual: str, reading: _Reading
) -> Iterator[tuple[Element, Frame, str]]:
    """The elements inside of one, with the frames around them and the class of their defaults."""
    for child in element:
        if child.tag == "frame":
            inner = reading.frame(Attributes(child.attrib, "<frame>")).within(frame)
            yield from _contents(child, inner, child.get("childclass", usual), reading)
        else:
            yield child, frame, usual


def _body(element: Element, parent: int | None, frame: Frame, usual: str, reading: _Reading) -> Body:
    name, hinges = element.get("name", ""), []
    body = Body(name, parent, frame)
    # MuJoCo's rule: a stated inertia wins over the geoms', unless the compiler says otherwise.
    source = reading.compiler.text("inertiafromgeom", "auto")
    inertial = element.find("inertial") if source != "true" else None
    for child, within, named in _contents(element, Frame(), usual, reading):
        if child.tag in ("joint", "freejoint"):
            hinges.append(_hinge(child, within, named, reading))
        elif child.tag == "geom":
            _read_geom(child, within, named, reading, body, inertial is None and source != "false")
        elif child.tag == "site":
            place = reading.frame(reading.attributes(child, named)).within(within).origin
            body.marks.append((child.get("name", ""), place))
    if len(hinges) > 1:
        names = ", ".join(quoted(hinge.name) for hinge in hinges)
        raise SwingupError(
            f"<body> {quoted(name)} has {len(hinges)} joints ({names}): a plant's links have one each"
        )
    if inertial is not None:
        body.parts.append(_stated_part(Attributes(inertial.attrib, f"<inertial> of {quoted(name)}"), reading))
    # What is fixed to a link may mark its tip.
    if hinges == [] and parent is not None:
        body.marks.append((name, np.zeros(3)))
    return replace(body, hinge=hinges[0] if hinges else None)


def _stated_part(given: Attributes, reading: _Reading) -> Part:
    mass, frame = _mass(given), reading.frame(given)
    if not {"diaginertia", "fullinertia"} & {*given.values}:
        raise SwingupError(f"{given.where} has no inertia: add diaginertia")
    tensor = np.diag(given.numbers("diaginertia", (0, 0, 0)))
    if "fullinertia" in given.values:
        xx, yy, zz, xy, xz, yz = given.numbers("fullinertia", (0,) * 6)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Part(mass, frame.origin, frame.rotation @ tensor @ frame.rotation.T)


def _read_geom(element: Element, within: Frame, usual: str, reading: _Reading, body: Body, counts: bool) -> None:
    """Add a geom's mass to its body, where it counts, and its ends."""
    given = reading.attributes(element, usual)
    shape = given.text("type", "sphere")
    if given.number("contype", 1.0) or given.number("conaffinity", 1.0):
        reading.collides = True
    low, high = reading.compiler.numbers("inertiagrouprange", (0, 5))
    # Water, as in MuJoCo.
    weighs = given.number("density", 1000.0) if "mass" not in given.values else _mass(given)
    counts = counts and weighs != 0 and low <= given.number("group", 0.0) <= high and shape not in FLAT_SHAPES
    if shape not in SIZES or "mesh" in given.values:
        if counts:
            raise SwingupError(f"{given.where} of {quoted(body.name)} is a {shape}: give its body an <inertial>")
        return
    # A line between two points replaces a geom's place, direction and length.
    sizes, frame = given.numbers("size", (0, 0, 0), 1), reading.frame(given)
    if "fromto" in given.values:
        line = given.numbers("fromto", (0,) * 6)
        between = line[3:] - line[:3]
        frame = Frame(turn_onto(unit(between, given.where)), 0.5 * (line[:3] + line[3:]))
        half = 0.5 * float(np.linalg.norm(between))
        sizes = np.array([sizes[0], half]) if SIZES[shape] == 2 else np.array([sizes[0], sizes[0], half])
    sizes, frame = sizes[: SIZES[shape]], frame.within(within)
    if not (sizes > 0).all():
        raise SwingupError(f"{given.where} of {quoted(body.name)} has a size that is not positive")
    body.ends.extend(map(frame.point, ends(shape, sizes)))
    if not counts:
        return
    if given.text("shellinertia", "false") == "true":
        raise SwingupError(f"{given.where} of {quoted(body.name)} is a shell: give its body an <inertial>")
    mass = weighs if "mass" in given.values else weighs * volume(shape, sizes)
    tensor = frame.rotation @ inertia(shape, sizes, mass) @ frame.rotation.T
    body.parts.append(Part(mass, frame.origin, tensor, stated=False))


def _mass(given: Attributes) -> float:
    mass = given.number("mass", 0.0)
    if mass < 0:
        raise SwingupError(f"{given.where} has mass = {mass:g}, which must not be negative")
    return mass


def _hinge(element: Element, within: Frame, usual: str, reading: _Reading) -> Hinge:
    given, name = reading.attributes(element, usual), element.get("name", "")
    kind = "free" if element.tag == "freejoint" else given.text("type", "hinge")
    if kind != "hinge":
        raise SwingupError(f"joint {quoted(name)} is {quoted(kind)}: a plant's two joints are hinges")
    springs = given.numbers("stiffness", (0, 0, 0), 1).any() or given.numbers("springdamper", (0, 0)).any()
    if springs and reading.has("passive", "spring"):
        raise SwingupError(f"joint {quoted(name)} has a spring, which has no place in a plant: remove it")
    damping = given.numbers("damping", (0, 0, 0), 1) * reading.has("passive", "damper")
    if damping[1:].any():
        raise SwingupError(f"joint {quoted(name)} has damping that is not linear: write one number")
    dry = given.number("frictionloss", 0.0) * reading.has("frictionloss", "constraint")
    if dry:
        reading.notes.append(f"dry friction of {dry:g} N m in joint {quoted(name)} is cf = {dry / AT_SPEED:.4g}")
    if _is_limited(given, "limited", "range", reading) and reading.has("limit", "constraint"):
        low, high = reading.degree * given.numbers("range", (0, 0))
        reading.notes.append(f"left out: the stops of joint {quoted(name)} at {low:.4g} and {high:.4g} rad")
    # In a file with motors a joint without one is passive; without any the file does not say.
    limit = reading.limits.get(name, 0.0 if reading.limits else math.inf)
    limit = min(limit, _end_of(given, "actuatorfrc", reading))
    return Hinge(
        name,
        within.rotation @ unit(given.numbers("axis", (0, 0, 1)), f"joint {quoted(name)}"),
        within.point(given.numbers("pos", (0, 0, 0))),
        float(damping[0]),
        dry / AT_SPEED,
        given.number("armature", 0.0),
        limit if limit < math.inf else None,
        reading.degree * given.number("ref", 0.0),
    )
