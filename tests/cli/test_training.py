"""The command ``train``: its options, and the line that shows where a run stands."""

import math

import pytest

from swingup.areapo.config import Config, hyperparameters
from swingup.cli import main
from swingup.cli.hyperparameters import HyperparameterOptions, given_hyperparameters
from swingup.cli.progress import progress_line
from swingup.common.errors import SwingupError
from swingup.common.text import duration
from swingup.learner.report import TrainingReport


def report(frames, rate, reward, score, best):
    return TrainingReport(frames, rate, [{"reward": reward, "score": score}], best)


def test_the_line_by_hand():
    line = progress_line(report(3_000_000, 20_000.0, -0.25, 0.5, 0.75), 12_000_000, 1)
    # 9 million frames at 20,000 a second.
    assert line == "3,000,000 frames  20k/s  8 min left  reward -0.250  score 0.500  best 0.750"
    # Two seeds share the rate.
    assert "15 min left" in progress_line(report(3_000_000, 20_000.0, -0.25, 0.5, 0.75), 12_000_000, 2)


def test_the_line_names_resets_where_there_are_some():
    rows = [{"reward": 1.0, "score": 0.5, "termination_rate": rate} for rate in (0.001, 0.004)]
    report = TrainingReport(50_000, 20_000.0, rows, 0.75)
    assert progress_line(report, 100_000, 2, 99).endswith(" reward 1.000  resets 2.5/1k  score 0.500  best 0.750")
    assert progress_line(report, 100_000, 2).endswith(" left  resets 2.5/1k  score 0.500  best 0.750")
    never = [row | {"termination_rate": 0.0} for row in rows]
    assert "resets" not in progress_line(TrainingReport(50_000, 20_000.0, never, 0.75), 100_000, 2)


@pytest.mark.parametrize("reward", [0.0, -0.4935, -123456.789, 1e12, math.nan])
@pytest.mark.parametrize("rate", [0.51, 999.6, 21_340.0, 1_234_567.0])
@pytest.mark.parametrize("width", [80, 69])
def test_the_line_fits_a_narrow_terminal(reward, rate, width):
    for frames, goal in ((64, 12_000_000), (29_999_104, 30_000_000), (10**9, 10**10), (128, 64)):
        for score in (None, -math.inf, 0.955, 12345.678):
            best = -math.inf if score is None else score
            line = progress_line(report(frames, rate, reward, score, best), goal, 8, width)
            assert len(line) <= width
            assert line.startswith(f"{frames:,} frames  ")
            assert " left" in line


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(-3, "0 s"), (0.4, "0 s"), (99, "99 s"), (100, "2 min"), (5400, "90 min"), (7200, "2.0 h")],
)
def test_durations(seconds, words):
    assert duration(seconds) == words


@pytest.mark.parametrize("words", [("64", "32"), ("64,32",), ("64x32",)])
def test_one_spelling_of_several_numbers_and_two_that_are_understood(words):
    assert given_hyperparameters(HyperparameterOptions(policy_layers=words)) == {"policy_layers": (64, 32)}


def test_only_what_was_given():
    assert given_hyperparameters(HyperparameterOptions()) == {}
    options = HyperparameterOptions(
        learning_rate="3e-4", no_centre_values=True, state_dependent_std=True, num_envs="8"
    )
    assert given_hyperparameters(options) == {
        "learning_rate": 3e-4, "centre_values": False, "state_dependent_std": True, "num_envs": 8,
    }  # fmt: skip
    with pytest.raises(SwingupError, match="--centre-values and --no-centre-values exclude each other"):
        given_hyperparameters(HyperparameterOptions(centre_values=True, no_centre_values=True))


def test_help_has_every_hyperparameter_with_its_defaults(capsys):
    with pytest.raises(SystemExit):
        main(["train", "--help"])
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for name in hyperparameters():
        assert f"--{name.replace('_', '-')} " in text
    assert isinstance(Config().learning_rate, float)
    assert "Adam's step size. (0.0005; small, fast: 0.001; ppo, mujoco: 0.0003)" in text
    assert "(256x256; global: 128x128; small, fast, ppo, mujoco: 64x64)" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--learning-rate fast", "learning_rate = 'fast': use a number"),
        ("--num-envs 2.5", "num_envs = '2.5': use an integer"),
        ("--policy-layers 64 wide", "policy_layers = '64 wide': use integers"),
        ("--preset globall", "did you mean global?"),
        ("--terminations ends", "did you mean end?"),
        ("--gain often", "'often'"),
    ],
)
def test_bad_options_get_a_line(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["train", "acrobot", *words.split()]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
