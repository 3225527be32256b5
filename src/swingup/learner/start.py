"""Three ways to get a run: start a new one, resume one from its folder, or restore one from a snapshot."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax

from ..areapo.state import LearnerState
from ..common.checks import whole_number
from ..common.errors import SwingupError
from .backend import AbstractBackend
from .evaluators import check_actions
from .make_backend import make_backend
from .policy_files import best_on_disk
from .progress import initial_progress, is_finite, read_progress
from .run import Run, Snapshot
from .run_folder import RunFolder
from .run_settings import RunSettings, read_run_settings, write_run_settings


def start_run(settings: RunSettings, folder: str | Path | None, frames: int, env: Any = None) -> Run:
    """A new run of ``frames`` frames a seed.

    Args:
        settings: what to train.
        folder: one that does not exist yet or is empty; None to write nothing.
        frames: length of the run.
        env: the environment or the task, where the settings only name it.

    Raises:
        SwingupError: the folder holds something or cannot be written, or the task cannot be made.
    """
    goal = whole_number("frames", frames, 1)
    place = None if folder is None else RunFolder(folder)
    if place is not None:
        place.check_new()
    backend = make_backend(settings, env)
    state = backend.init()  # compiles for seconds, before the folder is made: interrupted here, nothing is left
    # A reset that is not finite would show only after the first chunk, as a divergence.
    if not is_finite(state.observations):
        raise SwingupError(f"{settings.name} cannot be trained on: {backend.find_fault()}")
    run = Run(settings, backend, initial_progress(state, settings.seeds), goal, place)
    if place is not None:
        place.create()
        write_run_settings(place.path, settings, goal)
    # A run that is killed before its first chunk ends can be resumed, too.
    run.save_checkpoint()
    return run


def resume_run(folder: str | Path, frames: int | None = None, env: Any = None) -> Run:
    """Continue a run from its last checkpoint, bit for bit; to another number of frames if one is given.

    Raises:
        SwingupError: the folder is no run, has no checkpoint, or its checkpoint is of another configuration.
    """
    settings, goal = read_run_settings(Path(folder))
    goal = whole_number("frames", goal if frames is None else frames, 1)
    place, backend = RunFolder(folder), make_backend(settings, env)
    state, metadata = place.load_checkpoint(state_shapes(backend))
    check_actions(metadata.get("actions", {}), backend.evaluator.actions)
    progress = read_progress(state, metadata, settings, f"the newest checkpoint in {place.checkpoints}")
    run = Run(settings, backend, progress, goal, place)
    if frames is not None and goal < run.frames:
        raise SwingupError(f"frames = {goal}, but {folder} stands at {run.frames} already: ask for more")
    on_disk = best_on_disk(place.path, settings, backend.evaluator.measure)
    # A policy may be newer than the checkpoint; a worse one must not replace it.
    run.progress = replace(progress, best=tuple(map(max, progress.best, on_disk)))
    write_run_settings(place.path, settings, goal)
    return run


def restore_run(
    settings: RunSettings, load: Callable[[LearnerState], Snapshot], source: str, env: Any = None
) -> Run:
    """A run without a folder that continues from a result of ``Run.snapshot``.

    Args:
        settings: what is trained.
        load: reads the snapshot, given the state's shapes and types.
        source: the name of the snapshot in an error.
        env: the environment or the task, where the settings only name it.

    Raises:
        SwingupError: the snapshot cannot be read or is of another configuration.
    """
    backend = make_backend(settings, env)
    state, metadata = load(state_shapes(backend))
    check_actions(metadata.get("actions", {}), backend.evaluator.actions)
    progress = read_progress(state, metadata, settings, source)
    return Run(settings, backend, progress, max(1, progress.iterations * settings.config.rollout_size), None)


def state_shapes(backend: AbstractBackend) -> LearnerState:
    """Shapes and types of a back end's state."""
    return jax.eval_shape(backend.init)
