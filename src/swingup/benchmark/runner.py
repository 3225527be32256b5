"""Run scenarios with any controller, in float64: compiled and batched in JAX, or step by step in plain Python."""

import functools
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..common.cores import cores
from ..common.errors import SwingupError, naming
from ..common.foreign import errors_named_after
from ..controllers.baselines.switch import AbstractExpensiveController
from ..controllers.interface.call_time import announce
from ..controllers.interface.controller import AbstractController, check_interface, check_robot, split
from ..controllers.interface.python_controller import PythonController
from ..controllers.registry import Controller
from ..controllers.stack.controller import PolicyController, plant_of, policy_of
from ..controllers.stack.estimator import EstimatingController
from ..controllers.stack.regulator import RegulatingController
from ..plant.plant import Plant
from ..plant.robots import Robot
from ..policy.plant_facts import plant_difference
from .host import simulate_on_host
from .rollout import Scenario, SimulatedBatch, SimulationEnd, Trajectory, simulate

TreeT = TypeVar("TreeT")

Progress: TypeAlias = Callable[[int, int], None]
"""Called with the number of finished simulations, and of all."""

SIDE_BY_SIDE = 64
"""Copies of a controller in plain Python that exist at a time."""
SMALLEST_BATCH = 32
"""Scenarios side by side that keep a core busy with more than calling compiled loops."""

_LOGGER = logging.getLogger(__name__)

_Result: TypeAlias = tuple[SimulationEnd, Trajectory | None]


class _Span(NamedTuple):
    """What is simulated of each scenario, and kept: static in a compiled program."""

    dt: float
    steps: int
    depth: int
    keep: bool


@jax.jit(static_argnames=("static", "span", "batched"))
def _simulate(scenarios: Scenario, arrays: Any, static: Any, span: _Span, batched: bool) -> _Result:
    """Compiled simulations of one controller, split into its numbers and the rest."""
    controller = eqx.combine(arrays, static)

    def one(scenario: Scenario) -> _Result:
        # Rows that are not kept must not leave the scan: those of a whole grid take 200 MB.
        end, rows = simulate(scenario, controller, jnp.zeros(4), span.dt, span.steps, span.depth)
        return end, rows if span.keep else None

    return jax.vmap(one)(scenarios) if batched else one(scenarios)


def prepare(source: Any, robot: Robot, name: str, plant: Plant | None = None) -> Controller:
    """Make a controller of any kind run on a robot, and say if it was made for a plant that differs much."""
    with naming(f"controller {name!r}"):
        known = isinstance(source, AbstractController | PythonController)
        controller = source if known else PythonController(source)
        check_robot(controller, robot)
        if isinstance(controller, AbstractController):
            with jax.enable_x64(True):
                check_interface(controller)
    policy = controller.controller if isinstance(controller, EstimatingController) else controller
    policy = policy.controller if isinstance(policy, RegulatingController) else policy
    if plant is not None and isinstance(policy, PolicyController):
        # Behind an identifier a policy that sees its plant is for all that it can be told of.
        finds = isinstance(controller, EstimatingController) and controller.identifier is not None
        seen = policy_of(policy).network.plant_stage if finds else None
        difference = plant_difference(plant_of(policy), plant, robot, seen)
        if difference is not None:
            _warn_once(f"controller {name!r}: {difference}")
    return controller


@functools.cache
def _warn_once(message: str) -> None:
    """Log a warning the first time only: training judges a policy again and again."""
    _LOGGER.warning("%s", message)


def run_one(controller: Controller, scenario: Scenario, dt: float, steps: int, depth: int = 1) -> Trajectory:
    """Simulate one scenario from hanging at rest and return its rows as NumPy arrays."""
    batch = run_many(controller, stack([scenario]), dt, steps, depth, keep=True)
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
) -> SimulatedBatch:
    """Simulate a batch of scenarios from hanging at rest.

    Scenarios have a leading axis, as :func:`stack` makes them; each gets a memory of its own. ``depth`` is more
    than the largest delay (steps), ``keep`` asks for the rows as well. ``progress`` is called after each part of
    the batch.
    """
    span = _Span(dt, steps, depth, keep)
    if isinstance(controller, PythonController):
        return _run_plain(controller, scenarios, span, progress)
    return _run_compiled(controller, scenarios, span, progress)


def stack(trees: Sequence[TreeT]) -> TreeT:
    """Scenarios or plants with a leading axis; scenarios all with a disturbance, or all without."""
    stacked: TreeT = jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *trees)
    return stacked


def _length(scenarios: Scenario) -> int:
    return len(scenarios.parameters.m1)  # batched, and so an array


def _run_compiled(
    controller: AbstractController[Any], scenarios: Scenario, span: _Span, progress: Progress
) -> SimulatedBatch:
    """One batch on an accelerator; on a CPU batches of one shape in a thread for each core, and one run alone.

    One batch hardly uses a second core. Controllers that can skip work get smaller batches: a batch takes as long
    as its slowest member, and neighbours in a grid mostly end in the same way.
    """
    number, (arrays, static) = _length(scenarios), split(controller)
    if number == 1:
        # Without a batch a controller skips the branch that it does not take.
        alone = jax.tree.map(lambda leaf: leaf[0], scenarios)
        with jax.enable_x64(True), errors_named_after("running it"):
            result = _simulate(alone, arrays, static, span, batched=False)
            return _batch(jax.tree.map(lambda leaf: np.asarray(leaf)[None], result), span.dt)
    on_cpu = jax.default_backend() == "cpu"
    threads = cores() if on_cpu else 1
    most = SMALLEST_BATCH if on_cpu and _is_sparing(controller) else -(-number // threads)
    size = min(number, max(SMALLEST_BATCH, most))
    parts = -(-number // size)
    # Parts of one shape need one compilation: the last scenario fills up the last part.
    padded = jax.tree.map(lambda leaf: leaf[np.minimum(np.arange(parts * size), number - 1)], scenarios)

    def run(part: int) -> _Result:
        with jax.enable_x64(True):  # which is a setting of the thread
            piece = jax.tree.map(lambda leaf: leaf[part * size : (part + 1) * size], padded)
            with errors_named_after("running it"):
                result = _simulate(piece, arrays, static, span, batched=True)
                # Converted in this thread: the call above returns before its result is computed.
                return jax.tree.map(np.asarray, result)

    pool, results = ThreadPoolExecutor(threads), []
    try:
        for result in pool.map(run, range(parts)):
            results.append(result)
            progress(min(len(results) * size, number), number)
    finally:  # an interrupt must not wait for the parts that still run
        pool.shutdown(wait=False, cancel_futures=True)
    return _batch(jax.tree.map(lambda *leaves: np.concatenate(leaves)[:number], *results), span.dt)


def _batch(result: _Result, dt: float) -> SimulatedBatch:
    end, rows = result
    what = "it gave a torque that is not finite at t = {:g} s: correct it there"
    return SimulatedBatch(np.asarray(end.final), [None if k < 0 else what.format(k * dt) for k in end.fault], rows)


def _is_sparing(controller: AbstractController[Any]) -> bool:
    # The whole tree is searched: the MPC stands inside a switch, which may stand behind an estimator.
    nodes = jax.tree.leaves(controller, is_leaf=lambda node: isinstance(node, AbstractExpensiveController))
    return any(isinstance(node, AbstractExpensiveController) for node in nodes)


def _run_plain(
    controller: PythonController, scenarios: Scenario, span: _Span, progress: Progress
) -> SimulatedBatch:
    number, runs = _length(scenarios), list[SimulatedBatch]()
    copies = controller.copies(min(SIDE_BY_SIDE, number))

    def timed(step: float, call: float) -> None:
        announce(step * span.steps * -(-number // len(copies)), call, number)

    for start in range(0, number, len(copies)):
        part = jax.tree.map(lambda leaf, start=start: leaf[start : start + len(copies)], scenarios)
        with jax.enable_x64(True):
            own = copies[: _length(part)]
            runs.append(simulate_on_host(part, own, *span, None if runs else timed))
        progress(min(start + len(copies), number), number)
    rows = jax.tree.map(lambda *parts: np.concatenate(parts), *[run.trajectory for run in runs])  # or None
    faults = [fault for run in runs for fault in run.faults]
    return SimulatedBatch(np.concatenate([run.final for run in runs]), faults, rows, runs[0].call_time)
