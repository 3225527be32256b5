"""Who stands beside a controller on a robot: a supervisor stops the run, throws the pendulum or pushes it.

A supervisor is called once a step with the measured state, before the controller. Like a controller it has explicit
state, so that whole closed loops compile and batch.
"""

import abc
import math
from dataclasses import replace
from typing import Annotated, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..common.types import Count, Flag, Scalar, State, Torque
from ..dynamics.dynamics import UPRIGHT, gravity_torque, wrap_difference
from ..plant.plant import Plant
from ..plant.units import DAMPING, TORQUE, TORQUE_RATE, VELOCITY

Memory = TypeVar("Memory")


class Intervention(eqx.Module):
    """What a supervisor does in one step."""

    takes: Flag  # The supervisor drives both joints, and the controller is not called
    torque: Torque  # The torques (N m) that replace the controller's then, before the motors' limits
    push: Torque  # Torques (N m) that are added to the controller's in any case, before the motors' limits
    stops: Flag  # The run is over: what follows is not scored


def no_intervention(dtype: jnp.dtype) -> Intervention:
    """The controller alone drives."""
    return Intervention(jnp.array(False), jnp.zeros(2, dtype), jnp.zeros(2, dtype), jnp.array(False))


class AbstractSupervisor(eqx.Module, Generic[Memory]):
    """``start() -> memory``, then ``(memory, t, x) -> (memory, intervention)`` at every step."""

    @abc.abstractmethod
    def start(self, dtype: jnp.dtype) -> Memory:
        """What the supervisor remembers before the first step."""

    @abc.abstractmethod
    def __call__(self, memory: Memory, t: Scalar, x: State) -> tuple[Memory, Intervention]:
        """What to remember, and what to do, for the state x measured at time t (s)."""


BRAKE = 1.0
"""Torque of the brake over the speed of a joint (N m s/rad). Source: the public loop of RealAIGym's robots."""


class Limits(eqx.Module):
    """The largest angle and speed of either joint."""

    angle: float | Scalar
    """rad; angles are not wrapped."""
    speed: Annotated[float | Scalar, VELOCITY]
    """rad/s"""

    @property
    def bounds(self) -> np.ndarray:
        """The largest |q1|, |q2|, |dq1| and |dq2|."""
        return np.array([self.angle, self.angle, self.speed, self.speed])

    def exceeded(self, x: State) -> Flag:
        """Whether either joint of a state is beyond a limit."""
        return jnp.any(jnp.abs(x[:2]) > self.angle) | jnp.any(jnp.abs(x[2:]) > self.speed)


class Stop(AbstractSupervisor[Flag]):
    """Stops the run and brakes once a measured state is beyond the limits."""

    limits: Limits

    def start(self, dtype: jnp.dtype) -> Flag:
        """Not stopped."""
        return jnp.array(False)

    def __call__(self, memory: Flag, t: Scalar, x: State) -> tuple[Flag, Intervention]:
        """Brake from the first state beyond the limits on."""
        # For good: a robot that has stopped does not start by itself.
        stopped = memory | self.limits.exceeded(x)
        return stopped, Intervention(stopped, -BRAKE * x[2:], jnp.zeros_like(x[:2]), stopped)


WITHOUT_DERIVATIVE = 2  # First calls of the run in which the PID takes its derivative for 0


class Thrower(eqx.Module):
    """Gains of the PID that throws."""

    kp: Annotated[float | Scalar, TORQUE] = 10.0  # N m/rad
    ki: Annotated[float | Scalar, TORQUE_RATE] = 0.1  # N m/(rad s)
    kd: Annotated[float | Scalar, DAMPING] = 1.0  # N m s/rad
    dt: float | Scalar = 0.001
    """The PID's period in its own formula (s); it is called every 0.002 s. It is real time for every pendulum."""
    limit: Annotated[float | Scalar, TORQUE] = 6.0
    """Torque limit of the PID, and of each of the two motors (N m)."""
    proportional_limit: Annotated[float | Scalar | None, TORQUE] = None
    """Limit of its proportional part alone (N m); None for none."""


THROWER = Thrower()  # The simulation's
ROBOT_THROWER, ROBOT_THROW = Thrower(kp=2.0, ki=0.0, kd=0.3, proportional_limit=3.0), 1.0
"""The real robot's, and how long it throws (s). Source: ICRA 2025."""


class PID(eqx.Module):
    """The PID's memory between calls."""

    calls: Count
    total: Float[Array, "2"]  # sum of the errors so far (rad)
    last: Float[Array, "2"]  # error of the last call (rad)


def start_pid(dtype: jnp.dtype) -> PID:
    """A PID before its first call."""
    return PID(jnp.zeros((), int), jnp.zeros(2, dtype), jnp.zeros(2, dtype))


class Throws(AbstractSupervisor[tuple[PID, Count]]):
    """At times a PID takes both joints from the controller and drives them to a random configuration.

    Source: the rules of the global-policy benchmark (ICRA 2025). They include the PID's quirks: its error is not
    wrapped, its error sum and its last error continue from throw to throw, and its period is not the loop's.
    """

    number: Int[Array | np.ndarray, "steps"]  # Number of the throw at each step, -1 between throws
    target: Float[Array | np.ndarray, "throws 2"]  # Angles that each throw aims at (rad)
    thrower: Thrower
    model: Plant  # The model with which the PID compensates gravity

    def start(self, dtype: jnp.dtype) -> tuple[PID, Count]:
        """The PID and the number of the first step."""
        return start_pid(dtype), jnp.zeros((), int)

    def __call__(self, memory: tuple[PID, Count], t: Scalar, x: State) -> tuple[tuple[PID, Count], Intervention]:
        """Let the PID drive both joints during a throw."""
        before, step = memory
        # By the step and not by the time: the benchmark's clock is a sum, whose rounding the plan contains.
        number = jnp.asarray(self.number)[step]
        thrown, none = number >= 0, no_intervention(x.dtype)
        pid, torque = throwing_torque(self.thrower, self.model, before, jnp.asarray(self.target)[number], x)
        # Between throws the PID rests: its error sum runs on from throw to throw.
        pid = jax.tree.map(lambda new, old: jnp.where(thrown, new, old), pid, before)
        return (pid, step + 1), replace(none, takes=thrown, torque=torque)


def throwing_torque(
    thrower: Thrower, parameters: Plant, pid: PID, target: Float[Array, "2"], x: State
) -> tuple[PID, Torque]:
    """One call of the PID towards a target (rad): its torque, minus the gravity torque of a model (N m)."""
    error = target - x[:2]
    total = pid.total + error
    derivative = jnp.where(pid.calls < WITHOUT_DERIVATIVE, 0.0, (error - pid.last) / thrower.dt)
    proportional = thrower.kp * error
    if thrower.proportional_limit is not None:
        proportional = jnp.clip(proportional, -thrower.proportional_limit, thrower.proportional_limit)
    u = proportional + thrower.ki * thrower.dt * total + thrower.kd * derivative
    # Clipped before the gravity torque; the motors clip the sum once more (benchmark).
    command = jnp.clip(u, -thrower.limit, thrower.limit) - gravity_torque(parameters, x)
    return PID(pid.calls + 1, total, error), command


class ResetMemory(eqx.Module):
    """What the resets remember from call to call."""

    active: Flag  # a reset runs: the PID has both joints
    begun: Count  # resets so far, planned or inserted
    planned: Count  # planned ones so far
    delay: Scalar  # time by which inserted resets delay the rest of the plan (s)
    before: Scalar  # time for which the last reset was planned, or at which it was inserted (s)
    clock: Scalar  # time of the present reset (s)
    t: Scalar  # time of the last call (s)
    clean: Count  # samples since the last that exceeded a limit
    pid: PID
    stopped: Flag


class Resets(AbstractSupervisor[ResetMemory]):
    """Throws at planned times, and at once when the pendulum exceeds a limit; stops the run at wider limits.

    Source: the rules of ICRA 2025 on the real robot. A reset at a limit is inserted before the planned ones, which
    it delays. The rules' quirks are kept: the delay counts from the time for which the reset before was planned,
    not from its end, and the PID's errors continue from reset to reset.
    """

    plan: Float[Array | np.ndarray, "resets"]  # Planned times, in order (s)
    target: Float[Array | np.ndarray, "goals 2"]  # Angles that one reset after another aims at (rad)
    duration: float | Scalar  # A reset lasts longer than this (s)
    clean: int | Count
    """A reset ends only after this many samples in a row within the limits, the present one included."""
    limits: Limits  # Beyond these a reset begins at once
    thrower: Thrower  # The PID
    model: Plant  # The model with which it compensates gravity
    stop: Stop

    def start(self, dtype: jnp.dtype) -> ResetMemory:
        """No reset so far, and not stopped."""
        zero, nothing, no = jnp.zeros((), dtype), jnp.zeros((), int), jnp.array(False)
        # As if samples before the run had been clean.
        clean, pid = jnp.asarray(self.clean, int), start_pid(dtype)
        return ResetMemory(no, nothing, nothing, zero, zero, zero, zero, clean, pid, self.stop.start(dtype))

    def __call__(self, memory: ResetMemory, t: Scalar, x: State) -> tuple[ResetMemory, Intervention]:
        """Begin or end a reset at time t (s), in which the PID drives; after a stop it is the brake.

        A reset that is due counts as planned, though a limit is exceeded as well.
        """
        exceeded = self.limits.exceeded(x)
        clean = jnp.where(exceeded, 0, memory.clean + 1)
        plan = jnp.append(jnp.asarray(self.plan), jnp.inf)[memory.planned] + memory.delay
        due = t >= plan
        begins = ~memory.active & (due | exceeded)
        clock = jnp.where(begins, 0.0, memory.clock)
        # Never in the call that begins it, since the clock is 0 then.
        active = (memory.active | begins) & ~((clock > self.duration) & (clean >= self.clean))
        begun = memory.begun + begins
        target = jnp.asarray(self.target)[jnp.maximum(begun - 1, 0)]
        thrown, torque = throwing_torque(self.thrower, self.model, memory.pid, target, x)
        stopped, end = self.stop(memory.stopped, t, x)
        after = ResetMemory(
            active=active,
            begun=begun,
            planned=memory.planned + (begins & due),
            # The first reset has none before it: `before` is 0 then.
            delay=jnp.where(begins & ~due, memory.delay + (t - memory.before), memory.delay),
            before=jnp.where(begins, jnp.where(due, plan, t), memory.before),
            clock=clock + jnp.where(active, t - memory.t, 0.0),
            t=jnp.asarray(t, memory.t.dtype),
            clean=clean,
            # Between resets the PID rests.
            pid=jax.tree.map(lambda new, old: jnp.where(active, new, old), thrown, memory.pid),
            stopped=stopped,
        )
        torque = jnp.where(stopped, end.torque, torque)
        return after, Intervention(active | stopped, torque, end.push, stopped)


SHOULDER = np.array([1.0, 0.0])


class CellSettings(eqx.Module):
    """When disturbances come and end."""

    threshold: float | Scalar = 0.3
    """Both angles within this of the goal, or of a move's target, are there (rad)."""
    at_goal: float | Scalar = 3.0  # Time at the goal before a disturbance that waits for it (s)
    anywhere: float | Scalar = 0.2  # Time anywhere before one that does not (s)
    kick: float | Scalar = 0.1  # Duration of a kick (s)
    move_timeout: float | Scalar = 2.0
    """A move that has not reached its target ends after this time (s). Chosen."""
    settled_speed: float | Scalar = 2.0
    """A move ends with both joints slower than this (rad/s). Chosen."""
    kp: float | Scalar = 0.1
    """Stiffness of the position control (N m/rad). Chosen."""
    kd: float | Scalar = 0.004
    """Damping of the position control (N m s/rad). Chosen."""


class Disturbances(eqx.Module):
    """The disturbances of a run, in their order."""

    target: Float[Array | np.ndarray, "n 2"]  # Angles to which a move goes (rad); NaN for a kick
    kick: Float[Array | np.ndarray, "n"]  # Torque of a kick on the shoulder (N m); 0 for a move
    anywhere: Bool[Array | np.ndarray, "n"]  # Whether it comes wherever the pendulum is


def example_disturbances(random: np.random.Generator) -> Disturbances:
    """The example's: 24 moves, 10 kicks at the goal and 20 weak ones anywhere, in an order that is drawn."""
    moves = [(i * math.pi / 4, q2) for i in range(8) for q2 in (0.0, -math.pi / 2, math.pi / 2)]
    strong = [sign * size for size in (0.02, 0.04, 0.06, 0.08, 0.1) for sign in (1, -1)]
    weak = [0.01] * 20
    kicks = np.array([0.0] * len(moves) + strong + weak)
    targets = np.full((kicks.size, 2), np.nan)
    targets[: len(moves)] = moves
    order = random.permutation(kicks.size)
    return Disturbances(targets[order], kicks[order], (np.arange(kicks.size) >= kicks.size - len(weak))[order])


class CellMemory(eqx.Module):
    """What a cell remembers from call to call."""

    done: Count  # disturbances that are over
    active: Flag  # one acts now
    clock: Scalar  # time that it has acted, or that the next one has waited (s)
    t: Scalar  # time of the last call (s)
    stopped: Flag


class Cell(AbstractSupervisor[CellMemory]):
    """Moves by position control and kicks of the shoulder, one after another; stops the run at limits.

    The shape is that of CloudPendulum's public benchmark example: most disturbances wait until the pendulum has
    been at the goal for a while. What the example does not say is chosen: the order, the gains of the position
    control, when a move ends, and that the controller drives on during a kick.
    """

    disturbances: Disturbances
    settings: CellSettings
    model: Plant  # The model with which a move compensates gravity
    stop: Stop

    def start(self, dtype: jnp.dtype) -> CellMemory:
        """Nothing has happened."""
        zero, no = jnp.zeros((), dtype), jnp.array(False)
        return CellMemory(jnp.zeros((), int), no, zero, zero, self.stop.start(dtype))

    def __call__(self, memory: CellMemory, t: Scalar, x: State) -> tuple[CellMemory, Intervention]:
        """Begin, continue or end a disturbance at time t (s)."""
        disturbances, settings = self.disturbances, self.settings
        number = jnp.asarray(disturbances.kick).shape[0]
        # Behind the last one the index stays there: that nothing begins any more is seen below.
        index = jnp.minimum(memory.done, number - 1)
        target, kick = jnp.asarray(disturbances.target)[index], jnp.asarray(disturbances.kick)[index]
        anywhere, moves = jnp.asarray(disturbances.anywhere)[index], kick == 0
        at_goal = self._near(x, jnp.asarray(UPRIGHT[:2], x.dtype))
        passed = memory.clock + (t - memory.t)
        # Away from the goal, the time there starts again.
        waited = jnp.where(anywhere | at_goal, passed, 0.0)
        wait = jnp.where(anywhere, settings.anywhere, settings.at_goal)
        begins = ~memory.active & (memory.done < number) & (waited >= wait)
        there = (self._near(x, target) & jnp.all(jnp.abs(x[2:]) < settings.settled_speed)) | (
            passed > settings.move_timeout
        )
        ends = memory.active & jnp.where(moves, there, passed >= settings.kick)
        active = (memory.active | begins) & ~ends
        clock = jnp.where(begins | ends, 0.0, jnp.where(memory.active, passed, waited))
        stopped, end = self.stop(memory.stopped, t, x)
        push = jnp.where(active & ~moves & ~stopped, kick * jnp.asarray(SHOULDER, x.dtype), 0.0)
        torque = jnp.where(stopped, end.torque, self._position_control(x, target))
        after = CellMemory(memory.done + ends, active, clock, jnp.asarray(t, memory.t.dtype), stopped)
        # A kick is added, and the controller drives on; a move takes both joints.
        return after, Intervention((active & moves) | stopped, torque, push, stopped)

    def _near(self, x: State, target: Float[Array, "2"]) -> Flag:
        return jnp.all(jnp.abs(wrap_difference(target - x[:2])) < self.settings.threshold)

    def _position_control(self, x: State, target: Float[Array, "2"]) -> Torque:
        """Towards the target the short way, before the motors' limits (N m)."""
        error = wrap_difference(target - x[:2])
        return self.settings.kp * error - self.settings.kd * x[2:] - gravity_torque(self.model, x)
