"""Pages about logs: comparisons, in which errors of the right plant vanish, and identifications."""

import dataclasses
import json

import numpy as np
import pytest
import yaml

from refusals import refusal
from swingup.benchmark.log_comparison import close_loop, compare
from swingup.cli import main
from swingup.common.table import write_columns
from swingup.identification import prediction
from swingup.identification.identify import Identification
from swingup.identification.prediction import INDEX, integration_of, vector_of
from swingup.identification.recording import read_recording
from swingup.identification.results import Estimates
from swingup.identification.scoring import (
    by_speed,
    predict_log,
    predicted_curves,
    prediction_errors,
    score_windows,
    summarise,
)
from swingup.identification.segments import INTERVAL, Segments, cut_windows
from swingup.loop.resolve import resolve
from swingup.plant.equations import NUMPY, damped_midpoint_step
from swingup.plant.files import load_plant
from swingup.plant.plant import ROBOTS, lump
from swingup.report.log_report import report_comparison, report_identification
from swingup.report.page import render_log_page

from .pages import parts_of

PERFECT = {"delay": 0.0, "lag": 3e-4}
"""The loop of the simulated logs; with it nothing is fitted."""


@pytest.fixture(scope="module", autouse=True)
def _small_programs():
    """Few windows at a time: a log of 3 s has no more."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prediction, "CHUNK", 32)
        yield


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return write_log(tmp_path_factory.mktemp("logs") / "run_$1.csv")


@pytest.fixture(scope="module")
def comparison(log):
    heavy = dataclasses.replace(C1, I2=1.3 * C1.I2, name="heavy")
    plants = {
        "right": resolve(domain={"plant": "C.1", **PERFECT}),
        "heavy": resolve(domain={"plant": heavy, **PERFECT}),
    }
    found = compare(log, plants)
    run = close_loop(found.recording, lambda x, t: [0.5, 0.0], "mine:push", ROBOTS["pendubot"], plants["right"])
    return dataclasses.replace(found, runs={"right": run})


def test_a_lag_that_the_model_would_cut_is_refused(log):
    slow = resolve(domain={"plant": "C.1", **PERFECT, "lag": 0.05})
    assert "slow has a lag of 0.05 s: a comparison takes up to 0.008 s" in refusal(compare, log, {"slow": slow})


def test_the_right_plant_predicts_and_another_does_not(comparison):
    right, heavy = (each.horizons for each in comparison.predictions)
    assert comparison.predictions[0].fitted == ()  # delay and lag come from the domain
    # What is left is the integrators' difference and the lag of 0.3 ms.
    assert right["0.25"].angle < 2e-3
    assert right["1"].angle < 2e-2
    assert all(heavy[key].angle > 10 * right[key].angle for key in right)
    assert right["1"].windows < right["0.5"].windows


def test_windows_are_grouped_by_their_fastest_joint():
    states = np.zeros((8, 11, 4))
    states[:, 0, 3] = [8, 7, 6, 5, 4, 3, 2, 1]
    windows = Segments(np.zeros(8, int), np.arange(8.0), INTERVAL * np.arange(11), states, np.zeros((8, 1, 2)))
    rows = by_speed(windows, np.tile(states[:, :1, 3:], (1, 10, 4)))
    found = [(row.slowest, row.fastest, row.errors.windows) for row in rows]
    assert found == [(speed, speed + 1.0, 2) for speed in (1.0, 3.0, 5.0, 7.0)]
    assert rows[0].errors.angle == pytest.approx(np.sqrt((1 + 4) / 2))


@pytest.mark.slow
def test_delay_and_lag_that_nobody_says_are_fitted(log):
    found = predict_log(read_recording(log), resolve(domain={"plant": "C.1"}), "C.1")
    assert found.fitted == ("delay", "lag")
    assert found.as_dict()["model"]["delay"] + found.as_dict()["model"]["lag"] < 1.5e-3


def test_drawn_predictions_pass_through_the_log(comparison):
    recording, right = comparison.recording, comparison.predictions[0]
    windows = cut_windows(recording, 0.5, stride=0.5, minimum_speed=0.0)
    drawn = predicted_curves(right.setting, right.model, windows)
    row = np.searchsorted(recording.time, drawn.times[0, 7])  # between two predicted states
    assert drawn.states[0, 7, :2] == pytest.approx(recording.q[row], abs=0.02)


def test_nothing_is_drawn_across_a_gap(comparison):
    recording = comparison.recording
    kept = (recording.time < 1.0) | (recording.time > 1.5)
    rows = {name: each[kept] for name, each in vars(recording).items() if np.shape(each)[:1] == kept.shape}
    torn = dataclasses.replace(recording, **rows)
    [position, *_] = report_comparison(dataclasses.replace(comparison, recording=torn)).parts[0].figure.panels
    log = position.curves[0]
    inside = (np.asarray(log.x) > 1.0) & (np.asarray(log.x) < 1.5)
    assert inside.any()
    assert np.isnan(np.asarray(log.y)[inside]).all()
    assert np.isfinite(np.asarray(log.y)[~inside]).mean() > 0.9


def test_the_page_stands_alone(comparison):
    markup, data = parts_of(render_log_page(report_comparison(comparison)))
    assert [len(figure["panels"]) for figure in data["figures"]] == [5, 2, 2, 5]
    for text in ("Errors by horizon", "Errors by speed", "Closed loop: right", "mine:push on the pendubot"):
        assert text in markup


def test_the_command(log, tmp_path, capsys):
    (tmp_path / "mine.yml").write_text(yaml.safe_dump(C1.values() | PERFECT))
    out = tmp_path / "compare.html"
    assert main(["compare", str(log), "--plant", str(tmp_path / "mine.yml"), "--out", str(out), "--json"]) == 0
    (plant,) = json.loads(capsys.readouterr().out)["plants"].values()
    assert plant["errors"]["0.25"]["angle"] < 2e-3
    assert [row["windows"] for row in plant["speeds"]]
    assert 20_000 < out.stat().st_size < 300_000
    for named in (["--plant", "nothing"], ["--domain", "recorded"], ["--robot", "acrobot"], ["--seed", "0"]):
        assert main(["compare", str(log), *named]) == 2
        assert named[-1] in capsys.readouterr().err


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    recording = read_recording(write_log(tmp_path_factory.mktemp("logs") / "<log>.csv"))
    setting, windows = integration_of(C1), score_windows([recording])
    fitted = vector_of(C1, delay=0.0, lag=3e-4)
    start = fitted.copy()
    start[INDEX["B"]] *= 1.3
    estimates = Estimates(
        {"I2": 0.05, "b1": 0.002, "cf1": 0.16, "b2": 0.0, "cf2": 0.12},
        {"I2": (0.049, 0.051), "b1": (0.001, 0.003), "cf1": (0.15, 0.17)},
        {"I2": True, "b1": False, "cf1": True},
    )
    errors = {
        name: summarise(prediction_errors(setting, row[None], windows))
        for name, row in {"fitted": fitted, "start": start}.items()
    }
    return Identification(
        C1, estimates, errors, {}, ("one <note>",), "heavy", setting, [recording], fitted[None], start[None],
        windows,
    )  # fmt: skip


def test_the_page_has_parameters_errors_windows_residuals_and_friction(found):
    study = report_identification(found)
    titles = [part.title for part in study.parts]
    assert titles == ["Parameters", "Held-out errors", "Held-out windows: <log>.csv", "Residuals", "Friction"]
    rows = [list(row) for part in study.parts[:2] for table in part.tables for row in table.rows]
    assert rows[1] == ["b1", "0.002", "0.001 to 0.003", "no"]
    assert [row[0] for row in rows[3:]] == ["0.1", "0.25", "0.5"]
    assert all(float(row[2]) > 10 * float(row[1]) for row in rows[3:])  # the start's angle beside the fitted
    markup, _ = parts_of(render_log_page(study))
    assert "one &lt;note&gt;" in markup
    assert "<log>" not in markup


def test_residuals_of_the_right_plant_are_small(found):
    for panel in report_identification(found).parts[-2].figure.panels:
        start, fitted = (np.median(np.abs(curve.y)) for curve in panel.curves)
        assert fitted < 0.2 * start


C1 = load_plant("C.1")


def write_log(path):
    """A swing of C.1 for 3 s, 500 rows a second, with a slow torque on the shoulder, as RealAIGym logs it."""
    time = 0.002 * np.arange(1500)
    u = np.outer(1.2 * np.sin(5.0 * time), [1.0, 0.0])
    lumped, x, rows = lump(C1), (1.5, -0.8, 0.0, 0.0), []
    for torque in u.tolist():
        rows.append(x)
        x = damped_midpoint_step(lumped, C1.friction, x, torque, 0.002, NUMPY)
    x = np.array(rows)
    columns = {"time": time, "pos_meas1": x[:, 0], "pos_meas2": x[:, 1], "vel_meas1": x[:, 2], "vel_meas2": x[:, 3]}
    write_columns(path, columns | {"tau_con1": u[:, 0], "tau_con2": u[:, 1]})
    return path
