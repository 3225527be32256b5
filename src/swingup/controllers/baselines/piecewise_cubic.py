"""Piecewise cubic fits of sampled signals: smooth inside a piece, not continuous at the joins."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.types import Scalar


class PiecewiseCubic(eqx.Module):
    """One cubic per piece for every channel; its value is constant before the first and after the last sample."""

    starts: Float[Any, "pieces"]
    """Time of each piece's first sample (s)."""
    ends: Float[Any, "pieces"]
    """Time of each piece's last sample (s): a time between two pieces belongs to the later one."""
    coefficients: Float[Any, "pieces 4 channels"]
    """Powers 0 to 3 of the time since the piece's start, in its lengths."""

    def __call__(self, t: Scalar) -> Float[Array, "channels"]:
        """The channels' values at time t (s)."""
        starts, ends = jnp.asarray(self.starts), jnp.asarray(self.ends)
        t = jnp.clip(t, starts[0], ends[-1])
        piece = jnp.searchsorted(ends, t)
        s = (t - starts[piece]) / (ends[piece] - starts[piece])
        return jnp.stack([jnp.ones_like(s), s, s * s, s**3]) @ jnp.asarray(self.coefficients)[piece]


def fit_piecewise_cubic(
    time: Float[np.ndarray, "n"], values: Float[np.ndarray, "n channels"], pieces: int
) -> PiecewiseCubic:
    """The least-squares fit; all pieces have the same number of samples, up to one."""
    starts, ends, coefficients = [], [], []
    for t, y in zip(np.array_split(time, pieces), np.array_split(values, pieces), strict=True):
        # Powers of a time from 0 to 1 keep the least squares well conditioned.
        powers = np.vander((t - t[0]) / (t[-1] - t[0]), 4, increasing=True)
        coefficients.append(np.linalg.lstsq(powers, y)[0])
        starts.append(t[0])
        ends.append(t[-1])
    return PiecewiseCubic(np.array(starts), np.array(ends), np.array(coefficients))
