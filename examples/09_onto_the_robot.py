"""Judge the policy for the real robot's plant, run it as a 500 Hz loop does, and export it to C."""

import dataclasses
import time
from pathlib import Path
from statistics import median

import numpy as np

import swingup
from swingup.export.c_header import c_header
from swingup.policy.guard import default_guard
from swingup.policy.shipped import load_policy
from swingup.runtime import load_controller

ROBOT, NAME, DOMAIN, SEEDS = "acrobot", "adaptive", "identified", 5

# Friction, motor inertia, a delay of 10 ms, noisy velocities, imperfect motors: docs/sim2real.md.
result = swingup.judge(swingup.get_controller(NAME, ROBOT), ROBOT, "sim2real", SEEDS, domain=DOMAIN)
print(f"{NAME} on the {ROBOT}'s plant: {result.successes} of {SEEDS} swing-ups held")

# The robot's loop calls this object, which needs NumPy alone. Its input here is the first of these runs.
controller = swingup.RealAIGymController(load_controller(NAME, ROBOT, guard=True))
controller.reset()
controller.init()
rows, took = result.trajectory, []
assert rows is not None
for t, x in zip(np.asarray(rows.time), np.asarray(rows.x), strict=True):
    start = time.perf_counter()
    u = controller.get_control_output(x=x, t=t)
    took.append(time.perf_counter() - start)
    assert u.shape == (2,)
    assert abs(u[0]) < 1.0  # the passive joint's motor only compensates friction
assert controller.fault is None  # the safety guard found nothing
print(f"{len(took)} calls, {1e6 * median(took):.0f} microseconds each in the median")

policy = dataclasses.replace(load_policy(NAME, ROBOT), guard=default_guard())
Path("policy.h").write_text(c_header(policy), encoding="utf-8")
print("written: policy.h, for a microcontroller")
