import numpy as np
import pytest
from synthetic import HEADER, QUANTUM, write

from refusals import refusal
from swingup.identification.log.recording import read_recording

TIME = np.arange(0, 3, 0.002)
ANGLES = np.column_stack([np.sin(3 * TIME), 0.5 * np.cos(5 * TIME)])
RATES = np.column_stack([3 * np.cos(3 * TIME), -2.5 * np.sin(5 * TIME)])
TORQUES = np.column_stack([np.sin(TIME), np.zeros_like(TIME)])
TABLE = np.column_stack([TIME, ANGLES, RATES, TORQUES])


def changed(columns, change):
    table = TABLE.copy()
    table[:, columns] = change(table[:, columns])
    return table


def test_a_log_is_read_as_it_is(tmp_path):
    recording = read_recording(write(tmp_path / "log.csv", changed([0], lambda time: time + 1.0)))
    assert recording.name == "log.csv"
    np.testing.assert_allclose(recording.time, TIME, atol=1e-12)
    np.testing.assert_allclose(recording.q, ANGLES, atol=1e-12)
    np.testing.assert_allclose(recording.u, TORQUES, atol=1e-12)
    assert (recording.driven, recording.commanded, recording.warnings) == ((True, False), True, ())
    assert recording.fresh.all()
    assert recording.period == pytest.approx(0.002)


def test_pushes_are_added_and_clipped(tmp_path):
    header = HEADER + ",tau_pert1,tau_pert2"
    path = write(tmp_path / "log.csv", np.column_stack([TABLE, np.full((len(TIME), 2), 0.25)]), header)
    np.testing.assert_allclose(read_recording(path).u, TORQUES + 0.25, atol=1e-12)
    np.testing.assert_allclose(read_recording(path, (1.0, 0.2)).u.max(axis=0), [1.0, 0.2])


def test_angles_that_wrap_are_continued(tmp_path):
    angle = 4 * TIME
    table = TABLE.copy()
    table[:, 1], table[:, 3] = (angle + np.pi) % (2 * np.pi) - np.pi, 4.0
    np.testing.assert_allclose(read_recording(write(tmp_path / "log.csv", table)).q[:, 0], angle, atol=1e-9)


def test_quanta_differ_by_joint(tmp_path):
    steps = np.array([QUANTUM, 4.8e-5])
    table = changed([1, 2], lambda angles: np.round(angles / steps) * steps)
    assert read_recording(write(tmp_path / "log.csv", table)).quantum == pytest.approx(steps, rel=1e-3)
    assert read_recording(write(tmp_path / "exact.csv", TABLE)).quantum == (0.0, 0.0)


def test_repeated_rows_are_found(tmp_path):
    repeated = np.arange(len(TIME)) // 2 * 2
    table = np.column_stack([TIME, TABLE[repeated, 1:]])
    recording = read_recording(write(tmp_path / "log.csv", table))
    assert recording.fresh[::2].all()
    assert np.mean(recording.fresh[1::2]) < 0.05
    assert "% of the rows repeat" in recording.warnings[0]


def test_torques_that_only_a_motor_reports(tmp_path):
    header = HEADER.replace("tau_con", "tau_meas")
    noise = np.random.default_rng(0).normal(0, 0.001, (len(TIME), 2))
    recording = read_recording(write(tmp_path / "log.csv", np.column_stack([TABLE[:, :5], noise]), header))
    assert (recording.driven, recording.commanded) == ((False, False), False)


def test_a_log_without_velocities_and_torques(tmp_path):
    recording = read_recording(write(tmp_path / "log.csv", TABLE[:, :3], "time,pos1,pos2"))
    np.testing.assert_allclose(recording.dq, RATES, atol=0.02)
    assert not any(recording.driven)
    assert "free fall" in recording.warnings[0]


FEW_ROWS = np.column_stack([0.1 * np.arange(14), TABLE[np.arange(14) * 50 // 250 * 250, 1:]])
REFUSED = {
    "joint 2 never moves": changed([2], np.zeros_like),
    "at least 0.8 s": changed([0], lambda time: time / 1000),
    "comes after": changed([0], lambda time: np.abs(time - 1)),
    "log.csv has 3 different rows, ": FEW_ROWS,
    "log.csv has only 3 different pairs of angles in 450 rows": np.column_stack(
        [0.01 * np.arange(450), np.repeat(TABLE[[0, 300, 600], 1:], 150, axis=0)]
    ),
    "lacks pos_meas2": TABLE[:, :2],
}


@pytest.mark.parametrize("named", REFUSED)
def test_what_no_log_can_hold_is_named(tmp_path, named):
    header = ",".join(HEADER.split(",")[: REFUSED[named].shape[1]])
    assert named in refusal(read_recording, write(tmp_path / "log.csv", REFUSED[named], header))


@pytest.mark.parametrize(
    ("table", "seen"),
    [
        (changed([5, 6], np.zeros_like), "torques are all zero"),
        (changed([5], np.sign), "torque 1 stands at ±1 N m in"),
        (changed([0], lambda time: time + 0.5 * (time > 1)), "time jumps by 0.502 s at 1"),
    ],
)
def test_what_needs_care_is_a_warning(tmp_path, table, seen):
    assert seen in read_recording(write(tmp_path / "log.csv", table)).warnings[0]
