"""Checks of what users give, before anything is traced or written: each returns plain Python, or refuses."""

import difflib
import math
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any

from .errors import SwingupError, quoted

LARGEST_NUMBER = 1e9  # no quantity in SI units comes near this; squares of larger numbers might overflow
MAXIMUM_SEED = 2**31 - 1  # noise keys hold a seed in 32 bits
MAXIMUM_SEEDS = 9999  # upper limit on seeds, to catch typing errors

OTHER_NAMES = {
    "n_envs": "num_envs",
    "n_steps": "num_steps",
    "n_epochs": "num_epochs",
    "update_epochs": "num_epochs",
    "num_minibatches": "batch_size",
    "lr": "learning_rate",
    "gamma": "discount",
    "ent_coef": "temperature",
    "vf_coef": "value_coefficient",
    "clip_coef": "clip_range",
    "clip_eps": "clip_range",
    "net_arch": "policy_layers and value_layers",
    "policy_kwargs": "policy_layers and value_layers",
    "agent_kwargs": "policy_layers, value_layers and activation",
    "anneal_lr": "schedule='anneal' and schedule_frames",
    "eval_freq": "evaluate_every",
    "save_freq": "checkpoint_every",
    "n_eval_episodes": "evaluation_episodes",
    "total_timesteps": "an argument of learn, and --frames on the command line",
}
"""Names that Stable-Baselines3, CleanRL and rejax give to hyperparameters, and ours.

A name is not taken for ours, since most of them mean something slightly different: an error says what to write, and
``docs/coming-from.md`` what differs.
"""
ADVICE = {
    "policy": "The networks are those of policy_layers and value_layers",
    "normalize_advantage": "Advantages are always normalised",
    "norm_adv": "Advantages are always normalised",
    "clip_range_vf": "The critic's loss is not clipped",
    "clip_vloss": "The critic's loss is not clipped",
    "use_sde": "The noise is drawn anew at every step",
    "verbose": "progress_bar=True, or a callback that prints, is an argument of learn",
    "device": "JAX takes a GPU where it is installed for one; JAX_PLATFORMS=cpu keeps it on the CPU",
    "tensorboard_log": "folder='runs/mine' gets TensorBoard's events, metrics and policies",
}
"""What to do in place of other arguments of Stable-Baselines3's."""


def is_number(value: Any) -> bool:
    """Whether a value is a finite real number; a truth value is not."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond floating point
        return False


def finite_number(
    name: str, value: Any, minimum: float = -LARGEST_NUMBER, maximum: float = LARGEST_NUMBER, unit: str = ""
) -> float:
    """A finite number from ``minimum`` to ``maximum``."""
    if not is_number(value) or not minimum <= value <= maximum:
        raise SwingupError(
            f"{name} = {quoted(value)}: use a number from {minimum:g} to {maximum:g}{unit and ' '}{unit}"
        )
    return float(value)


def positive_number(name: str, value: Any, maximum: float = LARGEST_NUMBER, unit: str = "") -> float:
    """A finite number above 0, at most ``maximum``."""
    if not is_number(value) or not 0 < value <= maximum:
        raise SwingupError(f"{name} = {quoted(value)}: use a positive number up to {maximum:g}{unit and ' '}{unit}")
    return float(value)


def whole_number(name: str, value: Any, minimum: int, maximum: int | None = None) -> int:
    """A whole number from ``minimum`` to ``maximum``; 3.0 counts as 3."""
    if not is_number(value) or (not isinstance(value, Integral) and value % 1 != 0):
        raise SwingupError(f"{name} = {quoted(value)}: use a whole number")
    if value < minimum or (maximum is not None and value > maximum):
        bounds = f"of at least {minimum}" if maximum is None else f"from {minimum} to {maximum}"
        raise SwingupError(f"{name} = {quoted(value)}: use a whole number {bounds}")
    return int(value)


def check_seeds(seed: int, seeds: int) -> range:
    """The seeds in a row that start with ``seed``."""
    first = whole_number("seed", seed, 0, MAXIMUM_SEED)
    return range(first, first + whole_number("seeds", seeds, 1, MAXIMUM_SEEDS))


def one_of(kind: str, value: Any, choices: Iterable[str], more: str = "") -> str:
    """One of several names; a misspelt one gets a suggestion.

    ``kind`` is what the names are of, as in "unknown KIND"; ``more`` is what else would do, for the message.
    """
    names = list(choices)
    if isinstance(value, str) and value in names:
        return value
    known = ", ".join(names)
    raise SwingupError(f"unknown {kind} {quoted(value)}: use one of {known}{more}{suggestion(value, names)}")


def suggestion(value: Any, choices: Iterable[str]) -> str:
    """The end of a message that suggests the nearest name; empty if none is near."""
    near = difflib.get_close_matches(value, list(choices), 1) if isinstance(value, str) else []
    return f"; did you mean {near[0]}?" if near else ""


def swingup_name(name: object) -> str:
    """The end of a message about an unknown name: our name for it; empty if we have none."""
    if isinstance(name, str) and name in ADVICE:
        return f", which is left out here. {ADVICE[name]}"
    ours = OTHER_NAMES.get(name) if isinstance(name, str) else None
    return f": here it is {ours}" if ours else ""
