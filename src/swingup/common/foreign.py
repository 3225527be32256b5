"""Code that is not ours: whatever it raises becomes one line that says who raised what.

A controller or an environment may end the process (``sys.exit``) or raise what is not an ``Exception``. Only an
interrupt from the keyboard passes. Everything else is a fault of that code, and must not end a benchmark of a
thousand runs.
"""

import contextlib
import re
from collections.abc import Iterator
from typing import Any

from .errors import SwingupError
from .text import one_line


@contextlib.contextmanager
def errors_named_after(what: str, remedy: str = "correct it there") -> Iterator[None]:
    """Run foreign code, named by ``what`` as in "its reset()"."""
    try:
        yield
    # A SwingupError already names its fault.
    except (KeyboardInterrupt, SwingupError):
        raise
    except BaseException as error:
        raise SwingupError(f"{what} raised {described(error)}: {remedy}") from error


def described(error: BaseException) -> str:
    """A foreign error's kind and text. Compiled callbacks raise whole tracebacks; of these only the end is kept."""
    text = one_line(error)
    if "Traceback (most recent call last)" in text:
        text = one_line(re.split(r'\n  File "', str(error))[-1].partition("\n")[2])
    return f"{type(error).__name__} ({text})"


def attribute(source: Any, name: str, default: Any = None) -> Any:
    """An attribute of a foreign object, which a property or ``__getattr__`` may compute."""
    with errors_named_after(f"its attribute {name}"):
        return getattr(source, name, default)
