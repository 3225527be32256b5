"""Recordings that nobody recorded: invented motions, and honest runs with other numbers in them."""

import dataclasses

import numpy as np

from swingup.benchmark.rollout import Trajectory
from swingup.plant.equations import coriolis, gravity, mass_entries
from swingup.plant.plant import LEADERBOARD, lump

PLANT = lump(LEADERBOARD)
ROWS = 5000
TIME = 0.002 * np.arange(ROWS)
REST = (0.0, 0.0, 0.0)


def smooth(time, duration):
    """From 0 to 1 in some time with the least jerk, and its first and second derivative."""
    s = np.clip(time / duration, 0.0, 1.0)
    bend = 60 * s * (1 - s) * (1 - 2 * s) / duration**2
    return np.array([s**3 * (10 - 15 * s + 6 * s**2), 30 * (s * (1 - s)) ** 2 / duration, bend])


def straight(time, duration):
    moving = (time > 0) & (time < duration)
    return np.array([np.clip(time / duration, 0.0, 1.0), moving / duration, 0.0 * time])


def moved(q1, q2=REST, driven=()):
    """A motion by its angles and their derivatives, with the torques on some joints that it needs."""
    (q1, v1, a1), (q2, v2, a2) = (np.array([np.broadcast_to(part, ROWS) for part in each]) for each in (q1, q2))
    m11, m12, m22 = mass_entries(PLANT, np.cos(q2))
    pulls = gravity(PLANT, np.sin(q1), np.sin(q1 + q2))
    swings = coriolis(PLANT, np.sin(q2), v1, v2)
    needed = m11 * a1 + m12 * a2 + swings[0] - pulls[0], m12 * a1 + m22 * a2 + swings[1] - pulls[1]
    u = np.column_stack([needed[joint] if joint in driven else 0.0 * q1 for joint in (0, 1)])
    return Trajectory(TIME, np.column_stack([q1, q2, v1, v2]), np.clip(u, -6.0, 6.0))


def noisy(rows, random, velocity=0.05, angle=0.0, torque=0.0):
    """The same with noise (rad/s, rad, N m)."""
    x = rows.x + random.normal(0, 1, rows.x.shape) * [angle, angle, velocity, velocity]
    return dataclasses.replace(rows, x=x, u=rows.u + torque * random.normal(0, 1, rows.u.shape))


def measured(rows, random):
    """As if from a robot: angles in an encoder's steps, velocities from differences, uneven periods."""
    q = 3.81e-4 * np.round(rows.x[:, :2] / 3.81e-4)
    time = rows.time + random.uniform(0, 2e-4, len(rows.time))
    v = np.vstack([np.zeros((1, 2)), np.diff(q, axis=0) / np.diff(time)[:, None]])
    return Trajectory(time - time[0], np.column_stack([q, v]), rows.u)


def picked(rows, kept, time=None):
    return Trajectory(rows.time[kept] if time is None else time, rows.x[kept], rows.u[kept])


def at(rows, times, time=None):
    """The rows of some times, as if they were those of others."""
    table = np.column_stack([np.interp(times, rows.time, column) for column in (*rows.x.T, *rows.u.T)])
    return Trajectory(times if time is None else time, table[:, :4], table[:, 4:])


def scaled(rows, velocity=1.0, torque=1.0):
    return dataclasses.replace(rows, x=rows.x * [1, 1, velocity, velocity], u=torque * rows.u)


def averaged(rows, count):
    u = [np.convolve(column, np.ones(count) / count, mode="same") for column in rows.u.T]
    return dataclasses.replace(rows, u=np.column_stack(u))


def held(rows, start):
    """Upright at rest from a row on, without torque."""
    x, u = rows.x.copy(), rows.u.copy()
    x[start:], u[start:] = [np.pi, 0, 0, 0], 0.0
    return dataclasses.replace(rows, x=x, u=u)


def invented(random, joint):
    """Motions from hanging to upright that no pendulum made, by name."""
    hanging, upright = moved(REST), moved((np.pi, 0.0, 0.0))
    found = {
        "teleport after two rows": held(hanging, 2),
        "teleport": held(hanging, int(random.integers(100, 1000))),
        "upright from the start": upright,
        "leaning on a torque from the start": moved((np.pi - 0.2, 0.0, 0.0), driven=(0, 1)),
        "three rows": Trajectory(np.array([0.0, 0.001, 10.0]), upright.x[:3] * [[0], [1], [1]], np.zeros((3, 2))),
        "in a gap": picked(moved(np.pi * straight(TIME, 0.8)), np.r_[0:50, 450:ROWS]),
        "ramp to a leaning pose": noisy(moved((np.pi - 0.2) * straight(TIME, 1.0), driven=(joint,)), random),
    }
    for duration in (1.0, 2.0, 3.0, 5.0, 8.0):
        found[f"ramp of {duration:g} s, noise"] = noisy(moved(np.pi * straight(TIME, duration)), random)
    for duration in random.uniform([0.3, 0.8, 2.0, 5.0], [0.8, 2.0, 5.0, 9.0]):
        ramp, spline = np.pi * straight(TIME, duration), np.pi * smooth(TIME, duration)
        spin = 2 * np.pi * smooth(TIME, duration)
        late = np.pi * smooth(TIME - random.uniform(0.1, 0.5), duration)
        fold = 2.0 * (smooth(TIME, duration / 2) - smooth(TIME - duration / 2, duration / 2))
        push = np.outer(duration > TIME, np.eye(2)[joint] * 7.65 / np.pi)
        found |= {
            f"{name}, {duration:.2g} s": rows
            for name, rows in {
                "ramp": moved(ramp),
                "spline": moved(spline),
                "spline, noise on every column": noisy(moved(late), random, angle=2e-4, torque=1e-3),
                "spline, as from a robot": measured(moved(late), random),
                "spline by both motors": moved(spline, driven=(0, 1)),
                "spline by its motor": moved(spline, driven=(joint,)),
                "spline by a constant torque": measured(dataclasses.replace(moved(spline), u=push), random),
                "folded": noisy(moved(spline, fold), random),
                "elbow turned": noisy(moved(ramp, spin), random),
            }.items()
        }
    return found


def changed(rows, random):
    """An honest swing-up with other numbers in it, by name; those that cannot gain 0.1 by it come second."""
    time, last = rows.time, rows.time[-1]
    down = np.flatnonzero(-0.2 * np.cos(rows.x[:, 0]) - 0.3 * np.cos(rows.x[:, 0] + rows.x[:, 1]) <= 0.45)
    up = int(down[-1]) + 1
    hasty = at(rows, np.minimum(1.25 * time, last), time)
    no_torque = scaled(rows, torque=0.0)
    gross = {
        "no torques": no_torque,
        "no torques, as from a robot": measured(no_torque, random),
        "a third of the torques": noisy(scaled(rows, torque=0.3), random),
        "torques reversed": scaled(rows, torque=-1.0),
        "mirrored without its torques": scaled(dataclasses.replace(rows, x=-rows.x)),
        "torques on the other joint": dataclasses.replace(rows, u=rows.u[:, ::-1]),
        "no velocities": scaled(rows, velocity=0.0),
        "velocities x 0.97": scaled(rows, velocity=0.97),
        "5 kHz": at(rows, np.arange(0.0, last, 0.0002)),
        "100 Hz": picked(rows, slice(None, None, 5)),
        "held as soon as it is up": held(rows, up),
        "held as soon as it is up, as from a robot": measured(held(rows, up), random),
        "twice as fast, as from a robot": measured(at(rows, np.minimum(2 * time, last), time), random),
    }
    fine = {
        "torques x 0.9": scaled(rows, torque=0.9),
        "rows twice": picked(rows, np.repeat(np.arange(ROWS), 2), 0.001 * np.arange(2 * ROWS)),
        "faster, as from a robot": measured(hasty, random),
        "noise on every column": noisy(rows, random, 0.1, 1e-3, 0.01),
        "averaged torques, as from a robot": measured(averaged(rows, 25), random),
        "no torques once it is up": dataclasses.replace(rows, u=np.where((time < time[up])[:, None], rows.u, 0.0)),
    } | {f"torques averaged over {count} rows": averaged(rows, count) for count in (5, 25, 101)}
    return gross, fine
