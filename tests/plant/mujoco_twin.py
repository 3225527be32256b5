"""A model file read by this package beside MuJoCo's own reading of it."""

import numpy as np

from benchmark.independent import derivative
from swingup.plant.model_files.files import read_model
from swingup.plant.plant import make_plant

ASKED = {"l2": 1.0, "tl1": 1.0, "tl2": 1.0}
"""What a file need not say, and no acceleration depends on."""


def largest_difference(mujoco, path, speed=4.0, slowest=0.0):
    """Between the accelerations of both readings in random states, relative to 1 rad/s² and the acceleration.

    Args:
        mujoco: the module.
        path: of the file.
        speed: deviation of the rates (rad/s).
        slowest: least rate, above which dry friction is MuJoCo's.
    """
    found = read_model(path, "centre")
    plant = make_plant(ASKED | found.facts, "the file").values()
    model = mujoco.MjModel.from_xml_path(str(path))
    data, random, worst = mujoco.MjData(model), np.random.default_rng(0), 0.0
    signs, offsets = np.array(found.angles).T
    for _ in range(20):
        rates = speed * random.normal(size=2)
        data.qpos[:], data.qvel[:] = random.uniform(-3, 3, 2), rates + slowest * np.sign(rates)
        data.ctrl[:] = random.uniform(-1, 1, model.nu)
        mujoco.mj_forward(model, data)
        q, dq, u = offsets + signs * data.qpos, signs * data.qvel, signs * data.qfrc_actuator
        error = derivative(plant, np.concatenate([q, dq]), u)[2:] - signs * data.qacc
        worst = max(worst, np.max(np.abs(error) / (1 + np.abs(data.qacc))))
    return worst
