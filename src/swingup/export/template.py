"""Texts with gaps: the files in ``assets`` name them ``@LIKE_THIS@``."""

import re
from collections.abc import Mapping
from importlib import resources


def asset(name: str) -> str:
    """The text of a file in ``assets``."""
    return (resources.files(__package__) / "assets" / name).read_text(encoding="utf-8")


def fill(template: str, values: Mapping[str, str]) -> str:
    """The template with its gaps filled; each must have a value."""
    return re.sub(r"@([A-Z0-9_]+)@", lambda match: values[match[1]], template)
