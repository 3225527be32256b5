"""swingup: swing up and balance underactuated double pendulums with average-reward maximum-entropy RL.

Importing the package is light: the names below are loaded when they are first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from .errors import SwingupError
from .version import __version__

if TYPE_CHECKING:
    from .benchmark.evaluate import Evaluation, evaluate, score
    from .control.learned import load_policy
    from .control.zoo import shipped_policy

_HOMES = {
    "Evaluation": "benchmark.evaluate",
    "evaluate": "benchmark.evaluate",
    "score": "benchmark.evaluate",
    "load_policy": "control.learned",
    "shipped_policy": "control.zoo",
}

__all__ = ["Evaluation", "SwingupError", "__version__", "evaluate", "load_policy", "score", "shipped_policy"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted(__all__)
