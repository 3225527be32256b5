"""The top of the pendulum: linear quadratic regulators, and the switch to them.

Without dry friction of the passive joint it is the published LQR. It is designed on the host, in continuous time,
and gives no torque where its cost-to-go, and with it the error, is large. With dry friction it is the policies'
regulator (``policy/regulator.py``), which has a law for it. Friction of the driven joint is a torque that its motor
adds (``baselines.InOwnUnits``).
"""

import abc
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_continuous_are

from ...common.errors import SwingupError
from ...common.types import Flag, Scalar, State, Torque
from ...dynamics.dynamics import UPRIGHT, linearise, wrap
from ...plant.plant import Plant, Robot
from ...policy.regulator import RegulatorSettings
from ..interface import AbstractController, Carry, Time, TimeLike, joint_torques, never, since_first_call
from ..stack.regulator import RegulatingController, with_regulator


@dataclass(frozen=True)
class LQRSettings:
    """Weights of ∫ xᵀQx + R u² dt, and the largest cost-to-go at which the LQR acts."""

    state_weights: tuple[float, float, float, float]  # Diagonal of Q (1/rad², s²/rad²)
    torque_weight: float  # R (1/N²m²)
    max_cost_to_go: float  # No torque where xᵀSx is above this


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

    def init(self) -> None:
        """Nothing to remember."""

    def __call__(self, carry: None, t: Scalar, x: State) -> tuple[None, Torque]:
        """The regulator's torque on the driven joint (N m)."""
        error = wrap(x) - jnp.asarray(UPRIGHT, x.dtype)
        within = error @ jnp.asarray(self.cost_to_go) @ error <= self.max_cost_to_go
        u = -jnp.asarray(self.gains) @ error
        u = jnp.where(within, u, 0.0)
        return None, joint_torques(u, self.robot, self.limit)


def upright_lqr(parameters: Plant, robot: Robot, settings: LQRSettings) -> LQR:
    """The regulator of the pendulum linearised upright at rest; a plant that none can hold is refused."""
    A, B, _ = linearised(parameters, robot, UPRIGHT[None], np.zeros(1))
    try:
        S = solve_continuous_are(A[0], B[0][:, None], np.diag(settings.state_weights), [[settings.torque_weight]])
    except ValueError:  # numbers beyond floating point, or as LinAlgError no solution
        raise SwingupError(f"no LQR can hold this {robot.name} upright: correct its plant") from None
    limit = float(parameters.limit(robot.joint))
    return LQR(B[0] @ S / settings.torque_weight, S, settings.max_cost_to_go, limit, robot)


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


HOLDING_BOUNDS = RegulatorSettings(enter=1e6, leave=1e6)
"""The regulator acts wherever gravity pushes the passive joint outwards."""
HAND_OVER = (0.4, 0.4, 1.5, 1.5)
"""|errors| below which the regulator takes over from a swing-up (rad, rad/s), in C.1's units. Friction keeps the
motion from the published ones, which are a quarter of these and less."""


def passive_friction(plant: Plant, robot: Robot) -> float:
    """Coulomb friction of the joint without a motor (N m)."""
    return float((plant.cf2, plant.cf1)[robot.joint])


class Idle(AbstractController[None]):
    """No torque."""

    def init(self) -> None:
        """Nothing to remember."""

    def __call__(self, carry: None, t: Scalar, x: State) -> tuple[None, Torque]:
        """Zeros (2,) (N m)."""
        return None, jnp.zeros(2, x.dtype)


def holding_regulator(plant: Plant, robot: Robot) -> RegulatingController:
    """The policies' regulator for a plant with its friction."""
    return with_regulator(Idle(), robot, plant, HOLDING_BOUNDS, float(plant.limit(robot.joint)))


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
    threshold: Float[np.ndarray, "4"]  # rad, rad/s
    robot: Robot = eqx.field(static=True)  # Which joint is driven

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
