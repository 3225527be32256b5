"""Smoothed logs, and errors of predictions over their windows."""

import numpy as np
import pytest
from synthetic import TRUTH, simulate, write

from swingup.identification.fit.prediction import integration_of, predict, vector_of
from swingup.identification.fit.scoring import ErrorRow, score_windows, summarise
from swingup.identification.log.recording import read_recording
from swingup.identification.log.smoothing import smooth
from swingup.plant.plant import load_plant


def test_errors_by_hand():
    errors = np.zeros((3, 10, 4))
    errors[0, 1], errors[1, 1] = [3.0, 0.0, 1.0, 1.0], [0.0, 1.0, 1.0, 1.0]
    errors[:, 4, 2:] = 2.0
    summary = summarise(errors)
    assert list(summary) == ["0.1", "0.25", "0.5"]
    # Six angles, (9 + 0 + 0 + 1 + 0 + 0) / 6, and six velocities, of which four are 1.
    assert (summary["0.1"].angle, summary["0.1"].velocity) == pytest.approx((np.sqrt(10 / 6), np.sqrt(4 / 6)))
    assert (summary["0.25"].angle, summary["0.25"].velocity) == pytest.approx((0.0, 2.0))
    # The windows' own errors are sqrt(9 / 2), sqrt(1 / 2) and 0.
    assert summary["0.1"].angle_median == pytest.approx(np.sqrt(0.5))
    assert summarise(errors[:0])["0.5"] == ErrorRow(0, None, None, None, None)


def test_windows_start_every_tenth_of_a_second_where_a_joint_is_fast(tmp_path):
    time = np.arange(0, 4, 0.002)
    # Faster than 1 rad/s from 2.0 s on: windows that reach it start after 1.5 s and end before 4 s.
    q1 = np.where(time < 2, 0.0, 1.5 * (time - 2)) + 0.01 * np.sin(time)
    table = np.column_stack([time, q1, 0.01 * np.sin(time)])
    windows = score_windows([read_recording(write(tmp_path / "log.csv", table, "time,pos1,pos2"))])
    assert windows.start[0] == pytest.approx(1.5, abs=0.11)
    np.testing.assert_allclose(np.diff(windows.start), 0.1)
    assert windows.start[-1] == pytest.approx(3.4)


def test_the_true_plant_predicts_a_simulation(tmp_path):
    recording = read_recording(write(tmp_path / "log.csv", simulate()))
    windows = score_windows([recording])
    model = vector_of(TRUTH, 0.003, 3e-4)
    model[9:11] = 0.012, -0.02
    errors = predict(integration_of(TRUTH), model, windows) - windows.states[:, 1:]
    assert np.median(np.abs(errors[:, 4]), axis=0) == pytest.approx(0.0, abs=0.03)
    wrong = predict(integration_of(TRUTH), vector_of(load_plant("C.1")), windows) - windows.states[:, 1:]
    assert np.median(np.abs(wrong[:, 4, :2])) > 5 * np.median(np.abs(errors[:, 4, :2]))


def recording_of(tmp_path, period, repeat=1):
    """Both angles are cubics of time."""
    random = np.random.default_rng(1)
    time = np.cumsum(random.uniform(0.8, 1.2, round(2 / period)) * period)
    q = np.column_stack([0.3 + time - time**2 + 0.4 * time**3, 2 - 3 * time + 0.5 * time**3])
    dq = np.column_stack([1 - 2 * time + 1.2 * time**2, -3 + 1.5 * time**2])
    table = np.column_stack([time, q, dq])[np.arange(len(time)) // repeat * repeat]
    table[:, 0] = time
    header = "time,pos1,pos2,vel1,vel2"
    return read_recording(write(tmp_path / "log.csv", table, header)), time[0]


def test_a_cubic_is_its_own_smoothing(tmp_path):
    # At any time between the rows, at both ends, at 500 Hz and where 20 ms hold one row.
    for period in (0.002, 0.03):
        recording, origin = recording_of(tmp_path, period)
        times = np.linspace(0.0, recording.duration, 57)
        t = times + origin
        expected = np.column_stack(
            [0.3 + t - t**2 + 0.4 * t**3, 2 - 3 * t + 0.5 * t**3, 1 - 2 * t + 1.2 * t**2, -3 + 1.5 * t**2]
        )
        np.testing.assert_allclose(smooth(recording, times), expected, atol=1e-8)


def test_repeated_rows_do_not_count(tmp_path):
    recording, origin = recording_of(tmp_path, 0.002, repeat=2)
    t = np.array([0.5, 1.0]) + origin
    found = smooth(recording, t - origin)
    np.testing.assert_allclose(found[:, 2], 1 - 2 * t + 1.2 * t**2, atol=5e-3)
