"""The step of a pendulum whose parameters are leaves, so that ``vmap`` can batch plants.

``PendulumTransition`` compiles its parameters into the program, which leaves out what is zero: it is faster, and
each plant needs a compilation. Here both joints' arctangents are always computed.
"""

import equinox as eqx

from ..physics.equations import Number, friction
from ..physics.parameters import Parameters
from ..physics.trigonometry import arctan
from .scalar_algebra import Matrix, Vector
from .transition import AbstractTransition, differentiate, driven_derivative, runge_kutta


class PlantTransition(AbstractTransition):
    """A Runge-Kutta step of the double pendulum with the torque held over it; the parameters may be traced."""

    parameters: Parameters
    joint: int = eqx.field(static=True)
    """Index of the driven joint."""
    dt: float = eqx.field(static=True)
    """Length of the step (s)."""

    def step(self, x: Vector, u: Number) -> Vector:
        """The state [q1, q2, dq1, dq2] after dt under the driven joint's torque u (N m)."""
        return runge_kutta(self.derivative, self.dt, x, u)

    def jacobian(self, x: Vector, u: Number) -> Matrix:
        """Columns by q1, q2, dq1, dq2 and u."""
        return differentiate(self.step, x, u)

    def derivative(self, x: Vector, u: Number) -> Vector:
        """[dq1, dq2, ddq1, ddq2] under the driven joint's torque u (N m)."""
        return driven_derivative(self.parameters, self.joint, _friction, x, u)


def _friction(damping: Number, coulomb: Number, rate: Number) -> Number:
    return friction(damping, coulomb, rate, arctan)
