"""``swingup.AREAPO``: the learner for your own tasks."""

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..areapo.checkpoint import save_checkpoint
from ..areapo.config import Config
from ..common.arrays import read_format
from ..common.checks import ADVICE, one_of, whole_number
from ..common.errors import SwingupError, quoted
from ..plant.plant import PlantLike
from ..policy.file import FORMAT
from ..policy.policy import Policy
from . import bar as bars
from .presets import get_preset
from .problem import make_problem
from .progress import TrainingReport
from .run import Run, restore_run, start_from_policy, start_run
from .run_folder import BEST
from .run_settings import RunSettings, make_run_settings

POLICIES = ("MlpPolicy", "CnnPolicy", "MultiInputPolicy")  # Stable-Baselines3's, its first argument
Callback = Callable[["AREAPO", TrainingReport], Any]  # Called after each chunk; returning False ends learn


class AREAPO:
    """AR-EAPO on your own task; one of its presets is PPO.

    Example:
        >>> from swingup import AREAPO
        >>> model = AREAPO("Pendulum-v1", num_envs=4, num_steps=32, batch_size=64, evaluation_episodes=0)
        >>> action, _ = model.learn(256).predict([1.0, 0.0, 0.0])
        >>> action.shape
        (1,)
    """

    def __init__(
        self,
        env: Any,
        preset: str | None = None,
        seed: int = 0,
        *,
        seeds: int | None = None,
        folder: str | Path | None = None,
        evaluate_every: int | None = None,
        checkpoint_every: int | None = None,
        evaluation_episodes: int | None = None,
        plant: PlantLike | None = None,
        resets: str | None = None,
        **overrides: Any,
    ) -> None:
        """Prepare to learn.

        Args:
            env: a Gymnasium id, an environment that ``gymnasium.make`` made (of which more are made alike), a
                function that makes a ``gymnasium.Env`` or a list of such functions, a ``gymnasium.Env`` or a
                ``gymnasium.vector.VectorEnv``, a task in JAX (:class:`swingup.tasks.task.AbstractTask`), an
                environment with gymnax's methods or a pair of one and its parameters, an environment of
                jax-envelope, or ``acrobot`` or ``pendubot``.
            preset: named settings, see :data:`swingup.learner.presets.PRESETS`. The default is ``pendulum`` for
                the robots, ``dm-acrobot`` for the id of dm_control's acrobot, ``continuing`` for streams and the
                continuing tasks, and ``episodes`` for anything else; a pendulum task passed in needs a name.
            seed: from which all randomness follows.
            seeds: how many seeds to train, ``seed`` and those after it; default: the preset's number. The learner
                then acts by the seed with the best score so far.
            folder: new or empty, for the files that ``swingup train`` writes; None to write none.
            evaluate_every: frames of a seed between evaluations. Each checkpoint also evaluates, reports and calls
                the callbacks.
            checkpoint_every: frames of a seed between checkpoints, where the environments that the host steps are
                reset.
            evaluation_episodes: episodes of an evaluation, whose mean return is the score; default: 5. With 0,
                where the host steps the environments, it is that of the training episodes. A robot has one episode.
                The score of a continuing task is its reward rate over ``evaluation_episodes`` × 2,000 steps.
            plant: the robot's pendulum, in whose units the task is: a plant, its name or its file; None for the
                leaderboards'.
            resets: ``never`` for one stream: ``reset`` is called once in the environment's life, and the score is
                the reward rate while training. A Gymnasium environment alone can be one, which then fills the
                preset's rollout by itself.
            **overrides: hyperparameters, names of :class:`swingup.areapo.config.Config`. Without ``num_envs`` a
                vector environment or a list keeps its number, and an environment that was passed in is one.

        Raises:
            SwingupError: an argument cannot work, or the environment's spaces are not supported.
        """
        if isinstance(env, str) and env in POLICIES:
            raise SwingupError(f"env = {env!r} is a policy's name: pass the environment first. {ADVICE['policy']}")
        settings = make_run_settings(
            env,
            preset,
            overrides,
            seed=seed,
            seeds=seeds,
            evaluate_every=evaluate_every,
            checkpoint_every=checkpoint_every,
            evaluation_episodes=evaluation_episodes,
            plant=plant,
            resets=resets,
        )
        self._use(start_run(settings, folder, get_preset(settings.preset).frames))

    @classmethod
    def load(cls, path: str | Path, env: Any = None, which: str = "last") -> "AREAPO":
        """Load a learner, which writes no files.

        Args:
            path: a file that ``save`` wrote, or a run's folder, in which nothing is changed: the learner goes on
                bit for bit. A policy file gives a new learner with its actor, normalisation and hyperparameters,
                whose critic and gain begin anew.
            env: the environment, where one was passed in as an object; others are made from their names.
            which: in a folder, the ``last`` checkpoint, or the ``best`` policy.

        Raises:
            SwingupError: the file cannot be read, the environment is needed and was not given, or its actions have
                other bounds than those of training.
        """
        one_of("policy to load", which, ("last", "best"))
        if which == "best" and not Path(path).is_dir():
            raise SwingupError(f"which = 'best' needs a run's folder, and {path} is not one: leave it out")
        model, file = cls.__new__(cls), Path(path) / BEST if which == "best" else path
        model._use((start_from_policy if read_format(file) == FORMAT else restore_run)(file, env))
        return model

    def _use(self, run: Run) -> None:
        self._run = run
        self._sampling = np.random.default_rng(run.settings.seed)
        self._cached: tuple[int, Policy] | None = None

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

    @property
    def pause(self) -> float:
        """Time of an update (s), for which the host's environments wait after a rollout; compiled tasks do not.

        It is measured when it is first asked for, or before the first step of a stream.
        """
        if self._run.backend.pause is None:
            self._run.compile()
        return float(self._run.backend.pause or 0.0)

    def learn(
        self,
        total_timesteps: int,
        callback: Callback | Sequence[Callback] | None = None,
        progress_bar: bool = False,
    ) -> "AREAPO":
        """Learn from more frames (rounded up to whole iterations), and return the learner itself.

        A second call continues. Each call starts by resetting the environments that the host steps, except a
        stream that is never reset. After an error the learner is as after the last whole chunk.

        Args:
            total_timesteps: number of frames of each seed, of all environments together.
            callback: one or several functions of the learner and a :class:`.TrainingReport`, for each chunk.
            progress_bar: whether to show a bar, a notebook's in a notebook, with the last report.

        Raises:
            SwingupError: training diverged, an environment failed, a file cannot be written, or a callback is not
                a function.
        """
        callbacks = list(callback) if isinstance(callback, Sequence) else [callback] if callback else []
        for each in callbacks:
            if not callable(each):
                raise SwingupError(f"callback = {quoted(each)}: pass a function of the learner and a report")
        self._run.extend(total_timesteps)
        bar = bars.progress_bar(self._run.goal, self.frames) if progress_bar else contextlib.nullcontext()
        # Closed also where a callback raises: else a traceback would keep the folder locked.
        with bar as show, contextlib.closing(self._run.advance()) as reports:
            for report in reports:
                if show is not None:
                    show(report.frames, str(report))
                # All are called, even after one returned False.
                answers = [each(self, report) for each in callbacks]
                # NumPy's and JAX's comparisons give arrays.
                truths = [
                    each for each in answers if isinstance(each, bool) or getattr(each, "dtype", None) == np.bool_
                ]
                if not all(np.all(each) for each in truths):
                    self._run.stop()
        return self

    def predict(
        self, observation: Any, state: None = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, None]:
        """Actions of the environment for an observation, or for several along a leading axis, and None.

        They are those of the policy's file, bit for bit: see :meth:`swingup.policy.policy.Policy.predict`. For the
        robots and for tasks in JAX, actions are those of the task: in [-1, 1], or integers.
        """
        return self.policy.predict(observation, state, episode_start, deterministic)

    @property
    def policy(self) -> Policy:
        """The best seed's policy as a file has it, made again after each call of ``learn``."""
        if self._cached is None or self._cached[0] != self.frames:
            policy = self._run.policies()[self._run.progress.best_seed]
            self._cached = (self.frames, self._run.backend.evaluator.file_policy(policy))
            self._cached[1].seed(self._sampling)
        return self._cached[1]

    def evaluate(self, episodes: int | None = None, env: Any = None) -> dict[str, Any]:
        """Evaluate the deterministic policy: ``score`` is the mean return, or for a robot the RealAI score.

        Args:
            episodes: number of episodes, each cut after 2,000 steps; default: 10, or one in each environment of a
                vector environment. A robot has one episode.
            env: another environment than the training one; needed if that is a vector environment.

        Raises:
            SwingupError: there is no environment to evaluate on, or it has other spaces, or it plays another number
                of episodes.
        """
        if episodes is not None:
            episodes = whole_number("episodes", episodes, 1)
        run, evaluator = self._run, self._run.backend.evaluator
        policy = run.policies()[run.progress.best_seed]
        if env is None:
            return evaluator.evaluate(policy, episodes or evaluator.default_episodes).as_dict()
        problem, actions = make_problem(env), evaluator.action_space.describe()
        return problem.evaluate(policy, self.settings.seed, episodes, actions).as_dict()

    def save(self, path: str | Path) -> None:
        """Write the complete state of all seeds: a loaded learner continues as this one does, bit for bit.

        The state of environments that the host steps cannot be saved: both learners reset them first, also where a
        callback saves; a stream that is never reset goes on as it is.
        """
        state, metadata = self._run.snapshot()
        save_checkpoint(path, state, metadata)

    def export_policy(self, path: str | Path) -> None:
        """Write the policy alone, in the format of ``docs/policy-format.md``."""
        run = self._run
        policies, index = run.policies(), run.progress.best_seed
        run.save_policy(Path(path), index, policies[index], run.backend.evaluate(policies)[index])

    def close(self) -> None:
        """Close the environments that were made here."""
        self._run.close()
