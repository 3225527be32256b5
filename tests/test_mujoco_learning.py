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

    def lines(returns, *options):
        path = tmp_path / "runs.jsonl"
        rows = [
            {"run": list(run), "seed": seed, "frames": [9], "scores": [last], "seconds": [1.0]}
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
