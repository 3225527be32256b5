"""One step of the pendulum under its driven joint's torque, and the step's Jacobian.

States are tuples of scalars (see ``scalar_algebra``). All operations are elementwise, so that an entry may
also be a row of many steps.
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.trigonometry import arctan, sine_cosine
from ...plant.equations import Number, acceleration, friction
from ...plant.plant import Plant, lump
from .scalar_algebra import Matrix, Vector, add_scaled, dot


class AbstractTransition(eqx.Module):
    """x' = f(x, u) for a driven scalar u."""

    @abc.abstractmethod
    def step(self, x: Vector, u: Number) -> Vector:
        """The next state."""

    def jacobian(self, x: Vector, u: Number) -> Matrix:
        """The columns of the step's Jacobian: one for each entry of x, then that for u."""
        return differentiate(self.step, x, u)


class PendulumTransition(AbstractTransition):
    """A step of the double pendulum by the classical Runge-Kutta method, with the torque held over it."""

    parameters: Plant
    """Python floats are compiled into the program, which is faster, and a friction of zero then costs nothing.
    Arrays, or values that are traced, let one program serve many plants."""
    joint: int = eqx.field(static=True)
    """Index of the driven joint."""
    dt: float = eqx.field(static=True)
    """Length of the step (s)."""
    exact: bool = eqx.field(static=True, default=True)
    """Whether the Jacobian is exact; otherwise it is right up to dt² and three times as fast."""

    def step(self, x: Vector, u: Number) -> Vector:
        """The state [q1, q2, dq1, dq2] after dt under the driven joint's torque u (N m)."""
        # Not dynamics.integrate.rk4_step: tuples of scalars compile to fewer loops, see scalar_algebra.
        half = 0.5 * self.dt
        k1 = self.derivative(x, u)
        k2 = self.derivative(add_scaled(x, half, k1), u)
        k3 = self.derivative(add_scaled(x, half, k2), u)
        k4 = self.derivative(add_scaled(x, self.dt, k3), u)
        total = tuple(a + 2.0 * (b + c) + d for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
        return add_scaled(x, self.dt / 6.0, total)

    def jacobian(self, x: Vector, u: Number) -> Matrix:
        """Columns by q1, q2, dq1, dq2 and u."""
        if self.exact:
            return super().jacobian(x, u)
        # With J = ∂ẋ/∂(x, u) half a step on: ∂x'/∂x = 1 + dt J + dt² J²/2 + O(dt³).
        middle = add_scaled(x, 0.5 * self.dt, self.derivative(x, u))
        rates = differentiate(self.derivative, middle, u)
        rows = tuple(zip(*rates[:4], strict=True))
        twice = [tuple(dot(row, column) for row in rows) for column in rates]
        unit = [tuple(float(i == j) for i in range(4)) for j in range(5)]
        return tuple(
            add_scaled(add_scaled(one, self.dt, rate), 0.5 * self.dt**2, second)
            for one, rate, second in zip(unit, rates, twice, strict=True)
        )

    def derivative(self, x: Vector, u: Number) -> Vector:
        """[dq1, dq2, ddq1, ddq2] under the driven joint's torque u (N m)."""
        p, (q1, q2, dq1, dq2) = self.parameters, x
        (sin1, cos1), (sin2, cos2) = sine_cosine(q1), sine_cosine(q2)
        # The addition theorem costs less than another sine.
        sines = sin1, sin2, sin1 * cos2 + cos1 * sin2
        torques = (u, 0.0) if self.joint == 0 else (0.0, u)
        losses = _friction(p.b1, p.cf1, dq1), _friction(p.b2, p.cf2, dq2)
        return (dq1, dq2, *acceleration(lump(p), sines, cos2, (dq1, dq2), torques, losses))


class TorqueRateTransition(AbstractTransition):
    """[x, u] → [f(x, u), u + v dt]: states [q1, q2, dq1, dq2, u] (rad, rad/s, N m), input v (N m/s).

    The torque is a fifth state and its rate the input, so that a cost can weigh the rate.
    """

    pendulum: PendulumTransition

    def step(self, x: Vector, u: Number) -> Vector:
        """The next state and torque. The torque is held over the step; the rate changes the next torque."""
        *state, torque = x
        return (*self.pendulum.step(tuple(state), torque), torque + self.pendulum.dt * u)


def differentiate(function: Callable[[Vector, Number], Vector], x: Vector, u: Number) -> Matrix:
    """The columns of a function's Jacobian by the entries of x, then by u."""
    inputs = (*x, u)

    def column(index: int) -> Vector:
        # One input at a time: the tangents of the others are then literal zeros, which cost nothing.
        def along(value: Number) -> Vector:
            moved = (*inputs[:index], value, *inputs[index + 1 :])
            return function(moved[:-1], moved[-1])

        return jax.jvp(along, (inputs[index],), (jnp.ones_like(inputs[index]),))[1]

    return tuple(column(index) for index in range(len(inputs)))


def _friction(damping: Number, coulomb: Number, rate: Number) -> Number:
    # Without friction an arctangent would be compiled for nothing: XLA keeps 0 · arctan(x), which may be NaN.
    absent = all(isinstance(value, float) and value == 0.0 for value in (damping, coulomb))
    return 0.0 if absent else friction(damping, coulomb, rate, arctan)
