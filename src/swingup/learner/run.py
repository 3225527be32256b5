"""A training run: a host loop over chunks of iterations, so that progress shows, runs resume and seeds batch.

A run's folder holds config.json, metrics.jsonl, tensorboard/, checkpoints/, best.npz and last.npz; with several
seeds also best-SEED.npz and last-SEED.npz, and best.npz is the best of all. A run without a folder writes nothing.
"""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..areapo.state import LearnerState, Metrics
from ..arrays import finite
from ..errors import SwingupError
from ..policy.jax_backend.policy import Policy, load_policy
from ..version import __version__
from .backend import AbstractBackend
from .make_backend import make_backend
from .metrics import MetricsWriter
from .run_folder import RunFolder
from .run_settings import Settings, read_settings, settings_from_dict, whole, write_settings

Snapshot = Callable[[LearnerState], tuple[LearnerState, dict[str, Any]]]


@dataclass(frozen=True)
class Report:
    """Where a run stands after a chunk."""

    frames: int
    """Frames of each seed so far."""
    frames_per_second: float
    """Of all seeds together, since the last report, evaluation and files included."""
    rows: list[dict[str, Any]]
    """What was written to metrics.jsonl: one row a seed."""
    best_score: float
    """Best score of any seed so far."""


class Run:
    """A training run that can be advanced, stopped between chunks, and resumed."""

    def __init__(self, settings: Settings, folder: str | Path | None, frames: int, env: Any = None) -> None:
        """Start a new run of ``frames`` frames a seed.

        Args:
            settings: what to train.
            folder: one that does not exist yet or is empty; None to write nothing.
            frames: length of the run.
            env: the environment or the task, where the settings only name it.

        Raises:
            SwingupError: the folder holds something or cannot be written, or the task cannot be made.
        """
        self._prepare(settings, folder, whole("frames", frames, 1), env)
        if self._folder is not None:
            self._folder.check_new()
        self._state = self._world.init()  # compiles for seconds: interrupted here, a run leaves nothing behind
        if self._folder is not None:
            self._folder.create()
            write_settings(self._folder.path, settings, frames)
        self._save_checkpoint()

    @classmethod
    def resume(cls, folder: str | Path, frames: int | None = None, env: Any = None) -> "Run":
        """Continue a run from its last checkpoint, bit for bit; to another number of frames if one is given.

        Raises:
            SwingupError: the folder is no run, has no checkpoint, or its checkpoint is of another configuration.
        """
        settings, goal = read_settings(Path(folder))
        goal = whole("frames", goal if frames is None else frames, 1)
        run = cls.__new__(cls)
        run._prepare(settings, folder, goal, env)
        assert run._folder is not None
        state, metadata = run._folder.load_checkpoint(run.like())
        run._restore(state, metadata)
        if frames is not None and goal < run.frames:
            raise SwingupError(f"frames = {goal}, but {folder} stands at {run.frames} already: ask for more")
        run._best = [max(best, run._kept_score(index)) for index, best in enumerate(run._best)]
        write_settings(run._folder.path, settings, goal)
        return run

    @classmethod
    def from_snapshot(cls, settings: Settings, load: Snapshot, env: Any = None) -> "Run":
        """A run without a folder that goes on from what ``snapshot`` gave; ``load`` is told the state's shapes."""
        run = cls.__new__(cls)
        run._prepare(settings, None, 1, env)
        run._restore(*load(run.like()))
        run.goal = max(1, run.frames)
        return run

    def _prepare(self, settings: Settings, folder: str | Path | None, frames: int, env: Any) -> None:
        self.settings, self.goal = settings, frames
        self._folder = None if folder is None else RunFolder(folder)
        self.iterations = 0
        self._seconds = 0.0
        self._best = [-math.inf] * settings.seeds
        self._world = make_backend(settings, env)
        self._stopping = False
        self._fresh = True  # what a checkpoint does not hold is to start anew

    def _restore(self, state: LearnerState, metadata: dict[str, Any]) -> None:
        if settings_from_dict(metadata["settings"]).as_dict() != self.settings.as_dict():
            raise SwingupError(
                f"the checkpoint is of another configuration than {self._folder}'s config.json: restore one of them"
            )
        self._state = state
        self.iterations, self._seconds = metadata["iterations"], metadata["seconds"]
        self._best = [-math.inf if best is None else best for best in metadata["best"]]

    @property
    def folder(self) -> Path:
        """The run's folder.

        Raises:
            SwingupError: it has none.
        """
        if self._folder is None:
            raise SwingupError("this run writes no files: give it a folder")
        return self._folder.path

    @property
    def world(self) -> AbstractBackend:
        """Where the run trains."""
        return self._world

    @property
    def frames(self) -> int:
        """Frames of each seed so far."""
        return self.iterations * self.settings.config.rollout_size

    @property
    def best_score(self) -> float:
        """Best score of any seed so far; -inf before the first evaluation."""
        return max(self._best)

    def like(self) -> LearnerState:
        """Shapes and types of the state."""
        return jax.eval_shape(self._world.init)

    def snapshot(self) -> tuple[LearnerState, dict[str, Any]]:
        """The complete state, and the metadata of a checkpoint.

        What it does not hold starts anew here as well, so that whoever goes on from it does what this run does.
        """
        self._check_finite((self._state.actor, self._state.critic), "weights are")
        self._fresh = True
        return self._state, {
            "settings": self.settings.as_dict(),
            "iterations": self.iterations,
            "seconds": self._seconds,
            "best": list(self._best),
        }

    def policy(self, index: int = 0) -> Policy[Any]:
        """The policy of one seed as it stands."""
        return self._world.policy(self._member(index))

    def extend(self, frames: int) -> None:
        """Set the goal to so many frames more than the run has seen."""
        self.goal, self._stopping = self.frames + whole("frames", frames, 1), False
        if self._folder is not None:
            write_settings(self._folder.path, self.settings, self.goal)

    def stop(self) -> None:
        """Ask the run to end after the chunk in progress."""
        self._stopping = True

    def advance(self) -> Iterator[Report]:
        """Train until each seed has seen its frames (rounded up to whole iterations), reporting each chunk.

        A checkpoint is written at intervals, at the end and when asked to stop. Whatever a checkpoint does not hold
        (environments that the host steps) starts anew after each, so that a resumed run does what this one does.
        Whatever is raised, the run stands where the last whole chunk left it.

        Raises:
            SwingupError: training diverged (something is not finite), an environment failed, a file cannot be
                written, or another process trains in the folder.
        """
        target = math.ceil(self.goal / self.settings.config.rollout_size)
        with self._locked(), self._metrics_writer() as writer:
            mark, saved, self._fresh = time.perf_counter(), True, True
            while self.iterations < target and not self._stopping:
                before = self.iterations
                metrics, extras = self._train_chunk(self._chunk_end(target) - before)
                evaluations = [self._evaluate(index) for index in range(self.settings.seeds)]
                now = time.perf_counter()
                rate = (
                    (self.frames - before * self.settings.config.rollout_size) * self.settings.seeds / (now - mark)
                )
                self._seconds += now - mark
                mark = now
                rows = self._rows(metrics, extras, evaluations, rate)
                if writer is not None:
                    writer.write(rows)
                saved = self._is_due(before) or self.iterations >= target or self._stopping
                if saved:
                    self._save(evaluations, writer)
                yield Report(self.frames, rate, rows, self.best_score)
            if self._stopping and not saved:
                self._save([self._evaluate(index) for index in range(self.settings.seeds)], writer)
            self._stopping = False

    def close(self) -> None:
        """Free the environments."""
        self._world.close()

    def _locked(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext() if self._folder is None else self._folder.locked(self.frames)

    def _metrics_writer(self) -> contextlib.AbstractContextManager[MetricsWriter | None]:
        if self._folder is None:
            return contextlib.nullcontext()
        return MetricsWriter(self._folder.path, after_frames=self.frames)

    def _chunk_end(self, target: int) -> int:
        """The iteration that ends the chunk: where the next report or checkpoint is due, or the last of all."""
        intervals = (self.settings.chunk, self.settings.checkpoint_interval)
        return min(target, *((self.iterations // every + 1) * every for every in intervals))

    def _is_due(self, before: int) -> bool:
        """Whether a checkpoint falls between an iteration and this one."""
        every = self.settings.checkpoint_interval
        return self.iterations // every > before // every

    def _train_chunk(self, count: int) -> tuple[Metrics, dict[str, Any]]:
        state = self._world.begin(self._state, self.iterations) if self._fresh else self._state
        self._fresh = True  # until the chunk is whole
        state, metrics, extras = self._world.train(state, count)
        metrics = jax.tree.map(np.asarray, metrics)
        self._check_finite(metrics, "metrics are")
        self._state, self.iterations, self._fresh = state, self.iterations + count, False
        return metrics, extras

    def _member(self, index: int) -> LearnerState:
        if self.settings.seeds == 1:
            return self._state
        return jax.tree.map(lambda leaf: leaf[index], self._state)

    def _evaluate(self, index: int) -> dict[str, Any]:
        """Judge the deterministic policy of one seed; keep it if it is its seed's best."""
        policy = self.policy(index)
        result = self._world.evaluate(policy)
        if result["score"] > self._best[index]:
            # The best of all first: killed before its own file is written, the seed finds the same record again.
            if result["score"] > self.best_score:
                self._save_policy("best.npz", index, policy, result)
            if self.settings.seeds > 1:
                self._save_policy(self._best_name(index), index, policy, result)
            self._best[index] = result["score"]
        return result

    def _best_name(self, index: int) -> str:
        return "best.npz" if self.settings.seeds == 1 else f"best-{self.settings.seed + index}.npz"

    def _kept_score(self, index: int) -> float:
        """Score of a seed's best policy on disk, which may be newer than the checkpoint; -inf without one."""
        path = self.folder / self._best_name(index)
        if not path.exists():
            return -math.inf
        return float(load_policy(path)[1]["scores"][self._world.measure]["score"])

    def provenance(self, index: int, result: dict[str, Any]) -> dict[str, Any]:
        """Where a seed's policy comes from, and how it was judged."""
        return {
            "version": __version__,
            "preset": self.settings.preset,
            "command": self.settings.command(self.goal),
            "seed": self.settings.seed + index,
            "frames": self.frames,
            "seconds": round(self._seconds, 1),
            "hyperparameters": self.settings.as_dict()["config"],
            "scores": {self._world.measure: result},
        }

    def _save_policy(self, name: str, index: int, policy: Policy[Any], result: dict[str, Any]) -> None:
        if self._folder is not None:
            self._world.save(self._folder.path / name, policy, self.provenance(index, result))

    def _rows(
        self, metrics: Metrics, extras: dict[str, Any], evaluations: list[dict[str, Any]], rate: float
    ) -> list[dict[str, Any]]:
        rows = []
        for index, result in enumerate(evaluations):
            mine = metrics if self.settings.seeds == 1 else jax.tree.map(lambda leaf, i=index: leaf[i], metrics)
            row = {
                "seed": self.settings.seed + index,
                "frames": self.frames,
                "seconds": round(self._seconds, 3),
                "frames_per_second": round(rate, 1),
                **mine.as_dict(),
                **extras,
                **result,
                "best_score": self._best[index],
            }
            rows.append(finite(row))
        return rows

    def _check_finite(self, tree: Any, what: str) -> None:
        if all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(tree)):
            return
        kept = "" if self._folder is None else f"; the last good checkpoint is in {self._folder.checkpoints}"
        raise SwingupError(
            f"training diverged: {what} not finite after frame {self.frames}{kept}: "
            f"lower --learning-rate or change --seed"
        )

    def _save(self, evaluations: list[dict[str, Any]], writer: MetricsWriter | None) -> None:
        """Write a checkpoint, after the metrics until there, and each seed's last policy with its score."""
        if writer is not None:
            writer.sync()
        self._save_checkpoint()
        for index, result in enumerate(evaluations):
            name = "last.npz" if self.settings.seeds == 1 else f"last-{self.settings.seed + index}.npz"
            self._save_policy(name, index, self.policy(index), result)

    def _save_checkpoint(self) -> None:
        state, metadata = self.snapshot()
        if self._folder is not None:
            self._folder.save_checkpoint(self.frames, state, metadata)
