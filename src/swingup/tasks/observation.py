"""The stages of an observation as pytrees: the same code serves training, judging, control and files."""

from dataclasses import fields

import jax

from ..policy.network import STAGES
from ..policy.network import NormaliseStage as NormaliseStage
from ..policy.network import PendulumStage as PendulumStage
from ..policy.network import PlantStage as PlantStage
from ..policy.network import Stage as Stage

for _kind in STAGES.values():
    _names = [each.name for each in fields(_kind)]
    # The encoding of the angles decides the shape, and so the program.
    _static = [name for name in _names if name == "angles"]
    jax.tree_util.register_dataclass(_kind, [name for name in _names if name not in _static], _static)
