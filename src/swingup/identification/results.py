"""What a fit found, under the names of results: estimates, intervals, and which of them the logs determine."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..plant.base_parameters import BASE_NAMES
from .fit.bootstrap import interval
from .fit.model import Unknowns
from .fit.prediction import INDEX, NAMES

TITLES = {
    "A": "I1 + m2 l1^2",
    "B": "I2",
    "m2r2": "m2 r2",
    "k": "m1 r1 + m2 l1",
    "gain1": "torque gain",
}
"""Names of a model's entries in results; the others keep theirs. Of A, results have what link 1 adds: A - B."""
DEAD_TIME = "delay + lag"
RATIOS = tuple(name for name in BASE_NAMES if name != "k")
"""Entries that a free fall determines only as multiples of m1 r1 + m2 l1."""

NARROW = 0.25
"""An interval as wide as this part of its value, or narrower, is determined."""
OFFSET_SIZE = 0.1
"""What the interval of an offset is measured by (rad): its value may be 0."""
SCALE_SPREAD = 0.5
"""Standard deviation of the logarithm of a common factor that no torque fixes."""

Interval = tuple[float, float]


@dataclass(frozen=True)
class Estimates:
    """Estimates and intervals by name."""

    values: Mapping[str, float]
    intervals: Mapping[str, Interval]
    determined: Mapping[str, bool]
    """Of every name, and of what logs never determine."""


def read_solution(
    unknowns: Unknowns,
    z: Float[np.ndarray, "unknowns"],
    draws: Float[np.ndarray, "draws unknowns"],
    has_scale: bool,
    known: Sequence[str],
    seed: int = 0,
) -> Estimates:
    """Read a solution and its draws.

    Args:
        unknowns: of the fit.
        z: the solution.
        draws: solutions of the bootstrap.
        has_scale: whether a torque or a known value fixes the common factor of masses and torques.
        known: entries that the user knows.
        seed: of the common factor's draws, where nothing fixes it.
    """
    values, spread = _entries(unknowns, z[None])[0], _entries(unknowns, draws)
    places = _places(len(unknowns.place))
    found = {name: float(values[place]) for name, place in places.items()}
    sampled = {name: spread[:, *place] for name, place in places.items()}
    free = {name for name, place in places.items() if unknowns.place[place] >= 0}
    if TITLES["B"] in free:
        free.add(TITLES["A"])  # as A - B, also where the user knows A
    for session in range(len(unknowns.place)):
        tail = _tail(session)
        total, delay, lag = DEAD_TIME + tail, f"delay{tail}", f"lag{tail}"
        found[total], sampled[total] = found[delay] + found[lag], sampled[delay] + sampled[lag]
        sampled[lag] = np.maximum(sampled[lag], 0.0)
        if {delay, lag} & free:
            free.add(total)
    if not has_scale:
        _add_ratios(found, sampled, free, seed)
    intervals = {name: interval(sampled[name]) for name in found if name in free}
    determined = {name: _is_determined(name, found[name], intervals[name]) for name in intervals}
    determined |= {TITLES.get(name, name): True for name in known if name != "A"}
    return Estimates(found, intervals, determined | _never_determined(found, determined))


def _places(sessions: int) -> dict[str, tuple[int, int]]:
    """Session and entry of each name: the plant's once, those of a session with its number."""
    own = (*NAMES[9:12], *NAMES[13:])
    places = {TITLES.get(name, name): (0, INDEX[name]) for name in (*NAMES[:9], *own)}
    for session in range(1, sessions):
        places |= {TITLES.get(name, name) + _tail(session): (session, INDEX[name]) for name in own}
    return places


def _tail(session: int) -> str:
    return f" @{session + 1}" if session else ""


def _entries(unknowns: Unknowns, z: np.ndarray) -> np.ndarray:
    """Models of many solutions, with A - B for A: by solution, session and entry."""
    values = np.pad(unknowns.centre + unknowns.scale * z, ((0, 0), (0, 1)))
    entries: np.ndarray = np.where(unknowns.place >= 0, values[:, unknowns.place], unknowns.fixed)
    entries[..., INDEX["A"]] -= entries[..., INDEX["B"]]
    return entries


def _add_ratios(found: dict[str, float], sampled: dict[str, np.ndarray], free: set[str], seed: int) -> None:
    """Add ratios to m1 r1 + m2 l1, and widen what only its assumed value fixes."""
    first = TITLES["k"]
    factor = np.exp(SCALE_SPREAD * np.random.default_rng(seed).normal(size=len(sampled[first])))
    for name in RATIOS:
        title = TITLES.get(name, name)
        ratio = f"({title}) / ({first})"
        found[ratio], sampled[ratio] = found[title] / found[first], sampled[title] / sampled[first]
        free.add(ratio)
        sampled[title] = sampled[title] * factor
    sampled[first] = sampled[first] * factor
    free.add(first)


def _is_determined(name: str, value: float, found: Interval) -> bool:
    size = OFFSET_SIZE if name.startswith("offset") else abs(value)
    return found[1] - found[0] <= NARROW * size


def _never_determined(found: Mapping[str, float], determined: Mapping[str, bool]) -> dict[str, bool]:
    """Products' factors, and a reference session's torque gain, which is 1 by convention."""
    never = dict.fromkeys(("m1", "m2", "r1", "r2", "I1"), False)
    gain = TITLES["gain1"]
    if gain in found and gain not in determined:
        never[gain] = False
    return never
