"""Logs of a simulated pendulum, without JAX: quick to make."""

import math

import numpy as np

from swingup.common.table import write_columns
from swingup.plant.equations import coriolis, gravity, lump, mass_entries
from swingup.plant.plant import load_plant

C1 = load_plant("C.1")


def write_log(path, plant=C1, duration=3.0, x0=(1.5, -0.8, 0.0, 0.0), driven=True, dt=0.002):
    """A swing of 500 rows a second, with a slow torque on the shoulder, as RealAIGym logs it."""
    time = dt * np.arange(round(duration / dt))
    u = np.zeros((len(time), 2))
    u[:, 0] = 1.2 * np.sin(5.0 * time) if driven else 0.0
    x, rows = np.array(x0), []
    for torque in u:
        rows.append(x)
        middle = x + 0.5 * dt * _rates(plant, x, torque)
        x = x + dt * _rates(plant, middle, torque)
    x = np.array(rows)
    columns = {"time": time, "pos_meas1": x[:, 0], "pos_meas2": x[:, 1], "vel_meas1": x[:, 2], "vel_meas2": x[:, 3]}
    write_columns(path, columns | {"tau_con1": u[:, 0], "tau_con2": u[:, 1]})
    return path


def _rates(p, x, u):
    q1, q2, dq1, dq2 = x
    plant = lump(p)
    m11, m12, m22 = mass_entries(plant, math.cos(q2))
    pull = gravity(plant, math.sin(q1), math.sin(q1 + q2))
    swing = coriolis(plant, math.sin(q2), dq1, dq2)
    right = [
        u[i] + pull[i] - swing[i] - b * v - cf * math.atan(100.0 * v)
        for i, (b, cf, v) in enumerate(((p.b1, p.cf1, dq1), (p.b2, p.cf2, dq2)))
    ]
    determinant = m11 * m22 - m12**2
    return np.array([
        dq1, dq2, (m22 * right[0] - m12 * right[1]) / determinant, (m11 * right[1] - m12 * right[0]) / determinant,
    ])  # fmt: skip
