"""Results of a fit under the names that users see, and domains: of a plant that was identified, or will be.

Estimates have intervals, and notes say what the logs leave open.
"""

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ..common.columns import completed
from ..common.errors import SwingupError
from ..loop.domain import Domain
from ..loop.loop import VALUES
from ..loop.resolve import resolve
from ..plant.base_parameters import BASE_NAMES
from ..plant.plant import ZEROS, Plant
from .conventions import remedy
from .prediction import INDEX, MINIMUM_LAG, NAMES, vector_of
from .recording import Recording
from .regression import AS_IS
from .unknowns import KNOWN_NAMES, MASSES, Problem, Unknowns

TITLES = {"A": "I1 + m2 l1^2", "B": "I2", "m2r2": "m2 r2", "k": "m1 r1 + m2 l1", "gain1": "torque gain"}
"""Names of a model's entries in results; the others keep theirs. Of A, results have what link 1 adds: A - B."""
DEAD_TIME = "delay + lag"
RATIOS = tuple(name for name in BASE_NAMES if name != "k")
"""Entries that a free fall determines only as multiples of m1 r1 + m2 l1."""
SESSION_ENTRIES = (*NAMES[9:12], *NAMES[13:])
"""Entries that each session has: offsets, the gain of both motors, delay and lag."""

LEVEL = 0.95  # probability of an interval
NARROW_INTERVAL = 0.25  # an interval as wide as this part of its value, or narrower, is determined
OFFSET_SIZE = 0.1  # reference for the interval of an offset (rad), whose value may be 0
WIDEST_INTERVAL = (
    f"{100 * NARROW_INTERVAL:g} % of the value, or {1e3 * NARROW_INTERVAL * OFFSET_SIZE:g} mrad of an offset"
)
"""The criterion of determined values in words."""
SCALE_SPREAD = 0.5  # standard deviation of the logarithm of a common factor that no torque fixes
FEW_WINDOWS = 10
NOTABLE_FACTOR = 1.3  # a common factor of the masses that is worth a note
FAR_FACTOR = 2.5
"""A factor of one mass or inertia that is worth a note; the bounds of the fit are 10 times the start's."""

BASE_RANGE = (0.8, 1.2)  # base parameters, as multiples of those that a drawing or a fit of another specimen gives
ROTOR_RANGE = (0.5, 2.5)
FRICTION_RANGE = (0.4, 1.6)
"""Rotors' inertia and Coulomb friction, as multiples. Source: fits of one robot in several sessions."""
MINIMUM_FRICTION = 0.02  # Coulomb friction may reach this part of gravity's torque where the plant has none
USUAL_LATENCY = {"delay": (0.001, 0.006), "lag": (0.001, 0.004)}  # s. Source: fits of recordings.

LATE = 0.012  # delay and lag (s) that no motor's own loop has
BOUND_SHARE = 1e-4  # part of the range between two bounds within which a value is at one of them
BOUND_REASONS = {
    "another unit of a torque, a torque that is not in the log, or another pendulum than --start": (
        *MASSES[:4], "gain1"),
    "a friction or a rotor that the motion does not show, or one that a torque outside of the log makes up for": (
        "b1", "b2", "cf1", "cf2", "Ir"),
    "a zero that is farther off: shift the angle with --columns, as in q1=pos1+0.3": ("offset1", "offset2"),
    "different clocks of motion and torques, or a later loop than the fit allows (a lag at its least is no lag)": (
        "delay", "lag"),
}  # fmt: skip
"""Likely reasons for a value at its bound, and the entries that they are about."""

Interval = tuple[float, float]


@dataclass(frozen=True)
class Estimates:
    """Estimates and intervals by name."""

    values: Mapping[str, float]
    intervals: Mapping[str, Interval]
    determined: Mapping[str, bool]
    """Whether the logs determine a value, for every name; false for those that no log determines."""


def read_solution(
    problem: Problem,
    unknowns: Unknowns,
    z: Float[np.ndarray, "unknowns"],
    draws: Float[np.ndarray, "draws unknowns"],
    seed: int = 0,
) -> Estimates:
    """Read a solution and its draws; the seed draws the common factor, where nothing fixes it."""
    values, spread, places = _entries(unknowns, z), _entries(unknowns, draws), _places(len(unknowns.place))
    found = {name: float(values[place]) for name, place in places.items()}
    sampled = {name: spread[:, *place] for name, place in places.items()}
    free = {name for name, place in places.items() if unknowns.place[place] >= 0}
    if TITLES["B"] in free:
        free.add(TITLES["A"])  # as A - B, also where the user knows A
    for session in range(len(unknowns.place)):
        total, delay, lag = (name + session_tail(session) for name in (DEAD_TIME, "delay", "lag"))
        found[total], sampled[total] = found[delay] + found[lag], sampled[delay] + sampled[lag]
        # The draws let delay and lag exchange beyond their bounds (fit.py), but no lag is below 0.
        sampled[lag] = np.maximum(sampled[lag], 0.0)
        if {delay, lag} & free:
            free.add(total)
    if not problem.has_scale:
        _add_ratios(found, sampled, free, seed)
    ends = [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL]
    intervals = {name: tuple(np.quantile(sampled[name], ends).tolist()) for name in found if name in free}
    sizes = {name: OFFSET_SIZE if name.startswith("offset") else abs(found[name]) for name in intervals}
    determined = {name: high - low <= NARROW_INTERVAL * sizes[name] for name, (low, high) in intervals.items()}
    # Not A: of a known I1 + I2 + m2 l1² results have A - B, which I2 leaves open.
    determined |= {TITLES.get(name, name): True for name in problem.known if name != "A"}
    # Logs determine products of these, and a first session's torque gain is 1 by convention.
    determined |= dict.fromkeys(("m1", "m2", "r1", "r2", "I1"), False)
    determined.setdefault(TITLES["gain1"], False)
    return Estimates(found, intervals, determined)


def _places(sessions: int) -> dict[str, tuple[int, int]]:
    """Session and entry of each name: the plant's once, those of a session with its number."""
    places = {TITLES.get(name, name): (0, INDEX[name]) for name in (*BASE_NAMES, *SESSION_ENTRIES)}
    for session in range(1, sessions):
        places |= {
            TITLES.get(name, name) + session_tail(session): (session, INDEX[name]) for name in SESSION_ENTRIES
        }
    return places


def session_tail(session: int) -> str:
    """What the names of a session's values end in."""
    return f" @{session + 1}" if session else ""


def _entries(unknowns: Unknowns, z: np.ndarray) -> np.ndarray:
    """The models of solutions, with A - B for A."""
    entries = unknowns.models(z)
    entries[..., INDEX["A"]] -= entries[..., INDEX["B"]]
    return entries


def _add_ratios(found: dict[str, float], sampled: dict[str, np.ndarray], free: set[str], seed: int) -> None:
    """Add ratios to m1 r1 + m2 l1, and widen what only its assumed value fixes."""
    first = TITLES["k"]
    # One factor for all: without torques the equations hold as well for an arm of other masses and frictions.
    factor = np.exp(SCALE_SPREAD * np.random.default_rng(seed).normal(size=len(sampled[first])))
    for name in RATIOS:
        title = TITLES.get(name, name)
        ratio = f"({title}) / ({first})"
        found[ratio], sampled[ratio] = found[title] / found[first], sampled[title] / sampled[first]
        free.add(ratio)
        sampled[title] = sampled[title] * factor
    sampled[first] = sampled[first] * factor
    free.add(first)


def make_notes(
    recordings: Sequence[Recording], problem: Problem, estimates: Estimates, fitted: int, judged: int
) -> tuple[str, ...]:
    """Notes for the user, one line each: the warnings of all logs, and what the fit leaves open and why.

    ``fitted`` and ``judged`` are numbers of windows.
    """
    notes = [warning for recording in recordings for warning in recording.warnings]
    if fitted < FEW_WINDOWS:
        notes.append(f"only {fitted} windows have a joint faster than 1 rad/s: the logs determine next to nothing")
    if not judged:
        notes.append("no held-out window has a joint faster than 1 rad/s: there are no errors to report")
    notes.append("of masses and centres of mass, motion determines m1 r1 + m2 l1, m2 r2 and I1 + m2 l1^2 alone")
    notes.append(_scale(problem))
    delay, lag, total = (estimates.determined.get(name, False) for name in ("delay", "lag", DEAD_TIME))
    if total and not (delay and lag):
        notes.append("of delay and lag the logs determine the sum, not the parts")
    unknown = [name for name, sure in estimates.determined.items() if not sure and name in estimates.intervals]
    if unknown:
        notes.append(f"not determined (interval wider than {WIDEST_INTERVAL}): {', '.join(unknown)}")
    return tuple(notes)


def _scale(problem: Problem) -> str:
    if problem.knows_mass:
        masses = ", ".join(TITLES.get(name, name) for name in MASSES if problem.known.get(name))
        return f"the known {masses} fixes the scale"
    if not problem.has_scale:
        return (
            "free fall determines ratios alone: m1 r1 + m2 l1 is the starting plant's (fix one scale with --known, "
            "or add a log with torques)"
        )
    if "gain1" in problem.known:
        return "the known torque gain fixes the scale of masses, inertias and frictions"
    return (
        "masses, inertias and frictions are relative to the torque: if the motors deliver less than the log says, "
        "all are smaller by that factor (fix one scale with --known)"
    )


def mass_notes(problem: Problem, model: Float[np.ndarray, "15"]) -> list[str]:
    """Masses that are far from the starting plant's, all by one factor where torques have another unit."""
    ratios = {name: float(model[INDEX[name]] / problem.start[INDEX[name]]) for name in MASSES[:4]}
    first, second = ratios["k"], ratios["m2r2"]
    # A wrong unit of torque scales all masses alike; unequal factors mean another pendulum.
    factor, unequal = math.sqrt(first * second), max(first / second, second / first)
    notable = unequal <= NOTABLE_FACTOR and not 1 / NOTABLE_FACTOR < factor < NOTABLE_FACTOR
    if notable and problem.driven and not problem.knows_mass:
        columns = replace(AS_IS, torques=np.eye(2) * float(f"{1 / factor:.3g}"))
        recording = next(each for each in problem.recordings if any(each.driven))
        words = completed(remedy(recording, columns), recording.columns)
        return [
            f"all masses are about {factor:.2g} times the starting plant's: if that one is right, the torques are "
            f"{1 / factor:.3g} times those of the log, as before a gear, or as currents: --columns {words}"
        ]
    names = {entry: name for name, entry in KNOWN_NAMES.items()}
    far = {names[entry]: ratio for entry, ratio in ratios.items() if not 1 / FAR_FACTOR < ratio < FAR_FACTOR}
    if not far:
        return []
    factors = ", ".join(f"{name} {ratio:.2g} times" for name, ratio in far.items())
    return [
        f"far from the starting plant's: {factors}; check units, conventions and the length of link 1, which "
        "counts as known: --start gives another, of a file that swingup plant --set l1=... writes"
    ]


def bound_notes(unknowns: Unknowns, z: Float[np.ndarray, "unknowns"]) -> list[str]:
    """A note for the values that end at a bound of the fit, with the likely reason, and one for a late loop."""
    models, notes = unknowns.models(z), list[str]()
    nearest = np.where(z - unknowns.low < unknowns.high - z, unknowns.low, unknowns.high)
    bounds, known = unknowns.models(nearest), {entry: name for name, entry in KNOWN_NAMES.items()}
    at_bound = np.flatnonzero(np.abs(z - nearest) < BOUND_SHARE * (unknowns.high - unknowns.low))
    # Of an entry that the sessions share, the first one's.
    places = [tuple(np.argwhere(unknowns.place == number)[0].tolist()) for number in at_bound]
    for reason, names in BOUND_REASONS.items():
        shown = [
            f"{known.get(NAMES[entry], NAMES[entry])}{session_tail(session)} = {models[session, entry]:.3g} of "
            f"{bounds[session, entry]:.3g}"
            for session, entry in places
            if NAMES[entry] in names
        ]
        if shown:
            notes.append(f"at a bound of the fit: {', '.join(shown)}; likely {reason}")
    late = float(np.max(models[:, INDEX["delay"]] + models[:, INDEX["lag"]]))
    if late > LATE:
        notes.append(
            f"the motion follows its commands {1e3 * late:.0f} ms late, as one that a camera or a slow bus "
            "measures: a controller in this loop has to know it (the domain has it as delay and lag)"
        )
    return notes


def prior_around(facts: Domain) -> Domain:
    """A domain around a plant's facts: as wide as specimens of one design, and sessions of one robot, differ.

    What the facts say of the loop stays, and so do the limits of the motors.
    """
    plant = facts.nominal_plant
    vector = vector_of(plant)
    # Friction's size is not known, but it is small beside gravity's torque.
    torque = plant.g * vector[INDEX["k"]]
    vector[INDEX["A"]] -= vector[INDEX["B"]]
    around = dict.fromkeys(MASSES[:4], BASE_RANGE) | {
        "Ir": ROTOR_RANGE,
        "cf1": FRICTION_RANGE,
        "cf2": FRICTION_RANGE,
    }
    ranges = {name: (low * vector[INDEX[name]], high * vector[INDEX[name]]) for name, (low, high) in around.items()}
    for joint in ("1", "2"):
        low, high = ranges[f"cf{joint}"]
        ranges[f"cf{joint}"] = (min(low, high), max(low, high, MINIMUM_FRICTION * torque))
        damping = vector[INDEX[f"b{joint}"]]
        ranges[f"b{joint}"] = (min(damping, 0.0), max(3 * damping, 0.002 * torque))
    loop = {**USUAL_LATENCY, "offset1": (0.0, 0.0), "offset2": (0.0, 0.0)}
    wide = resolve(domain=domain_of(plant, ranges | loop, {}) | {"plant": plant})
    low, high = (mine._replace(plant=end.plant) for mine, end in ((facts.low, wide.low), (facts.high, wide.high)))
    names = (*wide.names, *(name for name in facts.names if name in VALUES))
    prior = replace(facts, low=low, high=high, plant=plant, name=f"around {facts.name}")
    return replace(resolve(prior, wide), names=tuple(dict.fromkeys(names)), name=prior.name)


def domain_of(plant: Plant, ranges: Mapping[str, Interval], others: Mapping[str, Any]) -> dict[str, Any]:
    """A domain's content: ranges of plant and loop around an identified plant.

    Where corners of wide ranges do not make a pendulum, all ranges are narrowed together until they do. Ranges are
    of the base parameters, ``delay`` and ``lag`` (s); instead of A, of I1 + m2 l1² = A - B. Other entries stay as
    they are: offsets, quanta, torque gains, and where velocities come from.
    """
    for narrowing in (1.0, 0.7, 0.5, 0.3, 0.15):
        content = {**_content(plant, ranges, narrowing), **others}
        with contextlib.suppress(SwingupError):
            resolve(domain=content)
            return content
    content = {**_content(plant, ranges, 0.0), **others}
    resolve(domain=content)
    return content


def _content(p: Plant, ranges: Mapping[str, Interval], narrowing: float) -> dict[str, float | list[float]]:
    first, second, shoulder, elbow = (ranges[name] for name in ("k", "m2r2", "A", "B"))
    weight, inertia = float(p.m2 * p.l1), float(p.m2 * p.l1**2)
    # The masses stay: a range of a base parameter is one of the centre of mass or the inertia.
    spans: dict[str, Interval] = {
        "r1": ((first[0] - weight) / float(p.m1), (first[1] - weight) / float(p.m1)),
        "r2": (second[0] / float(p.m2), second[1] / float(p.m2)),
        "I1": (shoulder[0] - inertia, shoulder[1] - inertia),
        "I2": elbow,
        **{name: ranges[name] for name in ("Ir", "b1", "b2", "cf1", "cf2")},
    }
    kept = ("m1", "m2", "l1", "l2", "gr", "g", *ZEROS)
    content: dict[str, float | list[float]] = {name: float(getattr(p, name)) for name in kept}
    for name, (low, high) in spans.items():
        value = float(getattr(p, name))
        content[name] = [value + narrowing * min(low - value, 0.0), value + narrowing * max(high - value, 0.0)]
    content |= {"tl1": float(p.tl1), "tl2": float(p.tl2)}
    # Measured torques may be later than those that act, which a fit sees as a delay below 0. A loop has none.
    content["delay"] = [max(end, 0.0) for end in ranges["delay"]]
    content["lag"] = [max(end, MINIMUM_LAG) for end in ranges["lag"]]
    return content
