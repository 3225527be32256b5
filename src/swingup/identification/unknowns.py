"""A fit's problem and unknowns: which entries of the models are free, shared or known, and what is expected.

All sessions share the plant. Offsets, torque gain, delay and lag belong to a session. A free entry is

    value = centre + scale z,

where z is 0 for the starting plant and of the order of 1. The expectation z ~ N(0, spread²) is so weak that a few
seconds of motion outweigh it; it decides only on what the logs leave open, and the intervals show how wide it is.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..common.checks import finite_number, one_of
from ..common.errors import SwingupError
from ..plant.base_parameters import BASE_NAMES
from .prediction import INDEX, MINIMUM_LAG, NAMES, Integration
from .recording import Recording

MASSES = ("A", "B", "m2r2", "k", "Ir")
KNOWN_NAMES = {
    "m1r1+m2l1": "k", "m2r2": "m2r2", "I1+I2+m2l1^2": "A", "I2": "B", "Ir": "Ir", "b1": "b1",
    "b2": "b2", "cf1": "cf1", "cf2": "cf2", "gain": "gain1", "delay": "delay", "lag": "lag",
}  # fmt: skip
"""The model's entries by the names of ``--known``."""
LATENCY = ("delay", "lag")
MINIMUM_DELAY, MAXIMUM_DELAY, MAXIMUM_LAG = -0.015, 0.025, 0.008
"""Bounds of the fit (s). A delay below 0 is possible for measured torques alone, which are late themselves. The
model's memory (:data:`~.prediction.LAG_MEMORY`) would cut a longer lag."""


class Expectation(NamedTuple):
    """The prior of one entry, before any log is read."""

    centre: float
    scale: float
    spread: float  # standard deviation of the expectation, in scales
    low: float
    high: float


@dataclass(frozen=True)
class Unknowns:
    """The vector z of a fit and how the sessions' models follow from it."""

    sessions: Int[np.ndarray, "logs"]  # session of each recording
    entries: Int[np.ndarray, "unknowns"]
    """Place of each unknown in the model's vector; ``gain1`` stands for both gains."""
    place: Int[np.ndarray, "sessions 15"]  # unknown behind each entry of each session's model, or -1
    fixed: Float[np.ndarray, "sessions 15"]  # values of the entries that are not unknown
    centre: Float[np.ndarray, "unknowns"]
    scale: Float[np.ndarray, "unknowns"]
    spread: Float[np.ndarray, "unknowns"]
    low: Float[np.ndarray, "unknowns"]  # bounds of z
    high: Float[np.ndarray, "unknowns"]

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def start(self) -> Float[np.ndarray, "unknowns"]:
        """The position of the starting plant, within the bounds."""
        return np.clip(np.zeros(len(self)), self.low, self.high)

    def models(self, z: Float[np.ndarray, "*draws unknowns"]) -> Float[np.ndarray, "*draws sessions 15"]:
        """The model's vector of each session."""
        # One value more, so that -1 is a place also where nothing is unknown.
        values = np.append(self.centre + self.scale * z, np.zeros((*z.shape[:-1], 1)), axis=-1)
        return np.where(self.place >= 0, values[..., self.place], self.fixed)

    def derivative(self, session: int) -> Float[np.ndarray, "15 unknowns"]:
        """The derivative of a session's model with respect to z."""
        chosen = self.place[session][:, None] == np.arange(len(self))
        return chosen * self.scale

    def position(self, models: Float[np.ndarray, "sessions 15"]) -> Float[np.ndarray, "unknowns"]:
        """The position z of models, within the bounds; of a shared entry, that of the first session."""
        z = np.zeros(len(self))
        for session in reversed(range(len(self.place))):
            free = self.place[session] >= 0
            z[self.place[session][free]] = models[session][free]
        # SciPy's method starts strictly within the bounds.
        inner = 1e-3 * (self.high - self.low)
        return np.clip((z - self.centre) / self.scale, self.low + inner, self.high - inner)


def check_masses(base: Mapping[str, float]) -> None:
    """Refuse a starting plant, by its base parameters, around which nothing can be fitted in proportion."""
    texts = {"A": "I1 + I2 + m2 l1^2", "B": "I2", "m2r2": "m2 r2", "k": "m1 r1 + m2 l1"}
    for name, text in texts.items():
        if not base[name] > 0:
            raise SwingupError(f"the plant to start from has {text} = {base[name]:.3g}: it must be positive")


def expectations(setting: Integration, start: Float[np.ndarray, "15"], commanded: bool) -> dict[str, Expectation]:
    """The priors around a starting plant.

    Friction is measured by the torque of gravity on the shoulder: 5 % of it is Coulomb friction of one scale.
    """
    m = dict(zip(NAMES, start, strict=True))
    check_masses(m)
    geometry = setting.geometry
    torque = 0.05 * geometry.g * m["k"]
    # 2 √(g/l): the speed at the bottom after a fall from upright, of a point on a rod of about the arm's length.
    speed = 2.0 * math.sqrt(geometry.g / (geometry.l1 + m["B"] / m["m2r2"]))
    # Through the gear such a rotor adds a tenth to the elbow's inertia.
    rotor = max(m["Ir"], 0.1 * m["B"] / geometry.gr**2)
    found = {name: Expectation(m[name], m[name], 1.0, 0.1 * m[name], 10.0 * m[name]) for name in MASSES[:4]}
    found["Ir"] = Expectation(m["Ir"], rotor, 2.0, 0.0, m["Ir"] + 10.0 * rotor)
    for joint in ("1", "2"):
        b, cf = m[f"b{joint}"], m[f"cf{joint}"]
        found[f"b{joint}"] = Expectation(b, torque / speed, 2.0, min(b, 0.0), b + 20 * torque / speed)
        found[f"cf{joint}"] = Expectation(cf, torque, 2.0, min(cf, 0.0), cf + 20 * torque)
        found[f"offset{joint}"] = Expectation(0.0, 0.02, 2.5, -0.25, 0.25)
    found["gain1"] = Expectation(1.0, 0.2, 1.5, 0.2, 3.0)
    # Measured torques may be later than those that act.
    middle, minimum = (0.003, 0.0) if commanded else (0.0, MINIMUM_DELAY)
    found["delay"] = Expectation(middle, 0.004, 1.5, minimum, MAXIMUM_DELAY)
    found["lag"] = Expectation(0.0025, 0.002, 1.0, MINIMUM_LAG, MAXIMUM_LAG)
    return found


@dataclass(frozen=True)
class Problem:
    """The data of all fits of one identification."""

    setting: Integration
    start: Float[np.ndarray, "15"]  # the starting plant's model
    recordings: Sequence[Recording]  # those that are fitted
    sessions: Sequence[int]  # session of each recording
    known: Mapping[str, float]  # entries of the model that the user knows

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
        """Whether the user knows a mass: then it fixes the scale, and the torque gain is free.

        A rotor's inertia is a small part of the motion: it fixes the scale where no torques do, if it is not 0.
        """
        return any(self.known.get(name) for name in (MASSES[:4] if self.driven else MASSES))

    @property
    def unit_session(self) -> int:
        """The first session with torques, whose gain is the unit of all masses; 0 without torques."""
        pairs = zip(self.recordings, self.sessions, strict=True)
        return min((session for log, session in pairs if any(log.driven)), default=0)

    def unknowns(self, plant: bool) -> Unknowns:
        """All unknowns, or those of the loop alone; what is neither free nor known has the start's value."""
        known = self.known if plant else {name: value for name, value in self.known.items() if name in LATENCY}
        count, rows, entries = max(self.sessions) + 1, list[Expectation](), list[int]()
        place, fixed = np.full((count, len(NAMES)), -1), np.tile(self.start, (count, 1))
        for name, value in known.items():
            fixed[:, _places(name)] = value
        for session in range(count):
            logs = [log for log, owner in zip(self.recordings, self.sessions, strict=True) if owner == session]
            driven = [log for log in logs if any(log.driven)]
            expected = expectations(self.setting, self.start, all(log.commanded for log in driven))
            for name in self._free(session, bool(driven), plant):
                if name not in known:
                    place[slice(None) if name in BASE_NAMES else session, _places(name)] = len(rows)
                    rows.append(expected[name])
                    entries.append(INDEX[name])
        centre, scale, spread, low, high = np.array(rows).reshape(-1, 5).T
        low, high = (low - centre) / scale, (high - centre) / scale
        owners = np.array(self.sessions, int)
        return Unknowns(owners, np.array(entries, int), place, fixed, centre, scale, spread, low, high)

    def _free(self, session: int, driven: bool, plant: bool) -> list[str]:
        """Unknowns of a session: each has its loop, and the first one the plant that all share."""
        loop = LATENCY if driven else ()
        if not plant:
            return [*loop]
        # Without torques, one base parameter stands for the common factor of all.
        base = [name for name in BASE_NAMES if session == 0 and (name != "k" or self.has_scale)]
        gain = driven and (session != self.unit_session or self.knows_mass)
        return [*base, "offset1", "offset2", *(["gain1"] if gain else []), *loop]


def _places(name: str) -> list[int]:
    """Where an unknown or a known value stands in the model's vector: both motors have one gain."""
    return [INDEX[name], INDEX["gain2"]] if name == "gain1" else [INDEX[name]]


def known_entries(known: Mapping[str, float] | None) -> dict[str, float]:
    """The model's entries that the user knows."""
    entries = {}
    for name, value in (known or {}).items():
        entry = KNOWN_NAMES[one_of("known value", name.replace(" ", ""), KNOWN_NAMES)]
        # Delay and lag within the bounds of the fit; of other values a sign or a size is wrong.
        minimum = 1e-9 if entry in (*MASSES[:4], "gain1") else MINIMUM_DELAY if entry == "delay" else 0.0
        maximum = {"delay": MAXIMUM_DELAY, "lag": MAXIMUM_LAG}.get(entry, 1e3)
        found = finite_number(name, value, minimum, maximum)
        entries[entry] = max(found, MINIMUM_LAG) if entry == "lag" else found
    return entries


def session_numbers(labels: Sequence[str] | None, logs: int) -> list[int]:
    """The session of each log, counted from 0 in the order in which they first appear."""
    if not labels:
        return [0] * logs
    if len(labels) != logs:
        raise SwingupError(f"{len(labels)} sessions for {logs} logs: give one a log, test logs last")
    order = list(dict.fromkeys(labels))
    return [order.index(label) for label in labels]
