"""Fixed-step integrators with the torque held over the step (zero-order hold).

They are explicit: a step far above 10 ms is neither accurate nor stable for this pendulum.
"""

from collections.abc import Callable

from ..types import Scalar, State, Torque
from .dynamics import derivative
from .parameters import Parameters

Integrator = Callable[[Parameters, State, Torque, float], State]


def rk4_step(parameters: Parameters, x: State, u: Torque, dt: float) -> State:
    """One step of the classical fourth-order Runge-Kutta method over dt (s)."""
    k1 = derivative(parameters, x, u)
    k2 = derivative(parameters, x + 0.5 * dt * k1, u)
    k3 = derivative(parameters, x + 0.5 * dt * k2, u)
    k4 = derivative(parameters, x + dt * k3, u)
    return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def midpoint_step(parameters: Parameters, x: State, u: Torque, dt: float | Scalar) -> State:
    """One step of the explicit midpoint rule over dt (s): second order, at half the cost."""
    halfway = x + 0.5 * dt * derivative(parameters, x, u)
    return x + dt * derivative(parameters, halfway, u)


def euler_step(parameters: Parameters, x: State, u: Torque, dt: float) -> State:
    """One explicit Euler step over dt (s): first order, for comparison."""
    return x + dt * derivative(parameters, x, u)
