"""The one interface of all controllers: explicit state, so that whole closed loops compile and batch."""

import abc
import copy
import inspect
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Generic, NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..common.checks import positive_number
from ..common.errors import SwingupError, attribute, described, errors_named_after, quoted
from ..common.types import Count, Flag, Scalar, State, Torque
from ..plant.plant import TORQUE_LIMIT, Plant, Robot, get_robot
from ..policy.contract import LoopController
from ..policy.guard import GuardChoice, choose_guard
from ..tasks.task import structure_of


class Time(NamedTuple):
    """A time (s): ``seconds`` + ``rest``."""

    seconds: Count | np.ndarray
    rest: Scalar | np.ndarray

    def __sub__(self, before: "Time") -> Scalar:
        """The time (s) since ``before``."""
        return jnp.asarray((self.seconds - before.seconds) + (self.rest - before.rest))

    def like(self, other: "Time") -> "Time":
        """In another's types: a compiled loop keeps the types of its carry."""
        return Time(*(jnp.asarray(mine, jnp.result_type(its)) for mine, its in zip(self, other, strict=True)))


TimeLike: TypeAlias = Any
"""A number (s) or a :class:`Time`; any type, since most controllers are written for numbers alone."""


def split_time(t: float) -> Time:
    """A time (s) for calls of a controller in JAX outside 64-bit mode."""
    whole = math.floor(t) if math.isfinite(t) else 0
    # Arrays, since a compiled call would be compiled anew for each Python float.
    return Time(np.asarray(whole, np.int32), np.asarray(t - whole))


def as_time(t: TimeLike) -> Time:
    """A time that is perhaps split already."""
    return t if isinstance(t, Time) else Time(np.zeros((), np.int32), jnp.asarray(t))


def never() -> Time:
    """Before all times: what a controller remembers before its first call."""
    return Time(jnp.zeros((), jnp.int32), jnp.array(-jnp.inf))


def since_first_call(t: TimeLike, first: Time) -> tuple[Time, Scalar]:
    """The time of the first call, perhaps this one, at which trajectories begin, and the time since then (s)."""
    now = as_time(t).like(first)
    # As a value, since a compiled loop has no first call of its own.
    none: Flag = jnp.isneginf(first.rest)
    begun = Time(*(jnp.where(none, mine, its) for mine, its in zip(now, first, strict=True)))
    return begun, now - begun


Carry = TypeVar("Carry")


class AbstractController(eqx.Module, Generic[Carry]):
    """A controller of the double pendulum: ``init() -> carry``, then ``(carry, t, x) -> (carry, u)``."""

    wraps: ClassVar[bool] = False
    """Whether it stands around its field ``controller``."""

    @abc.abstractmethod
    def init(self) -> Carry:
        """What the controller remembers before the first step."""

    @abc.abstractmethod
    def __call__(self, carry: Carry, t: TimeLike, x: State) -> tuple[Carry, Torque]:
        """The torques [u1, u2] (N m) for the state x measured at time t (s), and what to remember.

        Outside 64-bit mode pass ``interface.split_time(t)``: single precision loses a time of some hours.
        """


def layers(controller: Any) -> list[AbstractController[Any]]:
    """A controller, then what stands behind it, from outside to the innermost; none in plain Python."""
    if not isinstance(controller, AbstractController):
        return []
    return [controller, *(layers(controller.controller) if controller.wraps else [])]  # type: ignore[attr-defined]


class AbstractPlantController(AbstractController[Carry]):
    """A controller that depends on its plant: a call may say which plant it is for.

    Subclasses implement ``control``; a call is ``control`` for the controller's own plant. Plants may be traced or
    batched, one for each pendulum.
    """

    @abc.abstractmethod
    def control(self, carry: Carry, t: TimeLike, x: State, base: Any) -> tuple[Carry, Torque]:
        """Do what a call does, for a plant with base parameters θ (9,), by ``plant.base_parameters.BASE_NAMES``.

        With None it is the controller's own plant.
        """

    def __call__(self, carry: Carry, t: TimeLike, x: State) -> tuple[Carry, Torque]:
        """The torques [u1, u2] (N m) for the state x measured at time t (s), and the memory for the next call."""
        return self.control(carry, t, x, None)


class ZeroedController(AbstractController[Carry]):
    """A controller that sees angles without the encoders' zeros."""

    wraps: ClassVar[bool] = True

    controller: AbstractController[Carry]
    zeros: tuple[float, float]  # Shown where the pendulum hangs (rad)

    @property
    def robot(self) -> Any:
        """The robot that the controller behind says it is for."""
        return attribute(self.controller, "robot")

    @property
    def passive_limit(self) -> float:
        """Largest torque on the passive joint (N m)."""
        return float(getattr(self.controller, "passive_limit", 0.0))

    def init(self) -> Carry:
        """What the controller behind remembers."""
        return self.controller.init()

    def __call__(self, carry: Carry, t: TimeLike, x: State) -> tuple[Carry, Torque]:
        """Its torques (N m)."""
        return self.controller(carry, t, x - jnp.stack([*self.zeros, 0.0, 0.0]).astype(jnp.result_type(x, 0.0)))


def from_zeros(controller: AbstractController[Any], plant: Plant) -> AbstractController[Any]:
    """A controller of a plant that is shown what the plant's encoders show."""
    return ZeroedController(controller, plant.zeros) if any(plant.zeros) else controller


def call_for_plant(
    controller: AbstractController[Any], carry: Any, t: TimeLike, x: State, base: Any
) -> tuple[Any, Torque]:
    """A call of any controller; a controller that depends on its plant gets θ."""
    if isinstance(controller, AbstractPlantController):
        return controller.control(carry, t, x, base)
    return controller(carry, t, x)


def joint_torques(u: Scalar, robot: Robot, limit: Scalar | float) -> Torque:
    """Both joints' torques (N m): u, clipped to the limit, on the driven joint and 0 on the passive one."""
    # Selected, not multiplied: a NaN is one of the driven joint alone.
    return jnp.where(jnp.array(robot.actuation) > 0, jnp.clip(u, -limit, limit), 0.0)


def check_interface(controller: AbstractController[Any]) -> None:
    """Trace one call of a controller in JAX without running it; call this in 64-bit mode, as the judge runs it."""
    # By what is not hashed JAX cannot tell one compiled program from another: lists, sets, static arrays.
    with errors_named_after(
        "hashing its fields", "make lists and sets tuples, and keep arrays in fields that are not static"
    ):
        hash(split(controller)[1])
    with errors_named_after("tracing it"):
        start = controller.init()
        answer = jax.eval_shape(lambda memory, t, x: controller(memory, t, x), start, jnp.zeros(()), jnp.zeros(4))
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise SwingupError("a call of it must return two things: what to remember, and the torques [u1, u2]")
    after, command = answer
    if getattr(command, "shape", None) != (2,):
        shape = getattr(command, "shape", type(command).__name__)
        raise SwingupError(f"its torque has shape {shape}: return [u1, u2] of shape (2,) in N m")
    if jnp.issubdtype(command.dtype, jnp.complexfloating):
        raise SwingupError(f"its torque is {command.dtype}: return real numbers [u1, u2] in N m")
    if structure_of(after) != structure_of(start):
        raise SwingupError("its memory changes shape or dtype in a call: keep what init() returns")


def split(controller: AbstractController[Any]) -> tuple[Any, Any]:
    """Split into the numbers, which are arguments of compiled programs, and the rest, which is compiled in."""
    # Floats as well: controllers that differ in them alone share a program. An int may be a shape, a bool a branch.
    return eqx.partition(controller, lambda leaf: eqx.is_array_like(leaf) and not isinstance(leaf, int))


def check_robot(source: Any, robot: Robot) -> None:
    """Refuse a controller that says it is for another robot."""
    meant = attribute(source, "robot")
    if isinstance(meant, Robot) and meant != robot:
        raise SwingupError(f"it is for the {meant.name}, not the {robot.name}: judge it there")


TorqueFunction = Callable[[np.ndarray, float], Any]

TRIAL_DT = 0.002  # Time between the calls of a trial (s)


class PythonController:
    """A controller in plain Python, called once a step.

    Its memory, if any, is cleared by its own ``reset()`` and ``init()``, in this order, where it has them.
    """

    def __init__(self, source: Any) -> None:
        # A class is callable, too, but a call of it makes an object.
        if inspect.isclass(source) or not callable(attribute(source, "get_control_output", source)):
            raise SwingupError(
                f"{quoted(source)} is not a controller: pass a function of (x, t), an object with "
                "get_control_output(x, t), or a swingup controller"
            )
        self.source = source
        self.robot = attribute(source, "robot")

    def start(self) -> TorqueFunction:
        """Clear the memory and return what to call with x (4,) (rad, rad/s) and t (s)."""
        for name in ("reset", "init"):
            method = attribute(self.source, name)
            if callable(method):
                with errors_named_after(f"its {name}()"):
                    method()
        return _by_keywords(attribute(self.source, "get_control_output", self.source))

    def copies(self, number: int) -> "list[PythonController]":
        """Independent controllers for simulations side by side; just this one where it has none."""
        try:
            with errors_named_after("its copying"):
                made = [self, *(PythonController(copy.deepcopy(self.source)) for _ in range(number - 1))]
        except SwingupError:
            return [self]
        # Two of them tell: all copies are made in the same way.
        return made if number == 1 or are_independent(made[:2]) else [self]


def checked_torques(call: TorqueFunction, x: np.ndarray, t: float) -> np.ndarray:
    """One call, checked: the torques [u1, u2] (N m) as float64."""
    try:
        given = call(x.copy(), t)
        u = np.asarray(given)
    # A SwingupError already names its fault.
    except (KeyboardInterrupt, SwingupError):
        raise
    except BaseException as error:  # no context manager: this is called millions of times
        raise SwingupError(f"it raised {described(error)} at t = {t:g} s: correct it there") from error
    if u.shape != (2,) or u.dtype.kind not in "fiub":
        what = f"of shape {u.shape}" if u.dtype.kind in "fiub" else quoted(given)
        raise SwingupError(f"its torque at t = {t:g} s is {what}: return two real numbers [u1, u2] in N m")
    if not np.isfinite(u).all():
        raise SwingupError(f"it gave a torque that is not finite at t = {t:g} s: correct it there")
    return u.astype(np.float64)


def call_in_turn(controllers: Sequence[PythonController], states: np.ndarray) -> list[np.ndarray]:
    """Start controllers anew and call them in turn, state by state (n, 4); the answers (n, 2) of each."""
    calls = [controller.start() for controller in controllers]
    answers = [[checked_torques(call, x, step * TRIAL_DT) for call in calls] for step, x in enumerate(states)]
    return [np.array([row[index] for row in answers]) for index in range(len(calls))]


def are_independent(controllers: Sequence[PythonController]) -> bool:
    """Whether copies of a controller that are called in turn answer as one that is called alone.

    Copies that share a memory (a closure, a global, a class attribute) answer differently. Copies that fail count
    as independent: they share nothing that matters.
    """
    states = trial_states()
    try:
        alone = call_in_turn(controllers[:1], states)[0]
        return all(np.array_equal(each, alone) for each in call_in_turn(controllers, states))
    except SwingupError:
        return True


def trial_states() -> np.ndarray:
    """States (n, 4) to try a controller on: hanging, upright, full turns away, fast, then random."""
    pi = np.pi
    chosen = [[0, 0, 0, 0], [pi, 0, 0, 0], [-pi, 2 * pi, 0, 0], [3, -7, 20, -20], [pi, 0, 30, 30]]
    random = np.random.default_rng(0).uniform(-1, 1, (27, 4)) * [2 * pi, 2 * pi, 20, 20]
    return np.concatenate([np.array(chosen, np.float64), random])


def _by_keywords(call: Callable[..., Any]) -> TorqueFunction:
    """The call by the names x and t where it has both, as RealAIGym calls; else in this order."""
    try:
        names = inspect.signature(call).parameters
    except Exception:  # built-in functions have none, and a foreign __signature__ may raise anything
        return call
    if {"x", "t"} <= set(names) and names["x"].kind is not inspect.Parameter.POSITIONAL_ONLY:
        return lambda x, t: call(x=x, t=t)
    return call


class CompiledSource:
    """The torques of a controller, compiled when it is made and not in the loop."""

    min_pause: float = 0.0  # The controller acts at each call (s)
    period: float | None = None

    def __init__(self, controller: AbstractController[Any]) -> None:
        """Compile one call in double precision, as the judge runs it."""
        with jax.enable_x64(True):
            self._call: Any = eqx.filter_jit(controller)
            self._start = controller.init()
        self.reset()
        self.act(np.zeros(4), 0.0)
        self.reset()

    def __deepcopy__(self, known: dict[int, Any]) -> "CompiledSource":
        # Memories are replaced, never altered: a shallow copy has its own, and shares what is compiled.
        return copy.copy(self)

    def reset(self) -> None:
        """Forget the run so far."""
        self._memory: Any = self._start

    def act(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m) for the state x (4,) at time t (s)."""
        with jax.enable_x64(True):
            self._memory, u = self._call(self._memory, np.float64(t), x)
            return np.asarray(u, np.float64)

    def remember(self, u: np.ndarray) -> None:
        """Nothing: the controller's memory has its own torques."""


def loop_controller(
    controller: Any, robot: Robot | str, guard: GuardChoice = None, limit: float = TORQUE_LIMIT
) -> LoopController[CompiledSource]:
    """Put a controller in JAX, as of :func:`swingup.get_controller`, behind the contract of a robot's loop.

    The driven joint's torque has a limit (N m). A safety guard is there for True, or with the settings given.

    Raises:
        SwingupError: the controller is in plain Python or for another robot, or a setting of the guard cannot work.
    """
    robot = get_robot(robot)
    if not isinstance(controller, AbstractController):
        raise SwingupError("this controller is in plain Python: call it as it is, only those in JAX are compiled")
    check_robot(controller, robot)
    limit = positive_number("limit", limit, unit="N m")
    passive = float(getattr(controller, "passive_limit", 0.0))
    limits = (limit, passive) if robot.joint == 0 else (passive, limit)
    return LoopController(CompiledSource(controller), robot, limits, choose_guard(guard, None, None))
