"""The options of the hyperparameters: each is optional, and the preset gives what is left out."""

import ast
import dataclasses
import inspect
import itertools
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import FlagCreatePairsOff, arg

from ..areapo.config import Config, format_value, is_pair, parse_value
from ..common.errors import SwingupError
from ..learner.presets import PENDULUM_PRESET, PRESETS


def _field_help() -> dict[str, str]:
    """The strings under the fields of the configuration."""
    # Python keeps no string under a field: only the source has it.
    body = ast.parse(inspect.getsource(Config)).body[0].body  # type: ignore[attr-defined]
    texts = {}
    for field, text in itertools.pairwise(body):
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
            texts[ast.unparse(field.target)] = " ".join(ast.literal_eval(text.value).split())
    return texts


def _defaults(name: str) -> str:
    """The value of a hyperparameter in every preset, as ``2.0; global: 0.4; ppo: 0.0``."""
    by_value: dict[str, list[str]] = {}
    for preset, each in PRESETS.items():
        by_value.setdefault(format_value(getattr(each.config, name)), []).append(preset)
    usual = format_value(getattr(PRESETS[PENDULUM_PRESET].config, name))
    others = [f"{', '.join(presets)}: {value}" for value, presets in by_value.items() if value != usual]
    return "; ".join([usual, *others])


def _options() -> list[tuple[str, Any, Any]]:
    """Fields of the options: a value as words, or a pair of flags."""
    fields: list[tuple[str, Any, Any]] = []
    for field in dataclasses.fields(Config):
        name, help_, note = field.name, _field_help()[field.name], f"({_defaults(field.name)})"
        if isinstance(field.default, bool):
            # Two flags, so that neither of them means the preset's value.
            off = arg(help=f"Without {name.replace('_', ' ')}.", help_behavior_hint="")
            on = arg(help=help_, help_behavior_hint=note)
            fields.append((name, Annotated[FlagCreatePairsOff[bool], on], False))
            fields.append((f"no_{name}", Annotated[FlagCreatePairsOff[bool], off], False))
            continue
        metavar = {int: "INT", float: "FLOAT", tuple: "INT..."}.get(type(field.default), "WORD")
        metavar = "FLOAT FLOAT" if is_pair(name) else metavar
        kind = tuple[str, ...] if isinstance(field.default, tuple) else str
        option = arg(metavar=metavar, help=help_, help_behavior_hint=note)
        fields.append((name, Annotated[kind | None, option], None))
    return fields


# Type checkers cannot follow fields that are computed.
if TYPE_CHECKING:
    HyperparameterOptions = Any
else:
    HyperparameterOptions = dataclasses.make_dataclass("HyperparameterOptions", _options(), frozen=True)


def given_hyperparameters(options: HyperparameterOptions) -> dict[str, Any]:
    """The hyperparameters among the options that were given.

    Raises:
        SwingupError: a value is of another type, or a flag was given with its opposite.
    """
    given: dict[str, Any] = {}
    for name, value in vars(options).items():
        if value is None or value is False:
            continue
        if value is not True:
            given[name] = parse_value(name, value if isinstance(value, str) else " ".join(value))
            continue
        flag = name.removeprefix("no_")
        if flag in given:
            words = flag.replace("_", "-")
            raise SwingupError(f"--{words} and --no-{words} exclude each other: choose one")
        given[flag] = flag == name
    return given
