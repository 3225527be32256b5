"""What all settings of a policy's parts share: ranges stand in the annotations; values are read and checked here.

A kind of settings is a frozen dataclass with the class variable ``PART``, its key in a policy file's metadata. Its
fields are annotated ``Annotated[kind, Range(minimum, maximum)]``; a kind is ``float``, ``int``, ``float | None`` or
a tuple of floats. A field may also be a word, which its class checks, or settings themselves; all others are
arrays. It is a subclass of :class:`Settings`, unless values may be traced by JAX.
"""

from collections.abc import Mapping
from dataclasses import Field, dataclass, fields, is_dataclass
from typing import Any, ClassVar, TypeVar, get_args

from .checks import finite_number, one_of, whole_number
from .errors import SwingupError, quoted

SettingsT = TypeVar("SettingsT", bound="Settings")
NoteT = TypeVar("NoteT")


# No tuple: Python 3.11.2 keeps one annotation for equal ones, and an exported copy's would be the package's.
@dataclass(frozen=True)
class Range:
    """Smallest and largest value of a setting, or of each of several numbers."""

    minimum: float
    maximum: float


def notes(field: "Field[Any]", kind: type[NoteT]) -> tuple[NoteT, ...]:
    """What a field's annotation says of one kind: its :class:`Range`, or its units."""
    return tuple(each for each in getattr(field.type, "__metadata__", ()) if isinstance(each, kind))


class Settings:
    """Settings whose ranges are checked when they are made."""

    PART: ClassVar[str]

    def __post_init__(self) -> None:
        """Refuse values out of their ranges, and turn lists into tuples and numbers into the field's type."""
        for name, value in in_range(self).items():
            # The dataclass is frozen for its users; here it is still being made.
            object.__setattr__(self, name, value)


def in_range(settings: Any) -> dict[str, Any]:
    """The values that have a range, by their names, once they were found to lie within."""
    return {
        name: _checked(f"{settings.PART} setting {name}", getattr(settings, name), kind, bounds)
        for name, (kind, bounds) in settings_of(type(settings)).items()
        if bounds is not None
    }


def read_settings(metadata: Mapping[str, Any], kind: type[SettingsT]) -> SettingsT | None:
    """Settings under their key in a policy file's metadata; None if it has none."""
    return kind(**read_values(metadata[kind.PART], kind.PART, kind)) if kind.PART in metadata else None


def read_values(content: Any, part: str, kind: Any) -> dict[str, Any]:
    """The values that an object of JSON gives for a kind's settings, whose names are checked."""
    if not isinstance(content, Mapping):
        raise SwingupError(f"{part} {quoted(content)} is not an object of settings: use {{}} for the defaults")
    known, values = settings_of(kind), dict(content)
    for name, value in content.items():
        inner, _ = known[one_of(f"{part} setting", name, known)]
        if is_dataclass(inner):
            values[name] = inner(**read_values(value, f"{part} {name}", inner))  # type: ignore[operator]  # a class
    return values


def _checked(name: str, value: Any, kind: Any, bounds: Range) -> Any:
    if kind is int:
        return whole_number(name, value, int(bounds.minimum), int(bounds.maximum))
    if isinstance(kind, tuple):
        if not isinstance(value, list | tuple) or len(value) != len(kind):
            raise SwingupError(f"{name} = {quoted(value)}: use {len(kind)} numbers")
        return tuple(finite_number(name, each, bounds.minimum, bounds.maximum) for each in value)
    if value is None and type(None) in get_args(kind):
        return None
    return finite_number(name, value, bounds.minimum, bounds.maximum)


def settings_of(kind: Any) -> dict[str, tuple[Any, Range | None]]:
    """Kind and range of each setting: a tuple's kind is that of its entries; words and settings have no range."""
    found: dict[str, tuple[Any, Range | None]] = {}
    for field in fields(kind):
        bounds = next(iter(notes(field, Range)), None)
        inner = field.type if bounds is None else get_args(field.type)[0]
        if bounds is not None or inner is str or is_dataclass(inner):
            found[field.name] = get_args(inner) if isinstance(field.default, tuple) else inner, bounds
    return found
