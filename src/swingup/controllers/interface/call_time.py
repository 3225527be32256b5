"""How long one call of a controller takes, and whether that is too long for its loop or for a whole board."""

import logging
import time
from statistics import median
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...common.errors import SwingupError, duration, errors_named_after
from .controller import AbstractController, split
from .python_controller import PythonController, answer

CALLS = 100
"""Calls that are timed."""
PATIENCE = 0.5
"""No more calls in plain Python are timed after this (s)."""
ANNOUNCED_TIME = 120.0
"""Simulations that take longer than this are announced (s)."""

_LOGGER = logging.getLogger(__name__)


def call_time(controller: AbstractController[Any] | PythonController, dt: float) -> float | None:
    """Wall time of a call (s) in a loop of period dt (s), on a pendulum that swings; None where calls fail.

    Calls in JAX are compiled, one after another as on a robot.
    """
    times = np.arange(CALLS) * dt
    # Smooth as a pendulum's: at jumps an estimator restarts, which takes less time.
    states = np.sin(times[:, None] * [3.0, 5.0, 4.0, 6.0]) * [0.3, 0.3, 1.0, 1.5]
    if isinstance(controller, PythonController):
        return _python_call_time(controller, times, states)
    with jax.enable_x64(True), errors_named_after("running it"):
        inputs = *split(controller), jnp.asarray(times), jnp.asarray(states)
        jax.block_until_ready(run_calls(*inputs))  # compiles
        took = []
        for _ in range(3):
            start = time.perf_counter()
            jax.block_until_ready(run_calls(*inputs))
            took.append(time.perf_counter() - start)
    # The least: whatever else the machine does only adds.
    return min(took) / CALLS


def _python_call_time(controller: PythonController, times: np.ndarray, states: np.ndarray) -> float | None:
    took: list[float] = []
    try:
        call = controller.start()
        for now, x in zip(times, states, strict=True):
            start = time.perf_counter()
            answer(call, x, float(now))
            took.append(time.perf_counter() - start)
            if sum(took) > PATIENCE:
                break
    except SwingupError:
        return None
    return median(took)


@jax.jit(static_argnames="static")
def run_calls(numbers: Any, static: Any, times: jax.Array, states: jax.Array) -> jax.Array:
    """Call a controller that :func:`split` cut in two, in one program as the benchmark's runner; torques (n, 2)."""
    controller = eqx.combine(numbers, static)

    def call(memory: Any, now: tuple[jax.Array, jax.Array]) -> tuple[Any, jax.Array]:
        return controller(memory, *now)

    return jax.lax.scan(call, controller.init(), (times, states))[1]


def slow_call(took: float | None, dt: float) -> str | None:
    """A warning if one call (s) takes longer than the loop's period dt (s); None if all is well."""
    if took is None or took <= dt:
        return None
    return (
        f"one call takes {1000 * took:.3g} ms on this machine, and the loop has {1000 * dt:g} ms: "
        "on a robot its torques would come too late"
    )


def announce(seconds: float, took: float, simulations: int, bound: str = "about ") -> None:
    """Log how long simulations will take, if that is long."""
    if seconds > ANNOUNCED_TIME:
        many = f"{simulations} simulations take" if simulations > 1 else "the simulation takes"
        _LOGGER.warning("%s %s%s: one call takes %.3g ms", many, bound, duration(seconds), 1000 * took)
