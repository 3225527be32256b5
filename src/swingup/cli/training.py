"""The command ``train``: from its options to a run before the user's eyes, and the score of the best policy."""

import contextlib
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
from ..learner.card import measured
from ..learner.compiled_backend import share_cores
from ..learner.metrics import METRICS_FILE, REWARD_RATE, describe_rates, read_metrics, shown_rate, training_resets
from ..learner.presets import CONTINUING_PRESET, ENV_PRESET, PENDULUM_PRESET, PRESETS, get_preset
from ..learner.problem import INTERVALS, RobotProblem
from ..learner.progress import TrainingReport
from ..learner.run import Run, resume_run, start_run
from ..learner.run_folder import BEST
from ..learner.run_settings import make_run_settings, read_run_settings
from ..policy.file import read_metadata
from .arguments import NO_OPTIONS, PlantOptions, RobotName, facts_of, optional, task_name, value_of
from .output import Progress, program_typed, tell, tell_table
from .results import judged_name, plant_note, result_lines


def _defaults_by_task(name: str) -> str:
    """The default of an interval, as ``default 5; robot 1``."""
    usual, *others = ((task, getattr(each, name)) for task, each in INTERVALS.items())
    differing = [f"{task} {value}" for task, value in others if value != usual[1]]
    return "; ".join([f"default {usual[1]}", *differing])


class RunOptions(TypedDict, total=False):
    """What is trained, and how often it is evaluated."""

    env: Annotated[str, optional("Gymnasium id of another task, as Swimmer-v5 or your.module:Task-v0.")]
    resets: Annotated[str, optional("never: one stream, which is reset once in its life.", "never")]
    preset: Annotated[str, optional(f"named settings: {', '.join(PRESETS)}; default: those of the task.", "NAME")]
    evaluate_every: Annotated[int, optional(f"frames between evaluations; {_defaults_by_task('evaluate_every')}.")]
    checkpoint_every: Annotated[
        int, optional(f"frames between checkpoints; {_defaults_by_task('checkpoint_every')}.")
    ]
    evaluation_episodes: Annotated[
        int,
        optional(
            f"episodes of an evaluation; {_defaults_by_task('evaluation_episodes')}. "
            "0: training episodes give the score."
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

    The folder holds config.json, metrics.jsonl, tensorboard/, checkpoints/, and the policies first.safetensors
    (untrained), best.safetensors and last.safetensors.

    Args:
        robot: acrobot or pendubot.
        frames: frames to train each seed for; default: the preset's.
        seed: the first seed; default 0.
        seeds: how many seeds to train side by side; default: the preset's, 1 or for fast 2.
        out: folder of the run, new or empty; default runs/NAME-PRESET-SEED, where NAME is the robot or the
            environment's id.
        resume: folder of a run to continue from its last checkpoint, bit for bit.
        run: what is trained, and how often it is evaluated.
        plant: the pendulum to train on, in whose units the task is.
        hyperparameters: those that are left out are the preset's. In brackets: the value in the preset pendulum,
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
    share_cores(settings.seeds)
    length = get_preset(settings.preset).frames if frames is None else frames
    return start_run(settings, out or f"runs/{settings.folder_name}", length)


def train_shown(run: Run, note: Callable[[TrainingReport], str] = lambda report: "") -> int:
    """Train to the goal, with the progress and notes among its figures, and free the environments.

    The exit status is 0, or that of the signal that stopped the run; then it is saved.
    """
    settings = run.settings
    plant = settings.problem.record.get("plant")
    on = settings.preset + ("" if plant is None else plant_note(plant, settings.problem.name))
    with Progress() as progress:
        progress.log(f"training {settings.problem.name} ({on}) to {run.goal:,} frames in {run.folder}")
        progress.log("compiling")
        run.compile()  # first, so that the estimate of the time left does not contain it
        progress("frames", run.frames, run.goal)
        if settings.problem.stream:
            progress.log(f"an update takes {run.backend.pause:.2f} s, in which nobody acts")
        ended: bool | None = None
        with _stopped_by_signals(run) as received:
            for report in run.advance():
                progress("frames", report.frames, run.goal, figures(report, note(report)))
                ended = ended or any(row.training.ended for row in report.rows)
        run.close()
        if ended is False and not received and settings.preset == ENV_PRESET:
            progress.log(
                f"no episode ended: where the task goes on for ever, --preset {CONTINUING_PRESET} is for it"
            )
        if not received:
            return 0
        command = f"{program_typed()} train --resume {shlex.quote(str(run.folder))}"
        progress.log(f"stopped at {run.frames:,} frames and saved: continue with {command}")
    # The status that shells give a program ended by this signal.
    return 128 + received[0]


def figures(report: TrainingReport, note: str) -> str:
    """The figures of a report, the important ones first, since a narrow terminal cuts the end.

    Score, reward and resets are those of the seed that is best now, resets per 1,000 steps where there were some.
    """
    row = report.best
    parts = [
        "" if report.best_score is None else f"best {report.best_score:.3f}",
        note,
        "score –" if row.score is None else f"score {row.score:.3f}",
        f"reward {row.reward:.3f}",
        f"resets {row.resets_per_1000_steps:.3g}/1k" if row.resets_per_1000_steps else "",
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
    known = vars(saved) | vars(saved.config) | saved.problem.record
    for name, value in given.items():
        if value not in (None, known.get(name)):
            raise SwingupError(
                f"{folder} was trained with {name} = {known.get(name)}, not {value}: resume it without "
                f"that option, or train anew with another --out"
            )
    share_cores(saved.seeds)
    return resume_run(folder, frames)


def _score(run: Run) -> int:
    """Print the score of the best policy; judge that of a robot."""
    problem, file = run.settings.problem, run.folder / BEST
    if problem.continuing:
        _show_rates(run)
    if isinstance(problem, RobotProblem):
        controller = get_controller(str(file), problem.name)
        result = judge(controller, problem.name, name=str(file), plant=problem.plant)
        tell(*result_lines(result, judged_name(str(file), controller)))
    else:
        print(f"best score {shown_rate(run.best_score)}, policy {file}")
        print(describe_rates(measured(read_metadata(file))[2]))
    return 0


def _show_rates(run: Run) -> None:
    """Show the rates of a continuing task in each tenth of the run: of training, and of the policy at its end.

    Of several seeds they are those of the best one, which is named.
    """
    seed, lines = run.settings.seed + run.progress.best_seed, []
    heads = ["frames", "reward rate", "resets per 1,000 steps", "deterministic rate"]
    columns = heads if run.settings.evaluation_episodes else heads[:-1]
    rows = [row for row in read_metrics(run.folder / METRICS_FILE) if row["seed"] == seed]
    for part in filter(len, np.array_split(np.array(rows, object), 10)):
        rate = float(np.mean([row["reward"] for row in part]))
        resets = float(np.mean([training_resets(row) or 0.0 for row in part]))
        line = [f"{part[-1]['frames']:,}", *map(shown_rate, (rate, resets, part[-1][REWARD_RATE]))]
        lines.append(line[: len(columns)])
    if run.settings.seeds > 1:
        tell(f"seed {seed}, the best of {run.settings.seeds}")
    tell_table(columns, lines)
