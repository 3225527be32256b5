"""One thing is wrong with a simulated log, and its motion says which."""

import numpy as np
import pytest
from synthetic import DELAY, OFFSETS, TRUTH, simulate, write

from refusals import refusal
from swingup.identification.causes import INDEX, expected_of, explain, roughness
from swingup.identification.prediction import integration_of
from swingup.identification.recording import read_recording


def turned(*columns):
    return lambda log: log * np.where(np.isin(np.arange(7), columns), -1.0, 1.0)


def shifted(column, angle):
    return lambda log: log + np.where(np.arange(7) == column, angle, 0.0)


def late(rows):
    def change(log):
        changed = log.copy()
        changed[:-rows, 5:] = log[rows:, 5:]  # commanded earlier than before, by about 2.25 ms a row
        return changed

    return change


CASES = {
    "nothing": lambda log: log,
    "joints swapped": lambda log: log[:, [0, 2, 1, 4, 3, 5, 6]],
    "encoder 1 reversed": turned(1, 3),
    "encoder 2 reversed": turned(2, 4),
    "motor reversed": turned(6),
    "zero 1": shifted(1, 0.2),
    "zero 2": shifted(2, -0.15),
    "delay": late(8),
    "torque constant": lambda log: log * np.where(np.arange(7) > 4, 2.0, 1.0),
}
"""What each cause changes of a log's columns: time, angles, rates, torques."""
VALUES = {
    "zero 1": ("offset1", 0.2),
    "zero 2": ("offset2", -0.15),
    "delay": ("delay", DELAY + 8 * 0.00225),
    "torque constant": ("gain", 0.5),
}


@pytest.fixture(scope="module")
def log():
    table = simulate(4.0)
    table[:, 1:3] -= OFFSETS
    return table


QUICK = ("nothing", "joints swapped", "zero 1", "delay")  # test_diagnosis.py has a reversed encoder


@pytest.mark.parametrize(
    "cause", [each if each in QUICK else pytest.param(each, marks=pytest.mark.slow) for each in CASES]
)
def test_the_cause_is_the_likeliest(cause, log, tmp_path):
    recording = read_recording(write(tmp_path / "log.csv", CASES[cause](log)))
    found = explain(recording, integration_of(TRUTH), expected_of(TRUTH, DELAY, (6.0, 6.0)))
    assert found[0].suspect.cause == cause
    if cause in VALUES:
        name, value = VALUES[cause]
        assert found[0].z[INDEX[name]] == pytest.approx(value, rel=0.1)
    # Jerks are those of encoders' steps alone.
    assert roughness(recording).max() < 2.5e-4


def test_a_log_of_shreds_is_refused(log, tmp_path):
    shreds = log.copy()
    shreds[:, 0] += np.arange(len(log)) // 40  # Gaps of a second after each 0.09 s
    recording = read_recording(write(tmp_path / "log.csv", shreds))
    told = refusal(explain, recording, integration_of(TRUTH), expected_of(TRUTH, DELAY, (6.0, 6.0)))
    assert "has gaps everywhere: at least 0.16 s in a row are needed" in told
