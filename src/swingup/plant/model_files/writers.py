"""URDF and MJCF of a plant's numbers, in which it hangs at rest where the joints' angles are 0."""

from collections.abc import Mapping
from xml.etree.ElementTree import Element, SubElement

from .bodies import without_rotors
from .mjcf import AT_SPEED
from .urdf import OURS

BASE, LINK1, LINK2, TIP = "base", "link1", "link2", "tip"
"""Names in files that are written."""

SPEED = 1000.0
"""The speed limit that a written joint must have (rad/s), beyond what a pendulum reaches."""


def write_urdf(name: str, plant: Mapping[str, float]) -> Element:
    """A URDF of a plant that hangs at rest where the joints' angles are 0.

    Args:
        name: of the robot.
        plant: its numbers, of which gravity has no place.
    """
    I1, I2, *armatures = without_rotors(plant)
    root = Element("robot", {"name": name, "xmlns:drake": "http://drake.mit.edu"})
    SubElement(root, OURS, gravity=repr(plant["g"]), inertia="centre")
    SubElement(root, "link", name=BASE)
    parents, drops = (BASE, LINK1), (0.0, plant["l1"])
    for number, (link, own) in enumerate(((LINK1, I1), (LINK2, I2)), 1):
        mass, length, centre = (plant[f"{each}{number}"] for each in ("m", "l", "r"))
        body = SubElement(root, "link", name=link)
        inertial = SubElement(body, "inertial")
        SubElement(inertial, "origin", xyz=f"0 0 {-centre!r}")
        SubElement(inertial, "mass", value=repr(mass))
        about = repr(own - mass * centre**2)
        SubElement(inertial, "inertia", ixx=about, ixy="0", ixz="0", iyy=about, iyz="0", izz=about)
        visual = SubElement(body, "visual")
        SubElement(visual, "origin", xyz=f"0 0 {-length / 2!r}")
        SubElement(SubElement(visual, "geometry"), "cylinder", length=repr(length), radius=repr(length / 40))
        joint = _joint(root, f"joint{number}", "continuous", parents[number - 1], link, drops[number - 1])
        SubElement(joint, "axis", xyz="1 0 0")
        SubElement(joint, "limit", effort=repr(plant[f"tl{number}"]), velocity=repr(SPEED))
        SubElement(joint, "dynamics", damping=repr(plant[f"b{number}"]), friction=repr(plant[f"cf{number}"]))
    SubElement(root, "link", name=TIP)
    _joint(root, f"{TIP}_joint", "fixed", LINK2, TIP, plant["l2"])
    for number, armature in enumerate(armatures, 1):
        transmission = SubElement(root, "transmission", name=f"transmission{number}")
        SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        SubElement(transmission, "joint", name=f"joint{number}")
        motor = SubElement(transmission, "actuator", name=f"motor{number}")
        SubElement(motor, "mechanicalReduction").text = repr(plant["gr"])
        SubElement(motor, "drake:gear_ratio", value=repr(plant["gr"]))
        SubElement(motor, "drake:rotor_inertia", value=repr(armature / plant["gr"] ** 2))
    return root


def _joint(root: Element, name: str, kind: str, parent: str, child: str, drop: float) -> Element:
    joint = SubElement(root, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=f"0 0 {-drop!r}")
    return joint


def write_mjcf(name: str, plant: Mapping[str, float]) -> Element:
    """An MJCF of a plant that hangs at rest where the joints' angles are 0; it moves as the plant.

    Args:
        name: of the model.
        plant: its numbers.
    """
    I1, I2, *armatures = without_rotors(plant)
    root = Element("mujoco", model=name)
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", gravity=f"0 0 {-plant['g']!r}", timestep="0.002", integrator="RK4")
    holder, drop = SubElement(root, "worldbody"), 0.0
    motors = Element("actuator")
    for number, (joint, own) in enumerate((("shoulder", I1), ("elbow", I2)), 1):
        m, l, r, b, cf, tl = (plant[f"{each}{number}"] for each in ("m", "l", "r", "b", "cf", "tl"))  # noqa: E741
        holder = SubElement(holder, "body", name=f"link{number}", pos=f"0 0 {-drop!r}")
        SubElement(
            holder, "joint", name=joint, axis="1 0 0", damping=repr(b), frictionloss=repr(AT_SPEED * cf),
            armature=repr(armatures[number - 1]),
        )  # fmt: skip
        about = repr(own - m * r**2)
        SubElement(holder, "inertial", pos=f"0 0 {-r!r}", mass=repr(m), diaginertia=f"{about} {about} {about}")
        line = f"0 0 0 0 0 {-l!r}"
        SubElement(
            holder, "geom", type="capsule", fromto=line, size=repr(l / 40), mass="0", contype="0", conaffinity="0"
        )
        if tl > 0:
            top = tl / plant["gr"]
            SubElement(
                motors, "motor", name=joint, joint=joint, gear=repr(plant["gr"]), ctrlrange=f"{-top!r} {top!r}"
            )
        drop = l
    SubElement(holder, "site", name="tip", pos=f"0 0 {-drop!r}")
    root.append(motors)
    return root
