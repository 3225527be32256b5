"""A checker for controllers that others plug in: it finds faults before a benchmark shows them in numbers."""

import contextlib
import inspect
import logging
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..common.checks import finite_number
from ..common.errors import SwingupError, attribute, duration, errors_named_after
from ..dynamics.dynamics import UPRIGHT
from ..plant.plant import TORQUE_LIMIT, Plant, Robot, get_robot
from .baselines.upright import linearised
from .interface import (
    TRIAL_DT,
    AbstractController,
    PythonController,
    call_in_turn,
    check_interface,
    check_robot,
    checked_torques,
    layers,
    split,
    trial_states,
)
from .stack.policy import PolicyController
from .swingups.design import design_model

TIMED_CALLS = 100  # Calls that are timed
MAX_TIMED_SECONDS = 0.5  # No more calls in plain Python are timed after this (s)
ANNOUNCED_TIME = 120.0  # Simulations that take longer than this are announced (s)

_LOGGER = logging.getLogger(__name__)


class CallTime(NamedTuple):
    """Wall times of calls (s)."""

    median: float
    percentile: float  # 99 % of the calls take no longer
    longest: float


def spread(seconds: Sequence[float]) -> CallTime:
    """What single calls took; at least one."""
    median, percentile = np.percentile(seconds, [50, 99]).tolist()
    return CallTime(median, percentile, max(seconds))


def call_time(controller: AbstractController[Any] | PythonController, dt: float) -> CallTime | None:
    """Wall times of calls in a loop of period dt (s), on a pendulum that swings; None where calls fail.

    Calls in JAX are compiled, one after another as on a robot.
    """
    times = np.arange(TIMED_CALLS) * dt
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
    # The minimum: other work of the machine only adds time. All calls do the same.
    return spread([min(took) / TIMED_CALLS])


def _python_call_time(controller: PythonController, times: np.ndarray, states: np.ndarray) -> CallTime | None:
    took: list[float] = []
    try:
        call = controller.start()
        for now, x in zip(times, states, strict=True):
            start = time.perf_counter()
            checked_torques(call, x, float(now))
            took.append(time.perf_counter() - start)
            if sum(took) > MAX_TIMED_SECONDS:
                break
    except SwingupError:
        return None
    return spread(took)


@jax.jit(static_argnames="static")
def run_calls(numbers: Any, static: Any, times: jax.Array, states: jax.Array) -> jax.Array:
    """Call a controller that :func:`split` cut in two, in one program as the benchmark's runner; torques (n, 2)."""
    controller = eqx.combine(numbers, static)

    def call(memory: Any, now: tuple[jax.Array, jax.Array]) -> tuple[Any, jax.Array]:
        return controller(memory, *now)

    return jax.lax.scan(call, controller.init(), (times, states))[1]


def slow_call(took: CallTime | None, dt: float) -> str | None:
    """A warning if over one call in a hundred takes longer than the loop's period dt (s), else None."""
    if took is None or took.percentile <= dt:
        return None
    return (
        f"{call_words(took)} on this machine, and the loop has {1000 * dt:g} ms: "
        "on a robot its torques would come too late"
    )


def call_words(took: CallTime) -> str:
    """How long a call takes, in words."""
    words = f"one call takes {1000 * took.median:.3g} ms"
    if took.longest == took.median:
        return words
    return f"{words} (median; 99 % {1000 * took.percentile:.3g}, longest {1000 * took.longest:.3g} ms)"


def announce(seconds: float, took: float, simulations: int, bound: str = "about ") -> None:
    """Log how long simulations will take, if that is long."""
    if seconds > ANNOUNCED_TIME:
        many = f"{simulations} simulations take" if simulations > 1 else "the simulation takes"
        _LOGGER.warning("%s %s%s: one call takes %.3g ms", many, bound, duration(seconds), 1000 * took)


TIME_NAMES = ("t", "time", "now", "seconds", "t_s")
STATE_NAMES = ("x", "state", "q", "obs", "observation", "measurement", "measured")
"""Names by which an argument is known."""
MAX_TORQUE_RATIO = 10.0
"""A torque of more than this many times what the motor has is in another unit. The loop clips smaller ones."""


def check_controller(source: Any, robot: Robot | str, torque_limit: float = TORQUE_LIMIT) -> list[str]:
    """Try a controller on a few dozen states and name its faults.

    It looks for errors, wrong shapes, arguments in another order, fields that cannot be compiled, torques that are
    not finite or far more than the motor has, torque on the passive joint above the controller's attribute
    ``passive_limit`` (N m; 0 where it has none), a memory that changes its structure, that ``reset()`` and
    ``init()`` do not clear or that copies share, and measurements that are altered in place.

    The controller is one in JAX, an object with ``get_control_output(x, t)``, or a function of (x, t). The driven
    joint's motor has a torque limit (N m). Each finding is one line; there is none if all is well.

    Raises:
        SwingupError: there is no such robot, or this is not a controller.
    """
    robot = get_robot(robot)
    if not isinstance(source, AbstractController | PythonController):
        source = PythonController(source)
    findings: list[str] = []
    try:
        check_robot(source, robot)
        if isinstance(source, AbstractController):
            torques = _try_compiled(source)
        else:
            findings, torques = _try_plain(source)
        passive = _try_passive(source, torques[:, 1 - robot.joint], 2 - robot.joint)
    except SwingupError as error:
        return _name_order(source) or [str(error)]
    return _name_order(source) + findings + _try_driven(torques[:, robot.joint], robot, torque_limit) + passive


def _name_order(source: Any) -> list[str]:
    """Whether the arguments are in another order, by their names, or because an answer comes only in that order."""
    in_jax = isinstance(source, AbstractController)
    call = source.__call__ if in_jax else attribute(source.source, "get_control_output", source.source)
    try:
        named = [*inspect.signature(call).parameters.values()][1 if in_jax else 0 :][:2]
    except (TypeError, ValueError):  # built-in functions have none
        named = []
    first, second = (STATE_NAMES, TIME_NAMES) if in_jax else (TIME_NAMES, STATE_NAMES)
    names = [each.name for each in named if each.kind is not inspect.Parameter.KEYWORD_ONLY]
    meant = "(memory, t, x)" if in_jax else "(x, t)"
    if len(names) == 2 and names[0] in first and names[1] in second:
        return [f"its arguments are {', '.join(names)}, and a controller is called with {meant}: swap them"]
    return (
        [] if in_jax or not _answers_swapped(source) else [f"it answers to (t, x) alone: its arguments are {meant}"]
    )


def _answers_swapped(source: PythonController) -> bool:
    x = trial_states()[-1]
    call = attribute(source.source, "get_control_output", source.source)
    try:
        checked_torques(call, x, 0.0)
    except SwingupError:
        with contextlib.suppress(SwingupError):
            checked_torques(lambda x, t: call(t, x), x, 0.0)
            return True
    return False


def _try_driven(torques: np.ndarray, robot: Robot, limit: float) -> list[str]:
    """Whether the torques (n,) of the driven joint are near what its motor has (N m)."""
    largest = float(np.abs(torques).max())
    if largest <= MAX_TORQUE_RATIO * limit:
        return []
    return [
        f"it commands up to {largest:.4g} N m on the driven joint {robot.joint + 1}, whose motor has {limit:g} "
        "N m: clip the torque, and return it in N m"
    ]


def _try_passive(source: Any, torques: np.ndarray, joint: int) -> list[str]:
    """Whether the torques (n,) of the passive joint, 1 or 2, are as the controller declares them."""
    controller = source.source if isinstance(source, PythonController) else source
    declared = finite_number("its attribute passive_limit", attribute(controller, "passive_limit", 0.0), 0.0)
    largest = float(np.abs(torques).max())
    if largest <= declared:
        return []
    finding = f"it commands up to {largest:g} N m on the passive joint {joint}"
    if declared:
        return [f"{finding}, and its passive_limit is {declared:g}: clip the torque, or declare more"]
    return [f"{finding}: return 0 there, or declare what compensates its friction as passive_limit"]


def _try_compiled(controller: AbstractController[Any]) -> np.ndarray:
    """Torques along the trial states, from a program compiled in the way of the benchmark's simulations."""
    states = trial_states()
    with jax.enable_x64(True):
        check_interface(controller)
        with errors_named_after("running it"):
            times = jnp.arange(len(states)) * TRIAL_DT
            torques = np.asarray(run_calls(*split(controller), times, jnp.asarray(states)))
    return _finite(states, torques)


def _try_plain(controller: PythonController) -> tuple[list[str], np.ndarray]:
    states, findings = trial_states(), []
    first = call_in_turn([controller], states)[0]
    copies = controller.copies(2)
    if not np.array_equal(call_in_turn([controller], states)[0], first):
        findings.append("it answers otherwise when run again: clear its memory in reset() or init(), and seed it")
    # One cause, one finding: copies also disagree where the memory is not cleared.
    elif len(copies) == 1:
        findings.append(
            "it has no independent copies, so that its simulations run one by one: let copy.deepcopy copy it, and "
            "keep memory in the object, not in globals or its class"
        )
    x = states[-1].copy()
    with errors_named_after("calling it"):
        # Called directly: checked_torques() passes a copy, which would hide the change.
        controller.start()(x, 0.0)
    if not np.array_equal(x, states[-1]):
        findings.append("it changes the measurement that it is given: copy x before altering it")
    return findings, first


SMALL_TURN = 1e-4  # Step of the differences that give a controller's gains (rad, rad/s)
OTHER_ZEROS = {"horizontal": 0.5 * np.pi, "upright": 0.0}
"""Angles of the shoulder that are upright where another convention counts from there (rad)."""


def upright_law(source: Any, robot: Robot, plant: Plant) -> tuple[list[str], list[str]]:
    """What is wrong with a controller's linear law at the top of a plant, and its gains and poles in words.

    The gains K of u = -K e are differences of the torques of first calls. The plant is linear without Coulomb
    friction. A law that does not hold is a finding where its other sign, or another zero of the shoulder, would.
    """
    controller = source if isinstance(source, AbstractController | PythonController) else PythonController(source)
    if any(isinstance(layer, PolicyController) for layer in layers(controller)):
        return [], []
    joint, limit, model = robot.joint, float(plant.limit(robot.joint)), design_model(plant, robot)
    A, B, _ = (each[0] for each in linearised(model, robot, UPRIGHT[None], np.zeros(1)))
    steps = SMALL_TURN * np.concatenate([np.zeros((1, 4)), np.eye(4), -np.eye(4)])
    uprights = [UPRIGHT[0], *OTHER_ZEROS.values()]
    states = np.concatenate([steps + np.array([shoulder, 0, 0, 0]) for shoulder in uprights])
    states[:, :2] += plant.zeros  # as the encoders show them
    try:
        torques = _first_torques(controller, states)[:, joint].reshape(-1, len(steps))
    except SwingupError as error:
        return [str(error)], []
    laws = (torques[:, 5:] - torques[:, 1:5]) / (2 * SMALL_TURN)

    def poles(gains: np.ndarray) -> np.ndarray:
        return np.sort_complex(np.linalg.eigvals(A - np.outer(B, gains)))

    def holding_sign(torque: float, gains: np.ndarray) -> float | None:
        """The sign with which the gains hold the pendulum, if they do and the torque (N m) rests there."""
        if abs(torque) > 0.01 * limit or not gains.any():
            return None
        return next((sign for sign in (1.0, -1.0) if poles(sign * gains).real.max() < 0), None)

    sign, *others = map(holding_sign, torques[:, 0], laws)
    gains, lines = laws[0], [f"at the top its torque is {torques[0, 0]:.3g} N m and has no gains"]
    if gains.any():
        shown = ", ".join(
            f"{pole.real:.3g}{f'{pole.imag:+.3g}i' if abs(pole.imag) > 1e-9 else ''}" for pole in poles(gains)
        )
        lines = [f"at the top u = -K e with K = {np.round(gains, 3).tolist()}; poles {shown} 1/s"]
    if sign is not None:
        wrong = f"its torque at the top has the wrong sign: u = -K e holds with {np.round(-gains, 3).tolist()}"
        return [wrong] if sign < 0 else [], lines
    for (where, zero), other in zip(OTHER_ZEROS.items(), others, strict=True):
        if other is not None:
            also = " and change its torque's sign" if other < 0 else ""
            return [
                f"it takes q1 = {zero:.4g} for upright, counted from {where}; here q1 = 0 hangs: give it "
                f"q1 - {np.pi - zero:.4g}{also}"
            ], lines
    if gains.any() and poles(gains).real.max() >= 0:
        lines.append("these poles leave out Coulomb friction, which may hold it: --board balance tells")
    return [], lines


def _first_torques(controller: AbstractController[Any] | PythonController, states: np.ndarray) -> np.ndarray:
    """The torques (n, 2) of a first call in each of the states (n, 4); refuses what is not finite."""
    if isinstance(controller, PythonController):
        return np.array([checked_torques(controller.start(), x, 0.0) for x in states])
    with jax.enable_x64(True):
        first = eqx.filter_jit(lambda x: controller(controller.init(), jnp.zeros(()), x)[1])
        return _finite(states, np.array([first(jnp.asarray(x)) for x in states]))


def _finite(states: np.ndarray, torques: np.ndarray) -> np.ndarray:
    """The torques (n, 2) of states (n, 4); those that are not finite are refused."""
    faulty = np.flatnonzero(~np.isfinite(torques).all(axis=1))
    if faulty.size:
        x = np.round(states[faulty[0]], 4).tolist()
        raise SwingupError(f"its torque is not finite for x = {x}: correct it there")
    return torques
