"""Time of one call of ar-eapo, which has the paper's sizes, and of adaptive, beside a floor of the same run.

Usage: taskset -c 0 python benchmarks/runtimes.py [ROBOT], by default acrobot; leave the machine idle. Needs gcc and
onnxruntime. The floor is one product of a 256 x 256 float32 matrix and a vector by NumPy's library: no 256-256
network in NumPy is faster. Calls are timed one by one, C's inside C.
"""

import ctypes
import dataclasses
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported

import jax
import numpy as np
import onnxruntime
import tyro

from swingup.benchmark.judge import judge
from swingup.controllers.registry import get_controller
from swingup.controllers.stack.policy import policy_alone
from swingup.export.c_header import c_header
from swingup.export.onnx_graph import onnx_model
from swingup.plant.files import load_plant
from swingup.policy.estimator import EstimatorSettings
from swingup.policy.guard import GuardSettings
from swingup.policy.identifier import IdentifierSettings
from swingup.policy.numpy_backend import TorqueNetwork, numpy_controller
from swingup.policy.pendulum import policy_plant
from swingup.policy.shipped import ADAPTIVE, AR_EAPO, load_policy
from swingup.runtime import load_controller

CALLS, WARM_UP, DT = 20_000, 500, 0.002

DRIVER = """
#include <time.h>
#include "policy.h"

static double nanoseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e9 * now.tv_sec + now.tv_nsec;
}

int measure(int n, const double *x, double *policy, double *controller)
{
    static swingup_controller memory;
    volatile double torque;
    double u[2], start;
    int k;
    swingup_reset(&memory);
    for (k = 0; k < n; k++) {
        start = nanoseconds();
        torque = swingup_policy(x + 4 * k);
        policy[k] = nanoseconds() - start;
        (void)torque;
    }
    for (k = 0; k < n; k++) {
        start = nanoseconds();
        swingup_control(&memory, 0.002 * k, x + 4 * k, u);
        controller[k] = nanoseconds() - start;
    }
    return swingup_guard_reason(&memory);
}
"""


def measure(call: Callable[[int], object]) -> np.ndarray:
    """Times of calls (µs), each with its number."""
    times = np.empty(CALLS)
    for k in range(CALLS):
        start = time.perf_counter_ns()
        call(k)
        times[k] = time.perf_counter_ns() - start
    return times / 1e3


def measure_c(text: str, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (µs) of the header's policy and of its controller, compiled with -O2."""
    policy, controller = np.empty(CALLS), np.empty(CALLS)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "policy.h").write_text(text, encoding="utf-8")
        (folder / "driver.c").write_text(DRIVER, encoding="utf-8")
        library = folder / "driver.so"
        command = [
            "gcc",
            "-std=gnu99",
            "-O2",
            "-shared",
            "-fPIC",
            "-o",
            str(library),
            str(folder / "driver.c"),
            "-lm",
        ]
        subprocess.run(command, check=True)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (states, policy, controller)]
        if ctypes.CDLL(str(library)).measure(CALLS, *pointers):
            raise SystemExit("the guard stopped the controller: its calls say nothing")
    return policy / 1e3, controller / 1e3


def main(robot: str = "acrobot", /) -> None:
    """Measure and print."""
    policy = dataclasses.replace(load_policy(AR_EAPO, robot), estimator=EstimatorSettings())
    # A slow drift: at every jump the estimator would reset, and have less to do.
    states = np.cumsum(np.random.default_rng(0).normal(size=(CALLS, 4)) * [2e-3, 2e-3, 0.05, 0.05], axis=0)
    alone, whole = TorqueNetwork(policy), load_controller(AR_EAPO, robot, estimator=True)
    # The drift is no pendulum and runs far: no wiring is watched, and limits are above it; the guard does all else.
    guard = GuardSettings(angle_limit=1e6, velocity_limit=1e6, watched=0.0)
    plant = policy_plant(load_plant("C.1"), policy.robot)
    everything = dataclasses.replace(policy, guard=guard, plant=plant)
    watched = numpy_controller(everything)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(onnx_model(policy), options, providers=["CPUExecutionProvider"])
    matrix, vector = np.ones((256, 256), np.float32), np.ones(256, np.float32)
    result = np.empty(256, np.float32)
    with jax.enable_x64(True):
        judged = policy_alone(policy)
        compiled = jax.jit(lambda x: judged(None, jax.numpy.zeros(()), x)[1])
        times = {
            "floor: one 256 x 256 product": measure(lambda k: np.dot(matrix, vector, out=result)),
            "NumPy": measure(lambda k: alone(states[k])),
            "NumPy with estimator": measure(lambda k: whole(states[k], DT * k)),
            "NumPy with estimator and guard": measure(lambda k: watched(states[k], DT * k)),
            "ONNX Runtime": measure(lambda k: session.run(None, {"state": states[k : k + 1]})),
            "JAX, compiled (peer)": measure(lambda k: np.asarray(compiled(states[k]))),
        }
    times["C"], times["C with estimator"] = measure_c(c_header(policy), states)
    identified = dataclasses.replace(policy, identifier=IdentifierSettings())
    times["C with estimator and identifier"] = measure_c(c_header(identified), states)[1]
    times["C with estimator and guard"] = measure_c(c_header(everything), states)[1]
    # Its swing-up, again and again: the identifier would not learn from a drift that no pendulum can follow.
    adaptive, swing_up = load_controller(ADAPTIVE, robot), judge(get_controller(ADAPTIVE, robot), robot).trajectory
    assert swing_up is not None
    states = np.resize(swing_up.x, states.shape)
    times["adaptive, NumPy"] = measure(lambda k: adaptive(states[k], DT * k))
    times["adaptive, C"] = measure_c(c_header(load_policy(ADAPTIVE, robot)), states)[1]
    print("| one call | median [µs] | p99 [µs] | p99 / median |\n|---|---:|---:|---:|")
    for name, each in times.items():
        median, late = np.quantile(each[WARM_UP:], [0.5, 0.99])
        print(f"| {name} | {median:.1f} | {late:.1f} | {late / median:.1f} |")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
