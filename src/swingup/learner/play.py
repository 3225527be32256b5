"""Episodes of a policy in an environment of Gymnasium, one after another: what evaluates and films it anywhere."""

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from .. import gym  # noqa: F401 (registers swingup's own ids)
from ..benchmark.values import mean_interval, share_interval
from ..common.checks import whole_number
from ..common.errors import SwingupError, errors_named_after, one_line
from ..policy.pendulum import PendulumPolicy
from ..policy.policy import Policy
from ..tasks.task import space_actions
from .backend import EPISODE_STEPS, EPISODES, check_actions
from .environments import OWN_RESETS, SUCCESS, make_by_id, refuse_running


@dataclass(frozen=True)
class Episodes:
    """What episodes gave, in their order."""

    task: str
    returns: tuple[float, ...]
    lengths: tuple[int, ...]
    terminations: int
    """Ends of the task itself; of a continuing task, the resets that it made."""
    successes: int | None = None
    """Episodes whose last step's info had a true ``is_success``; None where no last one has it."""

    def as_dict(self) -> dict[str, Any]:
        """Mean return, reward rate, mean length, resets in 1,000 steps and successes, as JSON values."""
        steps, number = sum(self.lengths), len(self.returns)
        interval = mean_interval(self.returns, -math.inf, math.inf) if number > 1 else None
        found: dict[str, Any] = {
            "task": self.task,
            "episodes": number,
            "return": float(np.mean(self.returns)),
            "return_deviation": float(np.std(self.returns)),
            "return_interval": interval,
            "reward_rate": sum(self.returns) / steps,
            "mean_length": steps / number,
            "resets_per_1000_steps": 1000.0 * self.terminations / steps,
        }
        if self.successes is not None:
            share = share_interval(self.successes, number)
            found |= {"success_rate": self.successes / number, "success_interval": share}
        return found


@contextlib.contextmanager
def _made(env: Any, **options: Any) -> Any:
    """The environment of an id or of a function, closed in the end, or one that was passed in, which is not."""
    if isinstance(env, gymnasium.Env):
        refuse_running(env.unwrapped, one_line(env, 100))
        yield env
        return
    with errors_named_after(f"making {one_line(env, 100)}", "use a Gymnasium id, an environment or what makes one"):
        made = make_by_id(env, **options) if isinstance(env, str) else env()
    try:
        yield made
    finally:
        made.close()


def play(
    policy: Any,
    env: Any = None,
    episodes: int = EPISODES,
    seed: int = 0,
    watch: Callable[[Any], object] | None = None,
    **options: Any,
) -> Episodes:
    """Play episodes under a policy's deterministic actions; they depend on the seed alone.

    Args:
        policy: a :class:`swingup.Policy`, an :class:`swingup.AREAPO`, or anything with Stable-Baselines3's
            ``predict``.
        env: a Gymnasium id, an environment or a function that makes one; None for the policy's task.
        episodes: number of episodes, each cut after 2,000 steps.
        seed: of the first reset.
        watch: called with the environment before each step and after the last one.
        **options: of ``gymnasium.make``, for an id.

    Raises:
        SwingupError: the environment cannot be made, fails, or has other spaces than the policy.
    """
    if isinstance(own := getattr(policy, "policy", None), Policy):  # of a learner, with spaces to compare
        policy = own
    if isinstance(policy, PendulumPolicy):
        # The task's environment shows scaled angles, in another number: a policy of states would act on nonsense.
        raise SwingupError(f"a robot's policy takes states: swingup evaluate {policy.task}, or swingup.judge")
    env = policy.task if env is None and isinstance(policy, Policy) else env
    if env is None or (isinstance(env, str) and env.startswith("<")):
        raise SwingupError(f"the policy's environment {env or ''} has no id: pass it as env")
    returns, lengths, terminations, successes = [], [], 0, list[bool]()
    with _made(env, **options) as made:
        if isinstance(policy, Policy):
            check_spaces(policy, made)
        resets = _own_resets(made)
        for episode in range(whole_number("episodes", episodes, 1)):
            with errors_named_after(f"an episode of {one_line(made, 100)}"):
                observation, _ = made.reset(seed=seed if episode == 0 else None)
                total, length, ended, info = 0.0, 0, False, {}
                while not ended and length < EPISODE_STEPS:
                    if watch is not None:
                        watch(made)
                    action, _ = policy.predict(observation, deterministic=True)
                    observation, reward, terminated, truncated, info = made.step(action)
                    total, length, ended = total + float(reward), length + 1, bool(terminated or truncated)
                    terminations += bool(terminated)
                if watch is not None:
                    watch(made)
            returns.append(total)
            lengths.append(length)
            successes += [bool(info[SUCCESS])] if SUCCESS in info else []
        terminations += _own_resets(made) - resets
        found = sum(successes) if successes else None
        return Episodes(one_line(env, 100), tuple(returns), tuple(lengths), terminations, found)


def evaluate_policy(model: Any, env: Any = None, n_eval_episodes: int = EPISODES) -> tuple[float, float]:
    """Mean and standard deviation of the return of :func:`play`'s episodes, by Stable-Baselines3's name."""
    found = play(model, env, n_eval_episodes)
    return float(np.mean(found.returns)), float(np.std(found.returns))


def check_spaces(policy: Policy, env: Any) -> None:
    """Refuse an environment with other spaces than the policy's."""
    seen, shown = policy.observation_space.shape, env.observation_space.shape
    if seen != shown:
        raise SwingupError(f"the policy sees observations of shape {seen}, the environment shows {shown}")
    check_actions(policy.action_space.describe(), space_actions(env.action_space))


def _own_resets(env: Any) -> int:
    return int(env.get_wrapper_attr(OWN_RESETS)) if env.has_wrapper_attr(OWN_RESETS) else 0
