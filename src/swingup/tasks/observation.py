"""The stages of an observation in JAX; the same code serves training, judging and control."""

import abc
from typing import Annotated, Any, Literal, get_args

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.checks import one_of
from ..common.errors import SwingupError
from ..common.types import Observation
from ..plant.units import VELOCITY
from ..policy.network.core import normalised, pendulum_features, plant_features

Angles = Literal["wrapped", "sincos"]


class AbstractStage(eqx.Module):
    """One stage of a policy's observation: a pure function from a vector to a vector."""

    @abc.abstractmethod
    def __call__(self, observation: Observation, base: Float[Any, "9"] | None = None) -> Observation:
        """What the next stage sees.

        Args:
            observation: what the stage before saw.
            base: base parameters θ of the plant by ``plant.base_parameters.BASE_NAMES``, for a stage that shows it.
        """


class PendulumObservation(AbstractStage):
    """Scaled angles and velocities of the double pendulum, the first stage of its policies.

    ``policy/network/core.py: pendulum_features`` has the equations.
    """

    velocity_scale: Annotated[float, VELOCITY] = 20.0
    """s: velocities are clipped to ± this and divided by it (rad/s)."""
    angles: Angles = eqx.field(static=True, default="wrapped")
    """How the angles are encoded."""

    def __check_init__(self) -> None:
        """Refuse an unknown encoding."""
        one_of("angle encoding", self.angles, get_args(Angles))

    @property
    def size(self) -> int:
        """Length of the observation."""
        return 4 if self.angles == "wrapped" else 6

    def __call__(self, observation: Observation, base: Float[Any, "9"] | None = None) -> Observation:
        """Observe a state [q1, q2, dq1, dq2] (rad, rad/s); every entry of the result lies in [-1, 1]."""
        return pendulum_features(jnp, observation, self.angles, self.velocity_scale)


class PlantObservation(AbstractStage):
    """The observation, then the plant's base parameters θ: (θ - centre) / scale, clipped."""

    centre: Float[Array, "9"]
    scale: Float[Array, "9"]
    clip: float = 10.0
    """What is appended is clipped to ± this."""

    def __call__(self, observation: Observation, base: Float[Any, "9"] | None = None) -> Observation:
        """Append the plant to an observation (n,)."""
        if base is None:
            raise SwingupError("the policy sees its plant: use swingup.get_controller")
        seen = plant_features(jnp, base, self.centre, self.scale, self.clip)
        return jnp.concatenate([observation, seen])


class Normalise(AbstractStage):
    """(observation - mean) / sqrt(variance + ε), clipped; the observation may have leading axes."""

    mean: Float[Array, "n"]
    variance: Float[Array, "n"]
    clip: float = 10.0
    """The result is clipped to ± this."""
    epsilon: float = 1e-8
    """ε."""

    def __call__(self, observation: Observation, base: Float[Any, "9"] | None = None) -> Observation:
        """Normalise and clip."""
        return normalised(jnp, observation, self.mean, self.variance, self.clip, self.epsilon)
