"""Run scenarios with any controller, in float64: compiled and batched in JAX, or step by step in plain Python."""

import functools
import logging
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from time import perf_counter
from typing import Any, NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import jax
import numpy as np

from ..common import DISPATCH, cores
from ..common.errors import SwingupError, errors_named_after, naming
from ..common.types import Count, State
from ..controllers.baselines.upright import AbstractExpensiveController
from ..controllers.check import announce, spread
from ..controllers.interface import (
    AbstractController,
    PythonController,
    TorqueFunction,
    check_interface,
    check_robot,
    checked_torques,
    layers,
    split,
)
from ..controllers.registry import Controller
from ..controllers.stack.estimator import EstimatingController
from ..controllers.stack.policy import PolicyController, plant_of, policy_of
from ..plant.plant import Plant, Robot
from ..policy.pendulum import plant_difference
from .rollout import (
    Record,
    Scenario,
    SimulatedBatch,
    Trajectory,
    apply_torque,
    initial_loop,
    initial_state,
    measure,
    record,
    simulate,
)

TreeT = TypeVar("TreeT")

Progress: TypeAlias = Callable[[int, int], None]  # Called with the number of finished simulations, and of all

StageProgress: TypeAlias = Callable[[str, int, int], None]
"""Called with what is computed, as a table's row, how much of it is done, and of how much."""

SIDE_BY_SIDE = 64  # Copies of a controller in plain Python that exist at a time
MIN_BATCH = 32  # Scenarios side by side that keep a core busy with more than calling compiled loops
TIMED_STEPS = 52  # Steps after which the time of a whole batch in plain Python is estimated
TIMED_CALLS = 1000  # Calls that are timed: the first ones, in which a controller that plans has most to do

_LOGGER = logging.getLogger(__name__)

_Result: TypeAlias = tuple[State, Count, Trajectory | None]

_measure = jax.jit(jax.vmap(measure, in_axes=(0, 0, None, None)))
_record = jax.jit(jax.vmap(record))
_apply_torque = jax.jit(jax.vmap(apply_torque, in_axes=(0, 0, None, 0, None)))


class _Span(NamedTuple):
    """What is simulated of each scenario, and kept: static in a compiled program."""

    dt: float
    steps: int
    depth: int
    keep: bool


@jax.jit(static_argnames=("static", "span"))
def _simulate(scenarios: Scenario, arrays: Any, static: Any, span: _Span) -> _Result:
    """Compiled simulations of one controller, split into its numbers and the rest."""
    controller = eqx.combine(arrays, static)

    def one(scenario: Scenario) -> _Result:
        # Rows that are not kept must not leave the scan: those of a whole grid take 200 MB.
        length = span.dt, span.steps, span.depth
        final, fault, rows = simulate(scenario, controller, initial_state(scenario), *length)
        return final, fault, rows if span.keep else None

    if _length(scenarios) > 1:
        return jax.vmap(one)(scenarios)
    # Without a batch a controller skips the branch that it does not take.
    alone = one(jax.tree.map(lambda leaf: leaf[0], scenarios))
    return jax.tree.map(lambda leaf: leaf[None], alone)


def prepare(source: Any, robot: Robot, name: str, plant: Plant | None = None) -> Controller:
    """Make a controller of any kind run on a robot, and say if it was made for a plant that differs much."""
    with naming(f"controller {name!r}"):
        known = isinstance(source, AbstractController | PythonController)
        controller = source if known else PythonController(source)
        check_robot(controller, robot)
        if isinstance(controller, AbstractController):
            with jax.enable_x64(True):
                check_interface(controller)
    around = layers(controller)
    if plant is not None and around and isinstance(policy := around[-1], PolicyController):
        # Behind an identifier a policy that sees its plant is for all plants in its range.
        identifies = any(isinstance(each, EstimatingController) and each.identifier is not None for each in around)
        seen = policy_of(policy).network.plant_stage if identifies else None
        difference = plant_difference(plant_of(policy), plant, robot, seen)
        if difference is not None:
            _warn_once(f"controller {name!r}: {difference}")
    return controller


@functools.cache
def _warn_once(message: str) -> None:
    """Log a warning the first time only: training judges a policy again and again."""
    _LOGGER.warning("%s", message)


def run_one(
    controller: Controller, scenario: Scenario, dt: float, steps: int, depth: int = 1, duration: float = math.inf
) -> Trajectory:
    """Simulate one scenario and return its rows as NumPy arrays."""
    batch = run_many(controller, stack([scenario]), dt, steps, depth, keep=True, duration=duration)
    if batch.faults[0] is not None:
        raise SwingupError(batch.faults[0])
    rows: Trajectory = jax.tree.map(lambda each: each[0], batch.trajectory)
    return rows


def run_many(
    controller: Controller,
    scenarios: Scenario,
    dt: float,
    steps: int,
    depth: int = 1,
    keep: bool = False,
    progress: Progress = lambda *_: None,
    duration: float = math.inf,
) -> SimulatedBatch:
    """Simulate a batch of scenarios.

    Scenarios have a leading axis, as :func:`stack` makes them; each gets a memory of its own. ``depth`` is more
    than the largest delay (steps), ``keep`` asks for the rows as well. ``progress`` is called after each part of
    the batch. A loop with a clock of its own may run on after the ``duration`` (s): what a controller does then is
    no fault.
    """
    span = _Span(dt, steps, depth, keep)
    if isinstance(controller, PythonController):
        return _run_plain(controller, scenarios, span, progress, duration)
    return _run_compiled(controller, scenarios, span, progress, duration)


def stack(trees: Sequence[TreeT]) -> TreeT:
    """Scenarios or plants with a leading axis; scenarios all with a disturbance, or all without."""
    stacked: TreeT = jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *trees)
    return stacked


def _length(scenarios: Scenario) -> int:
    return len(scenarios.parameters.m1)  # batched, and so an array


def _run_compiled(
    controller: AbstractController[Any], scenarios: Scenario, span: _Span, progress: Progress, duration: float
) -> SimulatedBatch:
    """One batch on an accelerator; on a CPU batches of one shape in a thread for each core, and one run alone.

    One batch hardly uses a second core. Controllers that can skip work get smaller batches: a batch takes as long
    as its slowest member, and neighbours in a grid mostly end in the same way.
    """
    number, (arrays, static) = _length(scenarios), split(controller)
    on_cpu = jax.default_backend() == "cpu"
    threads = cores() if on_cpu else 1
    # The whole tree is searched: the MPC stands inside a switch, which may stand behind an estimator.
    nodes = jax.tree.leaves(controller, is_leaf=lambda node: isinstance(node, AbstractExpensiveController))
    skips_work = any(isinstance(node, AbstractExpensiveController) for node in nodes)
    wanted = MIN_BATCH if on_cpu and skips_work else -(-number // threads)
    size = min(number, max(MIN_BATCH, wanted))
    # Parts of one shape need one compilation: the last scenario fills up the last part.
    parts = np.minimum(np.arange(-(-number // size) * size), number - 1).reshape(-1, size)

    def run(part: np.ndarray) -> _Result:
        with jax.enable_x64(True), errors_named_after("running it"):  # 64 bits are a setting of the thread
            with DISPATCH:
                result = _simulate(jax.tree.map(lambda leaf: leaf[part], scenarios), arrays, static, span)
            # Converted in this thread: the call above returns before its result is computed.
            return jax.tree.map(np.asarray, result)

    pool, results = ThreadPoolExecutor(threads), []
    try:
        for result in pool.map(run, parts):
            results.append(result)
            progress(min(len(results) * size, number), number)
    finally:  # an interrupt must not wait for the parts that still run
        pool.shutdown(wait=False, cancel_futures=True)
    final, faults, rows = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:number], *results)
    told: list[str | None] = [None] * number
    for index in np.flatnonzero(faults >= 0).tolist():
        t = faults[index] * span.dt if rows is None else rows.time[index, faults[index]]
        if t < duration:
            told[index] = f"it gave a torque that is not finite at t = {t:g} s: correct it there"
    return SimulatedBatch(final, told, rows)


def _run_plain(
    controller: PythonController, scenarios: Scenario, span: _Span, progress: Progress, duration: float
) -> SimulatedBatch:
    number, runs = _length(scenarios), list[SimulatedBatch]()
    copies = controller.copies(min(SIDE_BY_SIDE, number))
    for start in range(0, number, len(copies)):
        part = jax.tree.map(lambda leaf, start=start: leaf[start : start + len(copies)], scenarios)
        with jax.enable_x64(True):
            runs.append(_simulate_plain(part, copies[: _length(part)], span, 0 if runs else number, duration))
        progress(min(start + len(copies), number), number)
    rows = jax.tree.map(lambda *parts: np.concatenate(parts), *[run.trajectory for run in runs])  # or None
    faults = [fault for run in runs for fault in run.faults]
    return SimulatedBatch(np.concatenate([run.final for run in runs]), faults, rows, runs[0].call_time)


def _simulate_plain(
    scenarios: Scenario, controllers: Sequence[PythonController], span: _Span, announced: int, duration: float
) -> SimulatedBatch:
    """Run one controller in each of a batch of scenarios; call it in 64-bit mode.

    The torque of a controller whose answer is wrong is 0 from then on. After a few steps the time of
    ``announced`` simulations is logged if it is long.
    """
    number, (dt, steps, depth, keep) = len(controllers), span
    calls: dict[int, TorqueFunction] = {}  # of the controllers without a fault
    faults: list[str | None] = [None] * number
    for index, controller in enumerate(controllers):
        try:
            calls[index] = controller.start()
        except SwingupError as error:
            faults[index] = str(error)
    scenarios = jax.device_put(scenarios)  # once, not at each step
    # A batch even for one simulation: the compiled half steps have a leading axis.
    loop = jax.vmap(lambda each: initial_loop(each, initial_state(each), depth, dt))(scenarios)
    # A loop with a clock of its own overwrites its times.
    time = np.tile(np.arange(steps) * dt, (number, 1))
    kept = steps if keep else 0
    x, u = np.zeros((number, kept, 4)), np.zeros((number, kept, 2))
    # Rows that are never reached count as over.
    over = np.ones((number, kept), bool)
    written = Record(np.zeros_like(x), np.zeros_like(u), over, ~over)
    took: list[float] = []
    for step in range(steps):
        if step == 2:  # both halves are compiled
            began = perf_counter()
        if step == TIMED_STEPS and announced:
            seconds = (perf_counter() - began) / (TIMED_STEPS - 2) * steps * -(-announced // number)
            announce(seconds, median(took) if took else 0.0, announced)
        if keep:
            x[:, step] = loop.x
        loop, state, called = _measure(scenarios, loop, np.int64(step), dt)
        if loop.times is not None:
            time[:, step] = loop.times.now
        measured, command = np.asarray(state, np.float64), np.zeros((number, 2))
        # No call during a throw, nor on a state that has diverged, nor after the end: no fault of the controller.
        able = np.asarray(called) & np.isfinite(np.asarray(loop.x)).all(axis=1) & (time[:, step] < duration)
        for index in [each for each in calls if able[each]]:
            before = perf_counter()
            try:
                command[index] = checked_torques(calls[index], measured[index], float(time[index, step]))
            except SwingupError as error:
                # A wrong answer to a spoilt sample moves no motor.
                if np.isfinite(measured[index]).all():
                    faults[index] = str(error)
                    del calls[index]
            if len(took) < TIMED_CALLS:
                took.append(perf_counter() - before)
        if not calls:
            break  # every controller has failed
        if keep and scenarios.supervisor is not None:
            row = _record(scenarios, loop, state, command)
            written.x[:, step], written.u[:, step] = row.x, row.u
            written.over[:, step], written.alone[:, step] = row.over, row.alone
        loop = _apply_torque(scenarios, loop, np.int64(step), command, dt)
        if keep:
            u[:, step] = loop.u
    kept_record = None if scenarios.supervisor is None else written
    rows = Trajectory(time=time, x=x, u=u, record=kept_record) if keep else None
    return SimulatedBatch(np.asarray(loop.x), faults, rows, spread(took) if took else None)
