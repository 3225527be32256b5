"""A policy that sees its plant, told which plant that is.

Its controller is made for the plant of its file. The functions here return the same controller for another one: a
plant whose parameters are known, or an estimate of the base parameters at each call. All of it may be traced or
batched, a plant for each pendulum. Only what the policy sees changes: the model of an estimator before it, and the
plant that a file would hold, stay its own. A policy that sees the state alone is the same for all plants.
"""

from dataclasses import replace
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...control.controller import AbstractController
from ...physics.equations import lump
from ...physics.parameters import Parameters
from .observation import PlantObservation

ControllerT = TypeVar("ControllerT", bound=AbstractController[Any])


def told(controller: ControllerT, parameters: Parameters) -> ControllerT:
    """The controller whose policy sees this plant.

    Args:
        controller: a policy, or what runs one.
        parameters: the plant.
    """
    return told_base(controller, traced_base_parameters(parameters))


def told_base(controller: ControllerT, base: Float[Array, "9"]) -> ControllerT:
    """The controller whose policy sees a plant with base parameters θ.

    Args:
        controller: a policy, or what runs one.
        base: θ in the order of ``physics.base_parameters.BASE_NAMES``.
    """

    def changed(node: Any) -> Any:
        return replace(node, base=base) if _is_sight(node) else node

    told_one: ControllerT = jax.tree.map(changed, controller, is_leaf=_is_sight)
    return told_one


def sees_plant(controller: AbstractController[Any]) -> bool:
    """Whether a controller's policy sees its plant."""
    return any(map(_is_sight, jax.tree.leaves(controller, is_leaf=_is_sight)))


def traced_base_parameters(p: Parameters) -> Float[Array, "9"]:
    """``physics.base_parameters.base_parameters`` of parameters that may be JAX's."""
    plant = lump(p)
    inertial = plant.shoulder, plant.elbow, plant.coupling / p.l1, plant.gravity1 / p.g
    return jnp.array([*inertial, p.b1, p.b2, p.cf1, p.cf2, p.Ir])


def _is_sight(node: Any) -> bool:
    return isinstance(node, PlantObservation)
