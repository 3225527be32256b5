"""Policies of other tasks: the command ``watch``, and what ``evaluate`` does without a robot."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, TypedDict

from tyro.conf import arg

from ..common.arrays import SUFFIX
from ..common.errors import SwingupError
from ..common.files import has_suffix
from ..learner.play import Episodes, play
from ..policy.shipped import load_policy
from ..report.watch import LONGEST, watch
from .arguments import FileName, optional
from .output import foreign_prints_apart, tell, tell_json

PLAYED = 20  # Episodes of an evaluation


class EpisodeOptions(TypedDict, total=False):
    """Episodes of another task, which a policy file is for."""

    env: Annotated[str, optional("Gymnasium id, as Swimmer-v5 or your.module:Task-v0; default: the file's.")]
    episodes: Annotated[int, optional("number of episodes, each of at most 2,000 steps; default 20.")]


def play_episodes(controller: str, task: EpisodeOptions, seed: int, json: bool) -> int:
    """Play episodes of a policy file in an environment, and print what they gave."""
    if not has_suffix(controller, SUFFIX) and not Path(controller).is_dir():
        raise SwingupError(
            f"{controller} is for robots: name acrobot or pendubot, or give --controller FILE.safetensors"
        )
    policy = load_policy(controller)
    with foreign_prints_apart():
        found = play(policy, task.get("env"), task.get("episodes", PLAYED), seed)
    if json:
        tell_json({"controller": controller, "seed": seed, **found.as_dict()}, indent=1)
    else:
        tell(*episode_lines(found, controller))
    return 0


def episode_lines(found: Episodes, name: str) -> list[str]:
    """What episodes of another task gave."""
    values = found.as_dict()
    number, low_high = values["episodes"], values["return_interval"]

    def between(interval: Sequence[float] | None, form: str) -> str:
        return "" if interval is None else f"95 % interval {interval[0]:{form}} to {interval[1]:{form}}"

    rows = [
        ("Return", f"{values['return']:.6g}", between(low_high, ".6g")),
        ("Reward rate", f"{values['reward_rate']:.6g}", "of a step"),
        ("Length", f"{values['mean_length']:.6g}", "steps"),
        ("Resets", f"{values['resets_per_1000_steps']:.4g}", "in 1,000 steps, without time limits"),
    ]
    if found.successes is not None:
        rows.append(("Success", f"{found.successes} of {number}", between(values["success_interval"], ".0%")))
    lines = [f"  {title:<24}{value:>12}   {remark}".rstrip() for title, value, remark in rows]
    return [f"{name} in {found.task}, {number} episode{'s' if number > 1 else ''}", *lines]


def watch_command(
    source: Annotated[str, arg(metavar="RUN")],
    /,
    out: FileName,
    env: str | None = None,
    seed: int = 0,
    frames: int = LONGEST,
) -> None:
    """Film the first, the best and the last policy of a run side by side: .gif, .webp or .mp4.

    Args:
        source: a run's folder, or one policy file.
        out: the film's file.
        env: Gymnasium id of another environment; default: the policies' own, which draws itself (rgb_array).
        seed: seed of the episode.
        frames: most steps that are filmed.
    """
    with foreign_prints_apart():
        lines = watch(source, out, env, seed, frames)
    tell(out, *lines)
