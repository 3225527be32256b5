"""A dozen fixed motions, each a sum of sinusoids, from which an excitation is chosen.

    q_j(t) = reach share_j w(t) s_j(t) / max |s_j|,    s_j(t) = Σ_k f_k^tilt sin(2π f_k t + φ_k)

w rises from 0 within a moment, is 1, and falls to 0 before the end. Frequencies lie around those of the pendulum's
own swings, and no frequency drives both joints, so that their motions are unlike. The phases are Schroeder's: the
sum has low peaks. Sources: Swevers, Ganseman, Tükel, de Schutter and Van Brussel, Optimal robot excitation and
identification (IEEE Transactions on Robotics and Automation 13, 1997); Schroeder, Synthesis of low-peak-factor
signals (IEEE Transactions on Information Theory 16, 1970).
"""

import itertools

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
TILTS = (-2.0, -1.5, -1.0, -0.5)
"""Exponents of the amplitudes. Accelerations grow with the square of the frequency: the first motions swing widely,
the last ones shake."""
SHARES = ((1.0, 1.0), (1.0, 0.5), (0.5, 1.0))
"""Parts of the reach for shoulder and elbow."""


def multisines(duration: float, own: float, reach: float, driven: Float[np.ndarray, "2"]) -> np.ndarray:
    """Angles (rad) and velocities (rad/s) of each row of each motion: [motions, rows, 4].

    ``own`` is the frequency of the pendulum's small swings (Hz), ``reach`` the largest angle (rad). A joint moves
    where it is driven (1, otherwise 0).
    """
    time = PERIOD * np.arange(round(duration / PERIOD))
    # Every other frequency is the elbow's.
    relative = np.geomspace(*BAND, 2 * WAVES).reshape(WAVES, 2).T[..., None]
    number = np.arange(WAVES)[:, None]
    waves = np.sin(2 * np.pi * own * relative * time - np.pi * number * (number + 1) / WAVES)
    window = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(time, (1.0 - REST) * duration - time) / RISE, 0.0, 1.0))
    motions = []
    for tilt, share in itertools.product(TILTS, SHARES):
        signal = np.sum(relative**tilt * waves, axis=1)
        signal *= (reach * driven * share)[:, None] * window / np.abs(signal).max(1, keepdims=True)
        motions.append(np.concatenate([signal, np.gradient(signal, PERIOD, axis=1)]).T)
    return np.stack(motions)
