"""The search for an excitation: a motion within limits, with as much information as a search finds.

Desired motions of sinusoids are varied and selected for the smallest volume of the parameters' covariance
(D-optimality), averaged over plants drawn from a prior. The plant in the middle of the prior follows them by
feedback; its torques and its motion, with the same feedback, are what a robot plays. So other plants move alike.
Each excitation is as strong as angles and speeds allow on all drawn plants; the result is checked on more of them
and on the corners of the prior's ranges.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..checks import finite_number, one_of, whole_number
from ..errors import SwingupError
from ..physics.units import scales_of
from ..plants.domain import Domain
from .excitation import Excitation, Limits, Prospect
from .information import Noise, covariance, information, noise_of, unknowns_of
from .model import SHARED, Unknowns
from .prediction import INDEX, NAMES, Setting, setting_of
from .prior import corner_models, draw_models
from .reading import TITLES
from .trial import Play, try_out
from .waves import Waves, desired, join_waves, random_waves, varied
from .windows import INTERVAL

JOINTS = {"both": (1.0, 1.0), "shoulder": (1.0, 0.0), "elbow": (0.0, 1.0)}
"""Joints that are driven."""
SHORTEST, LONGEST = 3.0, 60.0
"""Durations (s)."""
SPEED = 20.0
"""Largest speed of a joint (rad/s) on design C.1 if none is given: the public loop stops there. It scales."""
QUANTUM = 3.81e-4
"""Step of an encoder (rad) if none is given: that of design C.1's robot."""

POPULATION, KEPT, GENERATIONS = 12, 3, 3
SEARCH_PLANTS, JUDGED_PLANTS, CHECKED_PLANTS = 8, 2, 64
"""Plants on which the search holds the limits and judges information, and on which the result is checked."""
REPORTED_PLANTS = 8
STRENGTHS = np.geomspace(0.1, 1.0, 6)
"""Multiples of a motion that the search tries."""
MARGIN = 0.9
"""Part of the limits of angle and speed that the search uses: the check has more plants."""
CALMER = np.array([1.0, 0.9, 0.8, 0.65, 0.45])
"""Multiples of the motion that the check tries."""
STIFFNESS, DAMPING = 2.0, 0.5
"""Feedback: kp in gravity's torque a radian, and kd in 2 sqrt(kp M) of a joint alone."""


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
    feedback: Float[np.ndarray, "2 2"]
    alone: bool
    """Whether the torques are played without feedback."""

    def play(self, waves: Waves) -> Play:
        """What the plant in the middle needs to follow desired motions, and how it moves then."""
        motion = desired(waves, self.duration, min(self.limits.angle, np.pi))
        limits, rest = np.array(self.limits.torque), np.zeros((*motion.shape[:2], 2))
        found = try_out(self.setting, self.models[:1], Play(rest, motion, self.feedback, limits), keep=True)
        assert found.torque is not None
        feedback = np.zeros((2, 2)) if self.alone else self.feedback
        return Play(found.torque[:, 0], found.states[:, 0], feedback, limits)


def excite(
    domain: Domain,
    duration: float = 10.0,
    joint: str = "both",
    torque: float | None = None,
    speed: float | None = None,
    angle: float = 3.0,
    quantum: float | None = None,
    seed: int = 0,
    alone: bool = False,
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
        alone: whether the torques will be played without feedback; plants that differ then move apart.

    Raises:
        SwingupError: an argument makes no sense, or no motion keeps the limits on all plants.
    """
    limits = _limits(domain, joint, torque, speed, angle)
    search = _prepare(domain, duration, limits, quantum, seed, alone)
    many = np.concatenate([draw_models(domain, CHECKED_PLANTS, seed + 2), corner_models(domain)])
    play, reached = _checked(search, _best(search, seed), many, domain.name)
    models = draw_models(domain, REPORTED_PLANTS, seed + 1)
    trial = try_out(search.setting, models, play, keep=True)
    found = information(search.setting, models, trial, search.unknowns, search.noise)[0]
    return Excitation(
        torque=play.torque[0],
        state=play.reference[0],
        feedback=play.feedback,
        limits=limits,
        angle=reached[0],
        speed=reached[1],
        plants=len(many),
        prospects=_prospects(search.unknowns, found, models),
        quantum=_quantum(domain, quantum),
    )


def _limits(domain: Domain, joint: str, torque: float | None, speed: float | None, angle: float) -> Limits:
    driven = JOINTS[one_of("joint", joint, JOINTS)]
    motors = [min(domain.middle(name), domain.middle("torque_limit")) for name in ("tl1", "tl2")]
    most = [motor if torque is None else finite_number("torque", torque, 1e-6, motor, "N m") for motor in motors]
    usual = SPEED * scales_of(domain.middle_parameters).velocity
    return Limits(
        torque=(most[0] * driven[0], most[1] * driven[1]),
        speed=usual if speed is None else finite_number("speed", speed, 0.1, 1e3, "rad/s"),
        angle=finite_number("angle", angle, 0.1, 100.0, "rad"),
    )


def _prepare(
    domain: Domain, duration: float, limits: Limits, quantum: float | None, seed: int, alone: bool
) -> _Search:
    length = finite_number("duration", duration, SHORTEST, LONGEST, "s")
    seed, plant = whole_number("seed", seed, 0, 2**32 - 3), domain.middle_parameters
    setting, models = setting_of(plant).coarse, draw_models(domain, SEARCH_PLANTS, seed)
    gravity = setting.gravity * float(models[0, INDEX["first"]])
    return _Search(
        setting=setting,
        limits=limits,
        duration=INTERVAL * round(length / INTERVAL),
        own=0.75 * scales_of(plant).velocity,
        models=models,
        unknowns=unknowns_of(setting, models[0]),
        noise=noise_of(_quantum(domain, quantum), gravity),
        feedback=_feedback(setting, models[0], gravity),
        alone=alone,
    )


def _feedback(setting: Setting, model: np.ndarray, gravity: float) -> np.ndarray:
    """Kp and kd of both joints, for the inertia of each while the other is stiff."""
    m = dict(zip(NAMES, model, strict=True))
    elbow = m["elbow"] + setting.gear**2 * m["rotor"]
    inertia = np.array([m["shoulder"] + 2 * setting.l1 * m["second"] + elbow, elbow])
    stiffness = np.full(2, STIFFNESS * gravity)
    return np.stack([stiffness, DAMPING * 2 * np.sqrt(stiffness * inertia)])


def _quantum(domain: Domain, given: float | None) -> float:
    if given is not None:
        return finite_number("quantum", given, 0.0, 0.1, "rad")
    own = [domain.middle(name) for name in ("quantum1", "quantum2") if name in domain.names]
    return max(own) if own else QUANTUM


def _best(search: _Search, seed: int) -> Waves:
    """The best members after some generations, best first."""
    random = np.random.default_rng(seed)
    driven = np.array(search.limits.torque) > 0
    waves = random_waves(random, POPULATION, search.own, driven.astype(float))
    waves, scores = _select(search, waves)
    waves, scores = waves.take(np.argsort(scores)[:KEPT]), np.sort(scores)[:KEPT]
    for _ in range(GENERATIONS):
        fresh, more = _select(search, varied(random, waves, POPULATION, search.own))
        waves, scores = join_waves(waves, fresh), np.concatenate([scores, more])
        order = np.argsort(scores, kind="stable")[:KEPT]
        waves, scores = waves.take(order), scores[order]
    return waves


def _select(search: _Search, waves: Waves) -> tuple[Waves, np.ndarray]:
    """Each member as strong as the limits allow, with its score."""
    count, strengths = len(waves.share), len(STRENGTHS)
    every = waves.take(np.repeat(np.arange(count), strengths)).scaled(np.tile(STRENGTHS, count))
    play = search.play(every)
    trial = try_out(search.setting, search.models, play)
    holds = trial.holds(MARGIN * search.limits.angle, MARGIN * search.limits.speed).reshape(count, strengths)
    able = np.flatnonzero(holds.any(axis=1))
    if not len(able):
        raise SwingupError(
            f"no motion keeps all plants within {search.limits.angle:g} rad and {search.limits.speed:g} rad/s: "
            "allow more, or narrow the prior"
        )
    strongest = strengths - 1 - np.argmax(holds[:, ::-1], axis=1)
    chosen = np.arange(count)[able] * strengths + strongest[able]
    # The population keeps its size, so that the programs compile once.
    chosen = chosen[np.arange(count) % len(chosen)]
    return every.take(chosen), _scores(search, play.take(chosen))


def _scores(search: _Search, play: Play) -> np.ndarray:
    """The mean log volume of the plant's covariance; small is good."""
    models, plant = search.models[:JUDGED_PLANTS], len(SHARED)
    trial = try_out(search.setting, models, play, keep=True)
    found = information(search.setting, models, trial, search.unknowns, search.noise)
    return np.linalg.slogdet(covariance(search.unknowns, found)[..., :plant, :plant])[1].mean(axis=1)


def _checked(search: _Search, waves: Waves, many: np.ndarray, name: str) -> tuple[Play, tuple[float, float]]:
    """The best member, each as strong as the limits allow on many plants; with the angle and speed it reaches."""
    count, strengths = len(waves.share), len(CALMER)
    every = waves.take(np.repeat(np.arange(count), strengths)).scaled(np.tile(CALMER, count))
    play = search.play(every)
    trial = try_out(search.setting, many, play)
    holds = trial.holds(search.limits.angle, search.limits.speed).reshape(count, strengths)
    able = np.flatnonzero(holds.any(axis=1))
    if not len(able):
        raise SwingupError(
            f"{len(many)} plants of {name} move too differently to keep {search.limits.angle:g} rad and "
            f"{search.limits.speed:g} rad/s: narrow the prior, or ask for a shorter excitation"
        )
    chosen = able * strengths + np.argmax(holds, axis=1)[able]
    best = chosen[int(np.argmin(_scores(search, play.take(chosen))))]
    return play.take(np.array([best])), (float(trial.angle[best].max()), float(trial.speed[best].max()))


def _prospects(
    unknowns: Unknowns, found: Float[np.ndarray, "plants unknowns unknowns"], models: Float[np.ndarray, "plants 15"]
) -> dict[str, Prospect]:
    spread = np.sqrt(np.diagonal(covariance(unknowns, found), axis1=1, axis2=2)) * unknowns.scale
    prospects = {}
    for place, name in enumerate(unknowns.names[: len(SHARED)]):
        relative = 1.96 * spread[:, place] / np.maximum(np.abs(models[:, INDEX[name]]), 1e-12)
        prospects[TITLES.get(name, name)] = Prospect(float(np.median(relative)), float(relative.max()))
    return prospects
