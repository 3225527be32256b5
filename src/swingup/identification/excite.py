"""The search for an excitation: torques within limits, with as much information as a search finds.

Torque sequences of sinusoids are varied and selected for the smallest volume of the parameters' covariance
(D-optimality), averaged over plants drawn from a prior. The torques are played alone, without feedback, so that
nothing but the plant shapes the motion. Each sequence is as strong as angles and speeds allow on all drawn plants;
the result is checked on more of them and on the corners of the prior's ranges.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..checks import finite_number, one_of, whole_number
from ..errors import SwingupError
from ..physics.units import scales_of
from ..plants.domain import Domain
from .excitation import Excitation, Limits, Prospect
from .information import Noise, covariance, information, noise_of, unknowns_of
from .model import SHARED, Unknowns
from .prediction import INDEX, Setting, setting_of
from .prior import corner_models, draw_models, middle_plant
from .reading import TITLES
from .trial import try_out
from .waves import PERIOD, Waves, join_waves, random_waves, torques, varied
from .windows import INTERVAL

JOINTS = {"both": (1.0, 1.0), "shoulder": (1.0, 0.0), "elbow": (0.0, 1.0)}
"""Joints that are driven."""
SHORTEST, LONGEST = 3.0, 60.0
"""Durations (s)."""
SPEED = 20.0
"""Largest speed of a joint (rad/s) on design C.1 if none is given: the public loop stops there. It scales."""
QUANTUM = 3.81e-4
"""Step of an encoder (rad) if none is given: that of design C.1's robot."""

POPULATION, KEPT, GENERATIONS = 16, 5, 6
SEARCH_PLANTS, JUDGED_PLANTS, CHECKED_PLANTS = 5, 2, 64
"""Plants on which the search holds the limits and judges information, and on which the result is checked."""
REPORTED_PLANTS = 8
STRENGTHS = np.geomspace(0.04, 1.0, 8)
"""Multiples of a sequence's torques that the search tries."""
MARGIN = 0.9
"""Part of the limits of angle and speed that the search uses: the check has more plants."""
CALMER = np.linspace(1.0, 0.3, 15)
"""Multiples of the torques that the check tries."""


@dataclass(frozen=True)
class _Search:
    """What all generations share."""

    setting: Setting
    limits: Limits
    duration: float
    own: float
    """Frequency of the pendulum's own swings (Hz)."""
    models: Float[np.ndarray, "plants 15"]
    unknowns: Unknowns
    noise: Noise

    def sequences(self, waves: Waves) -> np.ndarray:
        return torques(waves, self.duration, np.array(self.limits.torque))


def excite(
    domain: Domain,
    duration: float = 10.0,
    joint: str = "both",
    torque: float | None = None,
    speed: float | None = None,
    angle: float = 3.0,
    quantum: float | None = None,
    seed: int = 0,
) -> Excitation:
    """Find an excitation.

    Args:
        domain: ranges of the plant and its loop before it is identified.
        duration: of the excitation (s), 3 to 60; rounded to 0.05 s.
        joint: ``both``, or the one joint that is driven: ``shoulder`` or ``elbow``.
        torque: largest torque (N m); None for that of the motors.
        speed: largest speed of a joint (rad/s); None for 20 rad/s on design C.1, other plants in their own units.
        angle: largest angle of a joint from hanging (rad).
        quantum: step of the encoders (rad); None for the domain's, or 3.81e-4.
        seed: of the search and of the prior's draws; equal seeds give equal excitations.

    Raises:
        SwingupError: an argument makes no sense, or no torque keeps the limits on all plants.
    """
    search = _prepare(domain, duration, joint, torque, speed, angle, quantum, seed)
    waves = _best(search, seed)
    sequence, reached, plants = _checked(search, waves, domain, seed)
    models = draw_models(domain, REPORTED_PLANTS, seed + 1)
    trial = try_out(search.setting, models, sequence[None])
    found = information(search.setting, models, sequence[None], trial, search.unknowns, search.noise)[0]
    return Excitation(
        torque=sequence,
        state=try_out(search.setting, models[:1], sequence[None], PERIOD).states[0, 0],
        limits=search.limits,
        angle=reached[0],
        speed=reached[1],
        plants=plants,
        prospects=_prospects(search.unknowns, found, models),
        quantum=_quantum(domain, quantum),
    )


def _prepare(
    domain: Domain,
    duration: float,
    joint: str,
    torque: float | None,
    speed: float | None,
    angle: float,
    quantum: float | None,
    seed: int,
) -> _Search:
    length = finite_number("duration", duration, SHORTEST, LONGEST, "s")
    driven = JOINTS[one_of("joint", joint, JOINTS)]
    seed = whole_number("seed", seed, 0, 2**32 - 2)
    plant = middle_plant(domain)
    scales = scales_of(plant)
    motors = [min(domain.middle(name), domain.middle("torque_limit")) for name in ("tl1", "tl2")]
    most = [motor if torque is None else finite_number("torque", torque, 1e-6, motor, "N m") for motor in motors]
    limits = Limits(
        torque=(most[0] * driven[0], most[1] * driven[1]),
        speed=SPEED * scales.velocity if speed is None else finite_number("speed", speed, 0.1, 1e3, "rad/s"),
        angle=finite_number("angle", angle, 0.1, 100.0, "rad"),
    )
    setting, models = setting_of(plant).coarse, draw_models(domain, SEARCH_PLANTS, seed)
    gravity = setting.gravity * float(models[0, INDEX["first"]])
    own = 0.75 * scales.velocity
    noise = noise_of(_quantum(domain, quantum), gravity)
    return _Search(
        setting, limits, INTERVAL * round(length / INTERVAL), own, models, unknowns_of(setting, models[0]), noise
    )


def _quantum(domain: Domain, given: float | None) -> float:
    if given is not None:
        return finite_number("quantum", given, 0.0, 0.1, "rad")
    own = [domain.middle(name) for name in ("quantum1", "quantum2") if name in domain.names]
    return max(own) if own else QUANTUM


def _best(search: _Search, seed: int) -> Waves:
    """Vary the best of each generation."""
    random = np.random.default_rng(seed)
    driven = np.array(search.limits.torque) > 0
    waves = random_waves(random, POPULATION, search.own, driven.astype(float))
    waves, scores = _select(search, waves)
    for _ in range(GENERATIONS):
        fresh, more = _select(search, varied(random, waves, POPULATION, search.own))
        waves, scores = join_waves(waves, fresh), np.concatenate([scores, more])
        order = np.argsort(scores, kind="stable")[:KEPT]
        waves, scores = waves.take(order), scores[order]
    return waves.take(np.array([0]))


def _select(search: _Search, waves: Waves) -> tuple[Waves, np.ndarray]:
    """Each member as strong as the limits allow, with its score: the mean log volume of the plant's covariance."""
    count, strengths = len(waves.share), len(STRENGTHS)
    every = waves.take(np.repeat(np.arange(count), strengths)).scaled(np.tile(STRENGTHS, count))
    trial = try_out(search.setting, search.models, search.sequences(every))
    holds = trial.holds(MARGIN * search.limits.angle, MARGIN * search.limits.speed).reshape(count, strengths)
    able = np.flatnonzero(holds.any(axis=1))
    if not len(able):
        raise SwingupError(
            f"no torque keeps all plants within {search.limits.angle:g} rad and {search.limits.speed:g} rad/s: "
            "allow more, or narrow the prior"
        )
    strongest = strengths - 1 - np.argmax(holds[:, ::-1], axis=1)
    chosen = np.arange(count)[able] * strengths + strongest[able]
    # The population keeps its size, so that the programs compile once.
    chosen = chosen[np.arange(count) % len(chosen)]
    kept = every.take(chosen)
    part = replace(trial, states=trial.states[chosen, :JUDGED_PLANTS])
    models = search.models[:JUDGED_PLANTS]
    found = information(search.setting, models, search.sequences(kept), part, search.unknowns, search.noise)
    plant = len(SHARED)
    spread = covariance(search.unknowns, found)[..., :plant, :plant]
    return kept, np.linalg.slogdet(spread)[1].mean(axis=1)


def _checked(
    search: _Search, waves: Waves, domain: Domain, seed: int
) -> tuple[np.ndarray, tuple[float, float], int]:
    """The strongest of some multiples that keeps the limits on many plants, what it reaches, and their number."""
    models = np.concatenate([draw_models(domain, CHECKED_PLANTS, seed + 2), corner_models(domain)])
    sequences = search.sequences(waves.take(np.zeros(len(CALMER), int)).scaled(CALMER))
    trial = try_out(search.setting, models, sequences)
    holds = np.flatnonzero(trial.holds(search.limits.angle, search.limits.speed))
    if not len(holds):
        raise SwingupError(
            f"on {len(models)} plants of {domain.name} motions differ too much to keep {search.limits.angle:g} rad "
            f"and {search.limits.speed:g} rad/s: narrow the prior, or ask for a shorter excitation"
        )
    best = int(holds[0])
    return sequences[best], (float(trial.angle[best].max()), float(trial.speed[best].max())), len(models)


def _prospects(
    unknowns: Unknowns, found: Float[np.ndarray, "plants unknowns unknowns"], models: Float[np.ndarray, "plants 15"]
) -> dict[str, Prospect]:
    spread = np.sqrt(np.diagonal(covariance(unknowns, found), axis1=1, axis2=2)) * unknowns.scale
    prospects = {}
    for place, name in enumerate(unknowns.names[: len(SHARED)]):
        relative = 1.96 * spread[:, place] / np.maximum(np.abs(models[:, INDEX[name]]), 1e-12)
        prospects[TITLES.get(name, name)] = Prospect(float(np.median(relative)), float(relative.max()))
    return prospects
