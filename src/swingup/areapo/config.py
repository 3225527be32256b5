"""The algorithm's hyperparameters; the strings under the fields are the command line's help.

Fields marked static fix shapes and are compiled in; the others are leaves of the pytree, so that learning rates or
temperatures can be batched with ``vmap``. Defaults are Table I of the paper, to the letter.
"""

import dataclasses
from numbers import Integral, Real
from typing import Any, Literal, get_args

import equinox as eqx
import jax
import numpy as np

from ..errors import SwingupError

TINY, HUGE = 1e-12, 1e12
RANGES = {
    "temperature": (0.0, HUGE),
    "discount": (0.0, 1.0),
    "entropy_discount": (0.0, 1.0),
    "gae_lambda": (0.0, 1.0),
    "entropy_gae_lambda": (0.0, 1.0),
    "gain_step_size": (TINY, 1.0),
    "clip_range": (TINY, 1.0),
    "learning_rate": (0.0, HUGE),
    "adam_epsilon": (TINY, HUGE),
    "max_grad_norm": (TINY, HUGE),
    "value_coefficient": (0.0, HUGE),
    "entropy_value_coefficient": (0.0, HUGE),
    "log_std_init": (-20.0, 2.0),
    "observation_clip": (TINY, HUGE),
    "reset_cost": (0.0, HUGE),
    "popart_step_size": (TINY, 1.0),
}
"""Least and largest value of each hyperparameter that is a number; not asked of traced ones."""


Terminations = Literal["auto", "end", "reset_cost", "bootstrap"]


class Config(eqx.Module):
    """Hyperparameters of AR-EAPO (paper, Table I) and of its relatives."""

    num_envs: int = eqx.field(static=True, default=64)
    """Environments side by side."""
    num_steps: int = eqx.field(static=True, default=128)
    """Steps of each environment in a rollout."""
    num_epochs: int = eqx.field(static=True, default=6)
    """Passes over a rollout."""
    batch_size: int = eqx.field(static=True, default=1024)
    """Frames in a minibatch."""
    policy_layers: tuple[int, ...] = eqx.field(static=True, default=(256, 256))
    """Widths of the policy's hidden layers (ReLU)."""
    value_layers: tuple[int, ...] = eqx.field(static=True, default=(512, 512))
    """Widths of the hidden layers that both value heads share (ReLU)."""
    average_reward: bool = eqx.field(static=True, default=True)
    """Subtract the gains (average reward); without it, the discounts below 1 bound the values."""
    gain_trace: bool = eqx.field(static=True, default=True)
    """Divide the gains' step by its trace, which removes the bias of their start at 0 (authors' code). Not with a λ
    near 1: λ-advantages scale the step by about 1 / (1 - λ), and the first estimates overshoot more and more."""
    centre_values: bool = eqx.field(static=True, default=False)
    """Fix the values' free constant: after each rollout, take their mean off the heads' biases."""
    normalise_advantages: bool = eqx.field(static=True, default=True)
    """Normalise the soft advantages in each minibatch."""
    terminations: Terminations = eqx.field(static=True, default="auto")
    """What follows where a task ends itself. end: nothing, its value is 0; reset_cost: a new start, at a cost
    (ATRPO, arXiv 2106.07329); bootstrap: what would follow had the task gone on; auto: reset_cost with average
    reward, end without."""
    popart: bool = eqx.field(static=True, default=False)
    """Learn the values on a normalised scale that follows the returns (PopArt)."""
    temperature: float = 2.0
    """Temperature τ of the entropy reward -τ log π."""
    discount: float = 1.0
    """Discount γ of the reward objective."""
    entropy_discount: float = 1.0
    """Discount γ_H of the entropy objective."""
    gae_lambda: float = 0.8
    """λ of the reward advantages."""
    entropy_gae_lambda: float = 0.6
    """λ_e of the entropy advantages."""
    gain_step_size: float = 0.01
    """Step size η of both gains."""
    clip_range: float = 0.05
    """ε of the clipped surrogate."""
    learning_rate: float = 5e-4
    """Adam's step size."""
    adam_epsilon: float = 1e-5
    """Adam's ε."""
    max_grad_norm: float = 10.0
    """Joint norm to which the gradients are clipped."""
    value_coefficient: float = 0.25
    """Weight of the value loss."""
    entropy_value_coefficient: float = 0.5
    """c2: weight of the entropy value's loss within the value loss."""
    log_std_init: float = -1.0
    """Logarithm of the policy's initial standard deviation (before tanh)."""
    observation_clip: float = 10.0
    """Normalised observations are clipped to ± this."""
    reset_cost: float = 10.0
    """Taken off the reward where a task ends itself, with terminations = reset_cost (10 in arXiv 2501.06937's
    continuing MuJoCo tasks)."""
    popart_step_size: float = 0.1
    """Weight of a rollout's returns in PopArt's running moments."""

    def __check_init__(self) -> None:
        """Refuse what cannot work, before anything is traced."""
        for field in dataclasses.fields(self):
            _check_kind(field.name, getattr(self, field.name), field.default)
        for name in ("num_envs", "num_steps", "num_epochs", "batch_size"):
            if getattr(self, name) < 1:
                raise SwingupError(f"{name} = {getattr(self, name)} must be at least 1")
        if self.rollout_size % self.batch_size:
            raise SwingupError(
                f"batch_size = {self.batch_size} does not divide a rollout of num_envs x num_steps = "
                f"{self.num_envs} x {self.num_steps} = {self.rollout_size} frames: choose a divisor"
            )
        for name, (least, most) in RANGES.items():
            value = getattr(self, name)
            if isinstance(value, int | float) and not least <= value <= most:
                raise SwingupError(f"{name} = {value} must lie between {least:g} and {most:g}")
        for name in ("policy_layers", "value_layers"):
            if not getattr(self, name) or min(getattr(self, name)) < 1:
                raise SwingupError(
                    f"{name} = {getattr(self, name)} must name at least one layer of at least 1 unit"
                )
        if self.terminations not in get_args(Terminations):
            raise SwingupError(
                f"unknown terminations {self.terminations!r}: use one of {', '.join(get_args(Terminations))}"
            )
        if self.average_reward and self.terminations == "end":
            raise SwingupError(
                "terminations = 'end' does not go with average_reward, whose task goes on: "
                "use reset_cost or bootstrap"
            )
        if self.centre_values and self.popart:
            raise SwingupError("centre_values does not go with popart, which centres as well: choose one")
        for name in ("discount", "entropy_discount"):
            value = getattr(self, name)
            if not self.average_reward and isinstance(value, int | float) and value >= 1.0:
                raise SwingupError(f"{name} = {value} must be below 1 without average_reward")
            if self.centre_values and isinstance(value, int | float) and value < 1.0:
                raise SwingupError(
                    f"centre_values does not go with {name} = {value}: such a value has no free constant"
                )

    @property
    def ending(self) -> Literal["end", "reset_cost", "bootstrap"]:
        """What follows a termination, with ``auto`` resolved."""
        if self.terminations == "auto":
            return "reset_cost" if self.average_reward else "end"
        return self.terminations

    @property
    def rollout_size(self) -> int:
        """Frames of one iteration."""
        return self.num_envs * self.num_steps

    @property
    def num_minibatches(self) -> int:
        """Minibatches of one pass over a rollout."""
        return self.rollout_size // self.batch_size


def config_from_dict(values: dict[str, Any]) -> Config:
    """The inverse of ``dataclasses.asdict``, also after a trip through JSON.

    Raises:
        SwingupError: a name is unknown or a value cannot work.
    """
    names = {field.name for field in dataclasses.fields(Config)}
    unknown = sorted(set(values) - names)
    if unknown:
        raise SwingupError(f"unknown hyperparameter {', '.join(unknown)}: use names of areapo.config.Config")
    return Config(**{name: _plain(value) for name, value in values.items()})


def _plain(value: Any) -> Any:
    """A value as Python has it: no list, no number of NumPy's or JAX's."""
    if isinstance(value, list | tuple):
        return tuple(_plain(each) for each in value)
    return value.item() if isinstance(value, np.generic | np.ndarray | jax.Array) and value.ndim == 0 else value


def _check_kind(name: str, value: Any, usual: Any) -> None:
    """Refuse what is not of the usual value's kind; numbers may be traced."""
    if isinstance(usual, bool):
        good, wanted = isinstance(value, bool | np.bool_), "True or False"
    elif isinstance(usual, int):
        good, wanted = _is_integer(value), "an integer"
    elif isinstance(usual, float):
        good = isinstance(value, Real | np.ndarray | jax.Array) and not isinstance(value, bool)
        wanted = "a number"
    elif isinstance(usual, tuple):
        good, wanted = isinstance(value, tuple) and all(map(_is_integer, value)), "integers such as (64, 64)"
    else:
        return
    if not good:
        raise SwingupError(f"{name} = {value!r} must be {wanted}")


def _is_integer(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)
