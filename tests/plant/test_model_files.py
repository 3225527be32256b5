"""URDF and MJCF: RealAIGym's files beside their numbers, MuJoCo's dynamics, round trips, and what is refused."""

import math
import shutil
import sys
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from benchmark.independent import derivative
from refusals import refusal
from swingup import SwingupError, load_policy, measured_plant, save_plant
from swingup.common.errors import installing
from swingup.loop.resolve import resolve
from swingup.plant.files import SHIPPED_PLANTS, load_plant
from swingup.plant.model_file import read_model
from swingup.plant.plant import NAMES, ZEROS, make_plant
from swingup.policy.shipped import shipped_file

DATA = Path(__file__).parent / "data"
NOT_IN_URDF = {"l2", "Ir", "gr", *ZEROS}
"""What RealAIGym's URDFs do not say."""


def urdf(links="", joints="", more=""):
    """A URDF whose links are rods of 1 kg, 0.4 and 0.6 m long."""
    rod = '<inertial><origin xyz="0 0 {}"/><mass value="1"/><inertia ixx="{}" iyy="{}" izz="0.001" '
    rod += 'ixy="0" ixz="0" iyz="0"/></inertial>'
    first, second = rod.format(-0.2, 0.16 / 12, 0.16 / 12), rod.format(-0.3, 0.03, 0.03)
    return f"""<robot name="mine"><link name="world"/><link name="base"/>
<link name="upper">{first}</link><link name="lower">{second}</link>{links}
<joint name="weld" type="fixed"><parent link="world"/><child link="base"/><origin rpy="0 0 0.7"/></joint>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit effort="2" velocity="9"/><dynamics damping="0.1" friction="0.05"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0 0.1 -0.4"/>
<axis xyz="0 1 0"/></joint>{joints}<transmission name="t"><type>SimpleTransmission</type><joint name="shoulder"/>
<actuator name="m"><mechanicalReduction>5</mechanicalReduction></actuator></transmission>{more}</robot>"""


TOOL = (
    '<link name="tool"><inertial><origin xyz="0 0.02 -0.01" rpy="0.3 0 0"/><mass value="0.5"/>'
    '<inertia ixx="0.001" ixy="0.0001" iyy="0.002" izz="0.0015" ixz="0" iyz="0"/></inertial></link>',
    '<joint name="mount" type="fixed"><parent link="lower"/><child link="tool"/>'
    '<origin xyz="0 0 -0.6" rpy="0 0.4 0.2"/></joint>',
)


def mjcf(upper='<geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02"/>', lower="", head="", tail="", world=""):
    """An MJCF of two links on axes along x."""
    return f"""<mujoco>{head}<worldbody>{world}<body name="upper"><joint name="shoulder" axis="1 0 0"/>{upper}
<body name="lower" pos="0 0 -0.4"><joint name="elbow" axis="1 0 0" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.6" size="0.02"/>{lower}</body></body></worldbody>
<actuator><motor name="motor" joint="elbow" gear="3" ctrlrange="-2 2"/></actuator>{tail}</mujoco>"""


def largest_difference(mujoco, path, speed=4.0, slowest=0.0):
    """Between accelerations here and in MuJoCo in random states, relative to 1 rad/s² and the acceleration.

    The rates deviate by a speed, and are above a least one, from which on dry friction is MuJoCo's.
    """
    found, model, worst = read_model(path, "centre"), mujoco.MjModel.from_xml_path(str(path)), 0.0
    # What a file need not say, and no acceleration depends on.
    plant = make_plant({"l2": 1.0, "tl1": 1.0, "tl2": 1.0} | found.facts, "the file").values()
    data, random, (signs, offsets) = mujoco.MjData(model), np.random.default_rng(0), np.array(found.angles).T
    for _ in range(20):
        rates = speed * random.normal(size=2)
        data.qpos[:], data.qvel[:] = random.uniform(-3, 3, 2), rates + slowest * np.sign(rates)
        data.ctrl[:] = random.uniform(-1, 1, model.nu)
        mujoco.mj_forward(model, data)
        q, dq, u = offsets + signs * data.qpos, signs * data.qvel, signs * data.qfrc_actuator
        error = derivative(plant, np.concatenate([q, dq]), u)[2:] - signs * data.qacc
        worst = max(worst, np.max(np.abs(error) / (1 + np.abs(data.qacc))))
    return worst


def write(folder, text):
    """A file of the text, of its format's name."""
    path = folder / ("mine.urdf" if "<robot" in text else "mine.xml")
    path.write_text(text)
    return path


@pytest.mark.parametrize("design", ["A.0", "C.0", "C.1"])
def test_realaigyms_files_have_their_numbers_once_the_reading_is_named(design):
    """Link 2 is turned by almost π there, a link has no mass, and inertias are about the joints."""
    expected = yaml.safe_load((DATA / f"{design}.yml").read_text())
    found = read_model(DATA / f"{design}.urdf", inertia="joint").facts
    said = {name: expected[name] for name in NAMES if name not in NOT_IN_URDF}
    assert found == pytest.approx(said | {"gr": 1.0, "Ir": 0.0}, rel=1e-12)
    text = refusal(load_plant, DATA / f"{design}.urdf")
    assert "may be about the centres of mass" in text
    assert "--inertia centre or joint" in text
    # As the standard reads the file, link 1 has I + m r² about its joint.
    centre = read_model(DATA / f"{design}.urdf", inertia="centre").facts
    assert centre["I1"] == pytest.approx(expected["I1"] + expected["m1"] * expected["r1"] ** 2)
    # The second link of C.0 has I = 0.0539 < 0.0582 = m r².
    notes = measured_plant(str(DATA / f"{design}.urdf"), {"l2": 0.3}, "joint").notes
    assert any("below m r² = 0.05821" in note for note in notes) == (design == "C.0")


@pytest.mark.parametrize("ending", ["urdf", "xml", "yml"])
@pytest.mark.parametrize("name", [*SHIPPED_PLANTS, "odd"])
def test_round_trips_are_exact(tmp_path, name, ending):
    plant = load_plant("C.1" if name == "odd" else name)
    if name == "odd":  # on the moon, no motor at the elbow, a heavy rotor, and a centre on the other side
        plant = plant.changed(g=1.62, tl2=0.0, gr=3.0, Ir=1e-3, r2=-0.1, zero1=0.04, zero2=-0.03)
    save_plant(tmp_path / f"x.{ending}", plant)
    assert load_plant(tmp_path / f"x.{ending}").values() == pytest.approx(plant.values(), rel=1e-14, abs=1e-16)


@pytest.mark.parametrize("name", SHIPPED_PLANTS)
def test_exported_plants_move_in_mujoco_as_here(tmp_path, name):
    """To rounding without dry friction; with it where arctan(100 q̇) is π/2 but for 1/(100 q̇), from 20 rad/s on."""
    mujoco = pytest.importorskip("mujoco")
    plant, path = load_plant(name), tmp_path / "x.xml"
    save_plant(path, plant.changed(cf1=0.0, cf2=0.0))
    assert largest_difference(mujoco, path) < 1e-12
    save_plant(path, plant)
    assert largest_difference(mujoco, path, slowest=20.0) < 1e-2
    if name == "leaderboard":  # MuJoCo reads no rotors from a URDF
        save_plant(tmp_path / "x.urdf", plant)
        assert largest_difference(mujoco, tmp_path / "x.urdf") < 1e-12


BOX = """<geom type="box" size=".02 .03 .1" euler="0 90 0" pos=".1 0 0" density="700"/>"""
VARIANTS = {
    # MuJoCo takes URDF's friction as a torque, and RealAIGym as cf.
    "a tool's mass": urdf(*TOOL).replace("0.05", "0"),
    "a turned second link": urdf().replace("0.05", "0").replace('0.1 -0.4"', '0.1 -0.4" rpy="3.1415926535898 2 0"'),
    "degrees": mjcf(lower='<body euler="0 0 90"><geom size=".05"/></body>').replace(
        'pos="0 0 -0.4"', 'pos="0 0 -0.4" euler="40 0 0"'
    ),
    "shapes": mjcf(
        BOX.replace(".1 0 0", "0 0 -.1") + '<geom type="ellipsoid" size=".02 .03 .1" pos="0 0 -.2" mass=".3"/>',
        '<geom type="cylinder" size=".05 .01" zaxis="1 1 0" pos="0 .05 -.6"/><geom size=".1" mass="0"/>',
    ),
    "shells": mjcf().replace('size="0.02"', 'size="0.02" shellinertia="true"'),
    "inertias": mjcf(
        '<inertial pos="0 0 -.1" mass="1" fullinertia=".02 .02 .003 .001 0 0"/>' + BOX,
        '<inertial pos="0 .05 -.1" mass="1" diaginertia=".02 .015 .01" xyaxes="1 1 0 0 0 1"/>',
    ),
    "classes": mjcf(
        '<geom class="thin" fromto="0 0 0 0 0 -0.4"/>',
        '<frame pos="0 .1 0" quat="1 1 0 0"><geom class="heavy" pos="0 0 .2" size=".05 .2"/></frame>',
        """<default><joint damping=".2" armature=".01"/><default class="thin"><geom type="capsule" size=".02"/>
        <default class="heavy"><geom density="3000"/></default></default></default>""",
    ),
    "rotors": mjcf().replace('name="shoulder"', 'name="shoulder" armature=".03"').replace(
        'name="elbow"', 'name="elbow" armature=".02" ref="30" axis="-1 0 0" pos="0 0 .01"'
    ).replace('axis="1 0 0" damping', "damping"),
    "geoms count": mjcf('<inertial pos="0 0 -.1" mass="9" diaginertia="1 1 1"/>' + BOX.replace(".1 0 0", "0 0 -.1"),
        head='<compiler inertiafromgeom="true" inertiagrouprange="0 2"/>', lower='<geom size=".1" group="3"/>'),
    "no damping": mjcf(head='<option gravity="0 0 -3"><flag damper="disable"/></option>'),
}  # fmt: skip


@pytest.mark.parametrize("variant", VARIANTS)
def test_what_is_read_moves_as_in_mujoco(tmp_path, variant):
    mujoco = pytest.importorskip("mujoco")
    assert largest_difference(mujoco, write(tmp_path, VARIANTS[variant])) < 1e-12


def test_facts_of_a_urdf(tmp_path):
    """Rods, whose inertias about their centres are a third of m r²; a tip; a motor at the shoulder alone."""
    tip = ('<link name="tip"/>', '<joint name="end" type="fixed"><parent link="lower"/><child link="tip"/>'
           '<origin xyz="0 0 -0.6"/></joint>')  # fmt: skip
    path = write(tmp_path, urdf(*tip))
    expected = {
        "m1": 1.0, "m2": 1.0, "l1": 0.4, "l2": 0.6, "r1": 0.2, "r2": 0.3, "I1": 0.16 / 3, "I2": 0.36 / 3, "Ir": 0.0,
        "gr": 5.0, "b1": 0.1, "b2": 0.0, "cf1": 0.05, "cf2": 0.0, "g": 9.81, "tl1": 2.0, "tl2": 0.0, **ZEROS,
    }  # fmt: skip
    plant = load_plant(path)
    assert plant.values() == pytest.approx(expected)
    # Everywhere a plant is taken: as a domain, as that of a domain, and as the start of a parameter file.
    (tmp_path / "wide.yml").write_text("plant: mine.urdf\nm1: [0.9, 1.2]\n")
    (tmp_path / "heavy.yml").write_text("plant: mine.urdf\nm1: 1.5\n")
    assert resolve(domain=tmp_path / "wide.yml").nominal_plant.m1 == pytest.approx(1.05)
    assert load_plant(tmp_path / "heavy.yml").changed(m1=1.0) == plant
    assert resolve(domain=path).plant == resolve(path).plant == plant


def test_facts_of_an_mjcf(tmp_path):
    text = mjcf(
        lower='<site name="tip" pos="0 0 -0.62"/>', head='<include file="visual.xml"/>',
        tail='<contact><exclude body1="upper" body2="lower"/></contact>',
    )  # fmt: skip
    text = text.replace('damping="0.1"', 'damping="0.1" frictionloss="0.3" range="-90 90" actuatorfrcrange="-4 4"')
    path = write(tmp_path, text.replace('ctrlrange="-2 2"', 'ctrlrange="-2 1.5" forcerange="-9 9"'))
    facts, notes = read_model(path).facts, "\n".join(read_model(path).notes)
    # 3 · 1.5 = 4.5 N m, of which the joint lets 4 through. MuJoCo's friction is cf π/2 at speed.
    assert (facts["tl1"], facts["tl2"], facts["gr"], facts["l2"]) == (0.0, 4.0, 3.0, pytest.approx(0.62))
    assert facts["cf2"] == pytest.approx(0.3 * 2 / math.pi)
    for named in ("visual.xml", "contacts", "-1.571 and 1.571", "cf = 0.191", "the same both ways", "frame 'tip'"):
        assert named in notes
    assert read_model(write(tmp_path, mjcf(world='<geom type="mesh" mesh="stand"/>'))).facts["l1"] == 0.4
    servo = mjcf().replace('<motor name="motor"', '<position name="motor" kp="9" forcerange="-2 2"')
    found = read_model(write(tmp_path, servo))
    assert found.facts["tl2"] == 6.0
    assert any("only the force range" in note for note in found.notes)
    second = '<motor name="other" joint="shoulder" gear="7" ctrlrange="-1 1"/></actuator>'
    found = read_model(write(tmp_path, mjcf().replace("</actuator>", second)))
    assert any("3 of 'elbow', 7 of 'shoulder'" in note for note in found.notes)


WRONG = {
    "has a document type": '<!DOCTYPE robot [<!ENTITY a "b">]>' + urdf(),
    "it is xacro": urdf(more='<xacro:property name="m" value="1"/>'),
    "as type=\"continuous\" with its <axis>; fixed to what moves are 'elbow'": urdf().replace(
        'name="elbow" type="continuous"', 'name="elbow" type="fixed"'
    ),
    "'mount' is 'prismatic'": urdf(TOOL[0], TOOL[1].replace('type="fixed"', 'type="prismatic"')),
    "has multiple parents": urdf(joints=TOOL[1].replace("tool", "upper")),
    "'elbow' is turned by 90°": urdf().replace('-0.4"/>\n<axis xyz="0 1 0"', '-0.4"/>\n<axis xyz="1 0 0"'),
    "leans 90° from the horizontal": urdf().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>'),
    "mimics": urdf().replace('<axis xyz="0 1 0"/></joint>', '<axis xyz="0 1 0"/><mimic joint="shoulder"/></joint>'),
    "link 'upper' = -1 kg": urdf().replace('<mass value="1"/>', '<mass value="-1"/>', 1),
    "lies on the axis": urdf().replace('0.1 -0.4"', '0.1 0"').replace('xyz="0 0 -0.2"', 'xyz="0 0 0"'),
    "'elbow' has a damping, friction or armature that is negative": mjcf().replace("0.1", "-1"),
    "it does not say l2: swingup plant": urdf(),
    "'slider' is 'slide'": mjcf('<joint name="slider" type="slide"/>'),
    "'elbow' has a spring": mjcf().replace('damping="0.1"', 'stiffness="2"'),
    "<equality> has <joint> 'lock'": mjcf(tail='<equality><joint name="lock" joint1="elbow"/></equality>'),
    "gravity has a direction of length 0": mjcf(head='<option><flag gravity="disable"/></option>'),
    "is a mesh: give its body an <inertial>": mjcf('<geom name="arm" type="mesh" mesh="arm"/>'),
    "deeper than 60 levels": mjcf(lower="<frame>" * 60 + "</frame>" * 60),
    "<replicate> stands for other elements": mjcf(world='<replicate count="999999999"/>'),
    "both ways": mjcf().replace('ctrlrange="-2 2"', 'ctrlrange="0 2"'),
}


@pytest.mark.parametrize("named", WRONG)
def test_files_that_are_no_double_pendulum(tmp_path, named):
    assert named in refusal(load_plant, write(tmp_path, WRONG[named]))


@pytest.mark.parametrize("name", ["X.YML", "x.Yaml", "X.URDF", "x.Xml", "X.MJCF"])
def test_names_in_capitals_are_read_as_they_were_written(tmp_path, name):
    plant = load_plant("C.1")
    save_plant(tmp_path / name, plant)
    (tmp_path / "Base.YML").write_text(f"plant: {name}\nm1: 0.6\n")
    assert load_plant(tmp_path / name).values() == pytest.approx(plant.values(), rel=1e-14)
    assert resolve(domain=tmp_path / name).plant == resolve(tmp_path / name).plant == load_plant(tmp_path / name)
    assert load_plant(tmp_path / "Base.YML").m1 == 0.6
    shutil.copy(shipped_file("acrobot"), tmp_path / "P.SAFETENSORS")
    assert load_policy(tmp_path / "P.SAFETENSORS").robot.name == "acrobot"


def test_a_file_may_include_others_once_each(tmp_path):
    parts = {
        "body.xml": """<mujocoinclude><body name="lower" pos="0 0 -0.4"><joint name="elbow" axis="1 0 0"/>
            <geom type="capsule" fromto="0 0 0 0 0 -0.6" size="0.02"/></body></mujocoinclude>""",
        "motor.xml": """<mujoco><actuator><motor joint="elbow" ctrlrange="-2 2"/></actuator>
            <include file="motor.xml"/><include file="/dev/zero"/></mujoco>""",
    }
    for name, text in parts.items():
        (tmp_path / name).write_text(text)
    found = read_model(write(tmp_path, """<mujoco><include file="motor.xml"/><worldbody><body name="upper">
        <joint name="shoulder" axis="1 0 0"/><geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02"/>
        <include file="body.xml"/></body></worldbody></mujoco>"""))  # fmt: skip
    assert (found.facts["l1"], found.facts["tl2"]) == (0.4, 2.0)
    assert sum("<include> of motor.xml" in note or "/dev/zero" in note for note in found.notes) == 2


def test_point_masses_and_links_of_one_moment(tmp_path):
    """MuJoCo takes no inertia that is zero about an axis; a pendulum in a plane needs one moment alone."""
    text = urdf().replace(f'iyy="{0.16 / 12}" izz="0.001"', 'iyy="0.02" izz="0"').replace('iyy="0.03"', 'iyy="0"')
    facts = read_model(write(tmp_path, text.replace(f'ixx="{0.16 / 12}"', 'ixx="0"'))).facts
    # 1 kg at 0.2 m with 0.02 kg m² about its centre, and 1 kg at 0.3 m.
    assert (facts["I1"], facts["I2"]) == pytest.approx((0.06, 0.09), rel=1e-12)


def test_what_is_written_can_be_read(tmp_path):
    """Or it is refused when it is written: MuJoCo and readers have bounds."""
    plant, written = load_plant("C.1"), 0
    extremes = {"cf1": 9.9e8, "tl2": 9e8, "gr": 1e-5, "Ir": 9e8, "I1": 9e8, "m2": 9e8, "b1": 9e8}
    for name, value in {**extremes, "l1": 1e-8, "l2": 1e-9, "g": 1e-9, "cf2": 1e-300, "Ir ": 1e-300}.items():
        for ending in ("xml", "urdf"):
            path, extreme = tmp_path / f"x.{ending}", plant.changed(**{name.strip(): value})
            try:
                save_plant(path, extreme)
            except SwingupError:
                assert not path.exists()
            else:
                written += 1
                assert load_plant(path).values() == pytest.approx(extreme.values(), rel=1e-9, abs=1e-12)
                path.unlink()
    assert written > 8


def test_damaged_installations_are_named(tmp_path, monkeypatch):
    """An upgrade of MuJoCo 3 to 4 removes files of the new packages, of which pip still lists all."""
    (tmp_path / "mujoco.py").write_text("raise ImportError('its core bindings are missing')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mujoco")
    assert "missing): pip uninstall mujoco mujoco-core mujoco-studio, then" in refusal(
        read_model, DATA / "C.1.urdf"
    )
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert installing("mujoco") in refusal(read_model, DATA / "C.1.urdf")


@pytest.mark.parametrize(("origin", "words"), {
    None: "'swingup[plot]'",
    '{"url": "file:///a%20b", "dir_info": {"editable": true}}': "-e '/a b[plot]'",
    '{"url": "file:///swingup.whl", "archive_info": {}}': "'swingup[plot] @ file:///swingup.whl'",
    '{"url": "https://x.org/s", "vcs_info": {"vcs": "git"}}': "'swingup[plot] @ git+https://x.org/s'",
}.items())  # fmt: skip
def test_an_extra_comes_from_where_the_package_does(origin, words, monkeypatch):
    monkeypatch.setattr(metadata, "distribution", lambda name: SimpleNamespace(read_text=lambda file: origin))
    assert installing("plot") == f"pip install {words}"


def test_what_cannot_be_written(tmp_path):
    plant = load_plant("C.1")
    assert "b1 = -1 is negative" in refusal(save_plant, tmp_path / "x.xml", plant.changed(b1=-1.0))
    for name, value, minimum in (("gr", 1e-8, 1e-6), ("l2", 0.1, 0.127847)):
        named = f"{name} = {value:g} must be above {minimum:g}"
        assert named in refusal(save_plant, tmp_path / "x.urdf", plant.changed(**{name: value}))
    # m2 r2 = 0.16 and l1 = 0.2: a positive I1 + m2 l1² = 0.057 lets m2 be 1.35 kg at most, so that I2 ≥ 0.019.
    slim = plant.changed(I2=0.015, I1=0.04)
    assert "no bodies move as this plant does" in refusal(save_plant, tmp_path / "x.urdf", slim)
    passive = plant.changed(tl1=0.0, tl2=0.0)
    assert "it would lose gr of a plant without motors" in refusal(save_plant, tmp_path / "x.xml", passive)
    assert "cannot write" in refusal(save_plant, tmp_path / "x.txt", plant)
    assert [*tmp_path.iterdir()] == []
