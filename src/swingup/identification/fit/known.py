"""What a user knows: values of base parameters or of the torque gain, and the session of each log."""

from collections.abc import Mapping, Sequence

from ...common.checks import finite_number, one_of
from ...common.errors import SwingupError
from .model import MASSES
from .prediction import LEAST_LAG

KNOWN = {
    "m1r1+m2l1": "k", "m2r2": "m2r2", "I1+I2+m2l1^2": "A", "I2": "B", "Ir": "Ir", "b1": "b1",
    "b2": "b2", "cf1": "cf1", "cf2": "cf2", "gain": "gain1", "delay": "delay", "lag": "lag",
}  # fmt: skip
"""Names that a user gives, and the model's."""


def known_entries(known: Mapping[str, float] | None) -> dict[str, float]:
    """The model's entries that the user knows."""
    entries = {}
    for name, value in (known or {}).items():
        entry = KNOWN[one_of("known value", name.replace(" ", ""), KNOWN)]
        least = 1e-9 if entry in (*MASSES[:4], "gain1") else -0.015 if entry == "delay" else 0.0
        most = {"delay": 0.025, "lag": 0.015}.get(entry, 1e3)
        entries[entry] = max(finite_number(name, value, least, most), LEAST_LAG if entry == "lag" else least)
    return entries


def session_numbers(labels: Sequence[str] | None, logs: int) -> list[int]:
    """The session of each log, counted from 0 in the order in which they first appear."""
    if not labels:
        return [0] * logs
    if len(labels) != logs:
        raise SwingupError(f"{len(labels)} sessions for {logs} logs: give one a log, test logs last")
    order = list(dict.fromkeys(labels))
    return [order.index(label) for label in labels]
