"""The unknowns of a fit: which entries of the sessions' models are free, shared or known, and what is expected.

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

from ...plant.base_parameters import BASE_NAMES
from .prediction import INDEX, LEAST_LAG, NAMES, Integration

MASSES = ("A", "B", "m2r2", "k", "Ir")


class Expectation(NamedTuple):
    """What is expected of one entry before any log is read."""

    centre: float
    scale: float
    spread: float
    """Standard deviation of the expectation, in scales."""
    low: float
    high: float


@dataclass(frozen=True)
class Unknowns:
    """The vector z of a fit and how the sessions' models follow from it."""

    sessions: Int[np.ndarray, "logs"]
    """Session of each recording."""
    entries: Int[np.ndarray, "unknowns"]
    """Place of each unknown in the model's vector; ``gain1`` stands for both gains."""
    place: Int[np.ndarray, "sessions 15"]
    """Unknown behind each entry of each session's model, or -1."""
    fixed: Float[np.ndarray, "sessions 15"]
    """Values of the entries that are not unknown."""
    centre: Float[np.ndarray, "unknowns"]
    scale: Float[np.ndarray, "unknowns"]
    spread: Float[np.ndarray, "unknowns"]
    low: Float[np.ndarray, "unknowns"]
    """Bounds of z."""
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


def expectations(setting: Integration, start: Float[np.ndarray, "15"], commanded: bool) -> dict[str, Expectation]:
    """What is expected around a starting plant.

    Friction is measured by the torque of gravity on the shoulder: 5 % of it is Coulomb friction of one scale.
    """
    m = dict(zip(NAMES, start, strict=True))
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
    found["delay"] = Expectation(0.003 if commanded else 0.0, 0.004, 1.5, 0.0 if commanded else -0.015, 0.025)
    found["lag"] = Expectation(0.0025, 0.002, 1.0, LEAST_LAG, 0.015)
    return found


def make_unknowns(
    expected: Sequence[Mapping[str, Expectation]],
    start: Float[np.ndarray, "15"],
    free: Sequence[Sequence[str]],
    known: Mapping[str, float],
    sessions: Sequence[int],
) -> Unknowns:
    """The unknowns of several sessions.

    Expectations and free entries are those of each session; those of the plant count in the first one. What is
    neither free nor known has the start's value.
    """
    rows: list[Expectation] = []
    entries: list[int] = []
    place, fixed = np.full((len(free), len(NAMES)), -1), np.tile(start, (len(free), 1))
    for name, value in known.items():
        fixed[:, _places(name)] = value
    for session, names in enumerate(free):
        for name in names:
            # The plant is the same in all sessions: the first one brings it.
            if name in known or (name in BASE_NAMES and session > 0):
                continue
            place[slice(None) if name in BASE_NAMES else session, _places(name)] = len(rows)
            rows.append(expected[session][name])
            entries.append(INDEX[name])
    centre, scale, spread, low, high = np.array(rows).reshape(-1, 5).T
    low, high = (low - centre) / scale, (high - centre) / scale
    owners = np.array(sessions, int)
    return Unknowns(owners, np.array(entries, int), place, fixed, centre, scale, spread, low, high)


def _places(name: str) -> list[int]:
    """Where an unknown or a known value stands in the model's vector: both motors have one gain."""
    return [INDEX[name], INDEX["gain2"]] if name == "gain1" else [INDEX[name]]
