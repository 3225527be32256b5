"""Disturbances of a CloudPendulum cell: moves by position control, and kicks of the shoulder, one after another.

The shape is that of CloudPendulum's public benchmark example: most disturbances wait until the pendulum has been at
the goal for a while. What the example does not say is chosen: the order, the gains of the position control, when a
move ends, and that the controller drives on during a kick.
"""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...common.types import Count, Flag, Scalar, State, Torque
from ...dynamics.angles import UPRIGHT, wrap_difference
from ...dynamics.dynamics import gravity_torque
from ...plant.plant import Plant
from .limits import Stop
from .supervisor import AbstractSupervisor, Intervention

SHOULDER = np.array([1.0, 0.0])


class CellSettings(eqx.Module):
    """When disturbances come and end."""

    threshold: float | Scalar = 0.3
    """Both angles within this of the goal, or of a move's target, are there (rad)."""
    at_goal: float | Scalar = 3.0
    """Time at the goal before a disturbance that waits for it (s)."""
    anywhere: float | Scalar = 0.2
    """Time anywhere before one that does not (s)."""
    kick: float | Scalar = 0.1
    """Duration of a kick (s)."""
    longest: float | Scalar = 2.0
    """A move that has not reached its target ends after this time (s). Chosen."""
    slow: float | Scalar = 2.0
    """A move ends with both joints slower than this (rad/s). Chosen."""
    kp: float | Scalar = 0.1
    """Stiffness of the position control (N m/rad). Chosen."""
    kd: float | Scalar = 0.004
    """Damping of the position control (N m s/rad). Chosen."""


class Disturbances(eqx.Module):
    """The disturbances of a run, in their order."""

    target: Float[Array | np.ndarray, "n 2"]
    """Angles to which a move goes (rad); NaN for a kick."""
    kick: Float[Array | np.ndarray, "n"]
    """Torque of a kick on the shoulder (N m); 0 for a move."""
    anywhere: Bool[Array | np.ndarray, "n"]
    """Whether it comes wherever the pendulum is."""


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

    done: Count
    """Disturbances that are over."""
    active: Flag
    """One acts now."""
    clock: Scalar
    """Time that it has acted, or that the next one has waited (s)."""
    t: Scalar
    """Time of the last call (s)."""
    stopped: Flag


class Cell(AbstractSupervisor[CellMemory]):
    """Disturbs the pendulum by the list, and stops the run at limits."""

    disturbances: Disturbances
    settings: CellSettings
    model: Plant
    """The model with which a move compensates gravity."""
    stop: Stop

    def start(self, dtype: jnp.dtype) -> CellMemory:
        """Nothing has happened."""
        zero, no = jnp.zeros((), dtype), jnp.array(False)
        return CellMemory(jnp.zeros((), int), no, zero, zero, self.stop.start(dtype))

    def __call__(self, memory: CellMemory, t: Scalar, x: State) -> tuple[CellMemory, Intervention]:
        """Begin, continue or end a disturbance at time t (s)."""
        given, settings = self.disturbances, self.settings
        number = jnp.asarray(given.kick).shape[0]
        # Behind the last one the index stays there: that nothing begins any more is seen below.
        index = jnp.minimum(memory.done, number - 1)
        target, kick = jnp.asarray(given.target)[index], jnp.asarray(given.kick)[index]
        anywhere, moves = jnp.asarray(given.anywhere)[index], jnp.asarray(given.kick)[index] == 0
        at_goal = self._near(x, jnp.asarray(UPRIGHT[:2], x.dtype))
        passed = memory.clock + (t - memory.t)
        # Away from the goal, the time there starts again.
        waited = jnp.where(anywhere | at_goal, passed, 0.0)
        wait = jnp.where(anywhere, settings.anywhere, settings.at_goal)
        begins = ~memory.active & (memory.done < number) & (waited >= wait)
        there = (self._near(x, target) & jnp.all(jnp.abs(x[2:]) < settings.slow)) | (passed > settings.longest)
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
