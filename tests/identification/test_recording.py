"""Logs: what is read and refused, smoothing, and errors of predictions over their windows."""

import re
import shlex

import numpy as np
import pytest
from synthetic import HEADER, QUANTUM, simulate, write

from refusals import refusal
from swingup.identification.recording import read_recording
from swingup.identification.scoring import ErrorRow, hold_out, score_windows, summarise
from swingup.identification.segments import clear_of_gaps, smooth

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
    # Angles that wrap are continued.
    table = changed([1, 3], lambda _: np.column_stack([(4 * TIME + np.pi) % (2 * np.pi) - np.pi, 4 + 0 * TIME]))
    np.testing.assert_allclose(read_recording(write(tmp_path / "log.csv", table)).q[:, 0], 4 * TIME, atol=1e-9)
    # Pushes are added.
    header = HEADER + ",tau_pert1,tau_pert2"
    path = write(tmp_path / "log.csv", np.column_stack([TABLE, np.full((len(TIME), 2), 0.25)]), header)
    np.testing.assert_allclose(read_recording(path).u, TORQUES + 0.25, atol=1e-12)


@pytest.mark.parametrize("name", ["tau_con", "tau", "tau_meas", "duty"])
def test_one_mapped_torque_keeps_the_logs_other(name, tmp_path):
    """A log of duties has those of one joint alone: the other has no motor."""
    commands = np.column_stack([np.sin(TIME), np.cos(TIME)])
    header, table = HEADER.replace("tau_con", name), np.column_stack([TABLE[:, :5], commands * [1, 1000]])
    if name == "duty":
        header, table = header.replace(",duty1", ""), np.delete(table, 5, axis=1)
    found = read_recording(write(tmp_path / "log.csv", table, header), [f"u2={name}2:mNm"]).u
    np.testing.assert_allclose(found, commands * [name != "duty", 1], atol=1e-9)


def test_one_mapped_current_keeps_the_logs_torque_or_asks_for_the_other_current(tmp_path):
    table, header = np.column_stack([TABLE, 2 * TABLE[:, 5]]), HEADER + ",current2"
    recording = read_recording(write(tmp_path / "log.csv", table, header), ["u2=current2:A*0.5"])
    np.testing.assert_allclose(recording.u, TORQUES[:, [0, 0]], atol=1e-9)
    header = header.replace("tau_con1,tau_con2", "current1,none")
    log = write(tmp_path / "log.csv", table, header)
    assert "map u1 as well, or u1=0" in refusal(lambda: read_recording(log, ["u2=current2:A*0.5"]))


@pytest.mark.parametrize(("row", "time"), [(-3, 1.6e212), (0, -1.7e9), (slice(500, None), 1.7e9)])
def test_a_time_of_another_epoch_is_a_pause(tmp_path, row, time):
    table = TABLE.copy()
    table[row, 0] += time
    log = read_recording(write(tmp_path / "log.csv", table))
    assert f"the time jumps by {abs(time):.3g} s: read as a pause" in log.warnings[0]
    assert len(log.time) == len(TABLE)
    assert log.duration < TABLE[-1, 0] + 1.0


def test_an_exponent_beyond_decimals_in_a_time_since_1970(tmp_path):
    rows = [",".join(map(str, [f"{1.7e9 + row[0]:.3f}", *row[1:]])) for row in TABLE]
    rows[700] = rows[700].replace(rows[700].partition(",")[0], "0e99999999999999999999", 1)
    (tmp_path / "log.csv").write_text("\n".join([HEADER, *rows]))
    assert len(read_recording(tmp_path / "log.csv").time) >= len(TABLE) - 1


def test_quanta_differ_by_joint(tmp_path):
    steps = np.array([QUANTUM, 4.8e-5])
    table = changed([1, 2], lambda angles: np.round(angles / steps) * steps)
    assert read_recording(write(tmp_path / "log.csv", table)).quantum == pytest.approx(steps, rel=1e-3)
    assert read_recording(write(tmp_path / "exact.csv", TABLE)).quantum == (0.0, 0.0)


def test_a_slow_camera_in_a_fast_loop(tmp_path):
    """30 Hz in a loop of 500 Hz: each angle stands for 16 or 17 rows, of which the first is measured."""
    shown = np.floor(TIME * 30 + 1e-9).astype(int)
    first = np.append(True, np.diff(shown) > 0)
    motion = np.column_stack([3 * np.sin(3 * TIME), 0.5 * np.cos(5 * TIME)])
    table = np.column_stack([TIME, motion[first][shown], TORQUES])
    header = "time,pos_meas1,pos_meas2,tau_con1,tau_con2"
    recording = read_recording(write(tmp_path / "log.csv", table, header))
    assert np.count_nonzero(recording.fresh != first) < 25  # at turning points equal rows tell nothing
    assert len(recording.time) == len(TIME)  # no edge counts as a dropout
    assert "repeat the one before" in "".join(recording.warnings)
    slow = table.copy()
    slow[:, 1:3] = table[::60, 1:3].repeat(60, axis=0)
    refused = refusal(lambda: read_recording(write(tmp_path / "slow.csv", slow, header)))
    assert "rows are 0.12 s apart (median), too slow for a pendulum" in refused


def test_a_pendulum_that_is_held_before_it_falls_rests(tmp_path):
    """2 s of equal rows, a fall, and equal rows again: no window begins where the smoother would see the fall."""
    time = np.arange(0, 6, 0.01)
    fall = np.clip(time - 2.0, 0.0, 2.0)
    angles = np.round(np.column_stack([1.0 - np.cos(5 * fall), 0.5 * np.sin(4 * fall) ** 2]), 4)
    table = np.column_stack([time, angles, np.zeros((len(time), 2))])
    recording = read_recording(write(tmp_path / "log.csv", table, "time,pos_meas1,pos_meas2,tau_con1,tau_con2"))
    rest = np.arange(0.1, 1.95, 0.01)
    clear = clear_of_gaps(recording, rest, rest)
    np.testing.assert_allclose(smooth(recording, rest)[clear], 0.0, atol=0.01)
    moving = np.arange(2.1, 3.9, 0.01)
    assert clear_of_gaps(recording, moving, moving).all()


def test_a_slow_sensors_windows_keep_away_from_gaps(tmp_path):
    """The six nearest frames of a camera lie within 0.1 s: windows nearer to a gap would be smoothed across it."""
    shown = np.floor(TIME * 30 + 1e-9).astype(int)
    first = np.append(True, np.diff(shown) > 0)
    motion = np.column_stack([3 * np.sin(3 * TIME), 0.5 * np.cos(5 * TIME)])
    table = np.column_stack([TIME + (TIME >= 1.5), motion[first][shown], TORQUES])
    table = table[(TIME < 1.4) | (TIME >= 1.5)]
    recording = read_recording(write(tmp_path / "log.csv", table, "time,pos_meas1,pos_meas2,tau_con1,tau_con2"))
    times = np.array([1.2, 1.36, 1.38, 2.52, 2.7])
    assert clear_of_gaps(recording, times, times).tolist() == [True, False, False, False, True]


def test_repeated_rows_are_found(tmp_path):
    table = np.column_stack([TIME, np.repeat(TABLE[::2, 1:], 2, axis=0)])
    recording = read_recording(write(tmp_path / "log.csv", table))
    assert recording.fresh[::2].all()
    assert np.mean(recording.fresh[1::2]) < 0.05
    assert "% of the rows repeat" in recording.warnings[0]


def test_a_log_without_velocities_and_torques_and_one_of_which_only_the_motor_reports_them(tmp_path):
    recording = read_recording(write(tmp_path / "log.csv", TABLE[:, :3], "time,pos1,pos2"))
    np.testing.assert_allclose(recording.dq, RATES, atol=0.02)
    assert not any(recording.driven)
    assert "free fall" in recording.warnings[0]
    table = np.column_stack([TABLE[:, :5], np.random.default_rng(0).normal(0, 0.001, (len(TIME), 2))])
    recording = read_recording(write(tmp_path / "log.csv", table, HEADER.replace("tau_con", "tau_meas")))
    assert (recording.driven, recording.commanded) == ((False, False), False)


def test_torques_of_some_rows_hold_and_states_may_have_one_row_more(tmp_path):
    some = np.arange(len(TIME)) % 4 == 0
    table = changed([5], lambda torque: np.where(some[:, None] & (TIME[:, None] < 2), torque, np.nan))
    found = read_recording(write(tmp_path / "log.csv", table)).u[:, 0]
    expected = np.repeat(TORQUES[some, 0], 4)[: len(TIME)]
    np.testing.assert_allclose(found[TIME < 2], expected[TIME < 2])
    # They hold for 60 ms at most.
    assert found[TIME < 2.05][-1] == expected[TIME < 2][-1]
    np.testing.assert_array_equal(found[TIME > 2.06], 0.0)
    np.savez(tmp_path / "log.npz", t=TIME, q=ANGLES, dq=RATES, u=TORQUES[:-1])
    recording = read_recording(tmp_path / "log.npz")
    assert len(recording.time) == len(TIME)
    np.testing.assert_allclose(recording.u[:-1], TORQUES[:-1])


FEW_ROWS = np.column_stack([0.1 * np.arange(14), TABLE[np.arange(14) * 50 // 250 * 250, 1:]])
HELD = np.column_stack([0.01 * np.arange(450), np.repeat(TABLE[np.arange(0, 900, 60), 1:], 30, axis=0)])
REFUSED = {
    "joint 2 never moves": changed([2], np.zeros_like),
    "at least 0.8 s": changed([0], lambda time: time / 1000),
    "with enough digits of the time": changed([0], np.floor),
    "comes after": changed([0], lambda time: np.abs(time - 1)),
    "log.csv has 3 different rows, ": FEW_ROWS,
    "log.csv has only 15 different pairs of angles in 450 rows": HELD,
    "angle 2 stays at 0.1418 rad from 1 to 3 s, while joint 1 moves by 2 rad": np.vstack(
        [TABLE[:500], np.insert(np.delete(TABLE[500:], 2, axis=1), 2, TABLE[500, 2], axis=1)]
    ),
    "; if it counts rows, write time=PERIOD (s) instead": changed(
        [0], lambda time: np.arange(len(time), dtype=float)[:, None]
    ),
    # An encoder that flickers leaves no piece of a tenth of a second.
    "without rows whose angles jump away and back, has 0 different rows": changed(
        [1], lambda q: q + 0.5 * (np.arange(len(q)) // 10 % 2)[:, None]
    ),
}


@pytest.mark.parametrize("named", REFUSED)
def test_what_no_log_can_hold_is_named(tmp_path, named):
    assert named in refusal(read_recording, write(tmp_path / "log.csv", REFUSED[named]))


def test_turns_of_an_encoder_are_named(tmp_path):
    table = changed([1], lambda q: q - 4 * np.pi)
    warning, *others = read_recording(write(tmp_path / "log.csv", table)).warnings
    assert "angle 1 begins -2 turns from 0" in warning
    assert not others
    # One that begins upright is at no turn: to zero it there would be wrong.
    upright = read_recording(write(tmp_path / "up.csv", changed([1], lambda q: q + 3.3)))
    assert upright.warnings == ()


def test_lone_zeros_are_left_out(tmp_path):
    lost = np.arange(len(TIME)) % 40 == 20
    table = changed([1, 2], lambda q: np.where(lost[:, None], 0.0, q))
    found = read_recording(write(tmp_path / "log.csv", table))
    near = np.abs(ANGLES).max(axis=1) <= 0.15
    assert len(found.time) == len(TIME) - np.count_nonzero(lost & ~near)
    assert "have zeros for both angles: they are left out" in found.warnings[0]


def test_arrays_of_states_and_names_that_count_from_0(tmp_path):
    words = ["q1=x1", "q2=x2", "dq1=x3", "dq2=x4"]
    np.savez(tmp_path / "log.npz", t=(TIME * 1e9).astype("datetime64[ns]"), x=TABLE[:, 1:5], u=TORQUES, z=TIME + 1j)
    told = refusal(read_recording, tmp_path / "log.npz")
    assert f"--columns {' '.join(words[:2])}" in told
    assert "its z, complex128 of shape (1500,), is not read" in told
    np.testing.assert_allclose(read_recording(tmp_path / "log.npz", words).time, TIME, atol=1e-9)
    header = "time,pos0,pos1,vel0,vel1,tau0,tau1"
    told = refusal(read_recording, write(tmp_path / "log.csv", TABLE, header))
    assert "q1=pos0 q2=pos1" in told
    told = refusal(read_recording, write(tmp_path / "log.csv", TABLE, HEADER.replace("con2", "con0")))
    assert "--columns u1=tau_con0 u2=tau_con1" in told


def test_the_only_log_of_a_session_is_not_held_out(tmp_path):
    log = read_recording(write(tmp_path / "log.csv", TABLE))
    windows = score_windows([log] * 3)

    def judged(sessions, driven=(True, True, True)):
        return np.unique(hold_out(windows, windows, sessions, driven)[0].log).tolist()

    assert (judged([0, 0, 0]), judged([0, 1, 0]), judged([0, 1, 2])) == ([1], [2], [0, 1, 2])
    # The only one with torques is not, either.
    assert judged([0, 0, 0], (False, True, False)) == [2]


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


def cubics(t):
    """Both angles and their rates."""
    return np.column_stack(
        [0.3 + t - t**2 + 0.4 * t**3, 2 - 3 * t + 0.5 * t**3, 1 - 2 * t + 1.2 * t**2, -3 + 1.5 * t**2]
    )


def recording_of(tmp_path, period, repeat=1):
    time = np.cumsum(np.random.default_rng(1).uniform(0.8, 1.2, round(2 / period)) * period)
    table = np.column_stack([time, cubics(np.repeat(time[::repeat], repeat))])
    return read_recording(write(tmp_path / "log.csv", table, "time,pos1,pos2,vel1,vel2")), time[0]


def test_a_cubic_is_its_own_smoothing(tmp_path):
    # At any time between the rows, at both ends, at 500 Hz and where 20 ms hold one row.
    for period in (0.002, 0.03):
        recording, origin = recording_of(tmp_path, period)
        times = np.linspace(0.0, recording.duration, 57)
        np.testing.assert_allclose(smooth(recording, times), cubics(times + origin), atol=1e-8)
    # Repeated rows do not count.
    recording, origin = recording_of(tmp_path, 0.002, repeat=2)
    times = np.array([0.5, 1.0])
    np.testing.assert_allclose(smooth(recording, times)[:, 2], cubics(times + origin)[:, 2], atol=5e-3)


def test_suggested_columns_keep_earlier_ones_and_run_as_printed(tmp_path):
    table = simulate(2.0)
    table[:, 0] *= 1e3
    log = write(tmp_path / "mine.csv", table[:, [0, 1, 2, 5, 6]], "clock,theta1,theta2,current1,current2")
    for given in (["time=clock:ms"], ["time=clock:ms", "q1=theta1", "q2=theta2"]):
        words = shlex.split(re.search(r"--columns (.*?), if", refusal(read_recording, log, given))[1])
        assert words[: len(given)] == given
    assert read_recording(log, words).duration == pytest.approx(2.0, abs=0.01)
    in_order = ["time", "_", "q1", "q2", "u1", "u2"]
    log = write(tmp_path / "untitled.csv", table[:, [0, 3, 1, 2, 5, 6]], "")
    words = shlex.split(re.search(r"--columns (.*)", refusal(read_recording, log, in_order))[1])
    assert read_recording(log, words).duration == pytest.approx(2.0, abs=0.01)
