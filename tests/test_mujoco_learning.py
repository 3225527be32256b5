"""The table of the study on MuJoCo's tasks, on made runs with known answers."""

import json
import sys
from pathlib import Path

import pytest

import swingup

BENCHMARKS = Path(swingup.__file__).parents[2] / "benchmarks"

pytestmark = pytest.mark.skipif(not BENCHMARKS.is_dir(), reason="the scripts are only in a checkout")


@pytest.fixture
def table(monkeypatch, tmp_path, capsys):
    """Runs the script on last returns by task and learner, and gives the lines that it prints."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    import mujoco_learning

    def lines(returns, *options, **columns):
        path = tmp_path / "runs.jsonl"
        rows = [
            {"run": list(run), "seed": seed, "frames": [9], "scores": [last], "seconds": [1.0], **columns}
            for run, values in returns.items()
            for seed, last in enumerate(values)
        ]
        path.write_text("".join(json.dumps(row) + "\n" for row in rows))
        tasks = dict.fromkeys(task for task, _ in returns)
        # No seed is missing: nothing is trained.
        monkeypatch.setattr(sys, "argv", ["script", *tasks, "--seeds", "0", "--study", str(path), *options])
        mujoco_learning.main()
        return capsys.readouterr().out.splitlines()

    yield lines
    for name in ("study", "mujoco_learning"):
        sys.modules.pop(name, None)


def test_improvement_over_tasks_of_unequal_runs(table):
    found = table(
        {
            ("A-v1", "areapo"): [5.0, 5.0, 0.0],
            ("A-v1", "sb3-ppo"): [1.0, 2.0],
            ("B-v1", "areapo"): [10.0, 30.0],  # two runs: of A's three the first two count, which win 4 of 4 pairs
            ("B-v1", "sb3-ppo"): [20.0, 20.0],  # 2 of 4 pairs
        }
    )
    assert found[3].startswith("| A-v1 | 3 (0 to 5) | 2 (1 to 2, 2 seeds only) |")
    # The interval: with two of B's runs at 10 (1 of 4 resamples) none of its pairs wins, with two at 30 all do.
    assert found[-1] == "Probability that areapo improves on sb3-ppo: 0.75 (0.50 to 1.00; 2 and 2 runs of 2 tasks)"


def test_a_learner_without_runs_is_not_compared(table):
    found = table({("A-v1", "areapo"): [5.0, 6.0]})
    assert found[-1] == "Probability that areapo improves on sb3-ppo: not run"


def test_a_single_learner_is_compared_with_none(table):
    assert not any("improves" in line for line in table({("A-v1", "areapo"): [5.0]}, "--learners", "areapo"))


def test_rates_stand_beside_the_returns(table):
    runs = {("A-v1", "areapo"): [5.0, 5.0]}
    rows = table(runs, "--learners", "areapo", reward_rates=[1.25], resets=[0.5])[3:6]
    assert rows == [
        "| A-v1 | 5 (5 to 5, 2 seeds only) |",
        "| A-v1, reward rate (per step) | 1.250 (1.250 to 1.250, 2 seeds only) |",
        "| A-v1, resets per 1,000 steps | 0.50 (0.50 to 0.50, 2 seeds only) |",
    ]


def test_what_older_runs_did_not_record_is_a_dash(table):
    rows = table({("A-v1", "areapo"): [5.0]})[3:6]
    assert [row.split(" | ", 1)[1] for row in rows] == ["5 (5 to 5, 1 seeds only) | not run |"] + 2 * [
        "– | not run |"
    ]


def test_rates_are_drawn_where_they_were_recorded(table, tmp_path, monkeypatch):
    import mujoco_learning

    drawn = {}
    monkeypatch.setattr(mujoco_learning, "draw", lambda path, panels, labels, columns: drawn.update(panels))
    runs = {("A-v1", "areapo"): [5.0]}
    table(runs, "--plot", "p.png")
    assert list(drawn) == ["A-v1"]
    table(runs, "--plot", "p.png", reward_rates=[1.25], resets=[0.5])
    assert list(drawn) == ["A-v1", "A-v1: reward rates", "A-v1: resets"]
    (curve,) = drawn["A-v1: resets"]["AR-EAPO (swingup)"]
    assert curve["scores"] == [0.5]
    drawn.clear()
    table(runs, "--plot", "p.png", reward_rates=[1.25], resets=[0.0])
    assert list(drawn) == ["A-v1", "A-v1: reward rates"]


def test_a_run_with_its_rates_is_stored_and_read(table, tmp_path):
    import study

    points = [(9, 5.0, 1.0, 1.25, 0.5), (18, 6.0, 2.0, 1.5, 0.0)]
    study.Study(tmp_path / "new.jsonl").add(["A"], 3, points)
    (curve,) = study.Study(tmp_path / "new.jsonl").of("A")
    assert (curve["frames"], curve["reward_rates"], curve["resets"]) == ([9, 18], [1.25, 1.5], [0.5, 0.0])
    study.Study(tmp_path / "short.jsonl").add(["A"], 3, [row[:3] for row in points])
    (curve,) = study.Study(tmp_path / "short.jsonl").of("A")
    assert "resets" not in curve


def test_a_time_limit_of_the_peer_is_no_reset(table):
    import mujoco_learning

    falls = []
    note = mujoco_learning.watching(falls)
    for done, info in ((False, {}), (True, {"TimeLimit.truncated": True}), (True, {"TimeLimit.truncated": False})):
        note({"done": done, "info": info}, {})
    assert falls == [False, True]
