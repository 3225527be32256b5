"""The algorithm's hyperparameters; the strings under the fields are the command line's help.

Fields marked static fix shapes and are compiled in; the others are leaves of the pytree, so that learning rates or
temperatures can be batched with ``vmap``. Defaults are Table I of the paper, to the letter.
"""

import dataclasses
import itertools
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any, Literal, get_args

import equinox as eqx
import jax
import numpy as np

from ..common.checks import finite_number, one_of, suggestion, whole_number
from ..common.errors import SwingupError
from ..common.other_names import our_name
from ..common.text import quoted
from ..policy.network import Activation

TINY, HUGE = 1e-12, 1e12
LARGEST_COUNT = 2**31 - 1
"""Frames and units are indexed in 32 bits."""
NO_SCHEDULE: tuple[float, ...] = ()
"""The default of all schedules, which tells them from layers."""

Terminations = Literal["auto", "end", "reset_cost", "bootstrap"]
AUTO = "auto"


def _number(default: float, least: float, most: float) -> Any:
    """A real number, a leaf of the pytree, and its range; traced values are not checked."""
    return eqx.field(default=default, metadata={"range": (least, most)})


def _static(default: Any) -> Any:
    """A value that is compiled in."""
    return eqx.field(static=True, default=default)


def _schedule() -> Any:
    """Pairs of numbers that are compiled in, without any by default."""
    return eqx.field(static=True, default=NO_SCHEDULE, metadata={"schedule": True})


def _word(default: str | bool, words: tuple[str, ...]) -> Any:
    """One of some words, which is compiled in; also True or False if the default is."""
    return eqx.field(static=True, default=default, metadata={"words": words})


def _count(default: int) -> Any:
    """A whole number of at least 1 that is compiled in."""
    return eqx.field(static=True, default=default, metadata={"range": (1, LARGEST_COUNT)})


class Config(eqx.Module):
    """Hyperparameters of AR-EAPO (paper, Table I) and of its relatives."""

    num_envs: int = _count(64)
    """Environments side by side."""
    num_steps: int = _count(128)
    """Steps of each environment in a rollout."""
    num_epochs: int = _count(6)
    """Passes over a rollout."""
    batch_size: int = _count(1024)
    """Frames in a minibatch."""
    policy_layers: tuple[int, ...] = _static((256, 256))
    """Widths of the policy's hidden layers."""
    value_layers: tuple[int, ...] = _static((512, 512))
    """Widths of the hidden layers that both value heads share."""
    activation: Activation = _word("relu", get_args(Activation))
    """Activation of all hidden layers: relu, tanh, elu, silu or gelu. C, ONNX and pages run relu alone."""
    layer_norm: bool = _static(False)
    """Whether each hidden layer normalises its features before the activation (arXiv 1607.06450)."""
    shared_trunk: bool = _static(False)
    """Whether the value heads read the policy's hidden layers; value_layers then has no effect."""
    gru_width: int = eqx.field(static=True, default=0, metadata={"range": (0, LARGEST_COUNT)})
    """Numbers that a recurrent layer (GRU) after the hidden layers remembers; 0: none. It needs shared_trunk, and a
    batch_size that is a multiple of num_steps."""
    state_dependent_std: bool = _static(True)
    """Whether the standard deviation of continuous actions depends on the state, as in the paper. Without it each
    action has one that learns, as in Stable-Baselines3 and CleanRL. Discrete actions have none."""
    average_reward: bool = _static(True)
    """Subtract the gains (average reward); without it, the discounts below 1 bound the values."""
    gain_trace: bool = _static(True)
    """Divide the gains' step by its trace, which removes the bias of their start at 0 (authors' code). Not with a λ
    near 1: λ-advantages scale the step by about 1 / (1 - λ), and the first estimates overshoot more and more."""
    centre_values: bool = _static(False)
    """Fix the values' free constant: after each rollout, subtract their mean from the heads' biases."""
    normalise_rewards: bool = _static(False)
    """Divide rewards by their running standard deviation, the cost of a reset included. The temperature is then in
    units of it; metrics and gains stay in the task's."""
    normalise_advantages: bool = _static(True)
    """Normalise the soft advantages in each minibatch."""
    terminations: Terminations = _word("auto", get_args(Terminations))
    """The meaning of a termination. end: nothing follows, the value beyond is 0; reset_cost: a new start, at a cost
    (ATRPO, arXiv 2106.07329); bootstrap: the value of the last state, as at a time limit; auto: reset_cost with
    average reward, end without."""
    popart: bool = _static(False)
    """Learn the values on a normalised scale that follows the returns (PopArt)."""
    temperature: float = _number(2.0, 0.0, HUGE)
    """Temperature τ of the entropy reward -τ log π."""
    discount: float = _number(1.0, 0.0, 1.0)
    """Discount γ of the reward objective."""
    entropy_discount: float = _number(1.0, 0.0, 1.0)
    """Discount γ_H of the entropy objective."""
    gae_lambda: float = _number(0.8, 0.0, 1.0)
    """λ of the reward advantages."""
    entropy_gae_lambda: float = _number(0.6, 0.0, 1.0)
    """λ_e of the entropy advantages."""
    gain_step_size: float = _number(0.01, TINY, 1.0)
    """Step size η of both gains."""
    clip_range: float = _number(0.05, TINY, 1.0)
    """ε of the clipped surrogate."""
    learning_rate: float = _number(5e-4, 0.0, HUGE)
    """Adam's step size."""
    adam_epsilon: float = _number(1e-5, TINY, HUGE)
    """Adam's ε."""
    max_grad_norm: float = _number(10.0, TINY, HUGE)
    """Joint norm to which the gradients are clipped."""
    target_kl: float = eqx.field(static=True, default=0.0, metadata={"range": (0.0, HUGE)})
    """The steps on a rollout end before a minibatch whose KL divergence from the policy that collected it is above
    this; 0: they never end early."""
    value_coefficient: float = _number(0.25, 0.0, HUGE)
    """Weight of the value loss."""
    entropy_value_coefficient: float = _number(0.5, 0.0, HUGE)
    """c2: weight of the entropy value's loss within the value loss."""
    schedule_frames: int = eqx.field(static=True, default=0, metadata={"range": (0, LARGEST_COUNT)})
    """Frames of a seed over which the schedules run; 0: nothing changes."""
    schedule_repeats: bool = _static(False)
    """Whether the schedules begin anew after these frames (warm restarts, arXiv 1608.03983) or stay as they end."""
    learning_rate_schedule: tuple[float, ...] = _schedule()
    """Pairs of a part of schedule_frames and a factor on the learning rate, as 0.5 1 1 0.1: linear between them."""
    clip_range_schedule: tuple[float, ...] = _schedule()
    """Likewise for the clip range."""
    temperature_schedule: tuple[float, ...] = _schedule()
    """Likewise for the temperature."""
    log_std_init: float = _number(-1.0, -20.0, 2.0)
    """Logarithm of the policy's initial standard deviation (before tanh)."""
    observation_clip: float = _number(10.0, TINY, HUGE)
    """Normalised observations are clipped to ± this."""
    reset_cost: float = _number(10.0, 0.0, HUGE)
    """Subtracted from the reward where a task terminates, with terminations = reset_cost (10 in arXiv 2501.06937's
    continuing MuJoCo tasks). The first value where it adapts."""
    relative_reset_cost: bool = _static(False)
    """Whether the reset cost and its step are numbers of steps: a reset then costs what so many earn at present,
    and nothing where their mean is negative. A discount γ has such a cost, of 1 / (1 - γ) steps."""
    adaptive_reset_cost: bool | Literal["auto"] = _word(False, (AUTO,))
    """Whether the reset cost rises while terminations exceed their target, and falls otherwise (after RVI-SAC).
    auto: wherever a termination costs something, and nowhere else."""
    termination_target: float = _number(1e-3, TINY, 1.0)
    """Terminations a step that the adaptive reset cost permits (1e-3 in RVI-SAC, arXiv 2408.01972)."""
    reset_cost_step: float = _number(0.1, 0.0, HUGE)
    """The most by which a rollout changes the adaptive reset cost, in the units of reset_cost."""
    popart_step_size: float = _number(0.1, TINY, 1.0)
    """Weight of a rollout's returns in PopArt's running moments."""

    def __check_init__(self) -> None:
        """Refuse what cannot work, before anything is traced."""
        for field in dataclasses.fields(self):
            _check_field(field, getattr(self, field.name))
        # An epoch is reshaped into minibatches, which leaves no room for a remainder.
        if self.rollout_size % self.batch_size:
            raise SwingupError(
                f"batch_size = {self.batch_size} does not divide a rollout of num_envs x num_steps = "
                f"{self.num_envs} x {self.num_steps} = {self.rollout_size} frames: choose a divisor"
            )
        if self.average_reward and self.terminations == "end":
            raise SwingupError(
                "terminations = 'end' does not go with average_reward, whose task goes on: "
                "use reset_cost or bootstrap"
            )
        if self.adapts_reset_cost and self.ending != "reset_cost":
            raise SwingupError(
                f"adaptive_reset_cost has no effect with terminations = {self.terminations!r}"
                f"{'' if self.average_reward else ' and without average_reward'}: use terminations = 'reset_cost'"
            )
        if self.centre_values and self.popart:
            raise SwingupError("centre_values does not go with popart, which centres as well: choose one")
        self._check_gru()
        if self.normalise_rewards and self.popart:
            raise SwingupError("normalise_rewards does not go with popart, which scales as well: choose one")
        for name in ("discount", "entropy_discount"):
            value = getattr(self, name)
            # Traced or batched values cannot be compared here.
            # Without a gain, only a discount below 1 bounds the values.
            if not self.average_reward and isinstance(value, int | float) and value >= 1.0:
                raise SwingupError(f"{name} = {value} must be below 1 without average_reward")
            if self.centre_values and isinstance(value, int | float) and value < 1.0:
                raise SwingupError(
                    f"centre_values does not go with {name} = {value}: such a value has no free constant"
                )

    def _check_gru(self) -> None:
        if self.gru_width and not self.shared_trunk:
            raise SwingupError(
                f"gru_width = {self.gru_width} needs shared_trunk: the values read the policy's memory"
            )
        if self.gru_width and self.batch_size % self.num_steps:
            raise SwingupError(
                f"batch_size = {self.batch_size} is no multiple of num_steps = {self.num_steps}: with gru_width a "
                f"minibatch has whole rollouts of some environments, so choose a multiple"
            )

    @property
    def ending(self) -> Literal["end", "reset_cost", "bootstrap"]:
        """What follows a termination, with ``auto`` resolved."""
        if self.terminations == "auto":
            return "reset_cost" if self.average_reward else "end"
        return self.terminations

    @property
    def adapts_reset_cost(self) -> bool:
        """Whether the reset cost adapts, with ``auto`` resolved."""
        return self.ending == "reset_cost" if self.adaptive_reset_cost == AUTO else bool(self.adaptive_reset_cost)

    @property
    def rollout_size(self) -> int:
        """Frames of one iteration."""
        return self.num_envs * self.num_steps

    @property
    def num_minibatches(self) -> int:
        """Minibatches of one pass over a rollout."""
        return self.rollout_size // self.batch_size


def config_from_dict(values: dict[str, Any], others: Iterable[str] = ()) -> Config:
    """The inverse of ``dataclasses.asdict``; values may come from JSON, which has lists for tuples.

    Args:
        values: hyperparameters by name; those that are missing have the defaults of Table I.
        others: further names that the caller accepts, as suggestions for misspelt ones.

    Raises:
        SwingupError: a name is unknown or a value cannot work.
    """
    for name in values:
        check_hyperparameter(name, others)
    return Config(**{name: _to_python(value) for name, value in values.items()})


def check_hyperparameter(name: Any, others: Iterable[str] = ()) -> str:
    """The name of a hyperparameter.

    Raises:
        SwingupError: no hyperparameter has that name; the line has ours for that of another package, or suggests
            the nearest.
    """
    names = hyperparameters()
    if name in names:
        return name
    near = our_name(name) or suggestion(name, [*names, *others]) or "; swingup train --help lists them all"
    raise SwingupError(f"unknown hyperparameter {quoted(name)}{near}")


def check_value(name: str, value: Any) -> None:
    """Refuse a value that a hyperparameter cannot have, whatever the others are.

    Raises:
        SwingupError: it is of another kind, or outside the hyperparameter's range.
    """
    _check_field(next(field for field in dataclasses.fields(Config) if field.name == name), value)


def hyperparameters() -> list[str]:
    """The names of all hyperparameters."""
    return [field.name for field in dataclasses.fields(Config)]


def words_of(name: str) -> tuple[str, ...]:
    """The words that a hyperparameter may be; none for numbers."""
    return next(field.metadata.get("words", ()) for field in dataclasses.fields(Config) if field.name == name)


def kind_of(name: str) -> str:
    """What values of a hyperparameter are, in words."""
    default, words = getattr(Config, name), words_of(name)
    if default == NO_SCHEDULE:
        return "pairs of numbers such as 0.5 1 1 0.1"
    flags = f"True, False or {' or '.join(words)}" if words else "True or False"
    kinds = {bool: flags, int: "an integer", float: "a number", tuple: "integers such as (64, 64)"}
    return kinds.get(type(default), "a word")


def _to_python(value: Any) -> Any:
    """A value in Python's own types: a tuple for a list, a plain number for one of NumPy or JAX."""
    if isinstance(value, list | tuple):
        return tuple(_to_python(each) for each in value)
    # An array with axes is a batch for vmap and stays as it is.
    return value.item() if isinstance(value, np.generic | np.ndarray | jax.Array) and value.ndim == 0 else value


def _check_field(field: Any, value: Any) -> None:
    """Refuse a value of another kind than the default's, or that the field cannot have; numbers may be traced."""
    name, default, words = field.name, field.default, field.metadata.get("words", ())
    if isinstance(default, bool) and isinstance(value, str) and value in words:
        return
    if not _is_of_kind(value, default):
        # Elsewhere a schedule is a function in the number's place.
        schedule = f"{name}_schedule"
        changing = f", and {schedule} to change it" if callable(value) and schedule in hyperparameters() else ""
        raise SwingupError(f"{name} = {quoted(value)}: use {kind_of(name)}{changing}")
    if isinstance(default, str):
        one_of(name, value, words)
    elif "schedule" in field.metadata:
        _check_schedule(name, value)
    elif isinstance(default, tuple):
        if not value:
            raise SwingupError(f"{name} = (): name at least one layer, such as 64")
        for width in value:
            whole_number(name, width, 1, LARGEST_COUNT)
    elif "range" in field.metadata and isinstance(default, int):
        whole_number(name, value, *field.metadata["range"])
    elif "range" in field.metadata and isinstance(value, Real):
        finite_number(name, value, *field.metadata["range"])


def _check_schedule(name: str, pairs: tuple[float, ...]) -> None:
    """Refuse pairs whose parts do not rise from 0 to 1, or whose factors are negative or endless."""
    parts, factors = pairs[0::2], pairs[1::2]
    if len(parts) != len(factors):
        raise SwingupError(f"{name} = {quoted(pairs)} has a part without a factor: use pairs such as 0.5 1 1 0.1")
    for part, factor in zip(parts, factors, strict=True):
        finite_number(f"a part in {name}", part, 0.0, 1.0)
        finite_number(f"a factor in {name}", factor, 0.0, HUGE)
    if any(later <= part for part, later in itertools.pairwise(parts)):
        raise SwingupError(f"{name} = {quoted(pairs)}: its parts must rise, as 0.5 and 1 do in 0.5 1 1 0.1")


def _is_of_kind(value: Any, default: Any) -> bool:
    # Before int: in Python a bool is an int.
    if isinstance(default, bool):
        return isinstance(value, bool | np.bool_)
    if isinstance(default, int):
        return _is_integer(value)
    if isinstance(default, float):
        return isinstance(value, Real | np.ndarray | jax.Array) and not isinstance(value, bool)
    if isinstance(default, tuple):
        kind = Real if default == NO_SCHEDULE else Integral
        return isinstance(value, tuple) and all(
            isinstance(each, kind) and not isinstance(each, bool) for each in value
        )
    return True


def _is_integer(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)
