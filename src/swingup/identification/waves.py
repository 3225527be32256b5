"""Desired motions as sums of sinusoids: a population that a search can vary.

    q_j(t) = reach share_j w(t) s_j(t) / max |s_j|,    s_j(t) = Σ_k a_jk sin(2π f_jk t + φ_jk)

w rises from 0 within a moment, is 1, and falls to 0 before the end. Frequencies lie around those of the pendulum's
own swings. Source: Swevers, Ganseman, Tükel, de Schutter and Van Brussel, Optimal robot excitation and
identification (IEEE Transactions on Robotics and Automation 13, 1997).
"""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

PERIOD = 0.002
"""Between rows (s): 500 Hz."""
WAVES = 6
"""Sinusoids of each joint."""
RISE = 0.5
"""Time in which the motion rises and falls (s)."""
REST = 0.05
"""Part of the time at the end at rest."""
BAND = (0.2, 6.0)
"""Frequencies, as multiples of the pendulum's own."""


@dataclass(frozen=True)
class Waves:
    """A population."""

    amplitude: Float[np.ndarray, "count 2 waves"]
    frequency: Float[np.ndarray, "count 2 waves"]
    """Hz"""
    phase: Float[np.ndarray, "count 2 waves"]
    """rad"""
    share: Float[np.ndarray, "count 2"]
    """Of the reach, at most 1; 0 on a joint that is not driven."""

    def take(self, rows: np.ndarray) -> "Waves":
        """Some of the population."""
        return Waves(*(getattr(self, field.name)[rows] for field in fields(self)))

    def scaled(self, factor: Float[np.ndarray, "count"]) -> "Waves":
        """The same with smaller motions."""
        return Waves(self.amplitude, self.frequency, self.phase, self.share * factor[:, None])


def join_waves(first: Waves, second: Waves) -> Waves:
    """Two populations as one."""
    return Waves(*(np.concatenate([getattr(first, f.name), getattr(second, f.name)]) for f in fields(first)))


def random_waves(random: np.random.Generator, count: int, own: float, driven: Float[np.ndarray, "2"]) -> Waves:
    """A population for a pendulum with its ``own`` frequency (Hz).

    Args:
        random: generator.
        count: of excitations.
        own: frequency of small swings (Hz).
        driven: 1 for a joint that is driven, otherwise 0.
    """
    shape = (count, 2, WAVES)
    frequency = own * np.exp(random.uniform(np.log(BAND[0]), np.log(BAND[1]), shape))
    # Accelerations grow with the square of the frequency: some members swing widely, others shake.
    tilt = random.uniform(-2.0, -0.5, (count, 1, 1))
    amplitude = np.exp(0.5 * random.normal(size=shape)) * (frequency / own) ** tilt
    share = np.exp(random.uniform(np.log(0.2), 0.0, (count, 2))) * driven
    return Waves(amplitude, frequency, random.uniform(0, 2 * np.pi, shape), share)


def varied(random: np.random.Generator, waves: Waves, count: int, own: float) -> Waves:
    """Neighbours of a population's members, in turn."""
    base = waves.take(np.arange(count) % len(waves.share))
    shape = base.amplitude.shape
    low, high = own * np.array(BAND)
    return Waves(
        base.amplitude * np.exp(0.3 * random.normal(size=shape)),
        np.clip(base.frequency * np.exp(0.08 * random.normal(size=shape)), low, high),
        base.phase + 0.4 * random.normal(size=shape),
        np.minimum(base.share * np.exp(0.25 * random.normal(size=base.share.shape)), 1.0),
    )


def desired(waves: Waves, duration: float, reach: float) -> Float[np.ndarray, "count rows 4"]:
    """Angles (rad) and velocities (rad/s) of each row."""
    time = PERIOD * np.arange(round(duration / PERIOD))
    angle = 2 * np.pi * waves.frequency[..., None] * time + waves.phase[..., None]
    signal = np.sum(waves.amplitude[..., None] * np.sin(angle), axis=2)
    signal *= reach * waves.share[..., None] * _window(time, duration) / np.abs(signal).max(axis=-1, keepdims=True)
    motion = np.concatenate([signal, np.gradient(signal, PERIOD, axis=-1)], axis=1)
    return np.swapaxes(motion, 1, 2)


def _window(time: np.ndarray, duration: float) -> np.ndarray:
    end = (1.0 - REST) * duration
    part = np.clip(np.minimum(time, end - time) / RISE, 0.0, 1.0)
    window: np.ndarray = 0.5 - 0.5 * np.cos(np.pi * part)
    return window
