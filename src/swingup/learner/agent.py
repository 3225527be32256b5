"""``swingup.AREAPO``: the learner for a task of one's own, in the manner of Gymnasium's users."""

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
from ..physics.parameters import ROBOTS
from ..policy.jax_backend.policy import Policy, act
from .presets import DEFAULT_PRESET, ENV_PRESET, get_preset
from .run import Report, Run
from .run_settings import Settings, default_intervals, label, settings_from_dict, whole

Callback = Callable[["AREAPO", Report], bool | None]
"""Called after each chunk; returning False ends ``learn``."""

_LOGGER = logging.getLogger(__name__)


class AREAPO:
    """AR-EAPO, and by its presets PPO, EAPO and APO, on a task of yours.

    Example:
        >>> from swingup import AREAPO
        >>> model = AREAPO("Pendulum-v1", num_envs=4, num_steps=32, batch_size=64, evaluation_episodes=0)
        >>> action = model.learn(256).predict([1.0, 0.0, 0.0])
        >>> action.shape
        (1,)
    """

    def __init__(
        self,
        env: Any,
        preset: str | None = None,
        seed: int = 0,
        *,
        folder: str | Path | None = None,
        evaluate_every: int | None = None,
        checkpoint_every: int | None = None,
        evaluation_episodes: int = 5,
        **overrides: Any,
    ) -> None:
        """Prepare to learn.

        Args:
            env: a Gymnasium id, a function that makes a ``gymnasium.Env``, a ``gymnasium.vector.VectorEnv``, a task
                in JAX (:class:`swingup.tasks.task.AbstractTask`), or ``acrobot`` or ``pendubot``.
            preset: named settings, see :data:`swingup.learner.presets.PRESETS`; by default ``default`` for the
                pendulum and ``mujoco`` for anything else.
            seed: from which all randomness follows.
            folder: new or empty; learning then writes what ``swingup train`` writes. None: nothing is written.
            evaluate_every: frames between evaluations, reports and callbacks, which come at checkpoints as well.
            checkpoint_every: frames between checkpoints; environments that the host steps start anew there.
            evaluation_episodes: episodes of an evaluation; 0: none, where the host steps the environments, which
                leaves training's episodes, or the reward of a step where none of them ends.
            **overrides: hyperparameters, names of :class:`swingup.areapo.config.Config`.

        Raises:
            SwingupError: an argument cannot work, or the environment's spaces are not supported.
        """
        robot = env if isinstance(env, str) and env in ROBOTS else None
        preset = preset or (DEFAULT_PRESET if robot else ENV_PRESET)
        usual = default_intervals(robot)
        settings = Settings(
            robot=robot,
            preset=preset,
            seed=seed,
            seeds=1,
            evaluate_every=usual["evaluate_every"] if evaluate_every is None else evaluate_every,
            checkpoint_every=usual["checkpoint_every"] if checkpoint_every is None else checkpoint_every,
            config=_config(preset, overrides),
            env=None if robot else label(env),
            evaluation_episodes=evaluation_episodes,
        )
        self._run = Run(settings, folder, get_preset(preset).frames, env)
        self._start_sampling()

    @classmethod
    def load(cls, path: str | Path, env: Any = None) -> "AREAPO":
        """A learner as it was saved by ``save``, or, from the folder of a run, as its last checkpoint has it.

        Args:
            path: the file or the folder.
            env: needed where the environment was passed in as an object; otherwise made from its name.

        Raises:
            SwingupError: the file cannot be read, or the environment is needed and was not given.
        """
        model = cls.__new__(cls)
        if Path(path).is_dir():
            model._run = Run.resume(path, env=env)
        else:
            metadata = read_metadata(path)
            settings = settings_from_dict(metadata["settings"])
            model._run = Run.from_snapshot(settings, lambda like: load_checkpoint(path, like), env)
        model._start_sampling()
        return model

    def _start_sampling(self) -> None:
        self._sampling = jax.random.key(self.settings.seed)
        self._cached: tuple[int, Policy[Any]] | None = None

    @property
    def settings(self) -> Settings:
        """What defines the run."""
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
        """Learn from so many frames more (rounded up to whole iterations), and return the learner itself.

        Called again it goes on. Environments that the host steps are reset at its start. Whatever is raised, the
        learner stands where the last whole chunk left it.

        Args:
            frames: how many.
            callback: what to call after each chunk with the learner and a :class:`Report`; one or several.

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
            # Every callback is called, whatever another one says.
            if [True for each in callbacks if each(self, report) is False]:
                self._run.stop()
        return self

    def predict(self, observation: Any, deterministic: bool = True) -> Shaped[np.ndarray, "..."]:
        """Actions of the environment for an observation, or for several along a leading axis.

        For the pendulum's robots and for tasks in JAX actions are those of the task: in [-1, 1], or integers.

        Args:
            observation: shape of the observation space, or with one axis more in front.
            deterministic: the policy's mode; otherwise a sample, which differs from call to call.

        Raises:
            SwingupError: the observation has another shape.
        """
        flat, single = self._run.world.flatten(observation)
        key = None
        if not deterministic:
            self._sampling, key = jax.random.split(self._sampling)
        actions = self._run.world.to_actions(act(self._policy(), flat, key))
        return actions[0] if single else actions

    def _policy(self) -> Policy[Any]:
        """The policy on the device, copied there once after each learning."""
        if self._cached is None or self._cached[0] != self.frames:
            self._cached = (self.frames, jax.tree.map(jnp.asarray, self._run.policy()))
        return self._cached[1]

    def evaluate(self, episodes: int = 10, env: Any = None) -> dict[str, Any]:
        """Judge the deterministic policy: ``score`` is the mean return; the pendulum's is the RealAI score.

        Episodes are cut after 10,000 steps where the host steps them, after 1,000 in a task in JAX.

        Args:
            episodes: how many.
            env: another environment than the one learned on; needed where that is a vector environment.

        Raises:
            SwingupError: there is no environment to evaluate on, or it has other spaces.
        """
        episodes = whole("episodes", episodes, 1)
        if env is None:
            return self._run.world.evaluate(self._run.policy(), episodes)
        from .host_backend import play_once

        return play_once(self._run.policy(), env, episodes, self.settings.seed)

    def save(self, path: str | Path) -> None:
        """Write the complete state: a learner that is loaded goes on as this one does, bit for bit.

        Therefore environments that the host steps start anew in both, also where a callback saves.

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
        self._run.world.save(Path(path), policy, self._run.provenance(0, self._run.world.evaluate(policy)))

    def close(self) -> None:
        """Close the environments that were made here."""
        self._run.close()


def _config(preset: str, overrides: dict[str, Any]) -> Config:
    return config_from_dict(vars(get_preset(preset).config) | overrides)
