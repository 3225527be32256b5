"""A student that sees the nominal plant at first and its own only later, as behind an identifier."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..control.controller import AbstractController
from ..plants.loop import LOOP_DT
from ..policy.jax_backend.controller import PolicyController
from ..policy.jax_backend.told import told_base
from ..types import Key, Scalar, State, Torque


class Informed(AbstractController[None]):
    """A student; the plant that it sees goes from the nominal one to its own on a straight line."""

    student: PolicyController
    nominal: Float[Array, "9"]
    """Base parameters that it sees first."""
    base: Float[Array, "9"]
    """Those of its own plant."""
    known_after: Scalar
    """When it sees them (s); 0: after the first step."""
    offset: Float[Array, "4"] | float = 0.0
    """What its measured state has too much (rad, rad/s)."""

    def init(self) -> None:
        """Nothing is remembered."""

    def __call__(self, carry: None, t: Scalar, x: State) -> tuple[None, Torque]:
        """The student's torques (N m)."""
        known = jnp.clip(t / jnp.maximum(self.known_after, LOOP_DT), 0, 1)
        seen = self.nominal + known * (self.base - self.nominal)
        return None, told_base(self.student, seen)(None, t, x + self.offset)[1]


def draw_known_after(key: Key, slowest: float) -> Scalar:
    """When a run's plant is known (s), up to ``slowest``; in two of five runs at once."""
    return slowest * jnp.clip(jax.random.uniform(key, minval=-0.7), 0.0)
