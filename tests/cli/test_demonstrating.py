"""The command ``demo``: what it watches for, prints and writes. A training of few frames is slow here."""

import json
import shlex
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from swingup.benchmark.boards import BOARDS
from swingup.benchmark.leaderboard import OURS, Row, Table, paper_score, published_rows
from swingup.cli import commands, demonstrating, main
from swingup.cli.demonstrating import Watch
from swingup.cli.judging import JudgingCommands
from swingup.cli.parsing import program_typed
from swingup.cli.progress import progress_line
from swingup.cli.results import comparison_lines
from swingup.common.errors import SwingupError
from swingup.controllers.registry import get_controller
from swingup.learner.metrics import read_metrics
from swingup.learner.report import TrainingReport
from swingup.plant.robots import ROBOTS
from swingup.policy.shipped import DEFAULT
from swingup.report import make

ACROBOT = ROBOTS["acrobot"]


pytestmark = pytest.mark.usefixtures("surroundings")


class SavingRun:
    """A run whose policies are words."""

    def __init__(self, folder):
        self.folder, self.frames, self.saved = folder, 0, []

    def policy(self, index):
        return f"policy {index} after {self.frames} frames"

    def save_policy(self, path, index, policy, result):
        path.write_text(policy)
        self.saved.append((path.name, result))


def report(frames, best):
    return TrainingReport(frames, 100_000.0, [{"reward": -0.25, "score": 0.5}], best)


def board(robot, mine, remark=None):
    """The published rows and one of ours, best first."""
    ours = Row("your policy", OURS, {**published_rows(robot, "performance")[0].values, "score": mine}, remark)
    rows = sorted([ours, *published_rows(robot, "performance")], key=lambda row: -row.values["score"])
    return Table(robot.name, "performance", BOARDS["performance"].columns, None, tuple(rows))


def test_the_papers_scores():
    assert [paper_score(robot) for robot in ROBOTS.values()] == [0.633, 0.659]


def test_the_watch_notes_when_the_papers_score_was_passed(tmp_path, monkeypatch):
    clock = iter([74.4, 99.0])
    monkeypatch.setattr(demonstrating, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    run = SavingRun(tmp_path)
    watch = Watch(run, paper=0.633, start=10.0)
    for frames, best, words in (
        (65_536, 0.0, "paper's 0.633"),
        (131_072, 0.632, "paper's 0.633"),
        (196_608, 0.633, "paper's 0.633 at 64 s"),
        (262_144, 0.64, "paper's 0.633 at 64 s"),
    ):
        run.frames = frames
        assert watch.note(report(frames, best)) == words
    # The first policy alone.
    assert run.saved == [("first.safetensors", {"score": 0.5, "frames": 65_536})]
    assert (tmp_path / "first.safetensors").read_text() == "policy 0 after 65536 frames"


def test_a_line_with_a_note_by_hand():
    before = progress_line(report(3_000_000, 0.5), 8_000_000, 1, 69, "paper's 0.633")
    # 5 million frames at 100,000 a second. Reward and rate have no room.
    assert before == "3,000,000 frames  50 s left  score 0.500  best 0.500  paper's 0.633"
    after = progress_line(report(3_000_000, 0.64), 8_000_000, 1, 69, "paper's 0.633 at 64 s")
    assert after == "3,000,000 frames  50 s left  best 0.640  paper's 0.633 at 64 s"
    for frames, note in ((10**10, "paper's 0.633 at 86400 s"), (64, "paper's 0.633")):
        line = progress_line(report(frames, 0.64), 2 * frames, 1, 69, note)
        assert len(line) <= 69
        assert line.endswith(f"  {note}")


def test_each_run_has_a_folder_of_its_own():
    names = []
    for _ in range(3):
        folder = demonstrating._new_folder(ACROBOT, None)
        folder.mkdir(parents=True)
        names.append(str(folder))
    assert names == ["runs/demo-acrobot", "runs/demo-acrobot-2", "runs/demo-acrobot-3"]
    assert demonstrating._new_folder(ACROBOT, "mine") == Path("mine")
    with pytest.raises(SwingupError, match="runs/demo-acrobot-2 exists: choose another --out"):
        demonstrating._new_folder(ACROBOT, "runs/demo-acrobot-2")


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=list(ROBOTS))
def test_the_comparison_is_narrow_and_sorted(robot):
    lines = comparison_lines(board(robot, 0.64), "your policy")
    assert max(map(len, lines)) <= 80
    rows = [line.removeprefix(">").split() for line in lines[3:]]
    scores = [float(row[0]) for row in rows]
    assert scores == sorted(scores, reverse=True)
    (mine,) = (line for line in lines if line.startswith(">"))
    assert mine.split()[1] == "0.640"
    assert mine.endswith("your policy (trained just now)")
    assert any(line.endswith("AR-EAPO (published, paper)") for line in lines)
    assert comparison_lines(board(robot, 0.0, "no swing-up"), "your policy")[-1].endswith(
        "your policy (no swing-up)"
    )


def test_the_board_has_three_published_rows(monkeypatch):
    monkeypatch.setattr(make, "leaderboard", lambda *_, **__: [board(ACROBOT, 0.64)])
    monkeypatch.setattr(make, "make_show", lambda *_: None)
    (table,) = make.trained_section(ACROBOT, {"your policy": get_controller("ar-eapo", ACROBOT)}).tables
    assert [row.controller for row in table.rows] == ["History SAC", "your policy", "AR-EAPO", "TVLQR"]


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=list(ROBOTS))
def test_the_next_commands_can_be_typed(robot, monkeypatch, tmp_path):
    program = tmp_path / "bin" / "swingup"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "argv", [".venv/bin/swingup"])
    monkeypatch.setenv("PATH", "")
    lines = demonstrating.next_lines(robot, Path(f"runs/demo-{robot.name}-2/best.safetensors"))
    assert max(len(line) for line in lines if line.startswith("#")) <= 80
    typed = [shlex.split(line) for line in lines if not line.startswith("#")]
    assert [words[0] for words in typed] == [".venv/bin/swingup"] * 3
    # They parse: what is not run here, the slow test runs.
    ready = []
    original = commands.parse
    monkeypatch.setattr(commands, "parse", lambda *given: ready.append(original(*given)) or (lambda: 0))
    assert [commands.run_command(words[1:]) for words in typed] == [0, 0, 0]
    assert len(ready) == 3
    # By its name where that is the same program, by the module where there is no program.
    monkeypatch.setattr(sys, "argv", [str(program)])
    monkeypatch.setenv("PATH", str(program.parent))
    assert program_typed() == "swingup"
    monkeypatch.setattr(sys, "argv", ["__main__.py"])
    assert program_typed() == f"{shlex.quote(sys.executable)} -m swingup"


@pytest.fixture
def pretended(monkeypatch):
    """The command with a training and a page that take no time; its options are kept."""
    given = []

    def start(robot, frames, out, **options):
        given.append((robot, frames, out, options))
        Path(out).mkdir(parents=True)
        return SavingRun(Path(out))

    monkeypatch.setattr(demonstrating, "page_template", lambda: None)
    monkeypatch.setattr(demonstrating, "start_training", start)
    monkeypatch.setattr(demonstrating, "train_shown", lambda run, note: note(report(65_536, 0.64)) and 0)
    monkeypatch.setattr(demonstrating, "find_policy", lambda path, robot: path.name)
    section = SimpleNamespace(tables=[board(ACROBOT, 0.64)])
    monkeypatch.setattr(demonstrating, "trained_section", lambda *_: section)
    monkeypatch.setattr(demonstrating, "render_page", lambda sections, title: title)
    return given


def test_the_output_is_narrow_and_ends_with_three_commands(pretended, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [".venv/bin/swingup"])
    monkeypatch.setenv("PATH", "")
    assert main(["demo", "--seed", "3"]) == 0
    assert pretended == [("acrobot", None, "runs/demo-acrobot", {"preset": "fast", "seed": 3})]
    lines = capsys.readouterr().out.splitlines()
    # A command that names a file may be longer: a terminal wraps it, and it is still copied whole.
    assert max(len(line) for line in lines if "best.safetensors" not in line) <= 80
    assert sum(line.startswith(">") for line in lines) == 1
    assert any(line.startswith("Training passed the paper's score after ") for line in lines)
    assert lines[-1] == ".venv/bin/swingup leaderboard acrobot"
    assert sum(line.startswith(".venv/bin/swingup ") for line in lines) == 3
    assert Path("runs/demo-acrobot/page.html").read_text().startswith("Acrobot: ")


def test_a_training_below_the_paper_says_so(pretended, monkeypatch, capsys):
    monkeypatch.setattr(demonstrating, "train_shown", lambda run, note: note(report(65_536, 0.6)) and 0)
    assert main(["demo"]) == 0
    assert "The best score stayed below the paper's: try more --frames" in capsys.readouterr().out


def test_an_interrupted_training_shows_no_result(pretended, monkeypatch, capsys):
    monkeypatch.setattr(demonstrating, "train_shown", lambda run, note: 130)
    assert main(["demo"]) == 130
    assert "Next" not in capsys.readouterr().out
    assert not Path("runs/demo-acrobot/page.html").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--frames 0", "frames = 0"),
        ("--seed -1", "seed = -1"),
        ("acrobat", "did you mean acrobot?"),
        ("--out .", ". exists: choose another --out"),
    ],
)
def test_bad_options_train_nothing(words, message, capsys, monkeypatch):
    monkeypatch.setattr(demonstrating, "page_template", lambda: None)
    assert main(["demo", *words.split()]) == 2
    assert message in capsys.readouterr().err
    assert not Path("runs").exists()


def test_without_its_libraries_nothing_is_trained(pretended, monkeypatch, capsys):
    def missing():
        raise SwingupError("a report needs Jinja, which is missing: pip install swingup[report]")

    monkeypatch.setattr(demonstrating, "page_template", missing)
    assert main(["demo"]) == 2
    assert "pip install swingup[report]" in capsys.readouterr().err
    assert pretended == []


@pytest.mark.slow
def test_a_short_demonstration_and_its_next_commands(capsys, monkeypatch, small_grid):
    pytest.importorskip("jinja2", reason="Jinja is not installed")
    monkeypatch.setattr(sys, "argv", ["swingup"])
    boards = JudgingCommands(BOARDS | {"robustness": small_grid}, ("ar-eapo",))
    assert main(["demo", "pendubot", "--frames", "150000"]) == 0
    output = capsys.readouterr()
    assert "training pendubot (fast) to 150,000 frames in runs/demo-pendubot" in output.err
    assert "paper's 0.659" in output.err
    folder = Path("runs/demo-pendubot")
    frames = [(row["seed"], row["frames"]) for row in read_metrics(folder / "metrics.jsonl")]
    # Whole iterations of 64 × 128 frames, of both seeds.
    assert frames == [(seed, number) for number in (65_536, 131_072, 155_648) for seed in (0, 1)]
    page = (folder / "page.html").read_text(encoding="utf-8")
    shown = json.loads(page.partition('id="data">')[2].partition("</script>")[0])["sections"][0]
    assert [show["name"] for show in shown["shows"]] == [
        "your policy",
        "your policy at first",
        DEFAULT,
        "ar-eapo",
    ]
    assert shown["policy"] is not None
    typed = [shlex.split(line) for line in output.out.splitlines()[-5::2]]
    assert [words[1] for words in typed] == ["evaluate", "demo", "leaderboard"]
    for words in typed:
        extra = ["--frames", "8192"] if words[1] == "demo" else []
        assert main([*words[1:], *extra], boards) == 0, words
    # Once more: the first run stays.
    assert main(["demo", "pendubot", "--frames", "8192"]) == 0
    assert Path("runs/demo-pendubot-2/page.html").exists()
