"""Ways to get a run: start a new one, resume one from its folder, or restore one from a snapshot; its back end."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax

from ..areapo.checkpoint import load_checkpoint, read_metadata
from ..areapo.state import LearnerState
from ..common.checks import whole_number
from ..common.errors import SwingupError, naming
from ..common.files import make_folder
from ..tasks.acrobot_swingup import IDS as ACROBOT_IDS
from ..tasks.acrobot_swingup import AcrobotPractice, acrobot_practice
from ..tasks.adapters import as_task
from ..tasks.pendulum import AbstractPendulumTask
from ..tasks.task import AbstractTask
from .backend import AbstractBackend
from .compiled_backend import CompiledBackend
from .evaluators import ReturnEvaluator, SwingUpEvaluator, check_actions
from .presets import ACROBOT_PRESET, is_acrobot
from .progress import UNRANKED, TrainingProgress, is_finite, read_progress
from .run import Run, Snapshot
from .run_folder import RunFolder
from .run_settings import RunSettings, is_description, read_run_settings, run_settings_from_dict, write_run_settings


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
    progress = TrainingProgress(state, (UNRANKED,) * settings.seeds)
    run = Run(settings, backend, progress, goal, place)
    if place is not None:
        make_folder(place.checkpoints)
        write_run_settings(place.path, settings, goal)
    # A run that is killed before its first chunk ends can be resumed, too.
    run.save_checkpoint()
    return run


def resume_run(folder: str | Path, frames: int | None = None, env: Any = None) -> Run:
    """Continue a run from its last checkpoint, bit for bit; to another number of frames if one is given.

    Raises:
        SwingupError: the folder is not a run's, has no checkpoint, or its checkpoint is of another configuration.
    """
    settings, before = read_run_settings(Path(folder))
    goal = whole_number("frames", before if frames is None else frames, 1)
    place = RunFolder(folder)
    source = f"the newest checkpoint in {place.checkpoints}"
    backend, progress = _restored(settings, place.load_checkpoint, source, env)
    run = Run(settings, backend, progress, goal, place)
    # The last chunk may have gone beyond the goal: the same one is still reached.
    if goal < min(before, run.frames):
        raise SwingupError(f"frames = {goal}, but {folder} stands at {run.frames} already: ask for more")
    on_disk = place.best(settings, backend.evaluator.measure)
    # A policy may be newer than the checkpoint; a worse one must not replace it.
    run.progress = replace(progress, best=tuple(map(max, progress.best, on_disk)))
    write_run_settings(place.path, settings, goal)
    return run


def restore_run(path: str | Path, env: Any = None) -> Run:
    """A run without a folder that continues from a file that :meth:`swingup.AREAPO.save` wrote."""
    with naming(f"cannot load {path}"):
        settings = run_settings_from_dict(read_metadata(path).get("settings"))
    backend, progress = _restored(settings, lambda like: load_checkpoint(path, like), str(path), env)
    return Run(settings, backend, progress, max(1, progress.iterations * settings.config.rollout_size), None)


def _restored(
    settings: RunSettings, load: Callable[[LearnerState], Snapshot], source: str, env: Any
) -> tuple[AbstractBackend, TrainingProgress]:
    backend = make_backend(settings, env)
    state, metadata = load(jax.eval_shape(backend.init))
    check_actions(metadata.get("actions", {}), backend.evaluator.described_actions)
    return backend, read_progress(state, metadata, settings, source)


def make_backend(settings: RunSettings, env: Any = None) -> AbstractBackend:
    """The back end of these settings, on the task that they name, or on a given environment or task."""
    config, seeds = settings.config, range(settings.seed, settings.seed + settings.seeds)
    env = as_task(settings.env if env is None else env)
    if settings.preset == ACROBOT_PRESET and is_acrobot(env):
        env = acrobot_practice(ACROBOT_IDS[env])
    if settings.robot is not None:
        pendulum = env if isinstance(env, AbstractPendulumTask) else settings.task()
        return CompiledBackend(pendulum, config, seeds, SwingUpEvaluator(pendulum, settings.plant))
    if isinstance(env, AbstractTask):
        episodes = settings.evaluation_episodes
        if not episodes:
            raise SwingupError("evaluation_episodes = 0, but a task in JAX is scored by episodes: use 1 or more")
        judged = env.judged if isinstance(env, AcrobotPractice) else env
        return CompiledBackend(env, config, seeds, ReturnEvaluator(judged, settings.seed, episodes))
    if isinstance(env, str) and is_description(env):
        raise SwingupError(f"this run's environment was passed in ({env}): pass it again as env")
    # Imported here: Gymnasium is slow to load, and the pendulum does not need it.
    from .host_backend import HostBackend

    return HostBackend(env, settings.name, config, seeds, settings.evaluation_episodes)
