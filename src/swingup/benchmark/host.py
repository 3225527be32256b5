"""The closed loop with controllers in plain Python: their calls between compiled half steps of many simulations."""

from collections.abc import Callable, Sequence
from statistics import median
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np

from ..common.errors import SwingupError
from ..controllers.interface.python_controller import Answer, PythonController, answer
from .rollout import (
    LoopState,
    Record,
    Scenario,
    SimulatedBatch,
    Trajectory,
    apply_torque,
    initial_loop,
    measure,
    record,
)

TIMED_STEPS = 52
"""Steps after which the time of the whole batch can be told."""
TIMED_CALLS = 1000
"""Calls that are timed: the first ones, in which a controller that plans has most to do."""

_measure = jax.jit(jax.vmap(measure, in_axes=(0, 0, None, None)))
_record = jax.jit(jax.vmap(record))
_apply_torque = jax.jit(jax.vmap(apply_torque, in_axes=(0, 0, None, 0, None)))


def simulate_on_host(
    scenarios: Scenario,
    controllers: Sequence[PythonController],
    dt: float,
    steps: int,
    depth: int,
    keep: bool,
    timed: Callable[[float, float], None] | None = None,
) -> SimulatedBatch:
    """Run one controller in each of a batch of scenarios from hanging at rest; call it in 64-bit mode.

    The torque of a controller whose answer is wrong is 0 from then on. After a few steps ``timed`` is called with
    the wall times of a step and of a call (s).
    """
    number = len(controllers)
    calls: dict[int, Answer] = {}  # of the controllers without a fault
    faults: list[str | None] = [None] * number
    for index, controller in enumerate(controllers):
        try:
            calls[index] = controller.start()
        except SwingupError as error:
            faults[index] = str(error)
    scenarios = jax.device_put(scenarios)  # once, not at each step
    # A batch even for one simulation: the compiled half steps have a leading axis.
    start = jax.vmap(lambda each: initial_loop(each, jnp.zeros(4), depth, dt))
    loop: LoopState = start(scenarios)
    # A loop with a clock of its own overwrites its times.
    time = np.tile(np.arange(steps) * dt, (number, 1))
    kept = steps if keep else 0
    x, u = np.zeros((number, kept, 4)), np.zeros((number, kept, 2))
    # Rows that are never reached count as over.
    written = Record(np.zeros_like(x), np.zeros_like(u), np.ones((number, kept), bool))
    took: list[float] = []
    for step in range(steps):
        if step == 2:  # both halves are compiled
            began = perf_counter()
        if step == TIMED_STEPS and timed is not None:
            timed((perf_counter() - began) / (TIMED_STEPS - 2), median(took) if took else 0.0)
        if keep:
            x[:, step] = loop.x
        loop, state, called = _measure(scenarios, loop, np.int64(step), dt)
        if loop.times is not None:
            time[:, step] = loop.times.now
        measured, command = np.asarray(state, np.float64), np.zeros((number, 2))
        # No call during a throw, nor on a state that has diverged: that is not the fault of the controller.
        able = np.asarray(called) & np.isfinite(measured).all(axis=1)
        for index in [each for each in calls if able[each]]:
            before = perf_counter()
            try:
                command[index] = answer(calls[index], measured[index], float(time[index, step]))
            except SwingupError as error:
                faults[index] = str(error)
                del calls[index]
            if len(took) < TIMED_CALLS:
                took.append(perf_counter() - before)
        if not calls:
            break  # every controller has failed
        if keep and scenarios.supervisor is not None:
            row = _record(scenarios, loop, state, command)
            written.x[:, step], written.u[:, step], written.over[:, step] = row.x, row.u, row.over
        loop = _apply_torque(scenarios, loop, np.int64(step), command, dt)
        if keep:
            u[:, step] = loop.u
    kept_record = None if scenarios.supervisor is None else written
    rows = Trajectory(time=time, x=x, u=u, record=kept_record) if keep else None
    return SimulatedBatch(np.asarray(loop.x), faults, rows, median(took) if took else None)
