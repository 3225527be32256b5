"""What all fits of an identification share: the logs, their sessions, and what the user knows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...common.checks import finite_number, one_of
from ...common.errors import SwingupError
from ...plant.base_parameters import BASE_NAMES
from ..log.recording import Recording
from .prediction import LEAST_LAG, Integration
from .unknowns import MASSES, Unknowns, expectations, make_unknowns

KNOWN_NAMES = {
    "m1r1+m2l1": "k", "m2r2": "m2r2", "I1+I2+m2l1^2": "A", "I2": "B", "Ir": "Ir", "b1": "b1",
    "b2": "b2", "cf1": "cf1", "cf2": "cf2", "gain": "gain1", "delay": "delay", "lag": "lag",
}  # fmt: skip
"""Names that a user gives, and the model's."""
LATENCY = ("delay", "lag")


@dataclass(frozen=True)
class Problem:
    """What all fits share."""

    setting: Integration
    start: Float[np.ndarray, "15"]
    """The starting plant's model."""
    recordings: Sequence[Recording]
    """Those that are fitted."""
    sessions: Sequence[int]
    """Session of each recording."""
    known: Mapping[str, float]
    """Entries of the model that the user knows."""

    @property
    def driven(self) -> bool:
        """Whether a torque acts in any log."""
        return any(any(recording.driven) for recording in self.recordings)

    @property
    def has_scale(self) -> bool:
        """Whether torques or known values fix the common factor of masses and torques."""
        return self.driven or self.knows_mass

    @property
    def knows_mass(self) -> bool:
        """Whether the user knows a mass: then it fixes the scale, and the torque gain is free."""
        return any(name in self.known for name in MASSES)

    def unknowns(self, plant: bool) -> Unknowns:
        """All unknowns, or those of the loop alone, with the plant as it is."""
        free, expected = [], []
        for session in range(max(self.sessions) + 1):
            logs = [log for log, owner in zip(self.recordings, self.sessions, strict=True) if owner == session]
            driven = [log for log in logs if any(log.driven)]
            free.append(self._free(session, bool(driven), plant))
            expected.append(expectations(self.setting, self.start, all(log.commanded for log in driven)))
        known = self.known if plant else {name: value for name, value in self.known.items() if name in LATENCY}
        return make_unknowns(expected, self.start, free, known, self.sessions)

    def _free(self, session: int, driven: bool, plant: bool) -> list[str]:
        loop = LATENCY if driven else ()
        if not plant:
            return [*loop]
        # Without torques, one base parameter stands for the common factor of all.
        base = [name for name in BASE_NAMES if name != "k" or self.has_scale]
        # The first session's gain is the unit of all masses, unless a known mass is.
        gain = driven and (session > 0 or self.knows_mass)
        return [*base, "offset1", "offset2", *(["gain1"] if gain else []), *loop]


def known_entries(known: Mapping[str, float] | None) -> dict[str, float]:
    """The model's entries that the user knows."""
    entries = {}
    for name, value in (known or {}).items():
        entry = KNOWN_NAMES[one_of("known value", name.replace(" ", ""), KNOWN_NAMES)]
        # Delay and lag within the bounds of the fit (unknowns.py); of other values a sign or a size is wrong.
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
