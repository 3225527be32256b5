"""A network that sees its plant as an ordinary one, for one plant.

The plant's inputs are constants then: the first layer's bias takes up what they add. Without an identifier, all
back ends but JAX's run this network, and know nothing of the stage ``plant``.
"""

from dataclasses import replace

import numpy as np

from ...plant.base_parameters import BASE
from .layers import Layer, Network


def fold(network: Network, base: np.ndarray) -> Network:
    """The network of the state alone that gives the same actions for one plant.

    Args:
        network: any network; one that does not see its plant is returned as it is.
        base: base parameters θ (9,) of the plant, as ``plant.base_parameters.base_parameters`` gives them.

    Raises:
        SwingupError: a base parameter is NaN.
    """
    stage = network.plant_stage
    if stage is None:
        return network
    inputs, stages = stage.inputs(base), network.stages[:-1]
    if network.trunk:
        first, *others = network.trunk
        return replace(network, stages=stages, trunk=(_absorb(first, inputs), *others))
    std = None if network.std is None else _absorb(network.std, inputs)
    return replace(network, stages=stages, head=_absorb(network.head, inputs), std=std)


def _absorb(layer: Layer, inputs: np.ndarray) -> Layer:
    """The layer without its last inputs, which are constant."""
    # In double precision, in which a policy that is told its plant adds the same.
    added = layer.weight[:, -BASE:].astype(np.float64) @ inputs
    return Layer(layer.weight[:, :-BASE], layer.bias + added)
