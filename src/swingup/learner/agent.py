"""``swingup.AREAPO``: the learner for your own tasks."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..areapo.checkpoint import load_checkpoint, read_metadata, save_checkpoint
from ..areapo.config import Config, config_from_dict
from ..common.checks import whole_number
from ..common.errors import SwingupError
from ..controllers.stack.policy import Policy, remember
from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant
from ..plant.robots import ROBOTS
from ..tasks.adapters import as_task
from ..tasks.task import AbstractTask
from .backend import batched
from .habits import callbacks_of, check_device, check_env, check_names, chosen_folder, frames_to_learn
from .policy_memory import memory_before
from .presets import choose_preset, get_preset, is_pendulum
from .report import TrainingReport
from .run import Run
from .run_settings import RunSettings, default_intervals, describe_env, run_settings_from_dict
from .shown import ProgressBar, tell
from .start import restore_run, resume_run, start_run

Callback = Callable[["AREAPO", TrainingReport], bool | None]
"""Called after each chunk; returning False ends ``learn``."""

OPTIONS = (
    "env", "preset", "seed", "folder", "evaluate_every", "checkpoint_every", "evaluation_episodes", "plant",
    "verbose", "tensorboard_log", "device",
)  # fmt: skip
"""Keywords of the class besides the hyperparameters, to suggest for a misspelt one."""


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
        plant: PlantLike = LEADERBOARD,
        verbose: int = 0,
        tensorboard_log: str | Path | None = None,
        device: Any = "auto",
        run: Run | None = None,
        **overrides: Any,
    ) -> None:
        """Prepare to learn.

        Args:
            env: a Gymnasium id, an environment that ``gymnasium.make`` made (of which more are made alike), a
                function that makes a ``gymnasium.Env``, a ``gymnasium.vector.VectorEnv``, a task in JAX
                (:class:`swingup.tasks.task.AbstractTask`), an environment with gymnax's methods or a pair of one
                and its parameters, an environment of jax-envelope, or ``acrobot`` or ``pendubot``.
            preset: named settings, see :data:`swingup.learner.presets.PRESETS`. The default is ``default`` for the
                robots and ``mujoco`` for anything else; a pendulum task that is passed in needs a name.
            seed: from which all randomness follows.
            folder: new or empty, for the files that ``swingup train`` writes; None to write none.
            evaluate_every: frames between evaluations, reports and callbacks; a checkpoint adds all three.
            checkpoint_every: frames between checkpoints, where the environments that the host steps are reset.
            evaluation_episodes: episodes of an evaluation. With 0, where the host steps the environments, the score
                is that of the training episodes, or, if none of them ended, the mean reward of a step.
            plant: the robot's pendulum, in whose units the task is: a plant, its name or its file.
            verbose: 1 or 2 shows a line of each report on standard error.
            tensorboard_log: a folder in which each run gets a new ``folder``: AREAPO_1, AREAPO_2 and so on.
            device: where JAX must run: ``auto``, ``cpu``, ``cuda`` or ``tpu``. It is checked, not chosen.
            run: a run to continue; the other arguments then have no effect.
            **overrides: hyperparameters, names of :class:`swingup.areapo.config.Config`. Without ``num_envs`` a
                vector environment keeps its number.

        Raises:
            SwingupError: an argument cannot work, or the environment's spaces are not supported.
        """
        self._verbose = whole_number("verbose", verbose, 0, 2) > 0
        if run is None:
            check_env(env)
            check_names(overrides)
            check_device(device)
            env = as_task(env)
            intervals = {"evaluate_every": evaluate_every, "checkpoint_every": checkpoint_every}
            settings = _settings(env, preset, seed, intervals, evaluation_episodes, load_plant(plant), overrides)
            place = chosen_folder(folder, tensorboard_log)
            run = start_run(settings, place, get_preset(settings.preset, is_pendulum(env)).frames, env)
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

    def learn(
        self,
        frames: int | None = None,
        callback: Callback | Sequence[Callback] | None = None,
        *,
        total_timesteps: int | None = None,
        progress_bar: bool = False,
        **others: Any,
    ) -> "AREAPO":
        """Learn from more frames (rounded up to whole iterations), and return the learner itself.

        A second call continues. Each call starts by resetting the environments that the host steps. After an
        error the learner is as after the last whole chunk.

        Args:
            frames: number of frames.
            callback: one or several functions of the learner and a :class:`.TrainingReport`, for each chunk.
            total_timesteps: another name of ``frames``.
            progress_bar: whether standard error shows a bar, which moves with each report.
            **others: arguments that other packages know; an error says what to write for them.

        Raises:
            SwingupError: training diverged, an environment failed, a file cannot be written, or an argument is
                unknown.
        """
        goal = frames_to_learn(frames, total_timesteps, others)
        callbacks = callbacks_of(callback)
        self._run.extend(goal)
        with ProgressBar(self.frames, self._run.goal, progress_bar) as bar:
            for report in self._run.advance():
                tell(report, self._verbose and not progress_bar)
                bar.draw(report.frames, report.frames_per_second)
                # A list, not any(): every callback is called, even after one returned False.
                if [True for each in callbacks if each(self, report) is False]:
                    self._run.stop()
        return self

    def predict(
        self, observation: Any, deterministic: bool = True, *, state: Any = None, episode_start: Any = None
    ) -> Any:
        """Actions of the environment for an observation, or for several along a leading axis.

        For the pendulum's robots and for tasks in JAX, actions are those of the task: in [-1, 1], or integers.

        Args:
            observation: shape of the observation space, or with one axis more in front.
            deterministic: the policy's mode; otherwise a sample, which differs from call to call.
            state: of a recurrent policy (``gru_width``), what the last call returned; None at the first.
            episode_start: of a recurrent policy, whether each observation is the first of an episode.

        Returns:
            The actions; of a recurrent policy a pair of them and the state for the next call.

        Raises:
            SwingupError: the observation, the state or ``episode_start`` has another shape.
        """
        flat, single = batched(observation, self._run.backend.evaluator.observation_shape)
        key = None
        if not deterministic:
            self._sampling, key = jax.random.split(self._sampling)
        policy = self._policy()
        before = memory_before(policy, state, episode_start, len(flat))
        after, chosen = remember(policy, before, flat, key)
        actions = self._run.backend.to_actions(chosen)
        found = actions[0] if single else actions
        return found if after is None else (found, np.asarray(after))

    def _policy(self) -> Policy[Any]:
        """The policy on the device; it is copied there again after each call of ``learn``."""
        if self._cached is None or self._cached[0] != self.frames:
            self._cached = (self.frames, jax.tree.map(jnp.asarray, self._run.policy()))
        return self._cached[1]

    def evaluate(self, episodes: int | None = None, env: Any = None) -> dict[str, Any]:
        """Evaluate the deterministic policy: ``score`` is the mean return, or for a robot the RealAI score.

        Episodes are cut after 10,000 steps of a host environment, or 1,000 of a task in JAX.

        Args:
            episodes: number of episodes; 10 by default, or one in each environment of a vector environment.
            env: another environment than the training one; needed if that is a vector environment.

        Raises:
            SwingupError: there is no environment to evaluate on, or it has other spaces, or it is a vector
                environment that plays another number of episodes.
        """
        number = getattr(env, "num_envs", 10) if episodes is None else episodes
        episodes = whole_number("episodes", number, 1)
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
    plant: Plant,
    overrides: dict[str, Any],
) -> RunSettings:
    """The settings of a new learner, with defaults for the arguments that are None."""
    robot = env if isinstance(env, str) and env in ROBOTS else None
    chosen = choose_preset(preset, env)
    name, num_envs = _name_and_number(env)
    number = {} if num_envs is None else {"num_envs": num_envs}
    given: dict[str, Any] = {name: value for name, value in intervals.items() if value is not None}
    return RunSettings(
        robot=robot,
        preset=chosen,
        seed=seed,
        seeds=1,
        **(default_intervals(robot) | given),
        # From names, so that misspelt keywords are found and NumPy's numbers become Python's.
        config=config_from_dict(vars(get_preset(chosen, is_pendulum(env)).config) | number | overrides, OPTIONS),
        env=None if robot else name,
        evaluation_episodes=evaluation_episodes,
        plant=plant,
    )


def _name_and_number(env: Any) -> tuple[str, int | None]:
    """The environment's id or description, and its number where it is several side by side."""
    if isinstance(env, str | AbstractTask):
        return describe_env(env), None
    # Imported here: Gymnasium is slow to load.
    from .made_environment import id_of, num_envs_of

    return id_of(env) or describe_env(env), num_envs_of(env)
