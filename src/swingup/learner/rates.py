"""How a continuing task is reported: its reward rate, and its resets per 1,000 steps.

The reward rate is the mean reward of a step, as measured. The gain ρ is the learner's estimate of it for the
exploring policy, less what its resets cost. A reset is a termination of the task itself. A truncation is not a
reset: the process would continue, and only the caller starts it anew.
"""

import contextlib
import math
from collections.abc import Mapping
from typing import Any

from ..common.checks import is_number

REWARD_RATE, REWARD_PER_SECOND = "reward_rate", "reward_per_second"
RESETS = "resets_per_1000_steps"

MISSING = "–"
"""Shown where a number was not recorded."""


def step_time(*timed: Any) -> float | None:
    """Seconds of one step: the ``dt`` of the first environment, task or its parameters that has it; None if none.

    Gymnasium's MuJoCo tasks have it, and so have its Pendulum and Acrobot. Wrappers are asked first: one that
    repeats actions can have a ``dt`` of its own.
    """
    for env in timed:
        # A figure for reports must not end a training, whatever a foreign property raises.
        with contextlib.suppress(Exception):
            find = getattr(env, "get_wrapper_attr", None)
            seconds = float(find("dt") if callable(find) else env.dt)
            if math.isfinite(seconds) and seconds > 0.0:
                return seconds
    return None


def rates(reward: float, termination_rate: float, step_time: float | None = None) -> dict[str, float]:
    """The entries of an evaluation's result; a task without time has no seconds of a step."""
    timed = {} if step_time is None else {REWARD_PER_SECOND: reward / step_time}
    return {REWARD_RATE: reward, **timed, RESETS: 1000.0 * termination_rate}


def training_resets(row: Mapping[str, Any]) -> float | None:
    """Resets per 1,000 steps of training in a row of metrics; None in rows of a version that did not count them."""
    rate: Any = row.get("termination_rate")
    return 1000.0 * float(rate) if is_number(rate) else None


def describe_rates(result: Mapping[str, Any]) -> str:
    """Both rates of an evaluation's result in words, with a dash for what it lacks."""
    per_second = result.get(REWARD_PER_SECOND)
    timed = f" ({shown_rate(per_second)} per second)" if is_number(per_second) else ""
    rate, resets = shown_rate(result.get(REWARD_RATE)), shown_rate(result.get(RESETS))
    return f"reward rate {rate} per step{timed}, resets per 1,000 steps {resets}"


def shown_rate(value: Any) -> str:
    """A number in four digits; a dash for anything else."""
    return f"{value:.4g}" if is_number(value) else MISSING
