"""The back end for a run's settings, or for an environment that was passed in."""

from typing import Any

from ..common.errors import SwingupError
from ..tasks.adapted import AbstractAdaptedTask
from ..tasks.adapters import as_task
from ..tasks.pendulum import AbstractPendulumTask
from ..tasks.task import AbstractTask
from .backend import AbstractBackend
from .compiled_backend import CompiledBackend
from .evaluators import ReturnEvaluator, SwingUpEvaluator
from .memory import check_memory
from .run_settings import RunSettings, is_description


def make_backend(settings: RunSettings, env: Any = None) -> AbstractBackend:
    """The back end of these settings.

    Args:
        settings: what to train on, by name.
        env: the environment or the task itself, if it cannot be made from a name; with a robot, another variant
            of its task than the preset's.

    Raises:
        SwingupError: the task cannot be made or must be passed in again, or memory is short.
    """
    config, seed, seeds = settings.config, settings.seed, settings.seeds
    env = as_task(env)
    if settings.robot is not None:
        pendulum = env if isinstance(env, AbstractPendulumTask) else settings.task()
        check_memory(config, pendulum.spaces, seeds)
        by_scores = SwingUpEvaluator(pendulum, settings.plant)
        return CompiledBackend(pendulum, config, seed, seeds, by_scores)
    if isinstance(env, AbstractTask):
        check_memory(config, env.spaces, seeds)
        episodes = settings.evaluation_episodes
        if not episodes:
            raise SwingupError("evaluation_episodes = 0, but a task in JAX is scored by episodes: use 1 or more")
        to_actions = env.actions if isinstance(env, AbstractAdaptedTask) else None
        return CompiledBackend(env, config, seed, seeds, ReturnEvaluator(env, seed, episodes), to_actions)
    if env is None and is_description(settings.name):
        raise SwingupError(f"this run's environment was passed in ({settings.name}): pass it again as env")
    # Imported here: Gymnasium is slow to load, and the pendulum does not need it.
    from .host_backend import HostBackend

    made_from = settings.env if env is None else env
    return HostBackend(made_from, settings.name, config, range(seed, seed + seeds), settings.evaluation_episodes)
