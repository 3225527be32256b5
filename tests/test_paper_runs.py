"""The summary of the runs of the preset `paper`, on made runs with known answers."""

import json
import sys
from pathlib import Path

import pytest

import swingup
from swingup.common.errors import SwingupError

BENCHMARKS = Path(swingup.__file__).parents[2] / "benchmarks"

pytestmark = pytest.mark.skipif(not BENCHMARKS.is_dir(), reason="the scripts are only in a checkout")


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import paper_runs

    yield paper_runs
    for name in ("study", "paper_runs"):
        sys.modules.pop(name, None)


def write_run(path, seed, scores, last_frames):
    """A run with evenly spaced evaluations, a second for each 10,000 frames, and a row without evaluation."""
    rows = [{"seed": seed, "frames": 1, "seconds": 0.1}]
    for k, score in enumerate(scores, start=1):
        frames = last_frames * k // len(scores)
        rows.append({"seed": seed, "frames": frames, "seconds": frames / 1e4, "score": score})
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))


def test_both_selections(script, tmp_path, monkeypatch, capsys):
    # Twenty evaluations: the last tenth are two, whose medians are 0.55 and 0.2.
    write_run(tmp_path / "acrobot-paper-0.jsonl", 0, [0.0] * 9 + [0.52, *[0.61] * 7, 0.64, 0.5, 0.6], 50_000_000)
    write_run(tmp_path / "acrobot-paper-1.jsonl", 1, [0.0] * 18 + [0.3, 0.1], 20_000_000)
    monkeypatch.setattr(sys, "argv", ["paper_runs", *map(str, sorted(tmp_path.glob("*.jsonl")))])
    script.main()
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("| acrobot")
    ]
    first, second, together = cells
    assert first == [
        "acrobot, seed 0", "50.0 M", "0.640 (45.0 M)", "0.550", "0.600",
        "25.0 M (2,500 s)", "27.5 M (2,750 s)", "27.5 M (2,750 s)", "45.0 M (4,500 s)",
    ]  # fmt: skip
    assert second == [
        "acrobot, seed 1", "20.0 M of 50 M, incomplete", "0.300 (19.0 M)", "0.200", "0.100", *["not reached"] * 4,
    ]  # fmt: skip
    # The best of all checkpoints; the median of 0.55 and 0.2; the paper's own score.
    assert together == ["acrobot", "2 (1 incomplete)", "0.640", "0.375", "0.633"]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("paper-0.jsonl", "", "start the file's name with its robot, acrobot or pendubot"),
        ("acrobot-paper-0.jsonl", '{"seed": 0, "frames": 1}\n', "has no evaluation"),
    ],
)
def test_files_without_a_run(script, tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(SwingupError, match=message):
        script.read_runs(tmp_path / name)
