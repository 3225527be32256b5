"""The top of the pendulum: linear quadratic regulators, what they do about dry friction, and the switch to them.

They are designed on the host in NumPy, and hold near the point of linearisation: the controller gives no torque
where its cost-to-go, and with it the error, is large.

Friction of the driven joint is a torque that its motor adds (``baselines.InOwnUnits``). Friction of the passive
joint is a disturbance. Near upright a regulator counts on it twice: as damping, since it resists motion, and by a
share of the torque that is best against it as a constant (``disturbance_gain``). How much of both holds a plant
differs: the settings are tried on the model, and the best ones are taken. Some plants are held by none.
"""

import abc
import itertools
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.linalg import solve_continuous_are

from ...common.types import Flag, Scalar, State, Torque
from ...dynamics.dynamics import UPRIGHT, linearise, wrap, wrap_difference
from ...dynamics.integrate import rk4_step
from ...plant.plant import Plant, Robot
from ..interface import AbstractController, Carry, Time, TimeLike, joint_torques, never, since_first_call


@dataclass(frozen=True)
class LQRSettings:
    """Weights of ∫ xᵀQx + R u² dt, and the largest cost-to-go at which the LQR acts."""

    state_weights: tuple[float, float, float, float]
    """Diagonal of Q (1/rad², s²/rad²)."""
    torque_weight: float
    """R (1/N²m²)."""
    max_cost_to_go: float
    """No torque where xᵀSx is above this."""


class LQR(AbstractController[None]):
    """u = -K (wrap(x) - goal), or 0 where the cost-to-go is too large; it remembers nothing."""

    gains: Float[Any, "4"]
    """K (N m/rad, N m s/rad)."""
    cost_to_go: Float[Any, "4 4"]
    """S"""
    max_cost_to_go: float
    limit: float
    """The motor's (N m)."""
    robot: Robot = eqx.field(static=True)
    friction: float | None = None
    """Added to u: this times arctan of ``knee`` times the passive joint's velocity (N m), against its friction."""
    knee: float | None = None
    """s/rad"""

    def init(self) -> None:
        """Nothing to remember."""

    def __call__(self, carry: None, t: Scalar, x: State) -> tuple[None, Torque]:
        """The regulator's torque on the driven joint (N m)."""
        error = wrap(x) - jnp.asarray(UPRIGHT, x.dtype)
        within = error @ jnp.asarray(self.cost_to_go) @ error <= self.max_cost_to_go
        u = -jnp.asarray(self.gains) @ error
        if self.friction is not None and self.knee is not None:
            u = u + self.friction * jnp.arctan(self.knee * x[3 - self.robot.joint])
        u = jnp.where(within, u, 0.0)
        return None, joint_torques(u, self.robot, self.limit)


def upright_lqr(parameters: Plant, robot: Robot, settings: LQRSettings) -> LQR:
    """The regulator of the pendulum linearised upright at rest."""
    A, B, _ = linearised(parameters, robot, UPRIGHT[None], np.zeros(1))
    S = solve_continuous_are(A[0], B[0][:, None], np.diag(settings.state_weights), [[settings.torque_weight]])
    limit = float(parameters.limit(robot.joint))
    return LQR(B[0] @ S / settings.torque_weight, S, settings.max_cost_to_go, limit, robot)


def disturbance_gain(parameters: Plant, regulator: LQR) -> float:
    """κ of u = -K e - κ f, the optimal regulator where a constant torque f acts on the undriven joint.

    With ė = A e + B u + D f the costate is S e + s f, (A - B K)ᵀ s = -S D, and κ the gain of s as K is that of S.
    """
    (A,), (B,), (D,) = linearised(parameters, regulator.robot, UPRIGHT[None], np.zeros(1))
    K, S = regulator.gains, regulator.cost_to_go
    # r, from K = Bᵀ S / r: a regulator does not keep the weights that it was designed with.
    weight = (B @ S @ B) / (K @ B)
    return float(B @ np.linalg.solve((A - np.outer(B, K)).T, -S @ D) / weight)


def linearised(
    parameters: Plant, robot: Robot, states: Float[np.ndarray, "n 4"], torque: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n 4"], Float[np.ndarray, "n 4"]]:
    """Continuous-time A = ∂ẋ/∂x, B = ∂ẋ/∂u and D = ∂ẋ/∂f of rows of states and torques.

    u is the driven joint's torque, f a torque on the undriven one.
    """
    with jax.enable_x64(True):
        u = jnp.asarray(torque)[:, None] * jnp.array(robot.actuation)
        A, B = map(np.asarray, _linearise_rows(parameters, jnp.asarray(states), u))
        return A, B[:, :, robot.joint], B[:, :, 1 - robot.joint]


# One function for all plants, which JAX compiles once for each number of rows.
_linearise_rows = jax.jit(jax.vmap(linearise, in_axes=(None, 0, 0)))


HAND_OVER = (0.4, 0.4, 1.5, 1.5)
"""|errors| below which the regulator takes over from a swing-up (rad, rad/s), in C.1's units. Friction keeps the
motion from the published ones, which are a quarter of these and less."""


class Counting(NamedTuple):
    """How a regulator counts on the passive joint's friction cf arctan(100 q̇)."""

    damping: float
    """cf times this is added to the joint's damping (s/rad)."""
    share: float
    """Share of the torque against cf as a constant."""
    knee: float
    """The friction's sign is 2/π arctan of this times the velocity (s/rad)."""


COUNTINGS = (Counting(1.0, 0.6, 6.0), Counting(4.0, 0.9, 30.0))
"""The two best of 540 settings on the shipped designs A.0, B.0, C.0 and C.1: neither is the better on all."""
MORE_COUNTINGS = tuple(
    itertools.starmap(Counting, itertools.product((4.0, 8.0, 16.0), (0.3, 0.6, 0.9), (12.0, 30.0)))
)
"""Others, for plants that the two hold from few starts: light ones, and heavy ones with much friction."""

STARTS = np.random.default_rng(0).uniform(-0.25, 0.25, (32, 4)) * HAND_OVER
"""Errors from which the settings are tried: a quarter of the hand-over's (rad, rad/s)."""
TRIAL_CALLS, LAST_CALLS = 3000, 500
"""Calls of a trial, and those of its end that count."""
FALLEN_ANGLE = 0.6
"""A larger error of an angle at the end of a trial is a fall (rad)."""

_LOGGER = logging.getLogger(__name__)


def passive_friction(plant: Plant, robot: Robot) -> float:
    """Coulomb friction of the joint without a motor (N m)."""
    return float((plant.cf2, plant.cf1)[robot.joint])


def holding_lqr(plant: Plant, robot: Robot, settings: LQRSettings, dt: float) -> LQR:
    """The regulator at the top of a plant; a warning tells of one that friction makes hard to hold.

    The plant is in C.1's units, with the dry friction of its passive joint alone; dt is the loop's period in these
    units (s).
    """
    if not passive_friction(plant, robot):
        return upright_lqr(plant, robot, settings)
    found, held = _best(plant, robot, settings, COUNTINGS, dt)
    if held < len(STARTS) / 2:
        other, more = _best(plant, robot, settings, MORE_COUNTINGS, dt)
        found, held = (other, more) if more > held else (found, held)
        _LOGGER.warning(
            f"the {robot.name}'s joint {2 - robot.joint} has dry friction and no motor: its regulator holds this "
            f"plant from {held} of {len(STARTS)} starts near upright"
        )
    return found


def _best(
    plant: Plant, robot: Robot, settings: LQRSettings, countings: Sequence[Counting], dt: float
) -> tuple[LQR, int]:
    """The regulator that holds from the most starts, and their number."""
    tried = []
    for each in countings:
        regulator = upright_lqr(linear_friction(plant, each.damping), robot, settings)
        tried.append(replace(regulator, friction=friction_gain(plant, regulator, each), knee=each.knee))
    # One program for all settings: they differ in numbers alone.
    with jax.enable_x64(True):
        stacked = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *tried)
        errors = np.asarray(_errors_held(stacked, plant, dt))
    held = (errors < FALLEN_ANGLE).sum(axis=1)
    # Where several hold from as many starts, the smaller error that remains decides.
    best = max(range(len(tried)), key=lambda index: (held[index], -np.median(errors[index])))
    return tried[best], int(held[best])


def linear_friction(plant: Plant, damping: float = 1.0) -> Plant:
    """The plant with Coulomb friction as damping: cf arctan(100 q̇) becomes ``damping`` (s/rad) times cf q̇.

    Its slope at rest is a hundred times as large, by which a regulator would take the joint for frozen.
    """
    b1, b2 = plant.b1 + damping * plant.cf1, plant.b2 + damping * plant.cf2
    return plant.changed(b1=b1, b2=b2, cf1=0.0, cf2=0.0)


def friction_gain(plant: Plant, regulator: LQR, counting: Counting) -> float:
    """Torque (N m) that this regulator of a plant adds against the undriven joint's Coulomb friction.

    Where the joint moves forwards, friction is a constant torque backwards (``lqr.disturbance_gain``).
    """
    damped = linear_friction(plant, counting.damping)
    return counting.share * disturbance_gain(damped, regulator) * passive_friction(plant, regulator.robot)


@jax.jit
def _errors_held(regulators: LQR, plant: Plant, dt: Scalar) -> Float[Array, "regulators starts"]:
    """Largest error of an angle in the last calls of each trial (rad)."""

    def error(x: State) -> State:
        off = x - jnp.asarray(UPRIGHT)
        return off.at[:2].set(wrap_difference(off[:2]))

    def trial(regulator: LQR, start: State) -> Array:
        def step(x: State, _: None) -> tuple[State, Array]:
            _, u = regulator(None, jnp.zeros(()), x)
            x = rk4_step(plant, x, u, dt)
            return x, jnp.abs(error(x)[:2]).max()

        # The end alone: a regulator that catches the pendulum lets it swing first.
        return jnp.max(jax.lax.scan(step, jnp.asarray(UPRIGHT) + start, length=TRIAL_CALLS)[1][-LAST_CALLS:])

    return jax.vmap(jax.vmap(trial, (None, 0)), (0, None))(regulators, jnp.asarray(STARTS))


class AbstractExpensiveController(AbstractController[Carry]):
    """A controller whose calls are expensive, and that can skip the work when its answer is not used.

    Subclasses implement ``control``; a call is ``control`` that is not idle.
    """

    @abc.abstractmethod
    def control(self, carry: Carry, t: Scalar, x: State, idle: Flag) -> tuple[Carry, Torque]:
        """Do what a call does. Where ``idle``, the answer is not used, and any finite torque is right."""

    def __call__(self, carry: Carry, t: Scalar, x: State) -> tuple[Carry, Torque]:
        """The torques [u1, u2] (N m) for the state x measured at time t (s), and the memory for the next call."""
        return self.control(carry, t, x, jnp.array(False))


class SwitchMemory(eqx.Module):
    """The memories of both controllers, which of them acts, and when they were first called."""

    first: Any
    second: Any
    latched: Flag
    begun: Time


class LatchingSwitch(AbstractController[SwitchMemory]):
    """The first controller until the state has been near the goal once; the second from then on.

    Near means |wrap(x) - upright| < threshold in all four entries. The second controller stays in charge even when
    it loses the pendulum. Time counts from the first call: the first controller may follow a trajectory.
    """

    first: AbstractController[Any]
    second: AbstractController[Any]
    threshold: Float[np.ndarray, "4"]
    """rad, rad/s"""
    robot: Robot = eqx.field(static=True)
    """Which joint is driven."""

    def init(self) -> SwitchMemory:
        """Both controllers' first memories; the first controller acts."""
        return SwitchMemory(self.first.init(), self.second.init(), jnp.array(False), never())

    def __call__(self, carry: SwitchMemory, t: TimeLike, x: State) -> tuple[SwitchMemory, Torque]:
        """The torques of the controller in charge (N m)."""
        begun, t = since_first_call(t, carry.begun)
        error = wrap(x) - jnp.asarray(UPRIGHT, x.dtype)
        latched = carry.latched | jnp.all(jnp.abs(error) < jnp.asarray(self.threshold))
        # Both controllers are computed: in a batch some members have switched and others have not.
        if isinstance(self.first, AbstractExpensiveController):
            first, u_first = self.first.control(carry.first, t, x, latched)
        else:
            first, u_first = self.first(carry.first, t, x)
        second, u_second = self.second(carry.second, t, x)
        return SwitchMemory(first, second, latched, begun), jnp.where(latched, u_second, u_first)
