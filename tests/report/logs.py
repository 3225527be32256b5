"""Logs of a simulated pendulum, without JAX: quick to make."""

import numpy as np

from swingup.common.table import write_columns
from swingup.plant.equations import NUMPY, damped_midpoint_step
from swingup.plant.files import load_plant
from swingup.plant.plant import lump

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
