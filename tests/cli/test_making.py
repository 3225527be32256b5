"""The command make-controller: what it writes beside a header, and what it refuses first."""

from pathlib import Path

import pytest

from refusals import refusal
from swingup import load_plant
from swingup.cli import making
from swingup.cli.making import make_controller_command
from swingup.common.errors import SwingupError
from swingup.loop.resolve import resolve
from swingup.policy.feedback import load_robot_policy
from swingup.policy.shipped import load_pendulum_policy

FACTS = "plant leaderboard --set tl1=0 --out mine.yml"


def test_what_is_refused_before_anything_is_made(run, tmp_path):
    run(FACTS)
    told = {
        "has two motors: name --robot": ("C.1",),
        "has no motor": ("idle.yml",),
        "2 files, the first of a plant": ("mine.yml", "a.csv"),
    }
    run("plant C.1 --set tl1=0 tl2=0 --out idle.yml")
    # Logs that nobody has read yet: the plant to start from says as much.
    assert "has two motors: name --robot" in refusal(make_controller_command, ("a.csv",), out="policy.h")
    for text, sources in told.items():
        assert text in refusal(make_controller_command, sources, out="policy.h")
    for name, value in {"seed": -1, "frames": 0, "domain": "moon"}.items():
        assert str(value) in refusal(make_controller_command, ("a.csv",), out="policy.h", **{name: value})
    assert "--columns is for logs" in refusal(make_controller_command, ("mine.yml",), out="x.h", columns=("q1=a",))
    assert {each.name for each in tmp_path.iterdir()} - {"cache"} == {"mine.yml", "idle.yml"}


@pytest.mark.slow
def test_from_a_plant_to_a_header_with_its_zeros(run, tmp_path):
    run(FACTS)
    with open("mine.yml", "a") as file:
        file.write("delay: 0.004\n")
    text = (tmp_path / "mine.yml").read_text().replace("zero1: 0.0", "zero1: 0.04")
    (tmp_path / "mine.yml").write_text(text)
    told = run("make-controller mine.yml --seeds 2 --out policy.h")
    assert "2 of 2" in told
    assert "refine" not in told
    policy, plant = load_pendulum_policy("policy.safetensors"), load_plant("mine.yml")
    assert (policy.robot.name, policy.parts) == ("acrobot", ("estimator", "guard", "regulator"))
    assert policy.plant == plant
    assert policy.metadata["base"]["policy"] == "adaptive"
    header = (tmp_path / "policy.h").read_text()
    assert "swingup_zeros[2] = {4.e-02, 0.e+00}" in header


@pytest.mark.slow
def test_from_two_logs_to_a_header(run, tmp_path):
    logs = Path(__file__).parents[2] / "examples" / "logs"
    sources = [str(logs / f"C1-excitation-{number}.csv") for number in (1, 2)]
    told = run("make-controller", *sources, "--robot", "acrobot", "--seeds", "2", "--out", "policy.h")
    assert "2 of 2" in told
    assert load_pendulum_policy("policy.safetensors").robot.name == "acrobot"
    assert load_plant("policy-plant.yml").l1 == load_plant("C.1").l1  # which no motion tells
    assert resolve("policy-plant.yml", "policy-plant-domain.yml").names
    assert "swingup_zeros[2]" in (tmp_path / "policy.h").read_text()


def lacks_swing_up(*_, **__):
    raise SwingupError("the swing-up of tvlqr does not come up")


@pytest.mark.slow
def test_tvlqr_where_the_search_finds_nothing(run, tmp_path, monkeypatch):
    monkeypatch.setattr(making, "find_policies", lambda *_, **__: [])
    run(FACTS)
    with open("mine.yml", "a") as file:
        file.write("delay: 0.002\n")
    told = run("make-controller mine.yml --seeds 2 --out policy.h")
    assert "2 of 2" in told
    again = "swingup evaluate acrobot --board=sim2real --controller=policy.safetensors --plant=mine.yml"
    assert again in told
    header = (tmp_path / "policy.h").read_text()
    assert "The baseline tvlqr behind its state estimator and its safety guard" in header
    assert load_robot_policy("policy.safetensors").name == "tvlqr"
    assert "of 2" in run(again.removeprefix("swingup "), "--seeds", "2")


@pytest.mark.slow
def test_a_weak_motor_needs_a_training(run, tmp_path, monkeypatch):
    monkeypatch.setattr(making, "find_policies", lambda *_, **__: [])  # What a long search finds
    monkeypatch.setattr(making, "feedback_policy", lacks_swing_up)
    run("plant leaderboard --set tl1=0 tl2=1.5 --out mine.yml")
    told = run("make-controller mine.yml --frames 4096 --seeds 2 --out policy.h")
    assert "swingup refine acrobot --recipe=adapt --plant=mine.yml" in told
    assert load_pendulum_policy("policy.safetensors").parts == ("estimator", "guard")
    # A second call goes on with the run that is there, which has reached its frames.
    run("make-controller mine.yml --frames 4096 --seeds 2 --to realaigym --out policy")
    assert (tmp_path / "policy" / "con_swingup.py").exists()
