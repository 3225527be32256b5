"""``swingup.AREAPO``: the learner for your own tasks."""

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Shaped

from ..areapo.checkpoint import load_checkpoint, read_metadata, save_checkpoint
from ..areapo.config import Config, config_from_dict
from ..checks import whole_number
from ..errors import SwingupError
from ..physics.parameters import ROBOTS
from ..plants.plant import Plant, PlantLike, find_plant
from ..policy.jax_backend.policy import Policy, act
from ..tasks.gymnax_task import as_task
from .backend import batched
from .presets import choose_preset, get_preset
from .report import TrainingReport
from .run import Run
from .run_settings import RunSettings, default_intervals, describe_env, run_settings_from_dict
from .start import restore_run, resume_run, start_run

Callback = Callable[["AREAPO", TrainingReport], bool | None]
"""Called after each chunk; returning False ends ``learn``."""

OPTIONS = ("preset", "seed", "folder", "evaluate_every", "checkpoint_every", "evaluation_episodes", "plant")
"""Keywords of the class besides the hyperparameters, to suggest for a misspelt one."""

_LOGGER = logging.getLogger(__name__)


class AREAPO:
    """AR-EAPO on your own task; its presets include PPO, EAPO and APO.

    Example:
        >>> from swingup import AREAPO
        >>> model = AREAPO("Pendulum-v1", num_envs=4, num_steps=32, batch_size=64, evaluation_episodes=0)
        >>> action = model.learn(256).predict([1.0, 0.0, 0.0])
        >>> action.shape
        (1,)
    """

    def __init__(
        self,
        env: Any = None,
        preset: str | None = None,
        seed: int = 0,
        *,
        folder: str | Path | None = None,
        evaluate_every: int | None = None,
        checkpoint_every: int | None = None,
        evaluation_episodes: int = 5,
        plant: PlantLike | None = None,
        run: Run | None = None,
        **overrides: Any,
    ) -> None:
        """Prepare to learn.

        Args:
            env: a Gymnasium id, a function that makes a ``gymnasium.Env``, a ``gymnasium.vector.VectorEnv``, a task
                in JAX (:class:`swingup.tasks.task.AbstractTask`), an environment with gymnax's methods or a pair of
                one and its parameters, or ``acrobot`` or ``pendubot``.
            preset: named settings, see :data:`swingup.learner.presets.PRESETS`. The default is ``default`` for the
                robots and ``mujoco`` for anything else; a pendulum task that is passed in needs a name.
            seed: from which all randomness follows.
            folder: new or empty, for the files that ``swingup train`` writes; None to write none.
            evaluate_every: frames between evaluations, reports and callbacks; a checkpoint adds all three.
            checkpoint_every: frames between checkpoints, where the environments that the host steps are reset.
            evaluation_episodes: episodes of an evaluation. With 0, where the host steps the environments, the score
                is that of the training episodes, or, if none of them ended, the mean reward of a step.
            plant: the robot's pendulum, in whose units the task is: a plant, its parameters, its name or its file;
                None for the leaderboards'.
            run: a run to continue; the other arguments then have no effect.
            **overrides: hyperparameters, names of :class:`swingup.areapo.config.Config`.

        Raises:
            SwingupError: an argument cannot work, or the environment's spaces are not supported.
        """
        if run is None:
            env = as_task(env)
            intervals = {"evaluate_every": evaluate_every, "checkpoint_every": checkpoint_every}
            settings = _settings(env, preset, seed, intervals, evaluation_episodes, find_plant(plant), overrides)
            run = start_run(settings, folder, get_preset(settings.preset).frames, env)
        self._run = run
        # Apart from the training's key: sampled actions do not change what is learned.
        self._sampling = jax.random.key(run.settings.seed)
        self._cached: tuple[int, Policy[Any]] | None = None

    @staticmethod
    def load(path: str | Path, env: Any = None) -> "AREAPO":
        """Load a learner that ``save`` wrote, or the last checkpoint in the folder of a run.

        Args:
            path: the file or the folder.
            env: the environment, if it was passed in as an object; otherwise it is made from its name.

        Raises:
            SwingupError: the file cannot be read, or the environment is needed and was not given.
        """
        if Path(path).is_dir():
            return AREAPO(run=resume_run(path, env=env))
        try:
            settings = run_settings_from_dict(read_metadata(path).get("settings"))
        except SwingupError as error:
            raise SwingupError(f"cannot load {path}: {error}") from error
        return AREAPO(run=restore_run(settings, lambda like: load_checkpoint(path, like), str(path), env))

    @property
    def settings(self) -> RunSettings:
        """The settings that define the run."""
        return self._run.settings

    @property
    def config(self) -> Config:
        """The hyperparameters."""
        return self.settings.config

    @property
    def frames(self) -> int:
        """Frames learned from so far."""
        return self._run.frames

    def learn(self, frames: int, callback: Callback | Sequence[Callback] = ()) -> "AREAPO":
        """Learn from more frames (rounded up to whole iterations), and return the learner itself.

        A second call continues. Each call starts by resetting the environments that the host steps. After an
        error the learner is as after the last whole chunk.

        Args:
            frames: number of frames.
            callback: one or several functions of the learner and a :class:`.TrainingReport`, for each chunk.

        Raises:
            SwingupError: training diverged, an environment failed, or a file cannot be written.
        """
        self._run.extend(frames)
        callbacks = [callback] if callable(callback) else list(callback)
        for report in self._run.advance():
            row = report.rows[0]
            _LOGGER.info(
                "%s frames, %.0f/s, reward %.4g, gain %.4g, score %s",
                f"{report.frames:,}", report.frames_per_second, row["reward"], row["gain"], row["score"],
            )  # fmt: skip
            # A list, not any(): every callback is called, even after one returned False.
            if [True for each in callbacks if each(self, report) is False]:
                self._run.stop()
        return self

    def predict(self, observation: Any, deterministic: bool = True) -> Shaped[np.ndarray, "..."]:
        """Actions of the environment for an observation, or for several along a leading axis.

        For the pendulum's robots and for tasks in JAX, actions are those of the task: in [-1, 1], or integers.

        Args:
            observation: shape of the observation space, or with one axis more in front.
            deterministic: the policy's mode; otherwise a sample, which differs from call to call.

        Raises:
            SwingupError: the observation has another shape.
        """
        flat, single = batched(observation, self._run.backend.evaluator.observation_shape)
        key = None
        if not deterministic:
            self._sampling, key = jax.random.split(self._sampling)
        actions = self._run.backend.to_actions(act(self._policy(), flat, key))
        return actions[0] if single else actions

    def _policy(self) -> Policy[Any]:
        """The policy on the device; it is copied there again after each call of ``learn``."""
        if self._cached is None or self._cached[0] != self.frames:
            self._cached = (self.frames, jax.tree.map(jnp.asarray, self._run.policy()))
        return self._cached[1]

    def evaluate(self, episodes: int = 10, env: Any = None) -> dict[str, Any]:
        """Evaluate the deterministic policy: ``score`` is the mean return, or for a robot the RealAI score.

        Episodes are cut after 10,000 steps of a host environment, or 1,000 of a task in JAX.

        Args:
            episodes: number of episodes.
            env: another environment than the training one; needed if that is a vector environment.

        Raises:
            SwingupError: there is no environment to evaluate on, or it has other spaces.
        """
        episodes = whole_number("episodes", episodes, 1)
        if env is None:
            return self._run.backend.evaluator.evaluate(self._run.policy(), episodes)
        # Imported here: Gymnasium is slow to load.
        from .host_evaluators import play_once

        return play_once(self._run.policy(), env, episodes, self.settings.seed)

    def save(self, path: str | Path) -> None:
        """Write the complete state: a loaded learner continues as this one does, bit for bit.

        The state of environments that the host steps cannot be saved: both learners reset them first, also where a
        callback saves.

        Raises:
            SwingupError: the file cannot be written.
        """
        state, metadata = self._run.snapshot()
        save_checkpoint(path, state, metadata)

    def export_policy(self, path: str | Path) -> None:
        """Write the policy alone, in the format of ``docs/policy-format.md``.

        Raises:
            SwingupError: the file cannot be written.
        """
        policy = self._run.policy()
        self._run.save_policy(Path(path), 0, policy, self._run.backend.evaluator.evaluate(policy))

    def close(self) -> None:
        """Close the environments that were made here."""
        self._run.close()


def _settings(
    env: Any,
    preset: str | None,
    seed: int,
    intervals: dict[str, int | None],
    evaluation_episodes: int,
    plant: Plant | None,
    overrides: dict[str, Any],
) -> RunSettings:
    """The settings of a new learner, with defaults for the arguments that are None."""
    robot = env if isinstance(env, str) and env in ROBOTS else None
    chosen = choose_preset(preset, env)
    given: dict[str, Any] = {name: value for name, value in intervals.items() if value is not None}
    return RunSettings(
        robot=robot,
        preset=chosen,
        seed=seed,
        seeds=1,
        **(default_intervals(robot) | given),
        # From names, so that misspelt keywords are found and NumPy's numbers become Python's.
        config=config_from_dict(vars(get_preset(chosen).config) | overrides, OPTIONS),
        env=None if robot else describe_env(env),
        evaluation_episodes=evaluation_episodes,
        plant=plant,
    )
