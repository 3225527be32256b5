"""Spoilt files of every kind that the package reads, from good ones: bytes, drawn from a seeded generator."""

import io
import json
import re
from functools import partial

import jax.numpy as jnp
import numpy as np
from scipy.io import savemat

from swingup.benchmark.robustness_board import CRITERIA
from swingup.learner.run_settings import make_run_settings
from swingup.plant.files import load_plant, model_text

from .mutations import EXTREMES, LINES, damage, mutate, several, spoilt_arrays

PLANT = {name: float(value) for name, value in load_plant("C.1").values().items()}
LOOP = ("torque_limit", "passive_limit", "delay", "velocity_noise", "torque_noise", "response", "rate_limit")

VALUES = [
    "1", "-1", "0", ".nan", ".inf", "1e999", "1_000", "0x10", "0x_", "0b_", "1:30", "190:20:30.15", "2001-99-99",
    "2001-01-01", "!!int x", "!!float '_'", "!!timestamp x", "!!python/name:os.system", "!!binary x", "!!set {a}",
    "!!python/object/apply:os.getcwd []", "!!omap [a: 1]", "!custom 5", "[1, 2]", "[2, 1]", "[1]", "[]", "{}",
    "{a: 1}", "[.nan, 1]", "['1', '2']", "true", "~", "''", '"\\x00"', '"\\ud800"', "*a", "&a 1", "&a [*a]", "- 1",
    "9" * 5000, "1e-320", "[[1, 2], [3, 4]]", "|\n  block", "? a", "=", "<<", "@x", "`", "%", "[1", "{", "'",
    "[1e8, 2e8]", "[" * 1500, "[" * 400 + "]" * 400,
]  # fmt: skip
KEYS = [
    "1: 2", "~: 1", "[a]: 1", "{a: 1}: 2", "true: 1", "2001-01-01: 3", '"m1\\n": 1', "*x : 1", ".nan: 3",
    "<<: {m1: 1}", "<<: [1]", "<<: &b {<<: *b}", "!!int x: 1", "? |\n  long\n: 2", "a: b: c", "---", "...",
    "%YAML 3.0", "\t", "m1: 1",
]  # fmt: skip


def yaml_map(random):
    """A file of parameters, or with some names of a loop a domain."""
    base = PLANT if random.random() < 0.4 else dict.fromkeys(random.sample(LOOP, 3), 0.1)
    lines = [f"{name}: {value}" for name, value in base.items()]
    for _ in range(random.choice([1, 1, 2])):
        kind = random.random()
        if kind < 0.6:
            name = random.choice([*base, *PLANT, *LOOP])
            lines = [line for line in lines if not line.startswith(f"{name}:")]
            lines.append(f"{name}: {random.choice(VALUES)}")
        elif kind < 0.8:
            lines.insert(random.randrange(len(lines) + 1), random.choice(KEYS))
        elif kind < 0.9:
            depth = random.choice([3, 6, 9])
            lines += ["a0: &a0 [u, u, u, u, u, u, u, u, u]"]
            lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, depth)]
            lines.append(f"m1: *a{depth - 1}")
        else:
            lines = random.choice([[], ["[]"], ["5"], lines + lines, ["!!set {m1}"], ["!!str {a: 1}"], ["- 1"]])
    data = "\n".join(lines).encode("utf-8", "surrogatepass") + b"\n"
    return damage(random, data) if random.random() < 0.1 else data


CELLS = [
    "nan", "inf", "-inf", "1e400", "", "abc", "1,5", "1_000", "１２", "0x10", "1e9", "1e10", "-0", "1d5", "--1",
    "1 2", '"', '"' + "1" * 200_000, "\u22121", "'1'", "=1+1", "None", "1e-400", "9" * 5000, "\x00", "1\t2", "½",
    "true",
]  # fmt: skip
TITLES = [
    "", "time", "Time", "t", "pos1", "tau1", "#time", "time[ms]", "time (s)", "pos_meas1[deg]",
    "vel_meas1 [rpm]", "[time]", " pos_meas1 ", '"time"', "x" * 100_000, "1", "nan", "time[", "\u00a0time",
    "time[" + "[" * 5000,
]  # fmt: skip
TIMES = [
    lambda k: 0.0, lambda k: -k, lambda k: 1e-9 * k, lambda k: 1e8 + k, lambda k: k**3, lambda k: k - 1e6,
    lambda k: k / 500, lambda k: 1.76e9 + k / 500, lambda k: round(k / 250, 2), lambda k: 5e-324 * k,
    lambda k: (k % 20) / 500,
]  # fmt: skip
HEADER = "time,pos_meas1,pos_meas2,vel_meas1,vel_meas2,tau_con1,tau_con2"


def trajectory(random):
    count = random.choice([0, 1, 2, 3, 10, 60])
    titles, rows = HEADER.split(","), [[f"{0.2 * k:g}", "0.1", "0", "0", "0.5", "0", "1"] for k in range(count)]
    for _ in range(random.choice([1, 1, 2, 3])):
        kind = random.choice(["cell", "cell", "title", "time", "row", "twice", "order", "swap", "still", "motion"])
        if kind == "cell" and rows:
            row = random.choice(rows)
            row[random.randrange(len(row))] = random.choice(CELLS)
        if kind == "title":
            titles[random.randrange(len(titles))] = random.choice(TITLES)
        if kind == "time":
            time = random.choice(TIMES)
            rows = [[repr(float(time(k))), *row[1:]] for k, row in enumerate(rows)]
        if kind == "row" and rows:
            place = random.randrange(len(rows))
            row = rows[place]
            rows[place] = random.choice([[*row, "1"], row[:-1] or ["1"], [""], [*row, "", ""]])
        if kind == "twice":
            titles, rows = [*titles, random.choice(titles)], [[*row, "5"] for row in rows]
        if kind == "order":
            random.shuffle(rows)
        if kind == "swap":
            random.shuffle(titles)
        if kind == "still":  # few different rows
            rows = [[row[0], *rows[k % 3][1:]] for k, row in enumerate(rows)]
        if kind == "motion":  # of which a column is perhaps in another unit
            columns = np.random.default_rng(random.randrange(1 << 30)).normal(size=(len(rows), 6)).cumsum(axis=0)
            columns[:, random.randrange(6)] *= random.choice([1, 1, 1e-320, 1e-9, 0.5, 57.3, 651.9, 1000.0, 1e150])
            rows = [[row[0], *map(str, drawn)] for row, drawn in zip(rows, columns, strict=True)]
    end = random.choice(["\n"] * 6 + ["\r\n", "\r", "\n\n", "\u2028", "\x0b"])
    comma, point = random.choice([",."] * 14 + [";,", ";.", "\t.", " .", ('","', ".")])
    lines = [comma.join(cell.replace(".", point) for cell in row) for row in [titles, *rows]]
    text = end.join(random.choice([[]] * 14 + [["# a comment"], ["sep=;"], [""]]) + lines)
    data = text.encode(random.choice(["utf-8"] * 9 + ["utf-8-sig", "utf-16", "utf-32"]), "replace")
    return damage(random, data) if random.random() < 0.15 else data


TIME = np.arange(0.0, 2.0, 0.01)
LOG = {
    "t": TIME,
    "q": np.column_stack([np.sin(3 * TIME), np.cos(2 * TIME)]),
    "dq": np.column_stack([3 * np.cos(3 * TIME), -2 * np.sin(2 * TIME)]),
    "u": np.column_stack([TIME, TIME]),
}
ARRAYS = [
    lambda random, array: array * random.choice([1e-300, 1e9, np.pi, 0.0]),
    lambda random, array: array[: random.randrange(len(array))],
    lambda random, array: array[::-1],
    lambda random, array: array.reshape(-1, 1, 1),
    lambda random, array: (
        np.where(np.arange(len(array)) % 7 == 3, random.choice([np.nan, np.inf, 1e300]), array.T).T
    ),
    lambda random, array: array.astype(random.choice(["i4", "f4", "c16", "U8", "?"])),
]


def log(random, save):
    """A log of arrays, as a writer saves it."""
    arrays = dict(LOG)
    for name in random.sample(list(LOG), random.choice([0, 1, 2])):
        arrays[name] = random.choice(ARRAYS)(random, arrays[name])
    save(stream := io.BytesIO(), random.choice([arrays, arrays, {"x": arrays["q"]}]))
    return damage(random, stream.getvalue()) if random.random() < 0.5 else stream.getvalue()


PARTS = {
    "estimator": (["dt", "velocity_noise", "acceleration_noise", "max_delay_steps", "longest_delay"], [1e-6, 1000]),
    "guard": (["dt", "angle_limit", "velocity_limit", "longest_gap", "torque_rate", "braking"], [None, 1000]),
    "plant": ([*PLANT, "name"], []),
    "identifier": (["passive_limit"], [{"rotor": 1}]),
    "regulator": (
        ["enter", "leave", "enter_coulomb", "leave_coulomb"],
        [[1.0, 1.0, 0.1, 0.1], [1e9, 1, 1, 1], 100],
    ),
}
"""Settings of a policy's parts, and values in their places beside the extreme ones."""


def policy(random):
    draw = np.random.default_rng(random.randrange(1 << 30)).normal
    metadata = {
        "format": "swingup policy", "format_version": 1, "robot": "acrobot", "torque_limit": 6.0, "seed": 0,
        "observation": [{"name": "pendulum", "angles": "wrapped", "velocity_scale": 20.0}],
        "command": "swingup train acrobot", "scores": {"v2": {"score": 0.1}},
    }  # fmt: skip
    arrays = {
        "network.trunk.0.weight": draw(size=(8, 4)), "network.trunk.0.bias": np.zeros(8),
        "network.mean.weight": draw(size=(1, 8)), "network.mean.bias": np.zeros(1),
    }  # fmt: skip
    arrays = {name: array.astype("f4") for name, array in arrays.items()}
    if random.random() < 0.3:
        metadata["observation"].append({"name": "normalise", "clip": 10.0, "epsilon": 1e-8})
        arrays |= {"observation.1.mean": np.zeros(4), "observation.1.variance": np.ones(4)}
    for part, (names, values) in PARTS.items():
        if random.random() < 0.3:
            metadata[part] = {random.choice([*names, "x"]): random.choice([*EXTREMES, *values])}
    if "plant" in metadata:
        metadata["plant"] = PLANT | metadata["plant"]
    if "identifier" in metadata:
        metadata.setdefault("estimator", {})
    return file_of(random, metadata, arrays)


def file_of(random, metadata, arrays):
    if random.random() < 0.5:
        metadata = several(random, mutate, metadata)
    return spoilt_arrays(random, json.dumps(metadata), arrays)


REFERENCE = (
    {"format": "swingup trajectory", "format_version": 1, "robot": "acrobot", "dt": 0.002, "seed": 0},
    {"states": np.zeros((20, 4)), "gains": np.zeros((20, 4)), "torque": np.zeros(20)},
)
"""A swing-up to follow: its metadata and arrays."""
LIKE = {"weights": jnp.zeros((4, 3)), "step": jnp.zeros((), int)}
"""What a checkpoint is read like."""
CHECKPOINT = (
    {"format": "swingup checkpoint", "format_version": 1, "frames": 1024, "best": [0.1, None], "seconds": 3.5},
    {name: np.asarray(array) for name, array in LIKE.items()},
)
"""A state of training."""


def json_text(random, value):
    """A JSON value with something else in it, or another text."""
    if random.random() < 0.1:
        return random.choice(LINES).encode("utf-8", "surrogatepass")
    text = json.dumps(several(random, mutate, value))
    if random.random() < 0.1:
        text = text.replace("0.", random.choice(["Infinity", "NaN", "1e999", "9" * 5000, '"', "0x"]), 1)
    data = text.encode("utf-8", "surrogatepass")
    return damage(random, data) if random.random() < 0.1 else data


ROW = {"seed": 0, "frames": 1024, "reward": 0.5, "score": 0.1, "best_score": 0.2, "entropy": -1.5, "seconds": 2.0}


def metrics(random):
    rows = [json.dumps(ROW | {"frames": 1024 * k}).encode() for k in range(1, 6)]
    rows[random.randrange(len(rows))] = json_text(random, ROW)
    data = b"\n".join(rows) + b"\n"
    return damage(random, data) if random.random() < 0.1 else data


ROBUSTNESS = {
    "robot": "acrobot", "controller": "x", "board": "robustness", "seed": 0, "seeds": [0, 1], "score": 0.5,
    "intervals": {"velocity_noise": [1, 2], "score": [0.1, 0.2]}, "details": [], **dict.fromkeys(CRITERIA, 50.0),
}  # fmt: skip
SETTINGS = make_run_settings("acrobot", "default", checkpoint_every=65_536)
CONFIG = {"version": "0.1.0", "frames": 10_000, **SETTINGS.as_dict()}
SHAPES = """<mujoco><compiler eulerseq="zyx"/><option><flag contact="disable"/></option>
<default><default class="a"><geom type="box" size=".02 .03 .1" density="800"/><joint axis="0 0 1" damping=".1"/>
</default></default><worldbody><body name="b0" euler="0 90 0"><body name="L1" childclass="a" axisangle="0 0 1 20">
<joint name="j1"/><geom pos=".1 0 0" zaxis="1 0 0"/><frame quat="1 1 0 0" pos=".25 0 0">
<body name="L2" xyaxes="1 0 0 0 0 -1"><joint name="j2" ref="9" range="-3 3" armature=".01" frictionloss=".1"/>
<geom type="capsule" class="main" fromto="0 0 0 .3 0 0" size=".01"/><body name="t" pos=".3 0 0">
<inertial pos="0 0 0" mass=".1" fullinertia=".1 .1 .1 0 0 0"/></body></body></frame></body></body></worldbody>
<actuator><motor joint="j1" gear="2" ctrlrange="-1 1"/>
<general joint="j2" gainprm="3" ctrlrange="-2 1" forcerange="-1 1"/></actuator></mujoco>"""
MODELS = [*(model_text(suffix, "x", PLANT | {"Ir": 0.001, "gr": 6.0}) for suffix in (".urdf", ".xml")), SHAPES]
WORDS = [
    "", "0", "-1", "nan", "inf", "1e400", "1e-320", "1e8", "0 0", "0 0 0", "1 0 0 0", "1,2", "x", "9" * 5000,
    "true", "false", "&amp;", "base", "link1", "free", "slide", "mesh", "global", "radian", "XyZ", "0 0 0 0 0 0",
    "\u202e", "１",
]  # fmt: skip
PIECES = [
    "<joint/>", "<link/>", "<body/>", "<body><joint/></body>", "<geom/>", "<frame/>", "<inertial/>", "<inertia/>",
    "<include file='/etc/passwd'/>", "<equality><weld/></equality>", "<default><default/></default>", "<mass/>",
    "<mimic joint='joint1'/>", "<replicate count='99999999'/>", "&a;", "<site/>", "<motor/>", "<!-- -- -->",
    "<transmission><joint/></transmission>", "<swingup data='1 1 1 1 1'/>", "<xacro:if/>", "</robot>",
    "<![CDATA[x]]>", "<?x y?>", "<a " + "".join(f"a{k}='' " for k in range(900)) + "/>", "<b>" * 100,
    "<b>" * 50 + "</b>" * 50,
]  # fmt: skip
HEADS = [
    '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>',
    '<!DOCTYPE r SYSTEM "file:///etc/passwd">', '<!DOCTYPE r [<!ENTITY a SYSTEM "/dev/zero">]>',
    "<?xml version='1.1'?>", "<?xml version='1.0' encoding='utf-7'?>", "<?xml version='1.0' encoding='idna'?>",
    "<?xml version='1.0' encoding='utf-16'?>", "\ufeff", "<!--", "<a/>",
]  # fmt: skip


def model(random):
    text = random.choice(MODELS)
    for _ in range(random.choice([1, 1, 2, 4])):
        kind, values = random.random(), [*re.finditer(r'"[^"]*"', text)]
        elements = [*re.finditer(r"<[^>]*/>", text)]
        if kind < 0.6 and values:
            found = random.choice(values)
            text = f'{text[: found.start()]}"{random.choice(WORDS)}"{text[found.end() :]}'
        elif kind < 0.7 and elements:
            found = random.choice(elements)
            text = text[: found.start()] + text[found.end() :] * random.choice([1, 1, 2])
        elif kind < 0.9 and elements:
            place = random.choice(elements).start()
            piece = random.choice([*PIECES, *(each.group() for each in elements)])
            text = text[:place] + piece + text[place:]
        elif kind < 0.95:
            text = random.choice(HEADS) + text
        else:
            names = [*re.finditer(r"[a-z]+(?==)", text)] or [re.match("", text)]
            found, other = random.choice(names), random.choice(names)
            text = text[: found.start()] + other.group() + text[found.end() :]
    data = text.encode("utf-8", "surrogatepass")
    return damage(random, data) if random.random() < 0.1 else data


KINDS = {
    "yaml": (yaml_map, "map.yml"),
    "trajectory": (trajectory, "run.csv"),
    "npz": (partial(log, save=lambda stream, arrays: np.savez(stream, **arrays)), "run.npz"),
    "mat": (partial(log, save=lambda to, a: savemat(to, {"log": a, "n": 1}, do_compression="q" in a)), "run.mat"),
    "policy": (policy, "policy.safetensors"),
    "reference": (lambda random: file_of(random, *REFERENCE), "reference.safetensors"),
    "checkpoint": (lambda random: file_of(random, *CHECKPOINT), "checkpoint.safetensors"),
    "config": (partial(json_text, value=CONFIG), "config.json"),
    "metrics": (metrics, "metrics.jsonl"),
    "robustness": (partial(json_text, value=ROBUSTNESS), "robustness.json"),
    "model": (model, "model.xml"),
}
"""How files of each kind are made, and what they are called."""
