"""The algorithm's hyperparameters; the strings under the fields are the command line's help.

Fields marked static fix shapes and are compiled in; the others are leaves of the pytree, so that learning rates or
temperatures can be batched with ``vmap``. A pair is [reward, entropy]. Defaults are Table I of the paper, with the
gains of its authors' code.
"""

import dataclasses
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any, Literal, get_args

import equinox as eqx
import jax
import numpy as np

from ..common.checks import finite_number, one_of, suggestion, swingup_name, whole_number
from ..common.errors import SwingupError, quoted
from ..policy.network import Activation

MIN_POSITIVE, MAX_NUMBER = 1e-12, 1e12
"""Bounds of numbers that must be positive, or need no other bound."""
LARGEST_COUNT = 2**31 - 1
"""Frames and units are indexed in 32 bits."""

Deviation = Literal["state", "action", "fitted"]
Gain = Literal["td", "advantage", "none"]
Terminations = Literal["reset_cost", "adaptive_cost", "bootstrap", "end"]
Schedule = Literal["constant", "anneal", "anneal_entropy", "anneal_lambda"]
Pair = tuple[float, float]
"""A value of the reward objective and one of the entropy objective."""
KINDS: dict[Any, Any] = {bool: bool | np.bool_, int: Integral, float: Real | np.ndarray | jax.Array}
"""What a value of a kind may be; an array is traced, or a batch for ``vmap``."""


def _to_python(value: Any) -> Any:
    # Python's own types: a tuple for a list from JSON, a plain number for NumPy's or JAX's. Traced values stay as
    # they are, and so do arrays with axes, which are batches for vmap.
    if isinstance(value, list | tuple):
        return tuple(map(_to_python, value))
    scalar = isinstance(value, np.generic | np.ndarray | jax.Array) and value.ndim == 0
    return value.item() if scalar and not isinstance(value, jax.core.Tracer) else value


def _number(default: float | Pair, minimum: float, maximum: float) -> Any:
    # A real number, or a pair of them: leaves of the pytree, whose range is not checked where they are traced.
    return eqx.field(default=default, converter=_to_python, metadata={"range": (minimum, maximum)})


def _static(default: Any, minimum: float = 0, maximum: float = LARGEST_COUNT) -> Any:
    # A number in a range, a truth value or widths of layers, which is compiled in.
    return eqx.field(static=True, default=default, converter=_to_python, metadata={"range": (minimum, maximum)})


def _word(default: str, words: Any) -> Any:
    # One of the words of a ``Literal``, which is compiled in.
    return eqx.field(static=True, default=default, metadata={"words": get_args(words)})


class Config(eqx.Module):
    """Hyperparameters of AR-EAPO (paper, Table I) and of its relatives."""

    num_envs: int = _static(64, 1)
    """Environments side by side."""
    num_steps: int = _static(128, 1)
    """Steps of each environment in a rollout."""
    num_epochs: int = _static(6, 1)
    """Passes over a rollout."""
    batch_size: int = _static(1024, 2)
    """Frames in a minibatch."""
    policy_layers: tuple[int, ...] = _static((256, 256), 1)
    """Widths of the policy's hidden layers."""
    value_layers: tuple[int, ...] = _static((512, 512), 1)
    """Widths of the hidden layers that both value heads share."""
    activation: Activation = _word("relu", Activation)
    """Activation of all hidden layers: relu, tanh, elu, silu or gelu."""
    deviation: Deviation = _word("state", Deviation)
    """What the standard deviation σ of continuous actions is. state: σ depends on the state, and tanh bounds
    actions, as in the paper; action: each action has its own σ and is clipped, as in Stable-Baselines3 and CleanRL;
    fitted: as action; after the first rollout that shows more than a price of actions, σ is cut to 15 % if large
    actions cost reward. Discrete actions have no σ."""
    log_std_init: float = _number(-1.0, -20.0, 2.0)
    """Logarithm of the policy's initial standard deviation (before the bounds)."""
    temperature: float = _number(2.0, 0.0, MAX_NUMBER)
    """Temperature τ of the entropy reward -τ log π."""
    discount: Pair = _number((1.0, 1.0), 0.0, 1.0)
    """Discounts γ of the reward and of the entropy objective."""
    gae_lambda: Pair = _number((0.8, 0.6), 0.0, 1.0)
    """λ of the reward advantages and λ_e of the entropy advantages."""
    gain: Gain = _word("advantage", Gain)
    """How the gains are estimated. td: as the mean of r + v(s') - v(s) over a rollout; advantage: by steps along
    the mean λ-advantage (authors' code), which overshoot where λ is near 1; none: no gains, discounts below 1."""
    gain_step_size: float = _number(0.01, MIN_POSITIVE, 1.0)
    """Step size η of gain = advantage."""
    centre_values: bool = _static(False)
    """Fix the values' free constant: after each rollout, subtract their mean from the heads' biases."""
    clip_range: float = _number(0.05, MIN_POSITIVE, 1.0)
    """ε of the clipped surrogate."""
    learning_rate: float = _number(5e-4, 0.0, MAX_NUMBER)
    """Adam's step size."""
    max_grad_norm: float = _number(10.0, MIN_POSITIVE, MAX_NUMBER)
    """Joint norm to which the gradients are clipped."""
    target_kl: float = _static(0.0, 0.0, MAX_NUMBER)
    """Target KL divergence per rollout: after each rollout the learning rate is scaled by up to 1.5 towards it (0:
    off)."""
    value_coefficient: Pair = _number((0.25, 0.125), 0.0, MAX_NUMBER)
    """Weights of both values' losses; Table I has c2 = 0.5 for the second over the first."""
    excess_coefficient: float = _static(0.0, 0.0, MAX_NUMBER)
    """Weight of how far means lie beyond the bounds of clipped actions, squared (0: off). Out there all samples are
    alike, and the entropy grows without bound."""
    terminations: Terminations = _word("reset_cost", Terminations)
    """What a termination means. reset_cost: a new start, at a fixed cost; adaptive_cost: at a cost that holds
    failures at one in 1,000 steps, and none at a goal; bootstrap: as a time limit; end: nothing follows, without
    gains alone."""
    reset_cost: float = _number(10.0, 0.0, MAX_NUMBER)
    """Cost of a reset, in units of the reward; with adaptive_cost the initial cost, in standard deviations of the
    reward."""
    normalise_rewards: bool = _static(False)
    """Divide rewards, with the costs of resets, by the standard deviation of Σ (γλ)^k (r - mean r); without gains,
    subtract their running mean. The temperature is then in this unit; metrics stay in the task's."""
    schedule: Schedule = _word("constant", Schedule)
    """Schedule over schedule_frames, repeated. anneal: in the second half, learning rate and clip range fall to
    10 % and 15 %; anneal_entropy: also, the temperature is lower for a while before. anneal_lambda: not repeated,
    λ falls to 0.9 after the first third."""
    schedule_frames: int = _static(12_000_000, 1)
    """Frames of each seed in a cycle of the schedule."""

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
        if self.gain != "none" and self.terminations == "end":
            raise SwingupError(
                f"terminations = 'end' does not go with gain = {self.gain!r}, whose task goes on: use reset_cost, "
                f"adaptive_cost or bootstrap"
            )
        # Traced or batched values cannot be compared here.
        discounts = [value for value in self.discount if isinstance(value, int | float)]
        if self.gain == "none" and any(value >= 1.0 for value in discounts):
            raise SwingupError(f"discount = {self.discount} must be below 1 with gain = 'none'")
        if self.centre_values and any(value < 1.0 for value in discounts):
            raise SwingupError(
                f"centre_values does not go with discount = {self.discount}: such a value has no free constant"
            )

    @property
    def rollout_size(self) -> int:
        """Frames of one iteration."""
        return self.num_envs * self.num_steps


HYPERPARAMETERS: dict[str, Any] = {field.name: field for field in dataclasses.fields(Config)}
"""The fields of all hyperparameters by their names."""


NEEDED = {
    "reset_cost": ("terminations", ("reset_cost", "adaptive_cost")),
    "gain_step_size": ("gain", ("advantage",)),
    "excess_coefficient": ("deviation", ("action", "fitted")),
    "schedule_frames": ("schedule", ("anneal", "anneal_entropy", "anneal_lambda")),
}
"""Hyperparameters that have an effect only with some words of another."""


def check_effects(given: Iterable[str], config: Config) -> None:
    """Refuse hyperparameters that a user gave and that these would ignore."""
    for name in given:
        if (why := why_without_effect(name, config)) is not None:
            raise SwingupError(why)


def why_without_effect(name: str, config: Config) -> str | None:
    """Why these would ignore a hyperparameter, and the remedy; None if they would not."""
    other, words = NEEDED.get(name, ("", ()))
    if not words or (word := getattr(config, other)) in words:
        return None
    return f"{name} has no effect with {other} = {word!r}: leave it out, or use {other} = {' or '.join(words)}"


def config_from_dict(values: dict[str, Any], others: Iterable[str] = ()) -> Config:
    """The inverse of ``dataclasses.asdict``; values may come from JSON, which has lists for tuples.

    Those that are missing have the defaults of Table I. ``others`` are further names to suggest for misspelt ones.
    """
    for name in values:
        check_hyperparameter(name, others)
    return Config(**values)


def check_hyperparameter(name: Any, others: Iterable[str] = ()) -> str:
    """The name of a hyperparameter; another package's is refused with ours, a misspelt one with the nearest."""
    if name in HYPERPARAMETERS:
        return name
    names = [*HYPERPARAMETERS, *others]
    near = swingup_name(name) or suggestion(name, names) or "; swingup train --help lists them all"
    raise SwingupError(f"unknown hyperparameter {quoted(name)}{near}")


def kind_of(name: str) -> str:
    """What values of a hyperparameter are, in words."""
    default, words = getattr(Config, name), HYPERPARAMETERS[name].metadata.get("words")
    if words:
        return f"one of {', '.join(words)}"
    if is_pair(name):
        return "two numbers, of the reward and of the entropy, such as 0.8 0.6"
    return {bool: "True or False", int: "an integer", float: "a number", tuple: "integers such as (64, 64)"}[
        type(default)
    ]


def is_pair(name: str) -> bool:
    """Whether a hyperparameter is a number for each objective."""
    return HYPERPARAMETERS[name].type == Pair


def parse_value(name: str, text: str) -> Any:
    """A hyperparameter from text: 3e-4, true or false, 64x64 or 64 64 or 64,64, 0.8 0.6, or a word."""
    default: Any = getattr(Config, check_hyperparameter(name))
    value: Any
    try:
        if isinstance(default, bool):
            value = {"true": True, "false": False}[text.lower()]
        elif isinstance(default, tuple):
            number = float if is_pair(name) else int
            value = tuple(number(part) for part in text.replace("x", " ").replace(",", " ").split())
        else:
            value = type(default)(text)
    except (KeyError, ValueError) as error:
        raise SwingupError(f"{name} = {quoted(text)}: use {kind_of(name)}") from error
    _check_field(HYPERPARAMETERS[name], value)
    return value


def format_value(value: Any, separator: str = "x") -> str:
    """A value as ``parse_value`` reads it; several numbers are joined by x, since commas separate alternatives."""
    return separator.join(map(str, value)) if isinstance(value, tuple) else str(value)


def _check_field(field: Any, value: Any) -> None:
    """Refuse a value of another kind than the default's, or that the field cannot have; numbers may be traced."""
    name, default = field.name, field.default
    if "words" in field.metadata:
        one_of(name, value, field.metadata["words"])
        return
    several = isinstance(default, tuple)
    kind = type(default[0] if several else default)
    entries = value if isinstance(value, tuple) else (value,)
    complete = len(entries) == 2 if is_pair(name) else bool(entries)
    # To Python a truth value is an integer, too.
    fits = all(isinstance(each, KINDS[kind]) and (kind is bool or not isinstance(each, bool)) for each in entries)
    if isinstance(value, tuple) != several or not complete or not fits:
        hint = '; schedule="anneal" lets it fall' if name == "learning_rate" and callable(value) else ""
        raise SwingupError(f"{name} = {quoted(value)}: use {kind_of(name)}{hint}")
    for each in entries:
        if kind is int:
            whole_number(name, each, *field.metadata["range"])
        elif kind is float and isinstance(each, Real):
            finite_number(name, each, *field.metadata["range"])
