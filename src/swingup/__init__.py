"""swingup: swing up and balance underactuated double pendulums with average-reward maximum-entropy RL.

Importing the package is light: the names below are loaded when they are first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from .common import __version__
from .common.errors import SwingupError

if TYPE_CHECKING:
    from .benchmark.board import AbstractBoard as AbstractBoard
    from .benchmark.board import Result as Result
    from .benchmark.boards import BOARDS as BOARDS
    from .benchmark.disturbances import DisturbanceSettings as DisturbanceSettings
    from .benchmark.judge import judge as judge
    from .benchmark.judge import score as score
    from .benchmark.leaderboard import Table as Table
    from .benchmark.leaderboard import leaderboard as leaderboard
    from .controllers.baselines.baselines import baseline as baseline
    from .controllers.check import check_controller as check_controller
    from .controllers.interface import AbstractController as AbstractController
    from .controllers.interface import loop_controller as loop_controller
    from .controllers.registry import get_controller as get_controller
    from .export.realaigym import RealAIGymController as RealAIGymController
    from .identification.identify import Identification as Identification
    from .identification.identify import identify as identify
    from .learner.agent import AREAPO as AREAPO
    from .learner.play import evaluate_policy as evaluate_policy
    from .learner.play import play as play
    from .plant.files import load_plant as load_plant
    from .plant.files import save_plant as save_plant
    from .plant.measured import measured_plant as measured_plant
    from .plant.plant import Plant as Plant
    from .policy.policy import Policy as Policy
    from .policy.shipped import load_policy as load_policy
    from .refine.adapt import adapt as adapt
    from .refine.recipe import run_recipe as run_recipe
    from .rehearsal.rehearse import Rehearsal as Rehearsal
    from .rehearsal.rehearse import rehearse as rehearse
    from .report.watch import watch as watch
    from .sweep.search import search as search

_HOMES = {
    "AREAPO": "learner.agent",
    "AbstractBoard": "benchmark.board",
    "AbstractController": "controllers.interface",
    "BOARDS": "benchmark.boards",
    "DisturbanceSettings": "benchmark.disturbances",
    "Plant": "plant.plant",
    "Policy": "policy.policy",
    "RealAIGymController": "export.realaigym",
    "Result": "benchmark.board",
    "Table": "benchmark.leaderboard",
    "Rehearsal": "rehearsal.rehearse",
    "adapt": "refine.adapt",
    "baseline": "controllers.baselines.baselines",
    "check_controller": "controllers.check",
    "get_controller": "controllers.registry",
    "identify": "identification.identify",
    "Identification": "identification.identify",
    "judge": "benchmark.judge",
    "leaderboard": "benchmark.leaderboard",
    "load_plant": "plant.files",
    "load_policy": "policy.shipped",
    "loop_controller": "controllers.interface",
    "measured_plant": "plant.measured",
    "rehearse": "rehearsal.rehearse",
    "run_recipe": "refine.recipe",
    "save_plant": "plant.files",
    "score": "benchmark.judge",
    "evaluate_policy": "learner.play",
    "play": "learner.play",
    "search": "sweep.search",
    "watch": "report.watch",
}

__all__ = ["SwingupError", "__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted(__all__)
