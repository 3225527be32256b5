"""Films of a run's policies side by side: of a pendulum's swing-up, or of any environment that draws itself."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..benchmark.judge import judge
from ..common.checks import whole_number
from ..common.errors import SwingupError, errors_named_after, one_line
from ..common.files import check_suffix, check_writable
from ..controllers.registry import get_controller
from ..learner.metrics import step_time
from ..learner.play import play
from ..learner.run_folder import BEST, FIRST, LAST
from ..policy.file import read_metadata
from ..policy.pendulum import PendulumPolicy
from ..policy.shipped import load_policy
from .film import FILM_FORMATS, FPS, MAX_FPS, animate, write_film

LONGEST = 500  # Frames of a film without a given number: an endless task has no end of its own
MAX_FRAMES = 5_000


def policy_files(source: str | Path) -> list[Path]:
    """The first, the best and the last policy in a run's folder, as far as they are there, or one file.

    Of several seeds the last policy is that of the seed with the best one.
    """
    path = Path(source)
    if not path.is_dir():
        return [path]
    names = [FIRST, BEST, LAST]
    if (path / BEST).is_file() and not (path / LAST).is_file():
        names[2] = LAST.replace(".", f"-{read_metadata(path / BEST).get('seed')}.")
    found = [path / name for name in names if (path / name).is_file()]
    if not found:
        raise SwingupError(f"{path} holds no policy: name a run's folder or a policy file")
    return found


def watch(
    source: str | Path, out: str | Path, env: Any = None, seed: int = 0, frames: int = LONGEST, **options: Any
) -> list[str]:
    """Write a film, ``.gif``, ``.webp`` or ``.mp4``, of one episode of each policy, side by side.

    Args:
        source: a run's folder, for its first (untrained), best and last policy, or a policy file.
        out: the film, whole or not at all.
        env: a Gymnasium id or a function that makes an environment; None for the policies' task, which is the
            benchmark's swing-up for a robot's.
        seed: of the episode.
        frames: most frames of an episode.
        **options: of ``gymnasium.make``.

    Returns:
        A line on each policy, from left to right.

    Raises:
        SwingupError: there is no policy, the environment cannot draw itself, or the film cannot be written.
    """
    check_suffix(out, FILM_FORMATS)
    check_writable(out)
    frames = whole_number("frames", frames, 1, MAX_FRAMES)
    files = policy_files(source)
    policies = [load_policy(file) for file in files]
    pendulums = [each for each in policies if isinstance(each, PendulumPolicy)]
    if env is None and len(pendulums) == len(files):
        if seed or options or frames != LONGEST:
            raise SwingupError("a robot's film is the benchmark's swing-up: leave seed, frames and options out")
        return _swing_ups(files, pendulums, out)
    lines, strips, rates = list[str](), list[list[np.ndarray]](), list[float]()
    for file, policy in zip(files, policies, strict=True):
        pictures: list[np.ndarray] = []

        def keep(made: Any, pictures: list[np.ndarray] = pictures) -> None:
            if len(pictures) < frames:
                pictures.append(_picture(made))
                seconds = step_time(made)
                rates.append(1.0 / seconds if seconds else float(made.metadata.get("render_fps", FPS)))

        found = play(policy, env, 1, seed, keep, render_mode="rgb_array", **options)
        lines.append(f"{file.name}: return {found.returns[0]:.6g} in {found.lengths[0]} steps")
        strips.append(pictures)
    # Viewers show at most 50 frames a second: of a faster task every second or third step is drawn.
    every = max(1, math.ceil(rates[0] / MAX_FPS - 1e-9))
    # The last picture of an episode stays while longer ones go on.
    rows = (
        np.concatenate([strip[min(index, len(strip) - 1)] for strip in strips], axis=1)
        for index in range(0, max(map(len, strips)), every)
    )
    write_film(out, rows, max(1.0, rates[0] / every))
    return lines


def _swing_ups(files: Sequence[Path], policies: Sequence[PendulumPolicy], out: str | Path) -> list[str]:
    """The benchmark's swing-up of each policy on its plant, with all that stands around it."""
    lines, motions = [], []
    for file, policy in zip(files, policies, strict=True):
        result = judge(get_controller(str(file), policy.robot), policy.robot, plant=policy.plant)
        if result.trajectory is None:
            raise SwingupError(f"{file} gave no torque: {result.faults[0].fault}")
        motions.append((result.trajectory, policy.robot))
        lines.append(f"{file.name}: score {result.criteria.score:.3f}")
    animate(motions, out, plant=policies[0].plant)
    return lines


def _picture(env: Any) -> np.ndarray:
    """The environment's picture (rows, columns, 3)."""
    with errors_named_after(f"render() of {one_line(env, 100)}"):
        picture = np.asarray(env.render())
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
        raise SwingupError(f"{one_line(env, 100)} draws no picture: its render_mode 'rgb_array' gives one")
    return picture
