"""The pictures of the pages: small, and labelled in words with units."""

import sys
from pathlib import Path

import pytest

import swingup

ROOT = Path(swingup.__file__).parents[2]
PICTURES = [*sorted((ROOT / "benchmarks").glob("*.png")), *sorted((ROOT / "docs").glob("*.png"))]

pytestmark = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="the pictures are only in a checkout")


@pytest.fixture
def figures(monkeypatch):
    """The figures that the studies' scripts draw, which are kept and not written."""
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import study

    from swingup.report import draw

    kept = []
    monkeypatch.setattr(draw, "render", lambda figure, suffix: kept.append(figure) or b"")
    monkeypatch.setattr(study, "write_atomically", lambda path, content: None)
    yield kept
    for name in ("study", "ablations", "mujoco_learning", "paper_runs"):
        sys.modules.pop(name, None)


def draw_stored(name, monkeypatch, *options):
    """Run a study's script on its stored rows, which have to be all that it asks for."""
    module = __import__(name)
    rows = ROOT / "benchmarks" / "runs" / f"{name.removesuffix('_learning')}.jsonl"
    monkeypatch.setattr(sys, "argv", [name, "--study", str(rows), "--plot", "picture.svg", *options])
    module.main()


def legend_of(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_pictures_are_small():
    assert len(PICTURES) >= 5
    assert [path.name for path in PICTURES if path.stat().st_size > 300_000] == []


def test_the_ablations_picture_speaks_in_words(figures, monkeypatch):
    draw_stored("ablations", monkeypatch)
    (figure,) = figures
    assert [axes.get_title() for axes in figure.axes] == [
        "angles as in the paper",
        "values' mean not removed",
        "no entropy reward (τ = 0)",
        "less entropy reward (τ = 0.5, not 2)",
        "episodes not cut at random",
    ]
    assert {axes.get_xlabel() for axes in figure.axes} == {"frames (millions)"}
    score = "RealAI score (0 to 1)"  # on the left of each row, whose panels have one scale
    assert [axes.get_ylabel() for axes in figure.axes] == [score, "", "", score, ""]
    assert legend_of(figure) == [
        "default preset", "with the change", "thick: mean of the seeds", "thin: one seed",
    ]  # fmt: skip


def test_the_mujoco_picture_explains_thick_and_thin_lines(figures, monkeypatch):
    draw_stored("mujoco_learning", monkeypatch, "--seeds", "0")
    (figure,) = figures
    returns = figure.axes[:3]  # reward rates and resets follow, of the runs that recorded them
    assert [axes.get_title() for axes in returns] == ["HalfCheetah-v5", "Hopper-v5", "Swimmer-v5"]
    assert {axes.get_xlabel() for axes in figure.axes} == {"frames (millions)"}
    assert {axes.get_ylabel() for axes in returns} == {"mean return (sum of rewards)"}
    assert legend_of(figure) == [
        "AR-EAPO (swingup)", "PPO (Stable-Baselines3)", "thick: mean of the seeds", "thin: one seed",
    ]  # fmt: skip
    for axes in returns:
        colours = [line.get_color() for line in axes.get_lines() if line.get_linewidth() < 1]
        assert len(set(colours)) == 2
        assert len(colours) + 2 == len(axes.get_lines())  # a mean for each learner


def test_the_papers_picture_has_runs_of_any_length(figures, monkeypatch, tmp_path):
    stored = ROOT / "benchmarks" / "runs" / "acrobot-paper-0.jsonl"
    stopped = tmp_path / "acrobot-paper-1.jsonl"
    stopped.write_text("".join(stored.read_text().splitlines(keepends=True)[:100]))
    monkeypatch.setattr(sys, "argv", ["paper_runs", str(stored), str(stopped), "--plot", "picture.svg"])
    __import__("paper_runs").main()
    (figure,) = figures
    (axes,) = figure.axes
    assert axes.get_title() == "acrobot"
    whole, short, mean, *_ = axes.get_lines()
    assert [len(line.get_xdata()) for line in (whole, short, mean)] == [458, 100, 100]
    assert legend_of(figure)[:2] == ["preset paper", "the paper's score"]
