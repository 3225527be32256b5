import numpy as np
from synthetic import write

from swingup.identification.log.recording import read_recording
from swingup.identification.log.smoothing import smooth


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
