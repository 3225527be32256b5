"""The command ``train``: from its options to a run before the user's eyes, and the score of the best policy."""

import contextlib
import math
import shlex
import signal
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

import numpy as np
from tyro.conf import arg
from tyro.constructors import MISSING, ConstructorRegistry, StructTypeInfo

from ..areapo.config import Config, format_value, is_pair, parse_value
from ..benchmark.judge import judge
from ..common.errors import SwingupError
from ..controllers.registry import get_controller
from ..learner.compiled_backend import share_cores
from ..learner.metrics import METRICS_FILE, REWARD_RATE, describe_rates, read_metrics, shown_rate, training_resets
from ..learner.presets import PENDULUM_PRESET, PRESETS, get_preset
from ..learner.progress import TrainingReport
from ..learner.run import Run, resume_run, start_run
from ..learner.run_folder import BEST, LAST, result_on_disk
from ..learner.run_settings import is_continuing, make_run_settings, read_run_settings
from .arguments import NO_OPTIONS, PlantOptions, RobotName, facts_of, optional, task_name, value_of
from .output import Progress, program_typed, tell, tell_table
from .results import judged_name, plant_note, result_lines


class RunOptions(TypedDict, total=False):
    """What is trained, and how often it is evaluated."""

    env: Annotated[str, optional("Gymnasium id of another task, as Swimmer-v5 or your.module:Task-v0.")]
    preset: Annotated[str, optional(f"named settings: {', '.join(PRESETS)}; default: those of the task.", "NAME")]
    evaluate_every: Annotated[int, optional("frames between evaluations and metrics; default 65536.")]
    checkpoint_every: Annotated[int, optional("frames between checkpoints; default 1048576, or 262144 with --env.")]
    evaluation_episodes: Annotated[
        int,
        optional(
            "episodes of an evaluation with --env; default 5, or 1 with a continuing task. "
            "0: training gives the score."
        ),
    ]


def _defaults(name: str) -> str:
    """The value of a hyperparameter in every preset, as ``2.0; global: 0.4; ppo: 0.0`` or ``0.8 0.6``."""
    by_value: dict[str, list[str]] = {}
    for preset, each in PRESETS.items():
        by_value.setdefault(format_value(getattr(each.config, name), " "), []).append(preset)
    usual = format_value(getattr(PRESETS[PENDULUM_PRESET].config, name), " ")
    others = [f"{', '.join(presets)}: {value}" for value, presets in by_value.items() if value != usual]
    return "; ".join([usual, *others])


def _annotation(name: str, text: str) -> Any:
    """Type, help and parser of a hyperparameter's option."""
    option = arg(help=" ".join(text.split()), help_behavior_hint=f"({_defaults(name)})")
    default = getattr(Config, name)
    if isinstance(default, bool):
        return Annotated[bool, option]
    kinds = {int: "INT", float: "FLOAT", tuple: "INT..."}
    metavar = "FLOAT FLOAT" if is_pair(name) else kinds.get(type(default), "WORD")
    words = "*" if isinstance(default, tuple) else 1
    return Annotated[Any, option, value_of(lambda *typed: parse_value(name, " ".join(typed)), metavar, words)]


# Type checkers cannot follow fields that are computed.
if TYPE_CHECKING:
    HyperparameterOptions = dict[str, Any]
else:
    # Tyro reads the strings under the fields, and leaves out what was not given.
    _described = ConstructorRegistry.get_struct_spec(StructTypeInfo.make(Config, MISSING, in_union_context=False))
    _fields = {field.name: _annotation(field.name, field.helptext()) for field in _described.fields}
    HyperparameterOptions = TypedDict("HyperparameterOptions", _fields, total=False)


def train_command(
    robot: RobotName | None = None,
    /,
    frames: int | None = None,
    seed: int | None = None,
    seeds: int | None = None,
    out: str | None = None,
    resume: str | None = None,
    run: RunOptions = NO_OPTIONS,
    plant: PlantOptions = NO_OPTIONS,
    hyperparameters: HyperparameterOptions = NO_OPTIONS,
) -> int:
    """Train a policy, show the progress, and end with the score of the best one.

    The folder holds config.json, metrics.jsonl, tensorboard/, checkpoints/, best.safetensors and last.safetensors.

    Args:
        robot: acrobot or pendubot.
        frames: frames to train each seed for; default: the preset's.
        seed: the first seed; default 0.
        seeds: how many seeds to train side by side; default: the preset's, 1 or for fast 2.
        out: folder of the run, new or empty; default runs/ROBOT-PRESET-SEED, or the id's name for the robot's.
        resume: folder of a run to continue from its last checkpoint, bit for bit.
        run: what is trained, and how often it is evaluated.
        plant: the pendulum to train on, in whose units the task is.
        hyperparameters: those that are left out are the preset's. In brackets: the value in the preset default,
            then in presets that differ.
    """
    given: dict[str, Any] = {"seed": seed, "seeds": seeds, "plant": facts_of(plant), **run}
    if resume is None:
        env = task_name(robot, given.pop("env", None))
        started = start_training(env, frames, out, hyperparameters, **given)
    else:
        if out is not None:
            raise SwingupError(f"--out {out} does not go with --resume {resume}: a run stays in its folder")
        started = _resume(Path(resume), frames, {"robot": robot and robot.name, **given, **hyperparameters})
    return train_shown(started) or _score(started)


def start_training(
    env: str, frames: int | None, out: str | None, changes: Mapping[str, Any] | None = None, **given: Any
) -> Run:
    """A new run of changed hyperparameters and given settings, with the defaults for what is None or left out."""
    settings = make_run_settings(env, changes=changes, **given)
    # Ids of Gymnasium may contain signs that a folder's name cannot.
    name = settings.name.replace("/", "-").replace(":", "-")
    folder = out or f"runs/{name}-{settings.preset}-{settings.seed}"
    share_cores(settings.seeds)
    return start_run(settings, folder, get_preset(settings.preset).frames if frames is None else frames)


def train_shown(run: Run, note: Callable[[TrainingReport], str] = lambda report: "") -> int:
    """Train to the goal, with the progress and notes among its figures, and free the environments.

    The exit status is 0, or that of the signal that stopped the run; then it is saved.
    """
    settings = run.settings
    on = settings.preset + ("" if settings.robot is None else plant_note(settings.plant, settings.robot))
    with Progress() as progress:
        progress.log(f"training {settings.name} ({on}) to {run.goal:,} frames in {run.folder}")
        progress.log("compiling")
        run.compile()  # first, so that the estimate of the time left does not contain it
        progress("frames", run.frames, run.goal)
        with _stopped_by_signals(run) as received:
            for report in run.advance():
                progress("frames", report.frames, run.goal, figures(report, note(report)))
        run.close()
        if not received:
            return 0
        command = f"{program_typed()} train --resume {shlex.quote(str(run.folder))}"
        progress.log(f"stopped at {run.frames:,} frames and saved: continue with {command}")
    # The status that shells give a program ended by this signal.
    return 128 + received[0]


def figures(report: TrainingReport, note: str) -> str:
    """What a report says, the most wanted first, since a narrow terminal cuts the end.

    Scores, rewards and resets are means over the seeds; resets are those per 1,000 steps, where there were some.
    """

    def mean(name: str) -> float:
        values = [math.nan if row[name] is None else row[name] for row in report.rows]
        return sum(values) / len(values)

    resets = [number for row in report.rows if (number := training_resets(row)) is not None]
    parts = [
        "" if report.best_score is None else f"best {report.best_score:.3f}",
        note,
        f"score {mean('score'):.3f}",
        f"reward {mean('reward'):.3f}",
        f"resets {sum(resets) / len(resets):.3g}/1k" if any(resets) else "",
        f"{report.frames_per_second / 1000:.3g}k/s",
    ]
    return "  ".join(filter(None, parts))


@contextlib.contextmanager
def _stopped_by_signals(run: Run) -> Iterator[list[int]]:
    """Ctrl-C and SIGTERM end the run after its iteration; a second one ends the program at once."""
    received: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        received.append(number)
        signal.signal(number, signal.SIG_DFL)
        run.stop()

    former = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    watched = signal.set_wakeup_fd(-1)  # the run is saved, however long its iteration takes
    try:
        yield received
    finally:
        signal.set_wakeup_fd(watched)
        for number, handler in former.items():
            signal.signal(number, handler)


def _resume(folder: Path, frames: int | None, given: dict[str, Any]) -> Run:
    """Continue a run, unless an option contradicts its settings."""
    saved, _ = read_run_settings(folder)
    known = vars(saved) | vars(saved.config)
    for name, value in given.items():
        if value not in (None, known[name]):
            raise SwingupError(
                f"{folder} was trained with {name} = {known[name]}, not {value}: resume it without "
                f"that option, or train anew with another --out"
            )
    share_cores(saved.seeds)
    return resume_run(folder, frames)


def _score(run: Run) -> int:
    """Print the score of the best policy; judge that of a robot."""
    settings, file = run.settings, run.folder / BEST
    if is_continuing(settings.name):
        _show_rates(run)
    if settings.robot is None:
        file = file if file.exists() else run.folder / LAST
        print(f"best score {shown_rate(run.best_score)}, policy {file}")
        print(describe_rates(result_on_disk(file, run.backend.evaluator.measure)))
    else:
        controller = get_controller(str(file), settings.robot)
        result = judge(controller, settings.robot, name=str(file), plant=settings.plant)
        tell(*result_lines(result, judged_name(str(file), controller)))
    return 0


def _show_rates(run: Run) -> None:
    """Show a continuing task's rates in each tenth of the run: while training, and of the policy at its end."""
    rows = [row for row in read_metrics(run.folder / METRICS_FILE) if row["seed"] == run.settings.seed]
    lines = []
    for part in filter(len, np.array_split(np.array(rows, object), 10)):
        rate = float(np.mean([row["reward"] for row in part]))
        resets = float(np.mean([training_resets(row) or 0.0 for row in part]))
        lines.append([f"{part[-1]['frames']:,}", *map(shown_rate, (rate, resets, part[-1][REWARD_RATE]))])
    tell_table(["frames", "reward rate", "resets per 1,000 steps", "deterministic rate"], lines)
