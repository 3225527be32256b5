"""A training run on disk: a host loop over compiled chunks, so that progress shows, runs resume and seeds batch.

A run's folder holds config.json, metrics.jsonl, tensorboard/, checkpoints/, best.npz and last.npz; with several
seeds also best-SEED.npz and last-SEED.npz, and best.npz is the best of all.
"""

import dataclasses
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..areapo import train
from ..areapo.checkpoint import load_checkpoint, save_checkpoint
from ..areapo.policy import Policy
from ..areapo.state import LearnerState, Metrics
from ..benchmark.criteria import Criteria
from ..benchmark.evaluate import evaluate
from ..control.learned import PolicyController, load_policy, save_controller
from ..errors import SwingupError
from ..physics.parameters import TORQUE_LIMIT, get_robot
from ..version import __version__
from .metrics import MetricsWriter
from .settings import Settings, read_settings, write_settings

CHECKPOINTS_KEPT = 2

# Compiled once for all runs of a program. A single seed goes without vmap, which costs it speed on a CPU.
_init = jax.jit(train.init)
_init_seeds = jax.jit(jax.vmap(train.init, in_axes=(0, None, None)))
_train = jax.jit(train.train, donate_argnums=0)
_train_seeds = jax.jit(jax.vmap(train.train, in_axes=(0, None, None, None)), donate_argnums=0)


@dataclass(frozen=True)
class Report:
    """Where a run stands after a chunk."""

    frames: int
    """Frames of each seed so far."""
    frames_per_second: float
    """Of all seeds together, over the last chunk, evaluation and files included."""
    rows: list[dict[str, Any]]
    """What was written to metrics.jsonl: one row a seed."""
    best_score: float
    """Best RealAI score of any seed so far."""


class Run:
    """A training run that can be advanced, stopped between chunks, and resumed."""

    def __init__(self, settings: Settings, folder: str | Path, frames: int) -> None:
        """Start a new run of ``frames`` frames a seed in a folder that does not exist yet or is empty.

        Raises:
            SwingupError: the folder holds something or cannot be written.
        """
        folder = Path(folder)
        _check_frames(frames)
        self._prepare(settings, folder, frames)
        try:
            if folder.exists() and any(folder.iterdir()):
                raise SwingupError(f"{folder} exists: continue it with --resume {folder}, or choose another --out")
            self._state = self._init()  # compiles for seconds: interrupted here, a run leaves nothing behind
            (folder / "checkpoints").mkdir(parents=True)
        except OSError as error:
            raise SwingupError(f"cannot create {folder}: {error.strerror}; choose another --out") from error
        write_settings(folder, settings, frames)
        self._save_checkpoint()

    @classmethod
    def resume(cls, folder: str | Path, frames: int | None = None) -> "Run":
        """Continue a run from its last checkpoint, bit for bit; to another number of frames if one is given.

        Raises:
            SwingupError: the folder is no run, has no checkpoint, or its checkpoint is of another configuration.
        """
        folder = Path(folder)
        settings, goal = read_settings(folder)
        goal = goal if frames is None else frames
        _check_frames(goal)
        paths = sorted((folder / "checkpoints").glob("*.npz"))
        if not paths:
            raise SwingupError(f"{folder} has no checkpoint: delete it and train again")
        run = cls.__new__(cls)
        run._prepare(settings, folder, goal)
        try:
            run._state, metadata = load_checkpoint(paths[-1], like=jax.eval_shape(run._init))
        except SwingupError as error:
            advice = "; delete it to resume from the one before" if len(paths) > 1 else ""
            raise SwingupError(f"{error}{advice}") from error
        if metadata.get("settings") != settings.as_dict():
            raise SwingupError(f"checkpoint {paths[-1]} is of another configuration than {folder / 'config.json'}")
        run.iterations = metadata["iterations"]
        if goal < run.frames:
            raise SwingupError(f"frames = {goal}, but {folder} stands at {run.frames} already: ask for more")
        run._seconds = metadata["seconds"]
        run._best = [max(best, run._kept_score(index)) for index, best in enumerate(metadata["best"])]
        write_settings(folder, settings, goal)
        return run

    def _prepare(self, settings: Settings, folder: Path, frames: int) -> None:
        self.settings, self.folder, self.goal = settings, folder, frames
        self.iterations = 0
        self._seconds = 0.0
        self._best = [-math.inf] * settings.seeds
        self._task = settings.task()
        self._stopping = False

    def _init(self) -> LearnerState:
        config, seeds = self.settings.config, self.settings.seeds
        keys = [jax.random.key(self.settings.seed + index) for index in range(seeds)]
        if seeds == 1:
            return _init(keys[0], self._task, config)
        return _init_seeds(jnp.stack(keys), self._task, config)

    @property
    def frames(self) -> int:
        """Frames of each seed so far."""
        return self.iterations * self.settings.config.rollout_size

    @property
    def best_score(self) -> float:
        """Best RealAI score of any seed so far; -inf before the first evaluation."""
        return max(self._best)

    def stop(self) -> None:
        """Ask the run to end after the chunk in progress."""
        self._stopping = True

    def advance(self) -> Iterator[Report]:
        """Train until each seed has seen its frames (rounded up to whole iterations), reporting each chunk.

        A checkpoint is written at intervals, at the end and when asked to stop.

        Raises:
            SwingupError: training diverged (something is not finite), or a file cannot be written.
        """
        target = math.ceil(self.goal / self.settings.config.rollout_size)
        every = max(1, self.settings.checkpoint_every // self.settings.config.rollout_size)
        with MetricsWriter(self.folder, after_frames=self.frames) as writer:
            while self.iterations < target and not self._stopping:
                start, before = time.perf_counter(), self.iterations
                chunk_end = (before // self.settings.chunk + 1) * self.settings.chunk
                metrics = self._train_chunk(min(chunk_end, target) - before)
                evaluations = [self._evaluate(index) for index in range(self.settings.seeds)]
                if self.iterations // every > before // every or self.iterations >= target or self._stopping:
                    self._save()
                seconds = time.perf_counter() - start
                self._seconds += seconds
                rate = (
                    (self.iterations - before) * self.settings.config.rollout_size * self.settings.seeds / seconds
                )
                rows = self._rows(metrics, evaluations, rate)
                writer.write(rows)
                yield Report(self.frames, rate, rows, self.best_score)
            if self._stopping:
                self._save()

    def _train_chunk(self, count: int) -> Metrics:
        advance = _train if self.settings.seeds == 1 else _train_seeds
        self._state, metrics = advance(self._state, self._task, self.settings.config, count)
        metrics = jax.tree.map(np.asarray, metrics)
        self._check_finite(metrics, "metrics are")
        self.iterations += count
        return metrics

    def _member(self, index: int) -> LearnerState:
        if self.settings.seeds == 1:
            return self._state
        return jax.tree.map(lambda leaf: leaf[index], self._state)

    def _controller(self, index: int) -> PolicyController:
        state = self._member(index)
        stages = (self._task.observation, state.statistics.stage(self.settings.config.observation_clip))
        # Policies observe in double precision, whatever they were trained in.
        stages = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), stages)
        policy = Policy(stages, jax.tree.map(np.asarray, state.actor))
        return PolicyController(policy, TORQUE_LIMIT, get_robot(self.settings.robot))

    def _evaluate(self, index: int) -> Criteria:
        """Score the deterministic policy of one seed; keep it if it is its seed's best."""
        controller = self._controller(index)
        criteria = evaluate(controller, get_robot(self.settings.robot)).criteria
        if criteria.score > self._best[index]:
            record = criteria.score > self.best_score
            self._best[index] = criteria.score
            if self.settings.seeds > 1:
                self._save_policy(self._best_name(index), index, controller, criteria)
            if record:
                self._save_policy("best.npz", index, controller, criteria)
        return criteria

    def _best_name(self, index: int) -> str:
        return "best.npz" if self.settings.seeds == 1 else f"best-{self.settings.seed + index}.npz"

    def _kept_score(self, index: int) -> float:
        """Score of a seed's best policy on disk, which may be newer than the checkpoint; -inf without one."""
        path = self.folder / self._best_name(index)
        if not path.exists():
            return -math.inf
        return float(load_policy(path)[1]["scores"]["v2"]["score"])

    def _save_policy(self, name: str, index: int, controller: PolicyController, criteria: Criteria) -> None:
        provenance = {
            "version": __version__,
            "preset": self.settings.preset,
            "command": self.settings.command(self.goal),
            "seed": self.settings.seed + index,
            "frames": self.frames,
            "seconds": round(self._seconds, 1),
            "hyperparameters": self.settings.as_dict()["config"],
            "scores": {"v2": dataclasses.asdict(criteria)},
        }
        save_controller(self.folder / name, controller, provenance)

    def _rows(self, metrics: Metrics, evaluations: list[Criteria], rate: float) -> list[dict[str, Any]]:
        rows = []
        for index, criteria in enumerate(evaluations):
            mine = metrics if self.settings.seeds == 1 else jax.tree.map(lambda leaf, i=index: leaf[i], metrics)
            rows.append(
                {
                    "seed": self.settings.seed + index,
                    "frames": self.frames,
                    "seconds": round(self._seconds, 3),
                    "frames_per_second": round(rate, 1),
                    **mine.as_dict(),
                    **dataclasses.asdict(criteria),
                    "best_score": self._best[index],
                }
            )
        return rows

    def _check_finite(self, tree: Any, what: str) -> None:
        if all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(tree)):
            return
        raise SwingupError(
            f"training diverged: {what} not finite after frame {self.frames}; the last good checkpoint is in "
            f"{self.folder / 'checkpoints'}: lower --learning-rate or change --seed"
        )

    def _save(self) -> None:
        """Write a checkpoint, and each seed's last policy with its score."""
        self._save_checkpoint()
        for index in range(self.settings.seeds):
            controller = self._controller(index)
            criteria = evaluate(controller, get_robot(self.settings.robot)).criteria
            name = "last.npz" if self.settings.seeds == 1 else f"last-{self.settings.seed + index}.npz"
            self._save_policy(name, index, controller, criteria)

    def _save_checkpoint(self) -> None:
        self._check_finite((self._state.actor, self._state.critic), "weights are")
        metadata = {
            "settings": self.settings.as_dict(),
            "iterations": self.iterations,
            "seconds": self._seconds,
            "best": self._best,
        }
        checkpoints = self.folder / "checkpoints"
        save_checkpoint(checkpoints / f"{self.frames:012d}.npz", self._state, metadata)
        for old in sorted(checkpoints.glob("*.npz"))[:-CHECKPOINTS_KEPT]:
            old.unlink(missing_ok=True)


def _check_frames(frames: int) -> None:
    if frames < 1:
        raise SwingupError(f"frames = {frames} must be at least 1")
