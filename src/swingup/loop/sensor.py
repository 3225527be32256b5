"""What a robot's sensors make of its state: offsets and steps of the angles, and velocities from differences."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.types import Scalar, State

JointAngles = Float[Array, "2"]
"""q1 and q2 (rad)."""


class Sensor(eqx.Module):
    """Both joints' encoders, and where velocities come from."""

    quantum: Float[Array | np.ndarray, "2"]
    """Step of the measured angle of each joint (rad); 0 for none."""
    offset: Float[Array | np.ndarray, "2"]
    """Measured angle of each joint where the true one is 0 (rad)."""
    differences: bool = eqx.field(static=True, default=True)
    """Velocities are backward differences of measured angles; otherwise the motors' drivers know the true ones."""

    def angles(self, q: JointAngles) -> JointAngles:
        """Measured angles (rad): with the offset, rounded to the nearest step."""
        shown, quantum = q + jnp.asarray(self.offset), jnp.asarray(self.quantum)
        grid = jnp.where(quantum > 0, quantum, 1.0)
        return jnp.where(quantum > 0, jnp.round(shown / grid) * grid, shown)

    def read(self, x: State, before: State, period: float | Scalar) -> State:
        """The measured state for the state x, and for the one ``before``, a ``period`` (s) earlier."""
        q = self.angles(x[:2])
        rates = (q - self.angles(before[:2])) / period if self.differences else x[2:]
        return jnp.concatenate([q, rates])
