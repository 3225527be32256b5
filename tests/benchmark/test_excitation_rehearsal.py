"""Which parameters the log of an excitation tells, against a truth that is known."""

import json

import pytest

from refusals import refusal
from swingup.benchmark.excitation_rehearsal import Found, rehearse_identification
from swingup.cli import main, pendulums
from swingup.cli.pendulums import identify_command
from swingup.identification import excitation
from swingup.identification.excitation import excite


def test_a_parameter_passes_near_the_truth_with_an_interval_that_says_so():
    assert Found("k", 1.0, 1.09, (1.0, 1.2), 0.1).passes
    assert not Found("k", 1.0, 1.11, (1.0, 1.2), 0.1).passes
    assert not Found("k", 1.0, 1.0, (0.5, 1.5), 0.1).passes


def test_what_is_no_excitation_is_named(tmp_path):
    (tmp_path / "log.csv").write_text("time,pos1,pos2\n0,0,0\n")
    assert "is not an excitation" in refusal(lambda: rehearse_identification("C.1", tmp_path / "log.csv"))
    ignored = {"rehearse": "C.1", "out": (str(tmp_path / "mine.yml"),)}
    assert "--out does not go with --rehearse" in refusal(identify_command, ("log.csv",), **ignored)


@pytest.mark.parametrize(("value", "status"), [(1.0, 0), (1.2, 1)])
def test_the_command_says_what_a_log_would_not_tell(value, status, monkeypatch, capsys):
    found = [Found("k", 1.0, 1.0, (0.9, 1.1), 0.1), Found("m2 r2", 1.0, value, (0.9, 1.3), 0.1)]
    monkeypatch.setattr(pendulums, "rehearse_identification", lambda plant, file, seed: found)
    assert main(["identify", "log.csv", "--rehearse", "C.1"]) == status
    told = capsys.readouterr().out
    assert ("its log would not tell m2 r2" in told) == bool(status)
    assert main(["identify", "log.csv", "--rehearse", "C.1", "--json"]) == status
    assert [row["passes"] for row in json.loads(capsys.readouterr().out)] == [True, not status]


@pytest.mark.slow  # two identifications
def test_a_strong_excitation_tells_the_masses_and_a_weak_one_does_not(tmp_path, monkeypatch):
    monkeypatch.setattr(excitation, "CHECKED_PLANTS", 8)
    excite("C.1", duration=10.0).save(tmp_path / "strong.csv")
    excite("C.1", duration=3.0, torque=0.5).save(tmp_path / "weak.csv")
    strong, weak = (
        {each.name: each for each in rehearse_identification("C.1", tmp_path / f"{name}.csv")}
        for name in ("strong", "weak")
    )
    for name in ("m1 r1 + m2 l1", "m2 r2", "I2"):
        assert strong[name].passes, strong[name]
    assert sum(each.passes for each in weak.values()) < sum(each.passes for each in strong.values())
