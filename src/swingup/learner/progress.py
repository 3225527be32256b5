"""The progress of a run as one value, with exactly the content of a checkpoint."""

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..areapo.state import LearnerState
from ..common.checks import finite_number, whole_number
from ..common.errors import SwingupError
from ..common.text import one_line
from .run_settings import MALFORMED, RunSettings, run_settings_from_dict


@dataclass(frozen=True)
class TrainingProgress:
    """The state of training after some iterations."""

    state: LearnerState
    """Of several seeds, with a leading axis."""
    best: tuple[float, ...]
    """Best score of each seed; -inf before the first evaluation."""
    iterations: int = 0
    seconds: float = 0.0
    """Time spent so far, compilation and files included (s)."""

    @property
    def best_score(self) -> float:
        """Best score of any seed."""
        return max(self.best)

    def member(self, index: int) -> LearnerState:
        """The state of one seed."""
        return self.state if len(self.best) == 1 else member(self.state, index)

    def metadata(self, settings: RunSettings) -> dict[str, Any]:
        """The metadata of a checkpoint."""
        return {
            "settings": settings.as_dict(),
            "iterations": self.iterations,
            "seconds": self.seconds,
            "best": list(self.best),
        }


def member(state: LearnerState, index: int) -> LearnerState:
    """The state of one of several seeds, in NumPy.

    Where devices share the seeds, an index in JAX would be a program on all of them for every leaf. Many such
    programs, started at once, can wait for each other without end on a CPU.
    """

    def row(leaf: jax.Array) -> Any:
        if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
            return jax.random.wrap_key_data(np.asarray(jax.random.key_data(leaf))[index])
        return np.asarray(leaf)[index]

    return jax.tree.map(row, state)


def initial_progress(state: LearnerState, seeds: int) -> TrainingProgress:
    """Before the first iteration."""
    return TrainingProgress(state, (-math.inf,) * seeds)


def read_progress(
    state: LearnerState, metadata: dict[str, Any], settings: RunSettings, source: str
) -> TrainingProgress:
    """The progress that a checkpoint holds.

    Args:
        state: its arrays.
        metadata: its metadata.
        settings: of the run that continues from it.
        source: its name in an error.

    Raises:
        SwingupError: the metadata is malformed, or of other settings.
    """
    try:
        saved = run_settings_from_dict(metadata["settings"])
        # JSON has no infinities: a best score of -inf was written as null.
        best = tuple(-math.inf if score is None else finite_number("best", score) for score in metadata["best"])
        iterations = whole_number("iterations", metadata["iterations"], 0)
        seconds = finite_number("seconds", metadata["seconds"], 0.0)
    except (*MALFORMED, SwingupError) as error:
        raise SwingupError(f"{source} is malformed ({one_line(error, 200)}): delete it or restore it") from error
    # What the environments hold is theirs: infinite may be right there.
    learned = {name: value for name, value in vars(state).items() if name not in ("task_states", "key")}
    if not is_finite(learned):
        raise SwingupError(f"{source} holds weights or statistics that are not finite: delete it or restore it")
    # A checkpoint is trusted only with the settings that it was written under: shapes alone may agree.
    if saved.as_dict() != settings.as_dict() or len(best) != settings.seeds:
        raise SwingupError(f"{source} is of another configuration than config.json: restore one of them")
    return TrainingProgress(state, best, iterations, seconds)


def is_finite(tree: Any) -> bool:
    """Whether all numbers of a pytree of arrays are finite."""
    return all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(tree))
