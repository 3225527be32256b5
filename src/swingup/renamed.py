"""Names that changed in this version: the old ones work for one more release and log a line with the new one.

The line goes to the logger ``swingup``, which prints it on standard error unless a program configures logging.
"""

import logging

RENAMED = {
    "controller": {"ar-eapo-base": "ar-eapo", "ar-eapo-global": "global"},
    "domain": {"hardware": "identified"},
}
"""New names by kind and old name."""

CHANGED = {
    "controller": {
        "ar-eapo": "now means the paper's learner alone; the policy that it meant before is 'refined'",
    }
}
"""Names that had another meaning before, and their new one."""

_LOGGER = logging.getLogger("swingup")
_told: set[tuple[str, str]] = set()


def current_name(kind: str, name: str) -> str:
    """The present name for a name that a user gave; a change is logged once in a program."""
    new = RENAMED.get(kind, {}).get(name)
    note = f"is now called {new!r}" if new else CHANGED.get(kind, {}).get(name)
    if note and (kind, name) not in _told:
        _told.add((kind, name))
        _LOGGER.warning("swingup: %s %r %s", kind, name, note)
    return new or name
