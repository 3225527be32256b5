"""Optuna's study of a search: what it suggests, what is cut short, and the file from which a killed search goes on.

Only the process that searches opens the file. Workers train and need no Optuna.
"""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..areapo.config import Config
from ..areapo.words import format_value, parse_value
from ..common.errors import SwingupError
from ..common.text import quoted
from .space import Range, Space

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.pruners import BasePruner
    from optuna.study import Study
    from optuna.trial import FrozenTrial, Trial

STUDY_FILE, STUDY_NAME = "study.journal", "search"
"""Optuna's journal and the name of the study in it, for Optuna's own tools."""
PLACE, SETTINGS = "place", "settings"
"""User attributes: the number of a trial's folder, and what the search was begun with."""

SHOWN = 3
"""Settings of another search that a message names."""

RUNGS = 10
"""Intermediate scores of a run: one a tenth."""
UNPRUNED_TRIALS, UNPRUNED_RUNGS = 5, 2
"""Trials before any is cut short, and tenths of each run before it may be."""


def open_study(folder: Path, settings: Mapping[str, Any], pruning: bool) -> "Study":
    """The study in a folder, or a new one; the caller holds the folder's lock.

    Args:
        folder: of the search.
        settings: what the search is, as JSON values.
        pruning: whether trials that are worse than the median of the others are cut short.

    Raises:
        SwingupError: Optuna is not installed, the file is damaged, or the folder holds another search.
    """
    try:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend
    except ImportError as error:
        raise SwingupError("a search needs Optuna: pip install 'swingup[optuna]'") from error
    path = folder.absolute() / STUDY_FILE
    pruner: BasePruner = optuna.pruners.NopPruner()
    if pruning:
        pruner = optuna.pruners.MedianPruner(UNPRUNED_TRIALS, UNPRUNED_RUNGS)
    try:
        _clear_after_kill(path)
        with _quiet():
            storage = JournalStorage(JournalFileBackend(str(path)))
            study = optuna.create_study(
                storage=storage, study_name=STUDY_NAME, direction="maximize", pruner=pruner, load_if_exists=True
            )
    # Optuna replays the file, and does not check what a line holds.
    except (OSError, ValueError, KeyError, TypeError, AssertionError, AttributeError) as error:
        raise SwingupError(f"cannot read {path}: restore it, or choose another --out") from error
    known = study.user_attrs.get(SETTINGS)
    if known is None:
        study.set_user_attr(SETTINGS, dict(settings))
    elif known != settings:
        raise SwingupError(
            f"{folder} holds a search with other settings ({_differences(known, settings)}): choose another --out"
        )
    return study


def begin_again(study: "Study") -> None:
    """Queue the trials that were cut off, with their hyperparameters and folders."""
    from optuna.trial import TrialState

    queued = {place_of(trial) for trial in study.get_trials(states=[TrialState.WAITING])}
    for trial in study.get_trials(states=[TrialState.RUNNING]):
        # Queued before it ends: killed between the two, the next start finds it queued.
        if place_of(trial) not in queued:
            study.enqueue_trial(trial.params, {PLACE: place_of(trial)})
        study.tell(trial.number, state=TrialState.FAIL)


def next_trial(study: "Study", space: Space, seed: int) -> "Trial":
    """A queued trial, or a new one that the Tree-structured Parzen estimator suggests."""
    from optuna.samplers import TPESampler

    place = max(latest_trials(study), default=-1) + 1
    # From the place, too: a search that goes on must not draw the first values again.
    source = np.random.SeedSequence([seed, place])
    study.sampler = TPESampler(seed=int(source.generate_state(1)[0]))
    trial = study.ask({name: distribution(name, values) for name, values in space.items()})
    if PLACE not in trial.user_attrs:
        trial.set_user_attr(PLACE, place)
    return trial


def place_of(trial: "FrozenTrial | Trial") -> int:
    """The number of a trial's folder, which it has in common with the trial that it goes on with."""
    # Killed before it had one, a trial has its own number, which no folder has: there are more trials than folders.
    return int(trial.user_attrs.get(PLACE, trial.number))


def latest_trials(study: "Study") -> dict[int, "FrozenTrial"]:
    """The last trial of each folder, by the folder's number."""
    return {place_of(trial): trial for trial in study.get_trials(deepcopy=False)}


def distribution(name: str, values: Range | Sequence[Any]) -> "BaseDistribution":
    """Optuna's form of a range or of alternatives, which it stores as text."""
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if not isinstance(values, Range):
        return CategoricalDistribution(tuple(dict.fromkeys(map(format_value, values))))
    if isinstance(getattr(Config(), name), int):
        return IntDistribution(int(values.low), int(values.high), log=values.log)
    return FloatDistribution(float(values.low), float(values.high), log=values.log)


def chosen_values(params: Mapping[str, Any]) -> dict[str, Any]:
    """Settings from a trial's parameters, in which alternatives are text."""
    return {
        name: parse_value(name, value) if isinstance(value, str) and name != "preset" else value
        for name, value in params.items()
    }


def _differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """What differs between two searches, with both values."""
    one, other = _flat(there), _flat(here)
    names = [name for name in dict.fromkeys([*other, *one]) if one.get(name) != other.get(name)]
    words = [f"{name} {quoted(one.get(name))} there, {quoted(other.get(name))} here" for name in names[:SHOWN]]
    more = [f"and {len(names) - SHOWN} more"] if len(names) > SHOWN else []
    return "; ".join(words + more)


def _flat(values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested values by name; those that vary as ``set NAME``."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if not isinstance(value, Mapping):
            flat[name] = value
            continue
        # Hyperparameters are known by their names alone.
        prefix = "" if name in (SETTINGS, "config") else f"{name} "
        flat |= {prefix + each: one for each, one in _flat(value).items()}
    return flat


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without Optuna's line about a new study."""
    from optuna import logging

    before = logging.get_verbosity()
    logging.set_verbosity(logging.WARNING)
    try:
        yield
    finally:
        logging.set_verbosity(before)


def _clear_after_kill(path: Path) -> None:
    """Remove what a killed process left: Optuna's lock, for which the next one would wait, and half a line."""
    Path(f"{path}.lock").unlink(missing_ok=True)
    if path.exists() and (content := path.read_bytes()) and not content.endswith(b"\n"):
        with path.open("rb+") as file:
            file.truncate(content.rfind(b"\n") + 1)
