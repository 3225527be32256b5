"""swingup: swing up and balance underactuated double pendulums with average-reward maximum-entropy RL.

Importing the package is light: the names below are loaded when they are first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from .common.errors import SwingupError
from .common.version import __version__

if TYPE_CHECKING:
    from .benchmark.disturbances import make_disturbance
    from .benchmark.evaluate import Evaluation, evaluate, score
    from .benchmark.leaderboard import Board, leaderboard
    from .benchmark.recorded_uptime import RecordedUptime, recorded_uptime
    from .benchmark.robustness import Robustness, robustness
    from .benchmark.sim2real import Sim2Real, sim2real
    from .benchmark.trials import Trials, trials
    from .benchmark.uptime import Uptime, uptime
    from .controllers.baselines.baselines import baseline
    from .controllers.interface.check import check_controller
    from .controllers.interface.controller import AbstractController
    from .controllers.registry import get_controller
    from .identification.identify import Identification, identify
    from .learner.agent import AREAPO
    from .plant.plant import Plant, load_plant
    from .policy.shipped import load_policy
    from .rehearsal.rehearse import rehearse
    from .rehearsal.result import Rehearsal
    from .sweep.search import search

_HOMES = {
    "AREAPO": "learner.agent",
    "AbstractController": "controllers.interface.controller",
    "Board": "benchmark.leaderboard",
    "Evaluation": "benchmark.evaluate",
    "Plant": "plant.plant",
    "Rehearsal": "rehearsal.result",
    "RecordedUptime": "benchmark.recorded_uptime",
    "Sim2Real": "benchmark.sim2real",
    "Trials": "benchmark.trials",
    "Robustness": "benchmark.robustness",
    "Uptime": "benchmark.uptime",
    "baseline": "controllers.baselines.baselines",
    "check_controller": "controllers.interface.check",
    "evaluate": "benchmark.evaluate",
    "get_controller": "controllers.registry",
    "recorded_uptime": "benchmark.recorded_uptime",
    "sim2real": "benchmark.sim2real",
    "trials": "benchmark.trials",
    "identify": "identification.identify",
    "Identification": "identification.identify",
    "leaderboard": "benchmark.leaderboard",
    "load_plant": "plant.plant",
    "load_policy": "policy.shipped",
    "make_disturbance": "benchmark.disturbances",
    "rehearse": "rehearsal.rehearse",
    "robustness": "benchmark.robustness",
    "score": "benchmark.evaluate",
    "search": "sweep.search",
    "uptime": "benchmark.uptime",
}

__all__ = [
    "AREAPO",
    "AbstractController",
    "Board",
    "Evaluation",
    "Identification",
    "Plant",
    "RecordedUptime",
    "Rehearsal",
    "Robustness",
    "Sim2Real",
    "SwingupError",
    "Trials",
    "Uptime",
    "__version__",
    "baseline",
    "check_controller",
    "evaluate",
    "get_controller",
    "identify",
    "leaderboard",
    "load_plant",
    "load_policy",
    "make_disturbance",
    "recorded_uptime",
    "rehearse",
    "robustness",
    "score",
    "search",
    "sim2real",
    "trials",
    "uptime",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted(__all__)
