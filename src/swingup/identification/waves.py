"""Excitations as sums of sinusoids: a population of torque sequences that a search can vary.

    u_j(t) = limit_j share_j w(t) s_j(t) / max |s_j|,    s_j(t) = Σ_k a_jk sin(2π f_jk t + φ_jk)

w rises from 0 within a moment, is 1, and falls to 0 before the end: there the pendulum swings freely, which shows
its friction. Frequencies lie around those of the pendulum's own swings. Source: Swevers, Ganseman, Tükel, de
Schutter and Van Brussel, Optimal robot excitation and identification (IEEE Transactions on Robotics and Automation
13, 1997).
"""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

PERIOD = 0.002
"""Between rows (s): 500 Hz."""
WAVES = 6
"""Sinusoids of each joint."""
RISE = 0.5
"""Time in which the torques rise and fall (s)."""
FREE = 0.15
"""Part of the time at the end without torque."""
BAND = (0.2, 4.0)
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
    """Of the torque limits, at most 1; 0 on a joint that is not driven."""

    def take(self, rows: np.ndarray) -> "Waves":
        """Some of the population."""
        return Waves(*(getattr(self, field.name)[rows] for field in fields(self)))

    def scaled(self, factor: Float[np.ndarray, "count"]) -> "Waves":
        """The same with smaller torques."""
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
    # Slow waves get larger amplitudes, as slow swings need them.
    amplitude = np.exp(0.5 * random.normal(size=shape)) * np.sqrt(own / frequency)
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


def torques(waves: Waves, duration: float, limits: Float[np.ndarray, "2"]) -> Float[np.ndarray, "count rows 2"]:
    """The torques of each row (N m)."""
    time = PERIOD * np.arange(round(duration / PERIOD))
    angle = 2 * np.pi * waves.frequency[..., None] * time + waves.phase[..., None]
    signal = np.sum(waves.amplitude[..., None] * np.sin(angle), axis=2)
    signal /= np.abs(signal).max(axis=-1, keepdims=True)
    signal *= waves.share[..., None] * np.asarray(limits)[:, None] * _window(time, duration)
    # Without the sign of zeros.
    return np.swapaxes(signal, 1, 2) + 0.0


def _window(time: np.ndarray, duration: float) -> np.ndarray:
    end = (1.0 - FREE) * duration
    part = np.clip(np.minimum(time, end - time) / RISE, 0.0, 1.0)
    window: np.ndarray = 0.5 - 0.5 * np.cos(np.pi * part)
    return window
