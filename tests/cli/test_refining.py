"""The command that refines."""

import numpy as np
import pytest

from policies import lone_policy
from swingup.cli import main, refining
from swingup.common.settings import read_settings
from swingup.policy.estimator.settings import EstimatorSettings
from swingup.refine.analytic_policy_gradient import PolicyGradientSettings
from swingup.refine.episodes import EpisodeSettings
from swingup.refine.recipe import GradientStage

TINY = GradientStage(
    PolicyGradientSettings(iterations=2, learning_rate=1e-4, duration=0.02),
    EpisodeSettings(nominal=2, anywhere=0, thrown=0),
)


@pytest.mark.slow
def test_refine_writes_a_policy_with_its_origin(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(refining.RECIPES, "recover", (TINY,))
    out = tmp_path / "refined.safetensors"
    assert main(["refine", "pendubot", "--out", str(out), "--seed", "3"]) == 0
    assert "swingup evaluate pendubot" in capsys.readouterr().out
    policy, metadata = lone_policy(out, "pendubot")
    base, origin = lone_policy("ar-eapo", "pendubot")
    assert metadata["command"] == (
        "swingup refine pendubot --policy=ar-eapo --recipe=recover --seed=3 --out=refined.safetensors"
    )
    assert metadata["base"]["frames"] == origin["frames"]
    assert metadata["stages"][0]["gradient"]["iterations"] == 2
    assert read_settings(metadata, EstimatorSettings) == EstimatorSettings()
    moved = np.abs(policy.policy.actor.mean_head.weight - base.policy.actor.mean_head.weight).max()
    assert 0 < moved < 1e-3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("acrobot --recipe magic --out x.safetensors", "unknown recipe 'magic': use one of recover, adapt"),
        ("acrobot --seed -1 --out x.safetensors", "seed = -1: use a whole number from 0"),
        ("acrobot --out missing/x.safetensors", "missing"),
        ("acrobot --policy none.safetensors --out x.safetensors", "no such file: none.safetensors"),
        ("cartpole --out x.safetensors", "unknown robot 'cartpole'"),
    ],
)
def test_bad_input_is_one_line_and_leaves_no_file(options, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["refine", *options.split()]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
