"""A policy that sees its plant, and a regulator for its plant, told which plant that is.

Their controller is made for the plant of its file. The functions here return the same controller for another one: a
plant whose parameters are known, or an estimate of the base parameters at each call. All of it may be traced or
batched, a plant for each pendulum. Only what the policy sees and what the regulator holds changes: the model of an
estimator before them, and the plant that a file would hold, stay its own. A policy that sees the state alone,
with no regulator, is the same for all plants.
"""

from dataclasses import replace
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...plant.base_parameters import base_parameters
from ...plant.plant import Plant
from ...tasks.observation import PlantObservation
from ..interface.controller import AbstractController
from .regulator import RegulatingController

ControllerT = TypeVar("ControllerT", bound=AbstractController[Any])


def told(controller: ControllerT, plant: Plant) -> ControllerT:
    """The controller whose policy sees this plant, and whose regulator holds it.

    Args:
        controller: a policy, or what runs one.
        plant: the plant; its numbers may be traced.
    """
    return told_base(controller, base_parameters(plant, jnp))


def told_base(controller: ControllerT, base: Float[Array, "9"]) -> ControllerT:
    """The controller whose policy sees a plant with base parameters θ, and whose regulator holds it.

    Args:
        controller: a policy, or what runs one.
        base: θ in the order of ``plant.base_parameters.BASE_NAMES``.
    """

    def changed(node: Any) -> Any:
        if isinstance(node, RegulatingController):
            # Its policy may see the plant, too.
            return replace(node, base=base, controller=told_base(node.controller, base))
        return replace(node, base=base) if isinstance(node, PlantObservation) else node

    told_one: ControllerT = jax.tree.map(changed, controller, is_leaf=_knows_plant)
    return told_one


def depends_on_plant(controller: AbstractController[Any]) -> bool:
    """Whether a controller depends on its plant: its policy sees it, or a regulator holds it."""
    return any(map(_knows_plant, jax.tree.leaves(controller, is_leaf=_knows_plant)))


def _knows_plant(node: Any) -> bool:
    return isinstance(node, PlantObservation | RegulatingController)
