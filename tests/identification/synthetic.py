"""Logs of a simulated pendulum, with a loop's delay, lag, quanta and uneven periods."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from swingup.dynamics.integrate import implicit_step
from swingup.plant.equations import Friction
from swingup.plant.files import load_plant
from swingup.plant.plant import lump

STEP = 0.001
QUANTUM = 3.81e-4
TRUTH = dataclasses.replace(
    load_plant("C.1"), r1=0.17, r2=0.262, I1=0.03, I2=0.052, Ir=1e-4, b1=0.004, b2=0.003, cf1=0.11, cf2=0.09
)
OFFSETS = np.array([0.012, -0.02])
DELAY = 0.003
"""Whole steps, so that the log knows it exactly; there is no lag."""
HEADER = "time,pos_meas1,pos_meas2,vel_meas1,vel_meas2,tau_con1,tau_con2"


def simulate(seconds=6.0, seed=0, torque=(2.0, 1.2), start=(0.0, 0.0, 0.0, 0.0)):
    """A table with the columns of ``HEADER``: rows 2 or 3 ms apart."""
    random = np.random.default_rng(seed)
    rows = np.concatenate([[0], np.cumsum(random.choice([2, 2, 2, 3], 2 * int(seconds / STEP)))])
    rows = rows[rows < int(seconds / STEP)]
    time = STEP * np.arange(int(seconds / STEP))
    frequency, phase = random.uniform(0.2, 2.5, (2, 4)), random.uniform(0, 2 * np.pi, (2, 4))
    waves = np.sin(2 * np.pi * frequency[..., None] * time + phase[..., None]).mean(axis=1)
    commands = (2 * np.array(torque)[:, None] * waves).T[rows]
    held = commands[np.searchsorted(rows, np.arange(len(time)), "right") - 1]
    late = np.concatenate([np.zeros((round(DELAY / STEP), 2)), held])[: len(time)]
    with jax.enable_x64(True):
        states = np.asarray(_simulated(jnp.array(start, float), jnp.array(late)))[rows]
    angles = np.round((states[:, :2] + OFFSETS) / QUANTUM) * QUANTUM
    rates = np.diff(angles, axis=0) / np.diff(time[rows])[:, None]
    return np.column_stack([time[rows], angles, np.concatenate([rates[:1], rates]), commands])


@jax.jit
def _simulated(x0, torques):
    return jax.lax.scan(lambda x, u: (step(TRUTH, x, u, STEP), x), x0, torques)[1]


def step(plant, x, u, dt):
    """A step of the integrator with implicit friction."""
    friction = Friction((plant.b1, plant.b2), (plant.cf1, plant.cf2))
    return jnp.stack(implicit_step(lump(plant), friction, x, u, dt))


def write(path, table, header=HEADER):
    """A CSV file of it."""
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    return path
