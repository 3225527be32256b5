"""The benchmark's closed loop written a second time, in plain NumPy, from its definition: for comparison only."""

import math

import numpy as np


def derivative(p, x, u):
    """The benchmark's equations of motion, written out as there and solved by Cramer's rule."""
    _, q2, dq1, dq2 = map(float, x)
    (g1, g2), (u1, u2), h = gravity(p, x), u, p["m2"] * p["l1"] * p["r2"]
    m12 = p["I2"] + h * math.cos(q2) - p["gr"] * p["Ir"]
    m22 = p["I2"] + p["gr"] ** 2 * p["Ir"]
    m11 = p["I1"] + p["I2"] + p["m2"] * p["l1"] ** 2 + 2 * h * math.cos(q2) + (p["gr"] ** 2 + 1) * p["Ir"]
    coriolis = h * math.sin(q2)  # C = h sin q2 [[-2 dq2, -dq2], [dq1, 0]]
    right1 = g1 + u1 + coriolis * (2 * dq2 * dq1 + dq2**2) - p["b1"] * dq1 - p["cf1"] * math.atan(100 * dq1)
    right2 = g2 + u2 - coriolis * dq1**2 - p["b2"] * dq2 - p["cf2"] * math.atan(100 * dq2)
    determinant = m11 * m22 - m12**2
    ddq1, ddq2 = m22 * right1 - m12 * right2, m11 * right2 - m12 * right1
    return np.array([dq1, dq2, ddq1 / determinant, ddq2 / determinant])


def gravity(p, x):
    """G(q)."""
    q1, q2 = map(float, x[:2])
    return -p["g"] * np.array(
        [
            p["m1"] * p["r1"] * math.sin(q1) + p["m2"] * (p["l1"] * math.sin(q1) + p["r2"] * math.sin(q1 + q2)),
            p["m2"] * p["r2"] * math.sin(q1 + q2),
        ]
    )


def rk4(p, x, u, dt):
    k1 = derivative(p, x, u)
    k2 = derivative(p, x + dt / 2 * k1, u)
    k3 = derivative(p, x + dt / 2 * k2, u)
    k4 = derivative(p, x + dt * k3, u)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


class World:
    """What disturbs a run; the noise is given as numbers, row by row."""

    def __init__(self, steps, response=1, delay=0, pushes=None, velocity_noise=0, torque_noise=0, stop=np.inf):
        self.response, self.delay, self.pushes, self.stop = response, delay, pushes, stop
        noises = velocity_noise, torque_noise
        self.velocity_noise, self.torque_noise = (np.broadcast_to(each, (steps, 2)) for each in noises)


def closed_loop(p, driven, control, x, dt, world):
    """Rows [t, x, u]: measure (delay, then noise), control, motor (response, noise, limits), push, integrate.

    ``driven`` are the indices of the joints that have a motor, ``control`` maps (x, t) to two torques, ``pushes``
    have centres, widths and amplitudes by joint. Beyond ``stop`` the run ends.
    """
    x = np.array(x, float)
    states, before, rows = [x], np.zeros(2), []
    for k in range(len(world.torque_noise)):
        t = k * dt
        if np.any(np.abs(x) > world.stop):
            break
        seen = states[max(0, len(states) - 1 - world.delay)].copy()
        seen[2:] += world.velocity_noise[k]
        wanted = control(seen, t)
        u = np.zeros(2)
        for joint in driven:
            motor = before[joint] + world.response * (wanted[joint] - before[joint]) + world.torque_noise[k, joint]
            limit = p[f"tl{joint + 1}"]
            u[joint] = min(max(motor, -limit), limit)
            if world.pushes is not None:
                centre, width, peak = (
                    getattr(world.pushes, name)[joint] for name in ("centre", "width", "amplitude")
                )
                u[joint] += np.sum(peak * np.exp(-((t - centre) ** 2) / (2 * width**2)))
        rows.append([t, *x, *u])
        x, before = rk4(p, x, u, dt), u
        states.append(x)
    return np.array(rows)


class Throw:
    """The PID of throws: the first two errors have no derivative yet, and all count in the integral."""

    def __init__(self, p, kp, ki, kd, limit=math.inf):
        self.p, self.gains, self.limit, self.errors = p, (kp, ki, kd), limit, []

    def __call__(self, goal, x):
        """The torques (N m), which gravity compensation may take beyond the limits."""
        (kp, ki, kd), errors = self.gains, self.errors
        errors.append(goal - x[:2])
        u = np.clip(kp * errors[-1], -self.limit, self.limit) + ki * 0.001 * sum(errors)
        if len(errors) > 2:
            u = u + kd * (errors[-1] - errors[-2]) / 0.001
        return np.clip(u, -6.0, 6.0) - gravity(self.p, x)


class ResetText:
    """The resets of ICRA 2025's robot, sentence by sentence: a list of times in which violations insert theirs."""

    def __init__(self, times, goals, model, limits, duration=1.0):
        self.times, self.goals, self.limits = [*times, math.inf], goals, limits
        self.duration, self.violations, self.pid = duration, [], Throw(model, 2.0, 0.0, 0.3, limit=3.0)
        self.number, self.running, self.clock, self.last = 0, False, 0.0, 0.0

    def __call__(self, t, x):
        """The torques of the PID while a reset runs, else None."""
        angle, speed = self.limits
        violated = abs(x[0]) > angle or abs(x[1]) > angle or abs(x[2]) > speed or abs(x[3]) > speed
        self.violations.append(violated)
        if not self.running:
            if t >= self.times[self.number]:
                self.start()
            elif violated:
                shift = t if self.number == 0 else t - self.times[self.number - 1]
                later = [time + shift for time in self.times[self.number :]]
                self.times = [*self.times[: self.number], t, *later]
                self.start()
        if self.running and self.clock > self.duration and not any(self.violations[-10:]):
            self.running = False
        u = None
        if self.running:
            u = self.pid(self.goal, x)
            self.clock += t - self.last
        self.last = t
        return u

    def start(self):
        self.goal, self.running, self.clock = self.goals[self.number], True, 0.0
        self.number += 1
