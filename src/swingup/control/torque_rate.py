"""A pendulum with the torque as a fifth state and its rate as the input: a cost can then ask for smooth torques."""

from .scalar_algebra import Matrix, Real, Vector
from .transition import AbstractTransition, PendulumTransition, differentiate


class TorqueRateTransition(AbstractTransition):
    """[x, u] → [f(x, u), u + v dt]: states [q1, q2, dq1, dq2, u] (rad, rad/s, N m), input v (N m/s)."""

    pendulum: PendulumTransition

    def step(self, x: Vector, u: Real) -> Vector:
        """The next state and torque: the present torque is held over the step, the rate changes the next one."""
        *state, torque = x
        return (*self.pendulum.step(tuple(state), torque), torque + self.pendulum.dt * u)

    def jacobian(self, x: Vector, u: Real) -> Matrix:
        """Columns by q1, q2, dq1, dq2, the torque and its rate."""
        return differentiate(self.step, x, u)
