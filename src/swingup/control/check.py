"""A checker for controllers that others plug in: what is wrong with one, before a benchmark shows it in numbers."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot
from .controller import AbstractController
from .plain import PlainController, answer

DT = 0.002
"""Time between the calls of the check (s)."""


def check_controller(source: Any, robot: Robot | str) -> list[str]:
    """Try a controller on a few dozen states and say what is wrong with it.

    It looks for errors, wrong shapes, torques that are not finite, torque on the passive joint, a memory that
    changes its structure, that ``reset()`` and ``init()`` do not clear or that copies share, and measurements that
    are altered in place.

    Args:
        source: a controller in JAX, an object with ``get_control_output(x, t)``, or a function of (x, t).
        robot: which joint is driven.

    Returns:
        One line for every finding; none if all is well.

    Raises:
        SwingupError: there is no such robot, or this is no controller at all.
    """
    robot = get_robot(robot)
    meant = getattr(source, "robot", robot)
    if meant != robot:
        return [f"it is for the {meant.name}: judge it there"]
    states = _probes()
    if isinstance(source, AbstractController):
        findings, torques = _check_compiled(source, states)
    else:
        findings, torques = _check_plain(PlainController(source), states)
    passive = 1 - robot.joint
    largest = max((abs(float(u[passive])) for u in torques), default=0.0)
    if largest > 0:
        findings.append(f"it commands up to {largest:g} N m on the passive joint {passive + 1}: return 0 there")
    return findings


def _probes() -> np.ndarray:
    """Hanging, upright, full turns away, fast, then random."""
    pi = np.pi
    chosen = [[0, 0, 0, 0], [pi, 0, 0, 0], [-pi, 2 * pi, 0, 0], [3, -7, 20, -20], [pi, 0, 30, 30]]
    random = np.random.default_rng(0).uniform(-1, 1, (27, 4)) * [2 * pi, 2 * pi, 20, 20]
    return np.concatenate([np.array(chosen, np.float64), random])


def _check_compiled(controller: AbstractController[Any], states: np.ndarray) -> tuple[list[str], list[np.ndarray]]:
    with jax.enable_x64(True):
        try:
            start = controller.init()
            after, command = jax.eval_shape(controller, start, jnp.zeros(()), jnp.zeros(4))
        except Exception as error:  # whatever a foreign controller raises
            reason = " ".join(str(error).split())
            return [f"tracing it raised {type(error).__name__}: {reason:.300}; mend it there"], []
        if getattr(command, "shape", None) != (2,):
            shape = getattr(command, "shape", type(command).__name__)
            return [f"its torque has shape {shape}: return [u1, u2] of shape (2,) in N m"], []
        if _structure(after) != _structure(start):
            return [
                "its memory changes shape or dtype in a call: return what init() returns, with other values"
            ], []

        def call(memory: Any, now: tuple[jax.Array, jax.Array]) -> tuple[Any, jax.Array]:
            return controller(memory, *now)

        times = jnp.arange(len(states)) * DT
        torques = np.asarray(jax.lax.scan(call, start, (times, jnp.asarray(states)))[1])
    faulty = np.flatnonzero(~np.isfinite(torques).all(axis=1))
    if faulty.size:
        x = np.round(states[faulty[0]], 3).tolist()
        return [f"its torque is not finite for x = {x}: mend it there"], []
    return [], list(torques)


def _structure(memory: Any) -> tuple[Any, list[tuple[tuple[int, ...], Any]]]:
    leaves, structure = jax.tree.flatten(memory)
    return structure, [(jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves]


def _check_plain(controller: PlainController, states: np.ndarray) -> tuple[list[str], list[np.ndarray]]:
    try:
        first = _run([controller], states)[0]
        findings = []
        if not np.array_equal(_run([controller], states)[0], first):
            findings.append(
                "it answers otherwise when run again: clear its memory in reset() or init(), and seed it"
            )
        copies = controller.copies(2)
        if len(copies) == 1:
            findings.append("it cannot be copied: its simulations will run one by one; let copy.deepcopy copy it")
        elif not findings and not all(np.array_equal(each, first) for each in _run(copies, states)):
            findings.append("copies of it share a memory: keep memory in the object, not in globals or its class")
        x = states[-1].copy()
        (controller.start())(x, 0.0)
        if not np.array_equal(x, states[-1]):
            findings.append("it changes the measurement that it is given: copy x before altering it")
    except SwingupError as error:
        return [str(error)], []
    return findings, list(first)


def _run(controllers: Sequence[PlainController], states: np.ndarray) -> list[np.ndarray]:
    """The answers of controllers that are called in turn, step by step."""
    calls = [controller.start() for controller in controllers]
    answers = [[answer(call, x, step * DT) for call in calls] for step, x in enumerate(states)]
    return [np.array([row[index] for row in answers]) for index in range(len(calls))]
