"""Spoilt files of all kinds: each read ends in a value or in a ``SwingupError`` of one line, within 20 s.

Other seeds: ``SWINGUP_FUZZ_SEEDS=5,6,7 python -m pytest -m slow tests/test_spoilt_files.py``.
"""

import contextlib
import dataclasses
import functools
import io
import json
import os
import random
import re
import signal
import tempfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.io import savemat

from bags import write_bag
from policy.references import sighted_policy, small_policy
from swingup import BOARDS, SwingupError, get_controller, load_plant, measured_plant, save_plant, score
from swingup.areapo.checkpoint import load_checkpoint, read_metadata, save_checkpoint
from swingup.benchmark.recording import load_trajectory
from swingup.benchmark.robustness_board import CRITERIA
from swingup.cli.pendulums import named_values
from swingup.controllers.baselines.baselines import feedback_policy
from swingup.controllers.stack.policy import policy_of
from swingup.controllers.swingups.reference import Reference, load_reference, save_reference
from swingup.export.c_header import c_header
from swingup.identification.recording import read_recording
from swingup.learner.backend import check_actions
from swingup.learner.metrics import read_metrics
from swingup.learner.run_settings import make_run_settings, read_run_settings
from swingup.loop.resolve import resolve
from swingup.plant.files import model_text
from swingup.plant.plant import ROBOTS
from swingup.policy.estimator import EstimatorSettings
from swingup.policy.feedback import policy_controller, read_feedback, write_feedback
from swingup.policy.file import read_network
from swingup.policy.guard import GuardSettings
from swingup.policy.identifier import IdentifierSettings
from swingup.policy.numpy_backend import numpy_controller
from swingup.policy.pendulum import read_pendulum_policy, write_pendulum_policy
from swingup.policy.regulator import RegulatorSettings
from swingup.policy.self_test import loop_test, read_test
from swingup.policy.spaces import Space
from swingup.report.figures import curves_figure, read_robustness, robustness_figure

WORDS = [
    "", "0", "1", "-1", "1.5", "nan", "NaN", "inf", "-Infinity", ".nan", ".inf", "1e999", "1e308", "-1e308",
    "1e-320", "9" * 5000, "9223372036854775808", "1_000", "0x10", "1:30", "2001-99-99", "1,5", "１２", "½",
    "\u22121", "true", "null", "~", "x", '"1"', "'", '"', "[]", "{}", "[1, 2]", "[2, 1]", "[null]", '{"a": 1}',
    "[" * 1500, "[" * 400 + "]" * 400, "[0, " + "0, " * 5000 + "0]", "../../up", "a\nb", "\x00", "\x1b[31m",
    "\u202e", "\udce9", "x" * 100_000, "!!int x", "!!timestamp x", "!!python/object/apply:os.getcwd []",
    "!!set {a}", "!custom 5", "&a [*a]", "*a", "<<: [1]", "- 1", "? a", "---", "time (s)", "pos_meas1[deg]",
    "vel_meas1 [rpm]", "time[", "1 0 0 0", "0 0 0", "&amp;", "&a;", "<joint/>", "<b>" * 100, "</robot>", "<!--",
    "<![CDATA[x]]>", "<include file='/etc/passwd'/>",
    '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>',
    "<?xml version='1.0' encoding='idna'?>", "<a " + "".join(f"a{k}='' " for k in range(900)) + "/>", "base",
    "free", "global", "XyZ", "torque_limit: 6", "1e-200", "-1e-200", "1e-300", "2.5e8", "9.9e8", "1.6e9", "1e-9",
]  # fmt: skip
"""In the place of others."""
BOMB = "a0: &a0 [u, u, u, u, u, u, u, u, u]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 9)
)
"""YAML's aliases that would grow to 9 to the power of 9 words."""


def damaged(draw, data):
    """Bytes of which some are cut off, flipped, or others."""
    kind = draw.random()
    if not data or kind < 0.3:
        return data[: draw.randrange(len(data) + 1)]
    changed = bytearray(data)
    for _ in range(draw.choice([1, 1, 2, 4, 16])):
        place = draw.randrange(len(changed))
        changed[place] = changed[place] ^ (1 << draw.randrange(8)) if kind < 0.8 else draw.randrange(256)
    return bytes(changed)


def changed_text(draw, text):
    """A text with one to three other words, or without some, or with lines twice or elsewhere."""
    for _ in range(draw.choice([1, 1, 2, 3])):
        words = [*re.finditer(r"""[^\s,:<>="'{}\[\]]+""", text)] or [re.match("", text)]
        found, other, kind = draw.choice(words), draw.choice(words), draw.random()
        lines = text.splitlines(keepends=True) or [""]
        if kind < 0.65:
            text = text[: found.start()] + draw.choice([*WORDS, other.group()]) + text[found.end() :]
        elif kind < 0.75:
            text = text[: found.start()] + draw.choice(WORDS) + text[found.start() :]
        elif kind < 0.9:
            place, line = draw.randrange(len(lines)), draw.choice([*lines, "", draw.choice(WORDS) + "\n", BOMB])
            text = "".join([*lines[:place], *draw.choice([[], [lines[place]]]), line, *lines[place + 1 :]])
        elif kind < 0.95:
            text = draw.choice(WORDS)
        else:
            text = draw.choice(["\ufeff", "sep=;\n", "%YAML 3.0\n", "\t"]) + text.replace(
                *draw.choice([",;", "\n\r", ".,"])
            )
    return text


def spoilt_text(draw, texts):
    text = changed_text(draw, draw.choice(texts))
    data = text.encode(draw.choice(["utf-8"] * 12 + ["utf-8-sig", "utf-16"]), "surrogatepass")
    return damaged(draw, data) if draw.random() < 0.1 else data


def other_array(draw, array):
    """An array of another type, shape or content."""
    kinds = ["U5", "i4", "f2", "f8", "c16", "?", ">f4"]
    shapes = [(), (0,), (1,), (0, 4), (1, 1, 1), (100_000,), (1, 9999)]
    values = [np.nan, np.inf, 1e300, 1e-320]
    with np.errstate(all="ignore"):
        return draw.choice([
            lambda: array.astype(draw.choice(kinds)),
            lambda: np.zeros(draw.choice(shapes)),
            lambda: np.where(np.arange(array.size).reshape(array.shape) % 7 == 3, draw.choice(values), array),
            lambda: array[::-1] * draw.choice([*values, np.pi, 0.0]),
        ])()  # fmt: skip


def spoilt_log(draw, save):
    """A log of arrays, as a writer saves it."""
    arrays = dict(LOG)
    for name in draw.sample(list(LOG), draw.choice([0, 1, 2])):
        arrays[name] = other_array(draw, arrays[name])
    save(stream := io.BytesIO(), draw.choice([arrays, arrays, {"x": arrays["q"]}]))
    return damaged(draw, stream.getvalue()) if draw.random() < 0.5 else stream.getvalue()


def spoilt_arrays(draw, good):
    """A safetensors file with something wrong in its metadata, header, length, numbers or bytes."""
    size = int.from_bytes(good[:8], "little")
    line, body = good[8 : 8 + size].decode(), bytearray(good[8 + size :])
    kind = draw.choice(["metadata", "metadata", "header", "header", "numbers", "length", "bytes"])
    if kind == "metadata":
        header = json.loads(line)
        text = json.dumps(json.loads(header["__metadata__"]["swingup"]), indent=1)
        line = json.dumps(header | {"__metadata__": {"swingup": changed_text(draw, text)}})
    if kind == "header":
        line = changed_text(draw, line)
    if kind == "numbers":
        place = 8 * draw.randrange(len(body) // 8)
        body[place : place + 8] = draw.choice([b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\xff" * 4, b"\1\0\0\0"]) * 2
    head = line.encode("utf-8", "surrogatepass")
    length = draw.choice([0, 1, len(head) - 1, 10**5, 2**63, 2**64 - 1]) if kind == "length" else len(head)
    data = length.to_bytes(8, "little") + head + body
    return damaged(draw, data) if kind == "bytes" else data


RANGES = resolve(domain="recorded").content
PLANT = {name: float(value) for name, value in load_plant("C.1").values().items()}
LOOP = dict.fromkeys(("torque_limit", "passive_limit", "delay", "velocity_noise", "torque_noise", "response"), 0.1)
MAPS = [
    "".join(f"{name}: {value}\n" for name, value in each.items()) for each in (PLANT, LOOP, PLANT | LOOP, RANGES)
]
HEADER = "time,pos_meas1,pos_meas2,vel_meas1,vel_meas2,tau_con1,tau_con2\n"
TRAJECTORIES = [
    HEADER + "".join(f"{k / 500:g},{np.sin(k / 9):g},0.1,{np.cos(k / 9):g},0,0.5,0\n" for k in range(count))
    for count in (0, 1, 3, 60)
]
TIME = np.arange(0.0, 2.0, 0.01)
LOG = {
    "t": TIME,
    "q": np.column_stack([np.sin(3 * TIME), np.cos(2 * TIME)]),
    "dq": np.column_stack([3 * np.cos(3 * TIME), -2 * np.sin(2 * TIME)]),
    "u": np.column_stack([TIME, TIME]),
}
LIKE = {"weights": jnp.zeros((4, 3)), "step": jnp.zeros((), int)}
"""What a checkpoint is read like."""


def written(write, *given):
    """The bytes of a good file."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / "good", *given)
        return (Path(folder) / "good").read_bytes()


REFERENCE = Reference(ROBOTS["acrobot"], 0.002, np.zeros((20, 4)), np.zeros(20), np.zeros((20, 4)))
WHOLE = dataclasses.replace(
    policy_of(sighted_policy()), guard=GuardSettings(), regulator=RegulatorSettings(),
    estimator=EstimatorSettings(), identifier=IdentifierSettings(),
)  # fmt: skip
POLICIES = [written(write_pendulum_policy, each, {}) for each in (WHOLE, policy_of(small_policy()))]
CONFIG = {"version": "0.1.0", "frames": 10_000} | make_run_settings("acrobot", "pendulum").as_dict()
ROW = {"seed": 0, "frames": 1024, "reward": 0.5, "score": 0.1, "best_score": 0.2, "entropy": -1.5, "seconds": 2.0}
ROBUSTNESS = {
    "robot": "acrobot", "controller": "x", "board": "robustness", "seed": 0, "seeds": [0, 1], "score": 0.5,
    "intervals": {"velocity_noise": [1, 2], "score": [0.1, 0.2]}, "details": [], **dict.fromkeys(CRITERIA, 50.0),
}  # fmt: skip
SHAPES = """<mujoco><compiler eulerseq="zyx"/><option><flag contact="disable"/></option>
<default><default class="a"><geom type="box" size=".02 .03 .1" density="800"/><joint axis="0 0 1" damping=".1"/>
</default></default><worldbody><body name="b0" euler="0 90 0"><body name="L1" childclass="a" axisangle="0 0 1 20">
<joint name="j1"/><geom pos=".1 0 0" zaxis="1 0 0"/><frame quat="1 1 0 0" pos=".25 0 0">
<body name="L2" xyaxes="1 0 0 0 0 -1"><joint name="j2" ref="9" range="-3 3" armature=".01" frictionloss=".1"/>
<geom type="capsule" class="main" fromto="0 0 0 .3 0 0" size=".01"/><body name="t" pos=".3 0 0">
<inertial pos="0 0 0" mass=".1" fullinertia=".1 .1 .1 0 0 0"/></body></body></frame></body></body></worldbody>
<actuator><motor joint="j1" gear="2" ctrlrange="-1 1"/>
<general joint="j2" gainprm="3" ctrlrange="-2 1" forcerange="-1 1"/></actuator></mujoco>"""
LAWS = [
    written(write_feedback, feedback_policy(name, "pendubot", load_plant("leaderboard")))
    for name in ("lqr", "tvlqr")
]
SELF_TEST = loop_test(policy_of(small_policy()))
WORDS_OF_COLUMNS = (
    "q1=pos1:counts/8192 q2=pos2-pos1:deg time=t:ms u1=8*goal1-8*pos1-0.3*vel1 u2=-u1:A*0.7 q1=atan2(s1,c1)"
)
WORDS_OF_PLANTS = [
    "m1=0.5 l1=0.2 m2=0.6 l2=0.3 motor=1 gr=6 Ic1=0.01",
    "m1r1+m2l1=0.2 m2r2=0.1 I1+m2l1^2=0.05 I2=0.02 l1=0.2 g=9.81 tl1=0 b1=0.1 zero1=0.02",
    "theta1=0.1 theta2=0.03 theta3=0.02 theta4=1.2 theta5=0.5 l1=0.2 tl2=1",
]
TABLES = [
    "%time,field.header.stamp,field.name0,field.name1,field.position0,field.position1,field.velocity0,field.effort0\n"
    + "".join(f"{17 * 10**17 + 2 * 10**7 * k},0,elbow,shoulder,{np.sin(k / 9):g},0.1,0,0\n" for k in range(60)),
    "# rig\nt [ms];q1 [deg];q2 [deg];goal1;goal2;i1 [A]\n"
    + "".join(
        f"{20 * k};{np.sin(k / 9):.4f};{np.cos(k / 7):.4f};0,5;0,25;{k % 7}\n".replace(".", ",") for k in range(60)
    ),
    "time pos1 pos2 s1 c1 x\n"
    + "".join(f"{k / 50:g} {k} {-k} {np.sin(k):g} {np.cos(k):g} {'OK' * (k % 2)}\n" for k in range(60)),
]
MODELS = [*(model_text(suffix, "x", PLANT | {"Ir": 0.001, "gr": 6.0}) for suffix in (".urdf", ".xml")), SHAPES]


def run_policy(path):
    """A policy that is accepted gives finite torques, and has a header in C."""
    found = read_pendulum_policy(path)
    try:
        controller = numpy_controller(found)
    except SwingupError as error:
        raise AssertionError(f"read, then refused: {error}") from error
    torques = [controller(np.array([0.1 * k, 0.2, 300.0, -0.1]), 0.002 * k) for k in range(3)]
    assert np.isfinite(torques).all(), f"torques {torques}"
    if found.network.activation == "relu":
        assert not {"inff", "nanf"} & set(re.findall("[a-z]+", c_header(found)))


def run_law(path):
    """A law that is accepted gives finite torques, and has a header in C."""
    found = read_feedback(path)
    controller = policy_controller(found)
    torques = [controller(np.array([0.1 * k, 0.2, 300.0, -0.1]), 0.002 * k) for k in range(3)]
    assert np.isfinite(torques).all(), f"torques {torques}"
    assert not {"inff", "nanf"} & set(re.findall("[a-z]+", c_header(found)))


def compare(path):
    """A self-test that is read compares answers."""
    controller = policy_controller(policy_of(small_policy()))
    test = read_test(Path(path).parent)
    test.check(lambda x, call: controller(x, test.period * call))


def map_columns(path):
    """Words of an option."""
    words = Path(path).read_text(encoding="utf-8", errors="replace").split()
    Path(path + ".csv").write_text(TABLES[-1], encoding="utf-8")
    read_recording(path + ".csv", columns=words)


def set_plant(path):
    """Words of an option."""
    words = Path(path).read_text(encoding="utf-8", errors="replace").split()
    for source in (None, "C.1"):
        measured_plant(source, named_values("--set", words, "m1=0.5"))


def use_domain(path):
    """A domain that is accepted draws plants, or refuses them."""
    domain = resolve(domain=path)
    assert domain.depth < 100_000
    assert domain.substeps <= 10_000
    assert domain.effects


def import_model(path):
    """A model file that makes a plant can be written, or is refused."""
    found = measured_plant(path, {"l2": 0.3, "tl1": 1.0, "tl2": 1.0}, "centre")
    assert all(note.isprintable() for note in found.notes)
    save_and_load(path, found.plant)


def save_and_load(path, plant):
    """A plant's file that is written is read as well."""
    for suffix in (".urdf", ".xml"):
        try:
            save_plant(path + suffix, plant)
        except SwingupError:
            continue
        try:
            load_plant(path + suffix)
        except SwingupError as error:
            raise AssertionError(f"written, then refused: {error}") from error


def use_plant(path):
    """A plant that is accepted has units, an LQR and files, or each refuses it."""
    plant = load_plant(path)
    save_and_load(path, plant)
    for robot in ROBOTS.values():
        with contextlib.suppress(SwingupError):
            get_controller("lqr", robot, plant=plant)
        with contextlib.suppress(SwingupError):
            get_controller("adaptive", robot, plant=plant)


def resume(path):
    """A checkpoint's actions are compared with those of the environment."""
    check_actions(read_metadata(path).get("actions"), Space((1,), "float32", low=[-1.0], high=[1.0]))


def score_log(path, board):
    score(load_trajectory(path), "acrobot", board)


COLUMNS = ["q2=q2-q1", "u1=0", "q1=q1+pi:deg", "q1=2:counts/1000", "time=t:ms", "u1=u2:A*0.7", "q1=-#3", "q1:"]
"""Words that map columns, good ones and others."""
LOGS = [
    *(functools.partial(read_recording, columns=COLUMNS[k : k + 2]) for k in range(0, len(COLUMNS), 2)),
    read_recording, load_trajectory,
]  # fmt: skip
MAPPED = [
    "q1=field.position1 q2=field.position0 u2=field.effort0", "u1=0 u2=i1:A*0.5",
    "q1=pos1:counts/8192 q2=atan2(s1,c1) u1=8*s1-8*pos1 u2=0",
]  # fmt: skip
"""Of each table."""
TABLE_READERS = [functools.partial(read_recording, columns=words.split()) for words in MAPPED]
ON_BOARDS = [functools.partial(score_log, board=board) for board in BOARDS]


def of(*texts):
    """A kind of text."""
    return functools.partial(spoilt_text, texts=texts)


def of_arrays(*goods):
    """A kind of file of arrays."""
    return lambda draw: spoilt_arrays(draw, draw.choice(goods))


def log_by(save):
    return functools.partial(spoilt_log, save=save)


@functools.cache
def bag():
    """The bytes of a bag."""
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    with tempfile.TemporaryDirectory() as folder:
        write_bag(Path(folder) / "run", np.column_stack([TIME, LOG["q"], LOG["dq"], LOG["u"]]))
        return (Path(folder) / "run" / "run.mcap").read_bytes()


BAG_COLUMNS = "q1=position.shoulder q2=position.elbow u1=effort_commands0 u2=effort_commands1"
KINDS = {
    "map.yml": (of(*MAPS), [load_plant, use_domain, use_plant]),
    "table.csv": (of(*TABLES), [*TABLE_READERS, read_recording]),
    "run.mcap": (
        lambda draw: damaged(draw, bag()),
        [functools.partial(read_recording, columns=BAG_COLUMNS.split())],
    ),
    "columns.txt": (of(WORDS_OF_COLUMNS), [map_columns]),
    "plant.txt": (of(*WORDS_OF_PLANTS), [set_plant]),
    "self_test.json": (of(SELF_TEST.to_json()), [compare]),
    "law.safetensors": (of_arrays(*LAWS), [run_law]),
    "run.csv": (of(*TRAJECTORIES), [*ON_BOARDS, *LOGS]),
    "run.npz": (log_by(lambda stream, arrays: np.savez(stream, **arrays)), LOGS),
    "run.mat": (log_by(lambda stream, arrays: savemat(stream, {"log": arrays, "n": 1})), LOGS),
    "policy.safetensors": (of_arrays(*POLICIES), [run_policy, run_policy, read_network]),
    "reference.safetensors": (of_arrays(written(save_reference, REFERENCE, {})), [load_reference]),
    "checkpoint.safetensors": (
        of_arrays(written(save_checkpoint, LIKE, {"frames": 1024, "best": [0.1, None], "actions": {"low": -1}})),
        [lambda path: load_checkpoint(path, LIKE), read_metadata, resume],
    ),
    "config.json": (of(json.dumps(CONFIG, indent=1)), [lambda path: read_run_settings(Path(path).parent)]),
    "metrics.jsonl": (
        of("".join(json.dumps(ROW | {"frames": 1024 * k}) + "\n" for k in range(1, 6))),
        [read_metrics, lambda path: curves_figure({"a": read_metrics(path)})],
    ),
    "robustness.json": (of(json.dumps(ROBUSTNESS)), [lambda path: robustness_figure({"a": read_robustness(path)})]),
    "model.xml": (of(*MODELS), [load_plant, import_model, import_model]),
}
"""By file: how it is spoilt, and what reads it."""

MAX_MESSAGE_LENGTH = 2000
MAX_READ_TIME = 20.0
"""s of the processor's time: others may be busy."""


class Overtime(BaseException):
    """A read took too long."""


def stop(*_):
    raise Overtime


def fault_of(read, path):
    """What is wrong with how a read ended; None if nothing is."""
    try:
        read(str(path))
    except SwingupError as error:
        text = str(error)
        is_line = text.isprintable() and len(text) <= MAX_MESSAGE_LENGTH
        return None if is_line else f"a message that is no line: {text!r:.200}"
    except Overtime:
        return "too slow"
    except Exception as error:  # a traceback, which is what is looked for
        return f"{type(error).__name__}: {error!s:.200}"
    return None


def campaign(seed, reads, folder, file):
    """Read spoilt files of a kind; gives faults with their files, which stay."""
    draw, faults, (make, readers) = random.Random(seed), [], KINDS[file]
    before = signal.signal(signal.SIGPROF, stop)
    for number in range(reads):
        data, path = make(draw), folder / file
        path.write_bytes(data)
        read = draw.choice(readers)
        signal.setitimer(signal.ITIMER_PROF, MAX_READ_TIME)
        fault = fault_of(read, path)
        signal.setitimer(signal.ITIMER_PROF, 0)
        if fault is not None:
            kept = folder / f"fault-{number}-{file}"
            kept.write_bytes(data)
            faults.append(f"read {number} of seed {seed}: {fault} ({kept})")
    signal.signal(signal.SIGPROF, before)
    return faults


SEEDS = [int(seed) for seed in os.environ.get("SWINGUP_FUZZ_SEEDS", "0").split(",")]


@pytest.mark.parametrize("file", KINDS)
def test_some_reads_of_a_kind(tmp_path, file):
    assert campaign(1, 12, tmp_path, file) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("file", KINDS)
def test_many_reads_of_a_kind(tmp_path, file, seed):
    assert campaign(seed, 20_000, tmp_path, file) == []
