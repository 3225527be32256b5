"""swingup: swing up and balance underactuated double pendulums with average-reward maximum-entropy RL.

Importing the package is light: the names below are loaded when they are first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from .common.errors import SwingupError
from .common.version import __version__

if TYPE_CHECKING:
    from .benchmark.board import AbstractBoard
    from .benchmark.boards import BOARDS
    from .benchmark.disturbances import DisturbanceSettings
    from .benchmark.judge import judge
    from .benchmark.leaderboard import Table, leaderboard
    from .benchmark.result import Result
    from .benchmark.score import score
    from .controllers.baselines.baselines import baseline
    from .controllers.interface.check import check_controller
    from .controllers.interface.compiled import loop_controller
    from .controllers.interface.controller import AbstractController
    from .controllers.registry import get_controller
    from .export.realaigym import RealAIGymController
    from .identification.identify import Identification, identify
    from .learner.agent import AREAPO
    from .plant.measured import measured_plant
    from .plant.plant import Plant, load_plant
    from .plant.save import save_plant
    from .policy.shipped import load_policy
    from .rehearsal.rehearse import rehearse
    from .rehearsal.result import Rehearsal
    from .sweep.search import search

_HOMES = {
    "AREAPO": "learner.agent",
    "AbstractBoard": "benchmark.board",
    "AbstractController": "controllers.interface.controller",
    "BOARDS": "benchmark.boards",
    "DisturbanceSettings": "benchmark.disturbances",
    "Plant": "plant.plant",
    "RealAIGymController": "export.realaigym",
    "Result": "benchmark.result",
    "Table": "benchmark.leaderboard",
    "Rehearsal": "rehearsal.result",
    "baseline": "controllers.baselines.baselines",
    "check_controller": "controllers.interface.check",
    "get_controller": "controllers.registry",
    "identify": "identification.identify",
    "Identification": "identification.identify",
    "judge": "benchmark.judge",
    "leaderboard": "benchmark.leaderboard",
    "load_plant": "plant.plant",
    "load_policy": "policy.shipped",
    "loop_controller": "controllers.interface.compiled",
    "measured_plant": "plant.measured",
    "rehearse": "rehearsal.rehearse",
    "save_plant": "plant.save",
    "score": "benchmark.score",
    "search": "sweep.search",
}

__all__ = [
    "AREAPO",
    "BOARDS",
    "AbstractBoard",
    "AbstractController",
    "DisturbanceSettings",
    "Identification",
    "Plant",
    "RealAIGymController",
    "Rehearsal",
    "Result",
    "SwingupError",
    "Table",
    "__version__",
    "baseline",
    "check_controller",
    "get_controller",
    "identify",
    "judge",
    "leaderboard",
    "load_plant",
    "load_policy",
    "loop_controller",
    "measured_plant",
    "rehearse",
    "save_plant",
    "score",
    "search",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted(__all__)
