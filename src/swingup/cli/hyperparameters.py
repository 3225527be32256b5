"""The options of the hyperparameters: each is optional, and the preset gives what is left out."""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

from tyro.conf import arg
from tyro.constructors import MISSING, ConstructorRegistry, PrimitiveConstructorSpec, StructTypeInfo

from ..areapo.config import Config, format_value, is_pair, parse_value
from ..learner.presets import PENDULUM_PRESET, PRESETS


def _defaults(name: str) -> str:
    """The value of a hyperparameter in every preset, as ``2.0; global: 0.4; ppo: 0.0``."""
    by_value: dict[str, list[str]] = {}
    for preset, each in PRESETS.items():
        by_value.setdefault(format_value(getattr(each.config, name)), []).append(preset)
    usual = format_value(getattr(PRESETS[PENDULUM_PRESET].config, name))
    others = [f"{', '.join(presets)}: {value}" for value, presets in by_value.items() if value != usual]
    return "; ".join([usual, *others])


def _annotation(name: str, text: str) -> Any:
    """Type, help and parser of a hyperparameter's option."""
    option = arg(help=" ".join(text.split()), help_behavior_hint=f"({_defaults(name)})")
    default = getattr(Config, name)
    if isinstance(default, bool):
        return Annotated[bool, option]
    metavar = {int: "INT", float: "FLOAT", tuple: "INT..."}.get(type(default), "WORD")
    parser = PrimitiveConstructorSpec(
        nargs="*" if isinstance(default, tuple) else 1,
        metavar="FLOAT FLOAT" if is_pair(name) else metavar,
        instance_from_str=functools.partial(_parse, name),
        is_instance=lambda value: True,
        str_from_instance=lambda value: [format_value(value)],
    )
    return Annotated[Any, option, parser]


def _parse(name: str, words: Sequence[str]) -> Any:
    return parse_value(name, " ".join(words))


# Type checkers cannot follow fields that are computed.
if TYPE_CHECKING:
    HyperparameterOptions = dict[str, Any]
else:
    # Tyro reads the strings under the fields, and leaves out what was not given.
    _described = ConstructorRegistry.get_struct_spec(StructTypeInfo.make(Config, MISSING, in_union_context=False))
    HyperparameterOptions = TypedDict(
        "HyperparameterOptions",
        {field.name: _annotation(field.name, field.helptext()) for field in _described.fields},
        total=False,
    )
