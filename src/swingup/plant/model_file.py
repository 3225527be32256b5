"""URDF and MJCF, read through MuJoCo's compiler, which knows frames, default classes, shapes and units.

MuJoCo never gets what would occupy it for long, fill the memory or read other files: elements that stand for
others and document types are refused first, files have bounds, and neither meshes nor assets are passed on.
"""

import contextlib
import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from ..common.checks import one_of
from ..common.errors import SwingupError, needing, one_line, quoted
from ..common.files import read_bytes
from .chain import READINGS, Link, Model, Part, double_pendulum
from .files import CHOSEN_NUMBERS, OUR_ELEMENT
from .model_formats import AT_SPEED, Source, check_numbers, has_physics, mjcf, urdf

MAXIMUM_BYTES = 2_000_000  # Bytes of a file; meshes lie in files of their own
MAXIMUM_DEPTH = 60  # Levels of elements
MAXIMUM_ELEMENTS = 2_000
"""Elements of a file with all that it includes; MuJoCo takes up to 3 s for them, and longer by the square."""

GENERATED_ELEMENTS = ("replicate", "composite", "flexcomp", "attach")  # Elements of MJCF that stand for others


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
        check_numbers(root)
        # The content decides, since both formats are called .xml.
        if root.tag not in ("robot", "mujoco"):
            raise SwingupError(f"it begins with <{one_line(root.tag, 40)}>: use URDF (<robot>) or MJCF (<mujoco>)")
        is_urdf = root.tag == "robot"
        own = root.find(OUR_ELEMENT if is_urdf else f"custom/numeric[@name='{OUR_ELEMENT}']")
        kept = None if own is None else own.get("data")
        with _heeding_mujoco(notes):
            source = (urdf if is_urdf else mjcf)(root, notes)
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
    data, builder, parser, depth = read_bytes(path, MAXIMUM_BYTES), TreeBuilder(), expat.ParserCreate(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAXIMUM_DEPTH:
            raise SwingupError(f"its elements are deeper than {MAXIMUM_DEPTH} levels")
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
    if sum(1 for _ in root.iter()) > MAXIMUM_ELEMENTS:
        raise SwingupError(f"it has more than {MAXIMUM_ELEMENTS:,} elements: it is another kind of model")


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
    m1, m2, r1, r2, I1 = (plant[name] for name in CHOSEN_NUMBERS[:5])
    return [m1 * r1 + m2 * plant["l1"], m2 * r2, I1 + m2 * plant["l1"] ** 2]


def _links(source: Source, notes: list[str]) -> tuple[tuple[Link, Link], np.ndarray]:
    """The two links, and gravity (m/s²), in the frame of what stands still."""
    import mujoco

    spec, names = source.spec, [joint.name for joint in source.spec.joints]
    if len(names) != 2:
        shown = f" ({', '.join(map(quoted, names[:6]))})" if names else ""
        remedy = "remove or fix the others" if len(names) > 2 else _joint_to_free(source)
        raise SwingupError(f"{len(names)} joints move{shown}, and a double pendulum has two: {remedy}")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    links = []
    # Sorted as MuJoCo sorts them: a body after the one that carries it.
    for joint, limit in sorted(zip(spec.joints, source.limits, strict=True), key=lambda pair: pair[0].id):
        name, number, dof = joint.name, joint.id, int(model.jnt_dofadr[joint.id])
        dry = float(model.dof_frictionloss[dof]) * has_physics(spec, "FRICTIONLOSS", "CONSTRAINT")
        if dry and source.stated is None:
            notes.append(f"dry friction of {dry:g} N m in joint {quoted(name)} is cf = {dry / AT_SPEED:.4g}")
        if model.jnt_limited[number] and has_physics(spec, "LIMIT", "CONSTRAINT"):
            low, high = model.jnt_range[number]
            notes.append(f"left out: the stops of joint {quoted(name)} at {low:.4g} and {high:.4g} rad")
        links.append(
            Link(
                joint=name,
                body=joint.parent.name,
                axis=data.xaxis[number].copy(),
                anchor=data.xanchor[number].copy(),
                damping=float(model.dof_damping[dof]) * has_physics(spec, "PASSIVE", "DAMPER"),
                coulomb=dry * source.coulomb,
                armature=float(model.dof_armature[dof]),
                limit=limit,
                zero=float(model.qpos0[model.jnt_qposadr[number]]),
            )
        )
    carriers = {int(body): link for body, link in zip(model.jnt_bodyid, links, strict=True)}
    # A body is welded to one that a joint carries, or to the world.
    found = [carriers.get(int(weld)) for weld in model.body_weldid]
    # Two links that both hang on the world are two pendulums.
    if found[model.body_parentid[model.jnt_bodyid[1]]] is not links[0]:
        raise SwingupError(f"joint {quoted(links[1].joint)} hangs on what stands still, not on link 1")
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
            place = (data.geom_xpos[geom], data.geom_xmat[geom])
            link.ends.extend(_ends(int(model.geom_type[geom]), model.geom_size[geom], *place))
    down = model.opt.gravity * has_physics(spec, "GRAVITY")
    return (links[0], links[1]), down if source.gravity is None else np.array([0.0, 0.0, -source.gravity])


def _joint_to_free(source: Source) -> str:
    """What makes the second joint of a model that lacks one."""
    carriers = [joint.parent.name for joint in source.spec.joints] or [source.spec.worldbody.name]
    welded = list[str]()
    for body in source.spec.bodies[1:]:  # a body comes after the one that carries it
        if body.parent.name in (*carriers, *welded) and not body.joints:
            welded.append(body.name)
    names = ", ".join(quoted(source.welds.get(name, name)) for name in welded[:6])
    if not names:
        return "add the link that hangs on it, with its joint"
    kind = (
        'the fixed joint of link 2, as type="continuous" with its <axis>' if source.welds else "link 2 by a <joint>"
    )
    return f"free {kind}; fixed to what moves are {names}"


def _ends(kind: int, sizes: np.ndarray, place: np.ndarray, turn: np.ndarray) -> list[np.ndarray]:
    """Points at which a link may end (m): those of a shape's middle line, without caps, or a box's faces."""
    import mujoco

    shapes = mujoco.mjtGeom
    if kind == shapes.mjGEOM_SPHERE:
        return [place.copy()]
    if kind in (shapes.mjGEOM_CAPSULE, shapes.mjGEOM_CYLINDER):
        sizes = np.array([0.0, 0.0, sizes[1]])
    elif kind not in (shapes.mjGEOM_BOX, shapes.mjGEOM_ELLIPSOID):
        return []
    # Columns are half axes.
    return [place + sign * half for half in (turn.reshape(3, 3) * sizes).T for sign in (1.0, -1.0)]
