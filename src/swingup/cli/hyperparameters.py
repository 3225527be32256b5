"""The options of the hyperparameters: each is optional, and the preset gives what is left out."""

from typing import TYPE_CHECKING, Annotated, Any, TypedDict

from tyro.conf import arg
from tyro.constructors import MISSING, ConstructorRegistry, StructTypeInfo

from ..areapo.config import Config, format_value, is_pair, parse_value
from ..learner.presets import PENDULUM_PRESET, PRESETS
from .parsing import value_of


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
    metavar = "FLOAT FLOAT" if is_pair(name) else metavar
    words = "*" if isinstance(default, tuple) else 1
    return Annotated[Any, option, value_of(lambda *typed: parse_value(name, " ".join(typed)), metavar, words)]


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
