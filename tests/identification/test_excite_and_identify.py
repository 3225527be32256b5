"""An excitation, played on a plant of the prior, lets identify find that plant."""

import numpy as np
import pytest

from swingup.common.table import write_columns
from swingup.identification.excite.excite import excite
from swingup.identification.excite.prior import draw_models, prior_around
from swingup.identification.excite.rollouts import Sequences, simulate
from swingup.identification.fit.prediction import INDEX, integration_of
from swingup.identification.identify import identify
from swingup.identification.results import TITLES
from swingup.plant.plant import load_plant

QUANTUM = 3.81e-4


@pytest.mark.slow
def test_the_plant_is_found(tmp_path):
    plant = load_plant("C.1")
    prior = prior_around(plant)
    excitation = excite(prior, duration=6.0, seed=1)
    truth = draw_models(prior, 4, 123)[3:]
    limits = np.array(excitation.limits.torque)
    play = Sequences(excitation.torque[None], excitation.state[None], excitation.feedback, limits)
    motion = simulate(integration_of(plant), truth, play, keep=True)
    q = QUANTUM * np.round(motion.states[0, 0, :, :2] / QUANTUM)
    columns = {"time": excitation.time, "pos_meas1": q[:, 0], "pos_meas2": q[:, 1]}
    columns |= {f"tau_con{joint + 1}": motion.torque[0, 0, :, joint] for joint in (0, 1)}
    write_columns(tmp_path / "log.csv", columns)
    found = identify([tmp_path / "log.csv"]).estimates
    truth[0, INDEX["A"]] -= truth[0, INDEX["B"]]  # results have what link 1 adds
    for name in ("k", "m2r2", "A", "B", "cf1", "cf2"):
        title, value = TITLES.get(name, name), truth[0, INDEX[name]]
        assert found.values[title] == pytest.approx(value, rel=0.08)
        assert found.determined[title]
