"""A training run: a host loop over chunks of iterations, so that progress shows, runs resume and seeds batch.

A run's folder holds config.json, metrics.jsonl, README.md (a model card), tensorboard/, checkpoints/,
first.safetensors (untrained), best.safetensors and last.safetensors; with several seeds also best-SEED.safetensors
and last-SEED.safetensors, and best.safetensors is the best of all. A run without a folder writes nothing.
"""

import contextlib
import functools
import math
import time
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..areapo.checkpoint import load_checkpoint, read_metadata
from ..areapo.networks import Actor, CategoricalActor
from ..areapo.state import LearnerState
from ..areapo.statistics import RunningStatistics
from ..common import __version__
from ..common.checks import whole_number
from ..common.errors import SwingupError, naming
from ..common.files import make_folder
from ..controllers.stack.policy import Policy, make_policy
from ..policy.file import read_network
from ..policy.network import NormaliseStage, checked
from ..policy.policy import ACTION_SPACE
from .backend import AbstractBackend, check_actions, split_seeds
from .card import write_card
from .metrics import Evaluation, MetricsWriter, Row, TrainingMetrics
from .progress import UNRANKED, TrainingProgress, TrainingReport, is_finite, rank, read_progress, score_of
from .run_folder import BEST, FIRST, LAST, RunFolder, seed_file
from .run_settings import (
    OF_DEVIATIONS,
    RunSettings,
    read_run_settings,
    run_settings_from_dict,
    settings_of_policy,
    write_run_settings,
)

MEMORY = "memory"  # Of a checkpoint's metadata: what the back end remembers
Snapshot = tuple[LearnerState, dict[str, Any]]  # The complete state, and the metadata of a checkpoint


class Run:
    """A training run that can be advanced, stopped between chunks, and saved.

    :func:`start_run`, :func:`resume_run` and :func:`restore_run` make one.
    """

    def __init__(
        self,
        settings: RunSettings,
        backend: AbstractBackend,
        progress: TrainingProgress,
        goal: int,
        folder: RunFolder | None,
    ) -> None:
        """A run up to ``goal`` frames of each seed; without a folder nothing is written."""
        self.settings, self.backend, self.progress, self.goal = settings, backend, progress, goal
        self._folder = folder
        self._stopping = False
        self._fresh = True  # the next chunk starts as from a checkpoint: the host's environments are reset

    @property
    def folder(self) -> Path:
        """The run's folder; a run without one is refused."""
        if self._folder is None:
            raise SwingupError("this run writes no files: give it a folder")
        return self._folder.path

    @property
    def frames(self) -> int:
        """Frames of each seed so far."""
        return self.progress.iterations * self.settings.config.rollout_size

    @property
    def best_score(self) -> float | None:
        """Best score of any seed so far; None where there is none yet."""
        return score_of(max(self.progress.best))

    def policies(self) -> list[Policy[Any]]:
        """The policies of all seeds as they stand."""
        return [self.backend.policy(member) for member in split_seeds(self.progress.state, self.settings.seeds)]

    def save_policy(self, path: Path, index: int, policy: Policy[Any], result: Evaluation) -> None:
        """Write a policy of one seed with its origin and its evaluation's result."""
        settings, evaluator = self.settings, self.backend.evaluator
        origin = {
            "version": __version__,
            "preset": settings.preset,
            "command": settings.command(self.goal),
            "seed": settings.seed + index,
            "frames": self.frames,
            "seconds": round(self.progress.seconds, 1),
            "hyperparameters": settings.as_dict()["config"],
            "resets": settings.problem.record.get("resets"),
            "scores": {evaluator.measure: result.as_dict()},
        }
        evaluator.save(path, policy, origin)

    def snapshot(self) -> Snapshot:
        """The complete state, and the metadata of a checkpoint.

        State that it does not hold is reset in this run as well. A run that continues from it then does the same as
        this one. Weights that are not finite are refused.
        """
        self._check_finite((self.progress.state.actor, self.progress.state.critic), "weights are")
        self._fresh = True
        metadata = self.progress.metadata(self.settings)
        actions = self.backend.evaluator.action_space.describe()
        return self.progress.state, metadata | {"actions": actions, MEMORY: self.backend.memory()}

    def extend(self, frames: int) -> None:
        """Set the goal to this number of frames more than the run has trained for."""
        self.goal, self._stopping = self.frames + whole_number("frames", frames, 1), False

    def stop(self) -> None:
        """End the run after the iterations in progress."""
        self._stopping = True

    def compile(self) -> None:
        """Compile now; otherwise ``advance`` does in its first chunk, for a stream before its first step."""
        self.backend.compile(self.progress.state)

    def advance(self) -> Generator[TrainingReport]:
        """Train until each seed has seen its frames (rounded up to whole iterations), reporting each chunk.

        A checkpoint is written at intervals, at the end and after ``stop``. It does not hold the environments that
        the host steps: they are reset after each, so that a resumed run does the same as this one. After an error
        the run is as after the last whole chunk.

        Raises:
            SwingupError: training diverged (something is not finite), an environment failed, a file cannot be
                written, or another process trains in the folder.
        """
        target = math.ceil(self.goal / self.settings.config.rollout_size)
        folder, nothing = self._folder, contextlib.nullcontext()
        locked = nothing if folder is None else folder.locked(self.frames)
        with (
            locked,
            self.backend.occupied(),
            nothing if folder is None else MetricsWriter(folder.path, self.frames) as writer,  # cuts the file
        ):
            if folder is not None:
                write_run_settings(folder.path, self.settings, self.goal)
            if self.settings.problem.stream and self.backend.pause is None:
                self.compile()
            mark, saved, self._fresh = time.perf_counter(), True, True
            while (before := self.progress.iterations) < target and not self._stopping:
                begun = mark
                metrics = self._train_chunk(self.settings.next_stop(before, target) - before)
                mark = self._count_time(mark)  # before policies are saved with it
                evaluations = self._evaluate_all()
                mark = self._count_time(mark)
                frames = (self.progress.iterations - before) * self.settings.config.rollout_size
                rate = frames * self.settings.seeds / (mark - begun)
                report = self._report(rate, metrics, evaluations)
                if writer is not None:
                    writer.write(row.as_dict() for row in report.rows)
                at_end = self.progress.iterations >= target or self._stopping
                saved = at_end or self.settings.is_checkpoint_due(before, self.progress.iterations)
                if saved:
                    self._save(evaluations, writer)
                # Files first: a caller may leave the loop at the yield.
                yield report
            # ``stop`` was called during the yield, where no checkpoint was due.
            if self._stopping and not saved:
                self._save(self._evaluate_all(), writer)
            self._stopping = False

    def _count_time(self, since: float) -> float:
        """Add the time since then to the run's; the time now (s)."""
        now = time.perf_counter()
        self.progress = replace(self.progress, seconds=self.progress.seconds + now - since)
        return now

    def close(self) -> None:
        """Free the environments."""
        self.backend.close()

    def save_checkpoint(self) -> None:
        """Write a checkpoint, if the run has a folder."""
        state, metadata = self.snapshot()
        if self._folder is not None:
            self._folder.save_checkpoint(self.frames, state, metadata)

    def _train_chunk(self, count: int) -> list[TrainingMetrics]:
        state, before = self.progress.state, self.progress.iterations
        if self._fresh:
            state = self.backend.begin(state, before)
        self._fresh = True  # until the chunk is whole
        state, metrics = self.backend.train(state, count, lambda: self._stopping)
        # Before the chunk counts, so that a run that diverged keeps its last good state.
        self._check_finite([each.means for each in metrics], "metrics are")
        iterations = int(np.max(jax.device_get(state.iterations)))
        self.progress, self._fresh = replace(self.progress, state=state, iterations=iterations), False
        return metrics

    def _report(self, rate: float, metrics: list[TrainingMetrics], evaluations: list[Evaluation]) -> TrainingReport:
        seeds = zip(metrics, evaluations, self.progress.best, strict=True)
        rows = tuple(
            Row(self.settings.seed + index, self.frames, self.progress.seconds, rate, each, result, score_of(best))
            for index, (each, result, best) in enumerate(seeds)
        )
        return TrainingReport(self.frames, rate, rows, self.best_score)

    def _evaluate_all(self) -> list[Evaluation]:
        """Evaluate each seed's deterministic policy, and keep it if it is the seed's best."""
        policies = self.policies()
        results = self.backend.evaluate(policies)
        for index, (policy, result) in enumerate(zip(policies, results, strict=True)):
            found, best = rank(result.score, result.reward_rate), self.progress.best
            if found > best[index]:
                # BEST first: if the run is killed before the seed's own file, resuming finds the record again.
                if found > max(best):
                    self._save_policy(BEST, index, policy, result)
                if self.settings.seeds > 1:
                    self._save_policy(seed_file(BEST, self.settings, index), index, policy, result)
                self.progress = replace(self.progress, best=(*best[:index], found, *best[index + 1 :]))
        return results

    def _save_policy(self, name: str, index: int, policy: Policy[Any], result: Evaluation) -> None:
        if self._folder is not None:
            self.save_policy(self._folder.path / name, index, policy, result)

    def _save(self, evaluations: list[Evaluation], writer: MetricsWriter | None) -> None:
        """Write a checkpoint, after the metrics until there and each seed's last policy with its score.

        A run that is killed before the checkpoint trains again from the one before, and writes the others anew.
        """
        if writer is not None:
            writer.sync()
        self._check_finite((self.progress.state.actor, self.progress.state.critic), "weights are")
        for index, (policy, result) in enumerate(zip(self.policies(), evaluations, strict=True)):
            self._save_policy(seed_file(LAST, self.settings, index), index, policy, result)
        if self._folder is not None and (self._folder.path / BEST).exists():
            write_card(self._folder.path)
        self.save_checkpoint()

    def _check_finite(self, tree: Any, subject: str) -> None:
        if is_finite(tree):
            return
        cause = self.backend.find_fault()
        kept = "" if self._folder is None else f"; the last good checkpoint is in {self._folder.checkpoints}"
        remedy = cause or "lower learning_rate, change seed, or scale rewards that are huge"
        raise SwingupError(f"training diverged: {subject} not finite after frame {self.frames}{kept}: {remedy}")


def start_run(settings: RunSettings, folder: str | Path | None, frames: int) -> Run:
    """A new run of ``frames`` frames a seed, in a new or empty folder; without a folder it writes nothing.

    Raises:
        SwingupError: the folder holds something or cannot be written, or the task cannot be made.
    """
    goal = whole_number("frames", frames, 1)
    place = None if folder is None else RunFolder(folder)
    if place is not None:
        place.check_new()
    backend = settings.make_backend()
    with _closed_on_error(backend):
        state = backend.init()  # compiles for seconds, before the folder is made: interrupted here, nothing is left
        if isinstance(state.actor, CategoricalActor) and (vain := OF_DEVIATIONS & settings.changes.keys()):
            raise SwingupError(
                f"{min(vain)} has no effect on discrete actions, which have no deviation: leave it out"
            )
        # A reset that is not finite would show only after the first chunk, as a divergence.
        if not is_finite(state.observations):
            fault = backend.find_fault() or "a reset gave an observation that is not finite: correct it there"
            raise SwingupError(f"{settings.problem.name} cannot be trained on: {fault}")
        progress = TrainingProgress(state, (UNRANKED,) * settings.seeds)
        run = Run(settings, backend, progress, goal, place)
        if place is not None:
            place.check_new()  # seconds have passed
            make_folder(place.checkpoints)
            write_run_settings(place.path, settings, goal)
            # The untrained policy, to look back at.
            run.save_policy(place.path / FIRST, 0, run.policies()[0], Evaluation(None))
        # A run that is killed before its first chunk ends can be resumed, too.
        run.save_checkpoint()
    return run


@contextlib.contextmanager
def _closed_on_error(backend: AbstractBackend) -> Generator[None]:
    """Close the environments of a run that its caller never gets."""
    try:
        yield
    except BaseException:
        backend.close()
        raise


def resume_run(folder: str | Path, frames: int | None = None, env: Any = None) -> Run:
    """Continue a run from its last checkpoint, bit for bit; to another number of frames if one is given.

    Nothing is written before the run advances.

    Raises:
        SwingupError: the folder is not a run's, has no checkpoint, or its checkpoint is of another configuration.
    """
    settings, before = read_run_settings(Path(folder))
    goal = whole_number("frames", before if frames is None else frames, 1)
    place = RunFolder(folder)
    source = f"the newest checkpoint in {place.checkpoints}"
    settings, backend, progress = _restored(settings, place.load_checkpoint, source, env)
    run = Run(settings, backend, progress, goal, place)
    # The last chunk may have gone beyond the goal: the same one is still reached.
    if goal < min(before, run.frames):
        raise SwingupError(f"frames = {goal}, but {folder} stands at {run.frames} already: ask for more")
    on_disk = place.best(settings, backend.evaluator.measure)
    # A policy may be newer than the checkpoint; a worse one must not replace it.
    run.progress = replace(progress, best=tuple(map(max, progress.best, on_disk)))
    return run


def start_or_resume_run(settings: RunSettings, folder: Path, frames: int) -> Run:
    """The run in a folder, continued to a number of frames, or a new one.

    Raises:
        SwingupError: the folder holds a run with other settings, or one that has more frames, or something else.
    """
    if not RunFolder(folder).has_checkpoint():
        return start_run(settings, folder, frames)
    if read_run_settings(folder)[0] != settings:
        raise SwingupError(f"{folder} holds a run with other settings: delete it, or name another --out")
    return resume_run(folder, frames)


def restore_run(path: str | Path, env: Any = None) -> Run:
    """A run without a folder that continues from a saved learner, or from the last checkpoint in a run's folder.

    It writes nothing, and needs no lock on a folder.
    """
    if Path(path).is_dir():
        settings, load = read_run_settings(Path(path))[0], RunFolder(path).load_checkpoint
    else:
        with naming(f"cannot load {path}"):
            settings = run_settings_from_dict(read_metadata(path).get("settings"))
        load = functools.partial(load_checkpoint, path)
    settings, backend, progress = _restored(settings, load, str(path), env)
    return Run(settings, backend, progress, max(1, progress.iterations * settings.config.rollout_size), None)


def start_from_policy(path: str | Path, env: Any = None) -> Run:
    """A new run without a folder that begins with the actor and the normalisation of a policy file.

    Its hyperparameters are those of the file, or else of the task's default preset. Critic and gains begin anew.

    Raises:
        SwingupError: the file is damaged, its environment is needed and was not given, or its network is not one
            that these hyperparameters train.
    """
    network, metadata = read_network(path)
    with naming(f"cannot begin with {path}"):
        settings = settings_of_policy(metadata, env)
        run = start_run(settings, None, settings.config.rollout_size)
    with naming(f"cannot begin with {path}"), _closed_on_error(run.backend):
        evaluator, state = run.backend.evaluator, run.progress.state
        if ACTION_SPACE in metadata:
            check_actions(metadata[ACTION_SPACE], evaluator.action_space)
        *before, normalise = network.stages or [None]
        if not isinstance(normalise, NormaliseStage) or not eqx.tree_equal(
            before, list(map(checked, evaluator.stages))
        ):
            raise SwingupError("its observation stages are not those of the learner")
        actor = jax.tree.map(jnp.asarray, make_policy(network).actor)
        if isinstance(actor, Actor) and actor.std_head is None and isinstance(state.actor, Actor):
            actor = replace(actor, std_head=state.actor.std_head)
        if not eqx.tree_equal(*(jax.tree.map(jnp.shape, each) for each in (actor, state.actor))):
            raise SwingupError("its network has another form than these hyperparameters give: it can only predict")
        mean, variance = (jnp.asarray(each, jnp.float32) for each in (normalise.mean, normalise.variance))
        # As many rows as trained it, so that what it sees moves no faster than it did.
        count = jnp.asarray(float(whole_number("frames", metadata.get("frames", 0), 0)))
        statistics = RunningStatistics(mean, jnp.zeros_like(mean), variance, count)
        run.progress = replace(run.progress, state=replace(state, actor=actor, statistics=statistics))
    return run


def _restored(
    settings: RunSettings, load: Callable[[LearnerState], Snapshot], source: str, env: Any
) -> tuple[RunSettings, AbstractBackend, TrainingProgress]:
    settings = replace(settings, problem=settings.problem.on(env))
    backend = settings.make_backend()
    with _closed_on_error(backend):
        state, metadata = load(jax.eval_shape(backend.init))
        check_actions(metadata.get("actions"), backend.evaluator.action_space)
        backend.remember(metadata.get(MEMORY))
        return settings, backend, read_progress(state, metadata, settings, source)
