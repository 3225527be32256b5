"""A pendulum with the torque as a fifth state and its rate as the input, so that a cost can weigh the rate."""

from ...plant.equations import Number
from .scalar_algebra import Matrix, Vector
from .transition import AbstractTransition, PendulumTransition, differentiate


class TorqueRateTransition(AbstractTransition):
    """[x, u] → [f(x, u), u + v dt]: states [q1, q2, dq1, dq2, u] (rad, rad/s, N m), input v (N m/s)."""

    pendulum: PendulumTransition

    def step(self, x: Vector, u: Number) -> Vector:
        """The next state and torque. The torque is held over the step; the rate changes the next torque."""
        *state, torque = x
        return (*self.pendulum.step(tuple(state), torque), torque + self.pendulum.dt * u)

    def jacobian(self, x: Vector, u: Number) -> Matrix:
        """Columns by q1, q2, dq1, dq2, the torque and its rate."""
        return differentiate(self.step, x, u)
