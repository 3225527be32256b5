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

from ..errors import SwingupError
from .excitation import Limits
from .information import Noise, covariance, information
from .model import SHARED, Unknowns
from .prediction import Setting
from .trial import Play, try_out
from .waves import Waves, desired, join_waves, random_waves, varied

POPULATION, KEPT, GENERATIONS = 12, 3, 3
JUDGED_PLANTS = 2
"""Plants on which the search judges information."""
STRENGTHS = np.geomspace(0.1, 1.0, 6)
"""Multiples of a motion that the search tries."""
MARGIN = 0.9
"""Part of the limits of angle and speed that the search uses: the check has more plants."""
CALMER = np.array([1.0, 0.9, 0.8, 0.65, 0.45])
"""Multiples of the motion that the check tries."""


@dataclass(frozen=True)
class Search:
    """What all generations share."""

    setting: Setting
    limits: Limits
    duration: float
    own: float
    """Frequency of the pendulum's own swings (Hz)."""
    models: Float[np.ndarray, "plants 15"]
    """On which the limits must hold; the first is the middle of the prior."""
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


def find_best(search: Search, seed: int) -> Waves:
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


def _select(search: Search, waves: Waves) -> tuple[Waves, np.ndarray]:
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


def _scores(search: Search, play: Play) -> np.ndarray:
    """The mean log volume of the plant's covariance; small is good."""
    models, plant = search.models[:JUDGED_PLANTS], len(SHARED)
    trial = try_out(search.setting, models, play, keep=True)
    found = information(search.setting, models, trial, search.unknowns, search.noise)
    return np.linalg.slogdet(covariance(search.unknowns, found)[..., :plant, :plant])[1].mean(axis=1)


def check_on_many(search: Search, waves: Waves, many: np.ndarray, name: str) -> tuple[Play, tuple[float, float]]:
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
