"""The page of an identification: its parts, from a hand-made result."""

import re

import numpy as np
import pytest

from swingup.identification.fit.prediction import INDEX, integration_of, vector_of
from swingup.identification.fit.scoring import prediction_errors, score_windows, summarise
from swingup.identification.identify import Identification
from swingup.identification.log.recording import read_recording
from swingup.identification.results import Estimates
from swingup.report.log_report import report_identification
from swingup.report.page import render_log_page

from .logs import C1, write_log


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
        C1,
        estimates,
        errors,
        {},
        ("one <note>",),
        "heavy",
        setting,
        [recording],
        fitted[None],
        start[None],
        windows,
    )


def test_the_page_has_parameters_errors_windows_residuals_and_friction(found):
    study = report_identification(found)
    titles = [part.title for part in study.parts]
    assert titles == ["Parameters", "Held-out errors", "Held-out windows: <log>.csv", "Residuals", "Friction"]
    rows = [list(row) for part in study.parts[:2] for table in part.tables for row in table.rows]
    assert rows[1] == ["b1", "0.002", "0.001 to 0.003", "no"]
    assert [row[0] for row in rows[3:]] == ["0.1", "0.25", "0.5"]
    assert all(float(row[2]) > 10 * float(row[1]) for row in rows[3:])  # the start's angle beside the fitted
    markup = re.sub(r"<script.*?</script>|<style.*?</style>", "", render_log_page(study), flags=re.DOTALL)
    assert "one &lt;note&gt;" in markup
    assert "<log>" not in markup


def test_friction_lies_within_its_band(found):
    panel = report_identification(found).parts[-1].figure.panels[0]
    fitted, start = panel.curves
    assert np.all((fitted.interval[:, 0] <= fitted.y) & (fitted.y <= fitted.interval[:, 1]))
    fast = fitted.x[-1]
    slope = np.arctan(found.setting.steepness * fast)
    assert fitted.y[-1] == pytest.approx(0.002 * fast + 0.16 * slope)
    assert start.y[-1] == pytest.approx(C1.b1 * fast + C1.cf1 * slope)


def test_residuals_of_the_right_plant_are_small(found):
    residuals = report_identification(found).parts[-2]
    for panel in residuals.figure.panels:
        start, fitted = (np.abs(curve.y) for curve in panel.curves)
        assert np.median(fitted) < 0.2 * np.median(start)
