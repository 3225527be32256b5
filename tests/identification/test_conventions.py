"""Logs as people have them: each is refused with the option that makes it the same log again, or read as it is."""

import re
import shlex
import struct
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import savemat
from synthetic import HEADER, TRUTH, simulate, write

from bags import write_bag
from refusals import refusal
from swingup.common import array_files
from swingup.common.columns import parse_columns
from swingup.common.table import read_table
from swingup.identification.conventions import check_columns, find_columns
from swingup.identification.prediction import integration_of, vector_of
from swingup.identification.recording import read_recording
from swingup.plant.files import load_plant

NAMES = HEADER.split(",")
SETTING, START = integration_of(TRUTH), vector_of(load_plant("C.1"))
TURN, PI = 2 * np.pi, np.pi
SHORT = ("t", "q1", "q2", "d1", "d2", "u1", "u2")


@pytest.fixture(scope="module")
def table():
    return simulate(4.0)


def changed(table, change):
    """The table with some columns computed from the others."""
    columns = dict(zip(SHORT, table.T, strict=True))
    return np.column_stack(list((columns | change(SimpleNamespace(**columns))).values()))


def each(name, function):
    """A change of both columns: angles q, rates d or torques u."""
    return lambda c: {f"{name}{joint}": function(getattr(c, f"{name}{joint}")) for joint in (1, 2)}


def wrapped(angle):
    return np.angle(np.exp(1j * angle))


ABSOLUTE, SWAPPED = "q2=pos_meas2-pos_meas1 dq2=vel_meas2-vel_meas1", "u1=tau_con2 u2=tau_con1"
CONVENTIONS = {
    "reversed": (lambda c: {"q2": -c.q2, "d2": -c.d2}, "q2=-pos_meas2 dq2=-vel_meas2"),
    "absolute, up": (lambda c: {"q1": c.q1 - PI, "q2": c.q1 + c.q2 - PI, "d2": c.d1 + c.d2},
                     f"q1=pos_meas1+pi {ABSOLUTE}"),
    "counts": (each("q", lambda q: np.round(q * 4096 / TURN)), "q1=pos_meas1:counts/4096 q2=pos_meas2:counts/4096"),
    "mN m": (each("u", lambda u: 1000 * u), "u1=tau_con1:mNm u2=tau_con2:mNm"),
    "milliseconds": (lambda c: {"t": np.round(1000 * c.t)}, "time=time:ms"),
    "torques swapped": (lambda c: {"u1": c.u2, "u2": c.u1}, SWAPPED),
    "velocities swapped": (lambda c: {"d1": c.d2, "d2": c.d1}, "dq1=vel_meas2 dq2=vel_meas1"),
    "one in mN m": (lambda c: {"u2": 1000 * c.u2}, "u2=tau_con2:mNm"),
    "horizontal": (lambda c: {"q1": c.q1 - PI / 2}, "q1=pos_meas1+pi/2"),
    "up in degrees": (lambda c: {"q1": np.degrees(c.q1) - 180, "q2": np.degrees(c.q2)},
                      "q1=pos_meas1+180:deg q2=pos_meas2:deg"),
    "joints swapped": (lambda c: dict(zip(SHORT[1:], (c.q2, c.q1, c.d2, c.d1, c.u2, c.u1), strict=True)),
                       f"q1=pos_meas2 q2=pos_meas1 dq1=vel_meas2 dq2=vel_meas1 {SWAPPED}"),
    "oz in": (each("u", lambda u: u / 0.00706155), "u1=tau_con1:ozin u2=tau_con2:ozin"),
    "deg/s beside rad": (each("d", np.degrees), "dq1=vel_meas1:deg/s dq2=vel_meas2:deg/s"),
    "counts that wrap": (each("q", lambda q: np.round(q * 8192 / TURN) % 8192),
                         "q1=pos_meas1:counts/8192 q2=pos_meas2:counts/8192"),
    "angles of the motors": (each("q", lambda q: 6 * q), "q1=pos_meas1:rad*0.166667 q2=pos_meas2:rad*0.166667"),
    "absolute, up, wrapped": (lambda c: {"q1": wrapped(c.q1 - PI), "q2": wrapped(c.q1 + c.q2 - PI),
                                         "d2": c.d1 + c.d2}, f"q1=pos_meas1+pi {ABSOLUTE}"),
}  # fmt: skip
"""What was done to a log, and the words that undo it; the first is not slow, since it needs no pairs."""


@pytest.mark.parametrize(
    "name", [*[*CONVENTIONS][:1], *(pytest.param(name, marks=pytest.mark.slow) for name in [*CONVENTIONS][1:])]
)
def test_the_option_makes_it_the_same_log(tmp_path, table, name):
    path, table, (change, words) = tmp_path / "log.csv", table[:1300], CONVENTIONS[name]  # 3 s
    np.savetxt(path, changed(table, change), delimiter=",", header=HEADER, comments="", fmt="%.20g")
    message = refusal(read_checked, path)
    if "seconds" not in name:  # all but times that no log can have can be forced, with a note
        assert len(check_columns(read_recording(path), SETTING, START, force=True)) == 1
    found = shlex.split(message.split("--columns ")[1].split(", or take")[0])
    assert found == words.split()
    again = read_checked(path, found)
    assert_same(again, read_recording(write(tmp_path / "right.csv", table)))


def read_checked(path, columns=()):
    recording = read_recording(path, columns=columns)
    check_columns(recording, SETTING, START)
    return recording


def assert_same(found, right, steps=2e-3):
    """Equal logs, but for whole turns and encoders' steps."""
    np.testing.assert_allclose(np.exp(1j * found.q), np.exp(1j * right.q), atol=steps)
    np.testing.assert_allclose(found.u, right.u, atol=1e-9)
    np.testing.assert_allclose(found.time, right.time, atol=1e-6)


@pytest.fixture
def found_in(tmp_path):
    """The convention that a table has instead of ours."""
    return lambda *given: find_columns(read_recording(write(tmp_path / "log.csv", *given)), SETTING, START)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_right_log_is_taken_as_it_is_and_noise_is_no_convention(found_in, table, noise):
    drawn = np.random.default_rng(0).normal(0.0, noise, (2, len(table)))
    assert found_in(changed(table, lambda c: {"q1": c.q1 + drawn[0], "q2": c.q2 + drawn[1]})) is None


def test_units_without_a_name_wrong_titles_and_torques_that_are_left_out(found_in, table):
    found = found_in(changed(table, each("u", lambda u: u / 0.06)))
    assert "a unit of 0.05" in found.text
    sizes = [float(word.partition(":Nm*")[2]) for word in found.remedy]
    assert sizes == pytest.approx([0.06, 0.06], rel=0.1)  # the masses are some percent from those of C.1
    found = found_in(table, HEADER.replace("vel_meas1,vel_meas2", "vel_meas1 [rpm],vel_meas2 [rpm]"))
    assert found.remedy == ("dq1=vel_meas1:rad/s", "dq2=vel_meas2:rad/s")
    assert "torques that are not in the log act" in found_in(table[:, :5], ",".join(NAMES[:5])).text  # no free fall


def as_text(separator=",", decimal=".", names=NAMES, above=(), below=(), encoding="utf-8"):
    def save(path, table):
        rows = [separator.join(f"{each:.12g}" for each in row).replace(".", decimal) for row in table]
        text = "\n".join([*above, separator.join(names), *below, *rows])
        path.with_suffix(".csv").write_bytes(text.encode(encoding))
        return path.with_suffix(".csv")

    return save


def edited(save, change):
    """A text whose lines are changed."""

    def changed(path, table):
        text = save(path, table)
        text.write_text("\n".join(change(text.read_text().split("\n"))))
        return text

    return changed


def as_npz(path, table):
    np.savez(path, t=table[:, 0], q=table[:, 1:3], dq=table[:, 3:5], u=table[:, 5:].T)
    return path.with_suffix(".npz")


def with_stamps(path, table):
    """ROS's times, from a clock that is not at 0."""
    second, rest = np.divmod(table[:, 0] + 7.9, 1)
    table = np.column_stack([second, np.round(1e9 * rest), table[:, 1:]])
    return as_text(names=["sec", "nanosec", *NAMES[1:]])(path, table)


def as_joint_states(path, table):
    """As rostopic writes ROS's joint states, sorted by name; times are nanoseconds since 1970."""
    titles = [f"field.{name}{k}" for name in ("name", "position", "velocity", "effort") for k in (0, 1)]
    rows = [
        f"{round(1e9 * row[0]) + 1764 * 10**15},elbow,shoulder,"
        + ",".join(f"{each:.12g}" for each in row[[2, 1, 4, 3, 6, 5]])
        for row in table
    ]
    path.with_suffix(".csv").write_text("\n".join([",".join(["%time", *titles]), *rows]))
    return path.with_suffix(".csv")


def with_tags(path, table):
    """As a camera writes angles."""
    angles = [function(each) for each in (table[:, 1], table[:, 2]) for function in (np.sin, np.cos)]
    names = ["time", "tag0_sin", "tag0_cos", "tag1_sin", "tag1_cos", *NAMES[3:]]
    return as_text(names=names)(path, np.column_stack([table[:, 0], *angles, table[:, 3:]]))


def with_duty(path, table):
    """A motor's duty, which says nothing of the joint."""
    return as_text(names=[*NAMES[:5], "duty"])(path, table[:, [0, 1, 2, 3, 4, 6]])


def as_mat(compressed, names=lambda q: {"q": q}):
    def save(path, table):
        log = {"t": table[:, :1], "u": table[:, 5:]} | names(table[:, 1:3])
        savemat(path.with_suffix(".mat"), {"log": log, "note": "mine", "n": 3}, do_compression=compressed)
        return path.with_suffix(".mat")

    return save


OTHERS = ["timestamp_ms", "theta1", "theta2", "omega1", "omega2", "motor_torque1", "motor_torque2"]
GERMAN = ["Zeit", "Winkel Schulter [rad]", "Winkel Ellbogen [rad]", "Drehzahl Schulter [rad/s]",
          "Drehzahl Ellbogen [rad/s]", "Drehmoment Schulter", "Drehmoment Ellbogen"]  # fmt: skip
FILES = {
    "semicolons": (as_text(";"), ""),
    "decimal commas": (as_text(";", ","), ""),
    "tabs and decimal commas": (as_text("\t", ",", encoding="utf-16"), ""),
    "comments": (as_text(above=["# robot: mine, blue", "% 500 Hz"]), ""),
    "quoted": (as_text(names=[f'"{name}"' for name in NAMES], encoding="utf-8-sig"), ""),
    "a row of units": (as_text(";", below=["s;rad;rad;-;rad/s;N·m;Nm"]), ""),
    "comments within": (edited(as_text(), lambda lines: [*lines[:70], "  # pause", '"# hot"', *lines[70:]]), ""),
    "quoted decimal commas": (
        edited(as_text(";", ","), lambda lines: ['"' + each.replace(";", '","') + '"' for each in lines]), ""
    ),
    "empty columns": (
        edited(as_text(names=[*NAMES, "tau_pert1", "tau_pert2"]),
               lambda lines: [lines[0], *(f"{each},," for each in lines[1:])]), ""
    ),
    "npz": (as_npz, ""),
    "mat, -v6": (as_mat(False), ""),
    "one name twice": (as_mat(True, lambda q: {"des": {"q": 0 * q}, "meas": {"q": q}}), "q1=meas.q1 q2=meas.q2"),
    "structures in an array": (
        as_mat(True, lambda q: {"joint": np.array([(q[:, :1],), (q[:, 1:],)], [("q", object)])}), "q1=1.q q2=2.q"
    ),
    "other names": (as_text(names=OTHERS), "time=timestamp_ms:ms q1=theta1 q2=theta2 dq1=omega1 dq2=omega2 "
                    "u1=motor_torque1 u2=motor_torque2"),
    "german": (as_text(";", ",", GERMAN, encoding="latin-1"), "time=Zeit|q1=Winkel Schulter|q2=Winkel Ellbogen|"
               "dq1=Drehzahl Schulter|dq2=Drehzahl Ellbogen|u1=Drehmoment Schulter|u2=Drehmoment Ellbogen"),
    "ROS": (with_stamps, "time=sec+nanosec*1e-09"),
    "numbers in brackets": (as_text(names=["t", "q[0]", "q[1]", "qd[0]", "qd[1]", "tau[0] (Nm)", "tau[1] (Nm)"]),
                            "q1=q[0] q2=q[1] dq1=qd[0] dq2=qd[1] u1=tau[0] u2=tau[1]"),
    "names in the rows": (as_joint_states, "q1=field.position1 q2=field.position0 dq1=field.velocity1 "
                          "dq2=field.velocity0 u1=field.effort1 u2=field.effort0"),
    "sines and cosines": (with_tags, "q1=atan2(tag0_sin,tag0_cos) q2=atan2(tag1_sin,tag1_cos)"),
    "torques of other names": (as_text(names=[*NAMES[:5], "torque1", "torque2"]), "u1=torque1 u2=torque2"),
    "one duty": (with_duty, "u1=0 u2=duty"),
    "one torque": (as_text(names=[*NAMES[:6], "none"]), "u1=tau_con1 u2=0"),
}  # fmt: skip
"""How a log is written, and the words that its refusal suggests, if it is refused."""


@pytest.mark.parametrize("name", FILES)
def test_files_of_other_programs(tmp_path, table, name):
    save, words = FILES[name]
    path, found = save(tmp_path / "log", table * ([1000, *6 * [1]] if "_ms" in words else 1)), []
    if words:
        message = refusal(read_recording, path)
        found = shlex.split(
            message.split("--columns ")[1].split(", if these")[0].split(" if joint")[0].split(" where")[0]
        )
        assert found == words.split("|" if "|" in words else " ")
    right = write(tmp_path / "right.csv", table * [*5 * [1], name != "one duty", name != "one torque"])
    assert_same(read_recording(path, columns=found), read_recording(right), steps=1e-9)


def test_the_rate_of_one_joint_alone_is_left_out(tmp_path, table):
    """The suggested words run as printed, and angles' differences are read; a torque of 0 would be one."""
    names = ["time", "theta1", "theta2", "omega2", "motor_torque1", "motor_torque2"]
    path = as_text(names=names)(tmp_path / "log", table[:, [0, 1, 2, 4, 5, 6]])
    words = shlex.split(refusal(read_recording, path).split("--columns ")[1].split(", if these")[0])
    assert words == ["q1=theta1", "q2=theta2", "u1=motor_torque1", "u2=motor_torque2"]
    assert read_recording(path, words).pairs == (("pos_meas1", "pos_meas2"), ("tau_con1", "tau_con2"))
    message = refusal(read_recording, path, [*words, "dq2=omega2"])
    assert message.endswith("maps dq2, which is not read: map dq1 as well, or leave it out if that joint has none")


def test_unpacked_arrays_have_one_bound_together(tmp_path, monkeypatch):
    """A compressed file may unpack to a thousand times its size, in one variable or in many."""
    monkeypatch.setattr(array_files, "LARGEST_ARRAYS", 200_000)
    columns = {name: np.zeros(10_000) for name in SHORT[:3]}  # 80 kB each
    savemat(tmp_path / "log.mat", columns, do_compression=True)
    np.savez_compressed(tmp_path / "log.npz", **columns)
    for ending in ("mat", "npz"):
        assert "it is another kind of file" in refusal(read_recording, tmp_path / f"log.{ending}")


MALFORMED = {
    "u1=tau_con1:A*0.7.1": "u1 in 'A*0.7.1': the units are N m,",
    "u1=tau_con1:N m*.": "u1 in 'N m*.': the units are N m,",
    "u1=tau_con1:A*1e999": "u1 in 'A*1e999': use a number from 1e-15 to 1e+21 in place of 1e999",
    "u1=tau_con1:A*0": "use a number from 1e-15",
    "q1=pos_meas1:counts/0": "q1 in 'counts/0': the units are rad,",
    "q1=pos_meas1*1e999": "q1 from 'pos_meas1*1e999': use a number from 0 to 1e+21",
    "q1=pos_meas1+1e999": "use a number from 0",
    "q1=pos_meas1*0.7.1": "it cannot be read behind 'pos_meas1*0.7'",
    "q1=pos_meas1+": "it cannot be read behind 'pos_meas1+'",
    "q1=8pos_meas1": "it cannot be read behind '8'",
    "q1=#0": "there is no column '#0'",
    "q1=pos_meas1+other": "there is no column 'other': its 7 columns are time, pos_meas1,",
    "q1=tan(pos_meas1)": "there is no function 'tan', but atan2,",
    "q1=atan2(pos_meas1)": "'atan2(pos_meas1)' needs 2 arguments",
    "q1=2*pos_meas1*(pos_meas2+1)": "'2*pos_meas1*(pos_meas2+1)' multiplies two columns",
    "q1=1/pos_meas1": "'1/pos_meas1' divides by something else than a number",
    "q1=pos_meas1^2": "'^2' is not part of an expression",
    "q1=pos_meas1**2": "'pos_meas1**2' is not a sum",
    "q1=" + "(" * 250 + "pos_meas1" + ")" * 40: "it",
    "q1=3.5": "it is a number",
    "angle=pos_meas1": "--columns maps 'angle', which nobody reads: the names are time, q1, q2,",
    "tau_pert1=vel_meas1+vel_meas2": "--columns maps tau_pert1, which is not read: map tau_pert2 as well",
    "q1=pos_meas1*1e20": "q1=pos_meas1*1e+20 reaches",
}
"""Words that map no column, and what is said of them."""


@pytest.mark.parametrize("word", MALFORMED)
def test_a_malformed_expression_is_named_at_its_place(tmp_path, table, word):
    assert MALFORMED[word] in refusal(read_recording, write(tmp_path / "log.csv", table[:200]), [word])


def test_an_expression_is_the_number_that_it_says(tmp_path, table):
    words = [
        "q1=-(pos_meas1 - 2*pos_meas2)/2 + pi/4:rad",
        "q2=pos_meas2",
        "time=20:ms",
        "dq1=clip(vel_meas1,-1,0.5)",
        "dq2=#5",
    ]
    found, rows = read_table(write(tmp_path / "log.csv", table[:50]), [(("time",),), (("pos_meas1", "pos_meas2"),),
                             (("vel_meas1", "vel_meas2"),)], columns=words), table[:50]  # fmt: skip
    np.testing.assert_allclose(found.values["pos_meas1"], PI / 4 - rows[:, 1] / 2 + rows[:, 2])
    np.testing.assert_allclose(found.values["vel_meas1"], np.clip(rows[:, 3], -1, 0.5))
    np.testing.assert_allclose(found.values["time"], 0.02 * np.arange(50))
    # What is said of a column is read again as the same.
    again = [column.word(name) for name, column in found.sources.items()]
    other = parse_columns("log.csv", again, NAMES)
    assert [column.word(name) for name, column in other.items()] == again


def test_goals_of_servos_are_a_law_whose_gains_the_starting_plant_tells(tmp_path, table):
    """u = 8 (goal - angle) - 0.3 velocity of joint 1, so that goal = angle + (u + 0.3 velocity) / 8."""
    gains = (np.array([8.0, 5.0]), np.array([0.3, 0.1]))
    goals = table[:, 1:3] + (table[:, 5:] + gains[1] * table[:, 3:5]) / gains[0]
    path = write(tmp_path / "log.csv", np.column_stack([table[:, :5], goals]), HEADER.replace("tau_con", "goal"))
    found = find_columns(read_recording(path), SETTING, vector_of(TRUTH))
    assert "goals of servos" in found.text
    told = [[float(each) for each in re.findall(r"\*([\d.]+)", word)] for word in found.remedy]
    np.testing.assert_allclose([each[0] for each in told], gains[0], rtol=0.1)
    np.testing.assert_allclose([each[1] for each in told], [each[0] for each in told])
    right = [
        f"u{k + 1}=8*(goal1-pos_meas1)-0.3*vel_meas1" if k == 0 else "u2=5*goal2-5*pos_meas2-vel_meas2*0.1"
        for k in (0, 1)
    ]
    np.testing.assert_allclose(read_recording(path, right).u, table[:, 5:], atol=1e-6)


def test_matlabs_objects_long_arrays_and_matrices_of_several_runs(tmp_path, table):
    savemat(tmp_path / "log.mat", {"short": np.zeros((9, 6)), "x": np.tile(table[:450, 1:7] + 0.3, (2, 1))})
    recording = read_recording(tmp_path / "log.mat", ["time=0.003", "q1=x#1", "q2=x#2", "u1=x#5", "u2=x#6"])
    assert recording.period == pytest.approx(0.003)
    # The level-5 file of an object in MATLAB's own classes: flags, name, kind of system, class.
    parts = [(6, struct.pack("<II", 17, 0)), (1, b"ts".ljust(8, b"\0")[:2]), (1, b"MCOS"), (1, b"timeseries")]
    body = b"".join(struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8) for kind, data in parts)
    (tmp_path / "object.mat").write_bytes(
        b"MATLAB 5.0".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49) + struct.pack("<II", 14, len(body)) + body
    )
    said = refusal(read_recording, tmp_path / "object.mat")
    assert "its ts is MATLAB's timeseries, not read: t = ts.Time; x = squeeze(ts.Data); save(" in said


@pytest.mark.parametrize("begin", [1764 * 10**15, 0], ids=["a clock", "a simulated clock"])
def test_a_ros_bag_is_read_by_the_names_of_its_joints(tmp_path, table, begin):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    table = table[:600]
    write_bag(tmp_path / "run", table, begin)
    message = refusal(read_recording, tmp_path / "run")
    words = shlex.split(message.split("--columns ")[1].split(", if these")[0])
    assert words == (["q1=position.shoulder", "q2=position.elbow", "u1=effort_commands0", "u2=effort_commands1"])
    right = read_recording(write(tmp_path / "right.csv", table))
    for path in (tmp_path / "run", tmp_path / "run" / "run.mcap"):
        assert_same(read_recording(path, words), right, steps=1e-9)
    (tmp_path / "bad.mcap").write_bytes(b"no bag")
    assert "as a ROS bag" in refusal(read_recording, tmp_path / "bad.mcap")


def put(rows, columns, value):
    """The table with a value in some rows and columns."""

    def change(table):
        other = table.copy()
        other[rows, columns] = value(other) if callable(value) else value
        return other

    return change


def jittered(table):
    """160 Hz with jitter and a gap of 2 s, as of a remote robot."""
    rows = np.arange(0, len(table) - 1, 3) + np.random.default_rng(0).integers(0, 2, len(table) // 3)
    return table[rows] + np.outer(rows > 800, 2.0 * np.eye(7)[0])


ALL, TIME, MEASURED = slice(None), 0, slice(1, 5)
ROWS = {
    "epoch": (lambda table: table + np.eye(7)[0] * 1.7e9, ""),
    "rounded": (put(ALL, TIME, lambda table: np.round(0.002 * np.arange(len(table)), 2)), "several share"),
    "first velocity": (put(0, slice(3, 5), np.nan), ""),
    "no measurement": (put(slice(500, 520), MEASURED, np.nan), "20 rows lack a time or an angle"),
    "restarts": (lambda table: table - np.outer(np.arange(len(table)) > 900, table[901, 0] * np.eye(7)[0]),
                 "the time restarts 1 times: read as 2 episodes"),
    "episodes": (lambda table: np.column_stack([table[:, 0], np.roll(table[:, 1:], 900, axis=0)]), "jump 1 times"),
    "160 Hz, a gap": (jittered, "time jumps by 2"),
    "no torques": (put(ALL, slice(5, 7), 0.0), "torques are all zero"),
    "rows twice": (lambda table: np.repeat(table, 2, axis=0), "repeat the one before and its time"),
}  # fmt: skip
"""Rows that a log may have, and what is said of them."""


@pytest.mark.parametrize("name", ROWS)
def test_rows_that_others_record(tmp_path, table, name):
    change, said = ROWS[name]
    path = tmp_path / "log.csv"
    np.savetxt(path, change(table), delimiter=",", header=HEADER, comments="", fmt=["%.15g", *6 * ["%.12g"]])
    recording = read_recording(path)
    assert said in " ".join(recording.warnings)
    assert bool(said) == bool(recording.warnings)
    assert np.all(np.diff(recording.time) > 0)
    assert np.isfinite(recording.dq).all()
    assert recording.time[0] == 0.0
    assert recording.duration == pytest.approx(table[-1, 0] - table[0, 0], rel=0.6)
