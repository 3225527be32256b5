"""Texts with gaps: files in ``assets`` name these ``@LIKE_THIS@``."""

import re
from collections.abc import Mapping
from importlib import resources

from ..common.errors import SwingupError
from ..common.text import quoted

NAME = "swingup"
"""Name of an export unless another one is given."""


def check_export_name(name: str) -> str:
    """A name for an export, which must fit files, Python and C."""
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name):
        raise SwingupError(f"name {quoted(name)}: use up to 40 small letters, digits and _, a letter first")
    return name


def asset(package: str, name: str) -> str:
    """The text of a file in a package's ``assets``."""
    return (resources.files(package) / "assets" / name).read_text(encoding="utf-8")


def fill(template: str, values: Mapping[str, str]) -> str:
    """Fill the gaps of a template; each must have a value."""
    return re.sub(r"@([A-Z0-9_]+)@", lambda match: values[match[1]], template)
