"""Arguments that several commands share."""

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, TypedDict

from tyro.conf import arg
from tyro.constructors import PrimitiveConstructorSpec

from ..common.checks import one_of
from ..common.errors import SwingupError, one_line
from ..common.files import check_suffix, check_writable
from ..loop.domain import Domain
from ..loop.resolve import resolve
from ..plant.files import PLANT_FILES, SHIPPED_PLANTS, is_model_file
from ..plant.model_file import read_model
from ..plant.plant import ROBOTS, Plant, Robot, get_robot


def optional(text: str, metavar: str | None = None) -> Any:
    """An option that may be left out, without tyro's "(default: None)": the text says what then happens."""
    return arg(metavar=metavar, help=text, help_behavior_hint="")


def value_of(make: Callable[..., Any], metavar: str, words: Any = 1) -> PrimitiveConstructorSpec[Any]:
    """How tyro makes a value from a number of words, ``"*"`` for any; errors of ``make`` are the command's."""
    return PrimitiveConstructorSpec(
        nargs=words,
        metavar=metavar,
        instance_from_str=lambda typed: make(*typed),
        is_instance=lambda value: True,
        str_from_instance=lambda value: [
            getattr(each, "name", str(each)) for each in (value if isinstance(value, tuple) else (value,))
        ],
    )


def word_of(kind: str, *words: str) -> Any:
    """One of several words."""
    return value_of(lambda word: one_of(kind, word, words), "{" + ",".join(words) + "}")


def split_commas(*values: str) -> tuple[str, ...]:
    """Values of one option, which spaces or commas may separate, but not those in parentheses or a file's name."""
    return tuple(part for value in values for part in ([value] if os.path.isfile(value) else _split(value)) if part)


def _split(text: str) -> list[str]:
    """The parts between commas that stand outside of parentheses, as those of atan2(s,c) do not."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth <= 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


NAMES = value_of(split_commas, "NAME...", "*")
RobotName = Annotated[Robot, value_of(get_robot, "ROBOT")]
FileName = Annotated[str, value_of(str, "FILE")]
DomainName = Annotated[str, value_of(str, "DOMAIN")]
Names = Annotated[tuple[str, ...], NAMES]
PLANTS = f"{', '.join(SHIPPED_PLANTS)}, {PLANT_FILES}"


class PlantOptions(TypedDict, total=False):
    """Which plant; by default the leaderboards', design C.1 without friction and rotors' inertia."""

    plant: Annotated[str, optional(f"{PLANTS}; default: the leaderboards' plant, C.1 without friction.", "PLANT")]
    frictionless: Annotated[bool, optional("leave the plant's friction and rotors' inertia out.")]


NO_OPTIONS: Any = {}
"""Nothing was given of a class of options."""


def plant_of(options: PlantOptions) -> Domain | None:
    """What the options name, with the ranges and the loop that a file has; None without any."""
    if "plant" not in options:
        if options.get("frictionless"):
            raise SwingupError("--frictionless needs --plant: the leaderboards' plant has no friction")
        return None
    found = resolve(options["plant"])
    if is_model_file(options["plant"]):
        for note in read_model(options["plant"]).notes:
            if note.startswith(("not ", "left out")):
                print(f"swingup: {one_line(options['plant'])}: {note}", file=sys.stderr)
    return found.frictionless() if options.get("frictionless") else found


def facts_of(options: PlantOptions) -> Plant | None:
    """The one plant that the options name; None without any."""
    found = plant_of(options)
    return None if found is None else found.facts


def refuse_ignored(options: Mapping[str, Any], why: str) -> None:
    """Refuse options that were given and would be ignored."""
    for name, value in options.items():
        if not (value is None or value is False or value == ()):
            raise SwingupError(f"--{name.replace('_', '-')} {why}: leave it out")


def check_outputs(formats: Sequence[str], *paths: str | None) -> None:
    """Refuse files that cannot be written, before the work that makes their content; None is not a file."""
    for path in paths:
        if path is not None:
            suffix = check_suffix(path, formats)
            check_writable(path)
            # An extra that is not installed is missed before the work, too.
            if suffix == ".html":
                from ..report.page import page_template

                page_template()
            elif suffix in (".png", ".svg", ".pdf"):
                from ..report.draw import styled

                styled()


def task_name(robot: Robot | None, env: str | None) -> str:
    """The robot's name or the Gymnasium id, of which one is given."""
    if robot is None and env is None:
        raise SwingupError(f"name a robot ({', '.join(ROBOTS)}) or give --env ID")
    if robot is not None and env is not None:
        raise SwingupError(f"{robot.name} and --env {env}: give one of the two")
    return robot.name if robot else str(env)
