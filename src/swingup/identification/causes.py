"""Which one cause explains a log: the momentum balance of a plant in its loop, with one thing wrong at a time.

The change of momentum over 0.1 s is the impulse of all torques (``plant.momentum``), here of smoothed states. For a
plant θ and a loop p, the error of a span is a change of velocity that they leave unexplained,

    e = M(q)⁻¹ (∫ [gain clip(u(t - delay)) - springs - loads - stiction] dt - Y(q - offsets) θ).

A suspect says how the encoders and motors are wired, and which entries of (θ, p) are free; the others keep within
their ordinary spreads. Its evidence is Laplace's approximation of the likelihood of the errors,

    log E = -min over z of (Σ (sqrt(1 + (e / σ)²) - 1) + ½ Σ ((z - centre) / spread)²) - ½ log |H|,

where H is the Hessian in spreads: freedom that the log does not need counts against a suspect. A joint that stands
has whatever friction is needed, up to its most. The delay is the sum of all dead times and lags.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..common.errors import SwingupError
from ..plant.base_parameters import BASE, BASE_NAMES, base_parameters, lumped
from ..plant.equations import ARRAYS, COULOMB_STEEPNESS, STRIBECK_RATE, mass_entries
from ..plant.momentum import momentum_rows
from ..plant.plant import Plant
from .prediction import Integration
from .recording import Recording
from .segments import REACH, clear_of_gaps, cumulative_torque, smooth
from .unknowns import check_masses

STEP = 0.01  # Time between the states from which momenta are taken (s)
SPAN, STRIDE = 10, 5  # Steps over which one equation goes, and between the starts of two
FIRST_SIGMA, MIN_SIGMA = 0.05, 0.01  # Spread of an error before the fit, and at least (rad/s)
ROUNDS = 10
FAR = 300.0  # Evidence below the best in the first fit from which a suspect is left out
STILL = 3.0  # Steps of an encoder within which a joint stands

UNITS = dict(
    zip(BASE_NAMES, ("kg m²", "kg m²", "kg m", "kg m", *["N m s/rad"] * 2, *["N m"] * 2, "kg m²"), strict=True)
)
UNITS |= {
    "offset1": "rad", "offset2": "rad", "gain": "", "delay": "s", "spring1": "N m/rad", "spring2": "N m/rad",
    "load1": "N m", "load2": "N m", "stiction": "", "sag": "N m s/rad", "lost": "", "link1": "", "link2": "",
}  # fmt: skip
"""Units of the entries z: θ, and the loop. The gain is delivered over commanded torque; stiction is a share of the
dry friction; the motors lose torque limit for a rate (sag), and a share of it at once; and both links are heavier
by shares of their masses and inertias."""
NAMES = tuple(UNITS)
INDEX = {name: place for place, name in enumerate(NAMES)}
POSITIVE = ("b1", "b2", "cf1", "cf2", "Ir", "spring1", "spring2", "stiction", "sag", "lost", "delay")
LINEAR = BASE + 6  # Entries whose impulses are linear, springs, loads and both joints' stiction after θ

_SAME, _SWAP = np.eye(2), np.eye(2)[::-1]
_TURN = np.diag([-1.0, 1.0]), np.diag([1.0, -1.0])


class Suspect(NamedTuple):
    """One thing that may be wrong."""

    cause: str  # Several suspects may stand for one cause
    text: str
    free: tuple[str, ...] = ()
    angles: Float[np.ndarray, "2 2"] = _SAME  # From measured angles to true ones
    torques: Float[np.ndarray, "2 2"] = _SAME  # From commanded torques to those that act


NOTHING = Suspect("nothing", "nothing")
SUSPECTS = (
    NOTHING,
    Suspect("joints swapped", "encoders and motors of shoulder and elbow are swapped", (), _SWAP, _SWAP),
    Suspect("joints swapped", "the encoders of shoulder and elbow are swapped", (), _SWAP),
    Suspect("joints swapped", "the motors of shoulder and elbow are swapped", (), _SAME, _SWAP),
    Suspect("encoder 1 reversed", "the shoulder's encoder counts the other way", (), _TURN[0]),
    Suspect("encoder 2 reversed", "the elbow's encoder counts the other way", (), _TURN[1]),
    Suspect("motor reversed", "the shoulder's motor turns the other way", (), _SAME, _TURN[0]),
    Suspect("motor reversed", "the elbow's motor turns the other way", (), _SAME, _TURN[1]),
    Suspect("motor reversed", "both motors turn the other way", (), _SAME, -_SAME),
    Suspect("zero 1", "the shoulder's zero is off", ("offset1",)),
    Suspect("zero 2", "the elbow's zero is off", ("offset2",)),
    Suspect("delay", "torques act later than the policy's loop has it", ("delay",)),
    Suspect("torque constant", "the motors deliver another torque than commanded", ("gain",)),
    Suspect("supply", "the motors saturate below their limits", ("lost",)),
    Suspect("supply", "the motors lose torque with speed", ("sag",)),
    Suspect("friction", "the shoulder's friction is another", ("b1", "cf1")),
    Suspect("friction", "the elbow's friction is another", ("b2", "cf2")),
    Suspect("friction", "the joints stick at rest", ("stiction",)),
    Suspect("spring", "a spring or a cable acts on the shoulder", ("spring1", "load1")),
    Suspect("spring", "a spring or a cable acts on the elbow", ("spring2", "load2")),
    Suspect("mass", "link 1 is heavier or lighter", ("link1",)),
    Suspect("mass", "link 2 is heavier or lighter", ("link2",)),
    Suspect("mass", "the links have other masses or inertias", ("A", "B", "m2r2", "k")),
)


@dataclass(frozen=True)
class Expected:
    """What is expected of a log before it is read."""

    centre: Float[np.ndarray, "entries"]
    ordinary: Float[np.ndarray, "entries"]  # Spreads (1 sigma) of a plant in its loop without a cause
    free: Float[np.ndarray, "entries"]  # Spreads of the entries that a suspect frees
    limits: tuple[float, float]  # Torques of shoulder's and elbow's motor (N m)
    links: Float[np.ndarray, "9 2"]  # θ of each link alone

    def base(self, z: Float[np.ndarray, "entries"]) -> Float[np.ndarray, "9"]:
        """θ with what the links are heavier by."""
        return np.asarray(z[:BASE] + self.links @ z[[INDEX["link1"], INDEX["link2"]]])


@dataclass(frozen=True)
class Explanation:
    """How well one suspect explains a log."""

    suspect: Suspect
    z: Float[np.ndarray, "entries"]
    sigma: Float[np.ndarray, "entries"]  # Standard deviations, 0 of entries that stay
    evidence: float  # log E
    errors: Float[np.ndarray, "spans 2"]  # e (rad/s)

    def text(self, name: str) -> str:
        """A fitted entry with its deviation and unit."""
        place = INDEX[name]
        return f"{self.z[place]:.3g} ± {self.sigma[place]:.1g} {UNITS[name]}".rstrip()


def explain(recording: Recording, setting: Integration, expected: Expected) -> list[Explanation]:
    """The best explanation of each cause that comes near, likeliest first; nothing may be among them."""
    balance = Balance(recording, setting, expected)
    found = [balance.fit(suspect) for suspect in SUSPECTS]
    # Errors of the best explanation are noise: they are the measure of the others'.
    best = max(found, key=lambda each: each.evidence)
    balance.sigma = np.maximum(1.48 * np.median(np.abs(best.errors), axis=0), MIN_SIGMA)
    near = [balance.fit(each.suspect, each.z) for each in found if each.evidence > best.evidence - FAR]
    near.sort(key=lambda each: -each.evidence)
    best_of: dict[str, Explanation] = {}
    for each in near:
        best_of.setdefault(each.suspect.cause, each)
    return list(best_of.values())


def roughness(recording: Recording) -> Float[np.ndarray, "2"]:
    """Root mean square distance of measured angles from smooth motion within 20 ms, less the encoders' own (rad).

    A joint that hits the ends of its play moves faster than the torques on a stiff arm can make it.
    """
    time = recording.time[recording.fresh]
    inside = (time > REACH) & (time < time[-1] - REACH) & clear_of_gaps(recording, time, time)
    distance = recording.q[recording.fresh][inside] - smooth(recording, time[inside])[:, :2]
    rounding = np.asarray(recording.quantum) ** 2 / 12.0
    return np.sqrt(np.maximum(np.mean(distance**2, axis=0) - rounding, 0.0))


class Balance:
    """The momentum balance of one log."""

    def __init__(self, recording: Recording, setting: Integration, expected: Expected) -> None:
        self.recording, self.setting, self.expected = recording, setting, expected
        self.sigma = np.full(2, FIRST_SIGMA)
        self.times = np.arange(REACH, recording.duration - REACH, STEP)
        self.q = smooth(recording, self.times)[:, :2]
        starts = np.arange(0, len(self.times) - 2 - SPAN, STRIDE)
        starts = starts[clear_of_gaps(recording, self.times[starts], self.times[starts + SPAN + 2])]
        if not starts.size:
            least = (SPAN + 2) * STEP + 2.0 * REACH
            raise SwingupError(f"{recording.name} has gaps everywhere: at least {least:.2g} s in a row are needed")
        self.starts = starts
        reach = np.stack([np.ptp(self.q[start : start + SPAN + 2], axis=0) for start in starts])
        self.stands = reach < STILL * np.maximum(np.asarray(recording.quantum), 1e-4)
        self._known: dict[tuple[object, ...], tuple[np.ndarray, ...]] = {}

    def fit(self, suspect: Suspect, z: np.ndarray | None = None) -> Explanation:
        """The explanation of a suspect, by Gauss' and Newton's method with damping, from a position z."""
        self._known.clear()
        expected, places = self.expected, [INDEX[name] for name in suspect.free]
        spread = expected.ordinary.copy()
        spread[places] = expected.free[places]
        active, centre = np.flatnonzero(spread > 0), expected.centre
        scale, z = spread[active], centre if z is None else z
        errors = self.errors(suspect, z)
        cost, damping, weight = self._cost(errors, z, active, scale), 1e-3, STRIDE / SPAN
        for _ in range(ROUNDS):
            slopes = np.stack(
                [self._slope(suspect, z, errors, int(k), h) for k, h in zip(active, scale, strict=True)], -1
            )
            size = weight / np.sqrt(1.0 + (errors / self.sigma) ** 2) / self.sigma**2
            hessian = np.einsum("nja,njb,nj->ab", slopes, slopes, size) + np.eye(len(active))
            slope = np.einsum("nja,nj,nj->a", slopes, size, errors) + (z - centre)[active] / scale
            better = False
            for _ in range(6):
                moved = z.copy()
                moved[active] -= scale * np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), slope)
                moved = _bounded(moved, centre)
                tried = self.errors(suspect, moved)
                after = self._cost(tried, moved, active, scale)
                if after < cost:
                    better = cost - after > 1e-3 + 1e-4 * cost
                    z, errors, cost, damping = moved, tried, after, 0.2 * damping
                    break
                damping = 6.0 * max(damping, 1e-4)
            if not better:
                break
        sigma = np.zeros(len(z))
        sigma[active] = scale * np.sqrt(np.diag(np.linalg.inv(hessian)))
        return Explanation(suspect, z, sigma, -cost - 0.5 * float(np.linalg.slogdet(hessian)[1]), errors)

    def errors(self, suspect: Suspect, z: Float[np.ndarray, "entries"]) -> Float[np.ndarray, "spans 2"]:
        """Changes of velocity that are not explained (rad/s), in measured coordinates."""
        p = dict(zip(NAMES, z.tolist(), strict=True))
        rows, _, cos2 = self._rows(suspect, p["offset1"], p["offset2"])
        (impulse,) = self._impulse(suspect, p["delay"], p["sag"], p["lost"])
        coulomb = z[[INDEX["cf1"], INDEX["cf2"]]]
        loads = [*(p[name] for name in ("spring1", "spring2", "load1", "load2")), *(p["stiction"] * coulomb)]
        net = p["gain"] * impulse - rows @ np.array([*self.expected.base(z), *loads])
        most = coulomb * (1.0 + p["stiction"]) * 0.5 * math.pi * SPAN * STEP
        net = np.where(self.stands, net - np.clip(net, -most, most), net)
        return self._accelerated(suspect, z, net, cos2)

    def _accelerated(self, suspect: Suspect, z: np.ndarray, net: np.ndarray, cos2: np.ndarray) -> np.ndarray:
        m11, m12, m22 = mass_entries(lumped(self.expected.base(z), self.setting.geometry), cos2)
        change = np.stack([m22 * net[:, 0] - m12 * net[:, 1], m11 * net[:, 1] - m12 * net[:, 0]], -1)
        return np.asarray(change / (m11 * m22 - m12 * m12)[:, None] @ suspect.angles)

    def _slope(self, suspect: Suspect, z: np.ndarray, errors: np.ndarray, place: int, spread: float) -> np.ndarray:
        """Derivative of the errors by an entry in its spread."""
        if NAMES[place].startswith("offset"):
            _, tilts, cos2 = self._rows(suspect, z[INDEX["offset1"]], z[INDEX["offset2"]])
            k, second = z[INDEX["k"]], z[INDEX["m2r2"]]
            kappa = [k, second] if NAMES[place] == "offset1" else [0.0, second]
            return self._accelerated(suspect, z, -spread * (tilts @ kappa), cos2)
        moved = z.copy()
        moved[place] += 1e-3 * spread
        return (self.errors(suspect, moved) - errors) / 1e-3

    def _cost(self, errors: np.ndarray, z: np.ndarray, active: np.ndarray, scale: np.ndarray) -> float:
        robust = np.sqrt(1.0 + (errors / self.sigma) ** 2) - 1.0
        distance = (z - self.expected.centre)[active] / scale
        # Spans overlap.
        return float(STRIDE / SPAN * robust.sum() + 0.5 * distance @ distance)

    def _rows(self, suspect: Suspect, offset1: float, offset2: float) -> tuple[np.ndarray, ...]:
        """Impulses of a unit of each linear entry, of each offset's tilt, and cos q2 in the middle of each span."""
        key = "rows", offset1, offset2
        if key not in self._known:
            q = self.q @ suspect.angles.T - [offset1, offset2]
            before, middle, after = ((q[k : len(q) - 2 + k, 0], q[k : len(q) - 2 + k, 1]) for k in range(3))
            centre = self.expected.centre
            ratio = centre[INDEX["m2r2"]] / centre[INDEX["k"]]
            found = momentum_rows(before, middle, after, (STEP, STEP), self.setting.geometry, ratio, ARRAYS)
            rate = (q[2:] - q[:-2]) / (2.0 * STEP)
            rest = np.exp(-((rate / STRIBECK_RATE) ** 2)) * np.arctan(COULOMB_STEEPNESS * rate)
            rows = np.zeros((len(rate), 2, LINEAR + 2))
            for joint, row in enumerate(found):
                rows[:, joint, [*range(BASE), LINEAR, LINEAR + 1]] = np.stack(np.broadcast_arrays(*row), -1)
                for place, loads in enumerate((q[1:-1], np.ones_like(rate), rest)):
                    rows[:, joint, BASE + 2 * place + joint] = loads[:, joint]
            sums = self._summed(rows)
            cos2 = np.cos(q[self.starts + SPAN // 2 + 1, 1])
            self._known[key] = sums[..., :LINEAR], sums[..., LINEAR:], cos2
        return self._known[key]

    def _impulse(self, suspect: Suspect, delay: float, sag: float, lost: float) -> tuple[np.ndarray, ...]:
        """Impulses of the motors."""
        key = "impulse", delay, sag, lost
        if key not in self._known:
            # Mean torques over a step about each state.
            edges = np.append(self.times[1:-1], self.times[-1]) - 0.5 * STEP - delay
            mean = np.diff(cumulative_torque(self.recording, edges), axis=0) / STEP @ suspect.torques.T
            rate = (self.q[2:] - self.q[:-2]) @ suspect.angles.T / (2.0 * STEP)
            sagging = np.where(mean * rate > 0, sag * np.abs(rate), 0.0)
            limits = np.maximum(np.asarray(self.expected.limits) * (1.0 - lost) - sagging, 0.0)
            self._known[key] = (self._summed(np.clip(mean, -limits, limits)),)
        return self._known[key]

    def _summed(self, values: np.ndarray) -> np.ndarray:
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)]) * STEP
        return np.asarray(total[self.starts + SPAN] - total[self.starts])


def _bounded(z: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Entries that a pendulum can have."""
    found = z.copy()
    found[:4] = np.clip(found[:4], 0.1 * centre[:4], 10.0 * centre[:4])
    for name in POSITIVE:
        found[INDEX[name]] = max(found[INDEX[name]], 0.0)
    found[INDEX["gain"]] = np.clip(found[INDEX["gain"]], 0.05, 10.0)
    found[INDEX["lost"]] = min(found[INDEX["lost"]], 0.95)
    for name in ("link1", "link2"):
        found[INDEX[name]] = max(found[INDEX[name]], -0.9)
    return found


def expected_of(plant: Plant, delay: float, limits: tuple[float, float]) -> Expected:
    """What is expected of a plant in a loop whose torques act after ``delay`` (s)."""
    values = dict(zip(BASE_NAMES, base_parameters(plant).tolist(), strict=True)) | {"gain": 1.0, "delay": delay}
    check_masses(values)
    pull = float(plant.g) * values["k"]
    # Friction and speed as the fit measures them (``unknowns.expectations``).
    torque, speed = 0.05 * pull, 2.0 * math.sqrt(float(plant.g) / float(plant.l1 + plant.l2))
    masses = ("A", "B", "m2r2", "k")
    frictions = {"b1": torque / speed, "b2": torque / speed, "cf1": torque, "cf2": torque}
    ordinary = {name: 0.04 * values[name] for name in masses} | {"Ir": 0.3 * values["Ir"]}
    ordinary |= {name: max(0.3 * values[name], 0.25 * size) for name, size in frictions.items()}
    ordinary |= {"offset1": 0.01, "offset2": 0.01, "gain": 0.03, "delay": 0.003}
    free = {name: 0.6 * values[name] for name in masses} | {name: 8.0 * size for name, size in frictions.items()}
    free |= {"offset1": 0.4, "offset2": 0.4, "gain": 0.6, "delay": 0.03, "stiction": 3.0, "lost": 0.6}
    free |= {"spring1": 0.3 * pull, "spring2": 0.3 * pull, "load1": torque, "load2": torque}
    free |= {"sag": max(limits) / speed, "link1": 0.5, "link2": 0.5}
    centre, spreads, wide = (
        np.array([named.get(name, 0.0) for name in NAMES]) for named in (values, ordinary, free)
    )
    lacking = (plant.changed(m1=0.0, I1=0.0), plant.changed(m2=0.0, I2=0.0))
    links = np.stack([base_parameters(plant) - base_parameters(each) for each in lacking], -1)
    return Expected(centre, spreads, wide, limits, links)
