"""One step of the pendulum under its driven joint's torque, and the step's Jacobian, in tuples of scalars.

XLA's CPU backend computes a batch of 4 x 4 products one by one. Written out in scalars, a batch is one fused loop.
Zeros and ones that are known when tracing (Python floats) cost nothing. All operations are elementwise, so that an
entry may also be a row of many steps.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.trigonometry import arctan, sine_cosine
from ...plant.equations import Number, acceleration, friction
from ...plant.plant import Plant, lump

Vector: TypeAlias = tuple[Number, ...]  # Entries

Matrix: TypeAlias = tuple[Vector, ...]  # Rows; of a symmetric matrix only row i's entries from column i on


def unpack(array: Any) -> Vector:
    """The entries of an array along its last axis."""
    return tuple(array[..., i] for i in range(array.shape[-1]))


def times(a: Number, b: Number) -> Number:
    """A product in which a literal 0 or 1 is left out."""
    for factor, other in ((a, b), (b, a)):
        # Literals alone: a traced number may be NaN, which 0 must not hide.
        if isinstance(factor, float) and factor in (0.0, 1.0):
            return other if factor == 1.0 else 0.0
    return a * b


def plus(a: Number, b: Number) -> Number:
    """A sum in which a literal 0 is left out."""
    if isinstance(a, float) and a == 0.0:
        return b
    return a if isinstance(b, float) and b == 0.0 else a + b


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """Σ a_i b_i."""
    total: Number = 0.0
    for left, right in zip(a, b, strict=True):
        total = plus(total, times(left, right))
    return total


def add_scaled(a: Sequence[Number], scale: Number, b: Sequence[Number]) -> Vector:
    """A + scale · b."""
    return tuple(plus(left, times(scale, right)) for left, right in zip(a, b, strict=True))


def entry(s: Matrix, i: int, j: int) -> Number:
    """Entry (i, j) of a symmetric matrix."""
    return s[i][j - i] if i <= j else s[j][i - j]


def symmetric_times(s: Matrix, v: Sequence[Number]) -> Vector:
    """S v of a symmetric matrix."""
    return tuple(dot([entry(s, i, j) for j in range(len(v))], v) for i in range(len(v)))


def diagonal(values: Sequence[Number]) -> Matrix:
    """A diagonal matrix as a symmetric one."""
    return tuple((value, *(0.0,) * (len(values) - 1 - i)) for i, value in enumerate(values))


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
    joint: int = eqx.field(static=True)  # Index of the driven joint
    dt: float = eqx.field(static=True)  # Length of the step (s)
    exact: bool = eqx.field(static=True, default=True)
    """Whether the Jacobian is exact; otherwise it is right up to dt² and three times as fast."""

    def step(self, x: Vector, u: Number) -> Vector:
        """The state [q1, q2, dq1, dq2] after dt under the driven joint's torque u (N m)."""
        # Not dynamics.integrate.rk4_step: tuples of scalars compile to fewer loops.
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
