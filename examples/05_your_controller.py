"""Judge a controller of your own in plain Python and in JAX: the same tables at two speeds."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jax import Array

import swingup
from swingup.benchmark.boards import ROBUSTNESS
from swingup.common.types import Scalar, State, Torque


class PlainSwing:
    """Swings the pendubot gently and never balances it."""

    def reset(self) -> None:
        """Forget the last torque."""
        self.last = 0.0

    def get_control_output(self, x: np.ndarray, t: float) -> list[float]:
        """Torques [u1, u2] (N m): a low-pass filter of the target torque, with weight 0.1."""
        self.last += 0.1 * (np.sin(5.0 * t) - 0.3 * x[2] - self.last)
        return [self.last, 0.0]


class JaxSwing(swingup.AbstractController[Array]):
    """The same controller with explicit memory: a whole grid of simulations runs side by side."""

    def init(self) -> Array:
        """The last torque: 0 N m."""
        return jnp.zeros(())

    def __call__(self, carry: Array, t: Scalar, x: State) -> tuple[Array, Torque]:
        """The new memory, and the torques (N m)."""
        carry = carry + 0.1 * (jnp.sin(5.0 * t) - 0.3 * x[2] - carry)
        return carry, jnp.array([1.0, 0.0]) * carry


DELAYS = dataclasses.replace(ROBUSTNESS, criteria=("delay",))

for swing in (PlainSwing(), JaxSwing()):
    name = type(swing).__name__
    print(name, "findings of the checker:", swingup.check_controller(swing, "pendubot"))
    result = swingup.judge(swing, "pendubot", name=name)
    delays = swingup.judge(swing, "pendubot", DELAYS, name=name)
    costs = result.criteria
    print(f"  score {costs.score:.3f}, energy {costs.energy:.2f} J, {delays.successes} of 21 delays")
