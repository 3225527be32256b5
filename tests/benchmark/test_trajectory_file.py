import numpy as np
import pytest

from refusals import refusal
from swingup.benchmark.recording import load_trajectory, save_trajectory
from swingup.benchmark.rollout import Trajectory

HEADER = "time,pos_meas1,pos_meas2,vel_meas1,vel_meas2,tau_con1,tau_con2"
ROWS = ("0.0,1,2,3,4,5,6", "0.1,1.5,2.5,3.5,4.5,5.5,6.5", "0.2,-1,-2,-3,-4,-5,-6")
TABLE = np.loadtxt(ROWS, delimiter=",")


def write(tmp_path, *lines, encoding="utf-8"):
    path = tmp_path / "run.csv"
    path.write_bytes("\n".join(lines).encode(encoding))
    return path


def columns_of(trajectory):
    return np.column_stack([trajectory.time, trajectory.x, trajectory.u])


def assert_table(trajectory):
    np.testing.assert_array_equal(columns_of(trajectory), TABLE)


def told(path):
    """The message with which a file is refused: one line, and it names the file."""
    message = refusal(load_trajectory, path)
    assert str(path) in message
    return message


def test_round_trip_is_exact(tmp_path):
    generator = np.random.default_rng(0)
    table = generator.normal(0, 1, (200, 7)) * 10.0 ** generator.integers(-300, 8, (200, 7))
    table[:, 0] = 0.1 * np.arange(200)  # among them 0.30000000000000004
    table[:5, 1] = [0.1 + 0.2, 5e-324, 123456789.01234567, -0.0, 1 / 3]
    path = tmp_path / "run.csv"
    save_trajectory(path, Trajectory(time=table[:, 0], x=table[:, 1:5], u=table[:, 5:]))
    read = load_trajectory(path)
    # By another reader, too. Bytes, so that -0.0 differs from 0.0.
    for found in (columns_of(read), np.loadtxt(path, delimiter=",", skiprows=1)):
        assert found.tobytes() == table.tobytes()
    assert path.read_text(encoding="utf-8").splitlines()[0] == HEADER
    assert [each.name for each in tmp_path.iterdir()] == ["run.csv"]


@pytest.mark.parametrize(
    "header",
    [
        HEADER,
        "time,pos1,pos2,vel1,vel2,tau1,tau2",
        "time,pos_meas1,pos_meas2,vel1,vel2,tau_con1,tau_con2",
        "time, pos_meas1 , pos_meas2,  vel_meas1,\tvel_meas2, tau_con1,tau_con2 ",
        "time[s],pos1[rad],pos2 [rad],vel1[rad/s],vel2[rad/s],tau1[N m],tau2 (N m)",
        *(f"{start}{HEADER}" for start in ("# ", "#", "\ufeff", "\n")),
        *(HEADER.replace("time", title) for title in ("time[]", "time[ S ]", "time (sec)")),
    ],
)
def test_headers_that_are_understood(tmp_path, header):
    assert_table(load_trajectory(write(tmp_path, header, *ROWS, "")))
    # With spaces, line ends and blank lines.
    spaced = "\r\n".join([header, *(row.replace(",", " ,  ") for row in ROWS), "", " "])
    assert_table(load_trajectory(write(tmp_path, spaced)))


def test_columns_are_found_by_name_and_others_ignored(tmp_path):
    header = "K11,tau_con2,vel_meas1,time,pos_meas2,note,pos_meas1,vel_meas2,tau_con1,"
    rows = [f"nan,{r[6]},{r[3]},{r[0]},{r[2]},none,{r[1]},{r[4]},{r[5]}," for r in TABLE]
    assert_table(load_trajectory(write(tmp_path, header, *rows)))
    # They may come twice.
    path = write(tmp_path, f"{HEADER},K,K,pos1[deg]", *(f"{row},9,9,9" for row in ROWS))
    assert_table(load_trajectory(path))


def test_measured_and_commanded_columns_win_group_by_group(tmp_path):
    # Positions of both kinds: measured. Velocities: plain ones alone. Torques: one commanded is not a pair.
    header = "time,pos1,pos2,vel1,vel2,tau1,tau2,pos_meas1,pos_meas2,vel_filt1,vel_filt2,tau_con1"
    rows = [f"{k},1,2,3,4,5,6,7,8,9,10,11" for k in range(3)]
    found = load_trajectory(write(tmp_path, header, *rows))
    np.testing.assert_array_equal(found.x, [[7, 8, 3, 4]] * 3)
    np.testing.assert_array_equal(found.u, [[5, 6]] * 3)


def test_rows_are_cut_to_the_shortest_column(tmp_path):
    # The torques end one row early, once as empty cells and once as missing ones; the ignored column two.
    rows = ["0,1,2,3,4,5,6,x", "1,1,2,3,4,5,6,x", "2,1,2,3,4,5,6,", "3,1,2,3,4,5,,", "4,1,2,3,4"]
    found = load_trajectory(write(tmp_path, HEADER + ",note", *rows))
    np.testing.assert_array_equal(found.time, [0, 1, 2])
    np.testing.assert_array_equal(found.u, [[5, 6]] * 3)


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        (None, HEADER.split(",")),
        (None, ["time", "q1", "q2", "dq1", "dq2", "u1", "u2"]),
        (None, ["time=1", "q1=2", "q2=3", "dq1=4", "dq2=5", "u1=6", "u2=7"]),
        ("t,theta1,theta2,w1,w2,m1,m2", ["time=t", "q1=theta1", "q2=theta2", "dq1=w1", "dq2=w2", "u1=m1", "u2=m2"]),
        # What is named takes the place of what had the name, and names may be exchanged.
        ("time,pos_meas2,pos_meas1,vel_meas2,v,tau1,tau2", ["q1=pos_meas2", "q2=pos_meas1", "dq1=4", "dq2=v"]),
        ("time,pos1,pos2,pos_meas1,pos_meas2,tau1,tau2", ["q1=pos1", "q2=pos2", "dq1=pos_meas1", "dq2=pos_meas2"]),
    ],
)
def test_columns_are_named_by_the_user(tmp_path, header, columns):
    path = write(tmp_path, *([] if header is None else [header]), *ROWS)
    assert_table(load_trajectory(path, columns))


def test_columns_in_order_may_be_skipped_and_end_early(tmp_path):
    path = write(tmp_path, *(row.replace(",", ",8,", 1) + ",9,9" for row in ROWS))
    names = ["time", "_", "q1", "q2", "dq1", "dq2", "u1", "u2"]
    assert_table(load_trajectory(path, names))


def cell(place, text):
    """The rows with another cell in the second; a blank line before it counts in the line's number."""
    cells = ROWS[1].split(",")
    cells[place] = text
    return [HEADER, ROWS[0], "", ",".join(cells), ROWS[2]]


REFUSED = {
    "lacks time: ": [["pos1,pos2,vel1,vel2,tau1,tau2", *ROWS]],
    "lacks tau_con1, tau_con2: ": [["time,pos_meas1,pos_meas2,vel_meas1,vel_meas2", *ROWS]],
    f"has no header: its first line must be {HEADER}": [[""], ["", " ", "\n"], ROWS],
    "has titles and no rows of numbers below them": [[HEADER], [HEADER, ""]],
    # Decimal commas shift all that follows.
    "line 5 has more cells than the 7 titles: write decimals with a point": [[HEADER, *ROWS, "0,3,1,2,3,4,5,6"]],
    "line 4, column time: 'fast' is not a number": [cell(0, "fast")],
    "line 4, column tau_con2: nan is not finite": [cell(6, "nan")],
    "line 4, column vel_meas1: 1e999 is not finite": [cell(3, "1e999")],
    f"'{'x' * 40}' is not a number": [cell(3, "x" * 1000)],
    "several rows share a time": [[HEADER, *ROWS[:2], "0.1,1,2,3,4,5,6"]],
    "line 4: time 0.05 comes after 0.1: keep one run a file": [[HEADER, *ROWS[:2], "0.05,1,2,3,4,5,6"]],
    # A row that one column does not reach is not counted.
    "has 2 complete rows: at least 3 are needed": [[HEADER, *ROWS[:2]], [HEADER, *ROWS[:2], "0.2,1,2,3,4,5,"]],
    "has time in 'h'": [[HEADER.replace("time", "time[h]"), *ROWS]],
    "has 2 columns tau_con2": [[f"{HEADER},tau_con2", *(f"{row},9" for row in ROWS)]],
}


@pytest.mark.parametrize("named", REFUSED)
def test_rows_and_titles_that_are_refused(tmp_path, named):
    for lines in REFUSED[named]:
        assert named in told(write(tmp_path, *lines))


def test_units_of_titles_are_converted(tmp_path):
    deg, rpm = np.pi / 180, np.pi / 30
    for header, factors in (
        ("time[ms],pos1[deg],pos2 (°),vel1 [rpm],vel2,tau1[Nmm],tau2[mN m", [1e-3, deg, deg, rpm, 1, 1e-3, 1e-3]),
        ("time,pos1,pos2,vel1,vel2,tau1[oz-in],tau2 (kgf·cm)", [1, 1, 1, 1, 1, 0.00706155, 0.0980665]),
    ):
        found = columns_of(load_trajectory(write(tmp_path, header, *ROWS)))
        np.testing.assert_allclose(found, TABLE * factors, rtol=1e-15)
