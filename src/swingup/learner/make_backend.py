"""Which world a run's settings, or an environment that was passed in, call for."""

from typing import Any

from ..errors import SwingupError
from ..tasks.pendulum import AbstractPendulumTask
from ..tasks.sim2real import Sim2RealTask
from ..tasks.task import AbstractTask
from .backend import AbstractBackend
from .compiled_backend import CompiledBackend
from .evaluators import ReturnEvaluator, Sim2RealEvaluator, SwingUpEvaluator
from .run_settings import Settings, is_label


def make_backend(settings: Settings, env: Any = None) -> AbstractBackend:
    """The world of these settings.

    Args:
        settings: what to train on, by name.
        env: the environment or the task itself, where it has no name to be made from; with a robot, another
            variant of its task than the preset's.

    Raises:
        SwingupError: the task cannot be made, or was passed in once and is not now.
    """
    config, seed, seeds = settings.config, settings.seed, settings.seeds
    if settings.robot is not None:
        task = env if isinstance(env, AbstractPendulumTask) else settings.task()
        real = Sim2RealEvaluator(task, seed) if isinstance(task, Sim2RealTask) else SwingUpEvaluator(task)
        return CompiledBackend(task, config, seed, seeds, real)
    if isinstance(env, AbstractTask):
        judge = ReturnEvaluator(env, seed, max(1, settings.evaluation_episodes))
        return CompiledBackend(env, config, seed, seeds, judge)
    if seeds > 1:
        raise SwingupError(
            f"seeds = {seeds}, but Gymnasium environments train one seed at a time: use swingup sweep"
        )
    if env is None and is_label(settings.name):
        raise SwingupError(f"this run's environment was passed in ({settings.name}): pass it again as env")
    # Imported here: Gymnasium is slow to load, and the pendulum does without.
    from .host_backend import HostBackend

    return HostBackend(
        settings.env if env is None else env, settings.name, config, seed, settings.evaluation_episodes
    )
