"""How well a motion would determine the parameters: Fisher's information of short predictions, as of a fit.

A window starts from the smoothed measurement and lasts 0.25 s. Its errors have three sources: the encoder's steps
at the start and at the outputs, and torques that no model explains: one over the whole window, and one that changes
every 25 ms. With the derivatives J of the outputs with respect to the unknowns (z), the start (x) and these torques
(u),

    R = S + Jx S0 Jxᵀ + Ju T Juᵀ,     information = Σ Jzᵀ R⁻¹ Jz.

With what is expected of z before any log, the covariance of z is (information + diag(1 / spread²))⁻¹.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .model import SHARED, Unknowns, expectations, make_unknowns
from .prediction import Setting, predict_window
from .smoothing import DEGREE, REACH
from .trial import Trial, in_chunks
from .waves import PERIOD
from .windows import FIT_LENGTH, HISTORY, INTERVAL, LEAST_SPEED, TORQUE_STEP, grid_size

OUTPUTS = round(FIT_LENGTH / INTERVAL)
"""States that a window reports; windows do not overlap."""
LEAST_NOISE = (1e-5, 1e-3)
"""Of smoothed angles (rad) and velocities (rad/s): encoders without steps are not perfect."""
UNEXPLAINED = 0.02
"""Standard deviation of torques that no model explains, as a part of gravity's torque on the shoulder. Chosen: with
it, errors of predictions after 0.25 s are those of good fits to recordings of design C.1's robot."""
PIECES = 10
"""Torques that no model explains in a window, for each joint."""
LANES = 16
"""Motions whose information one call of the compiled program computes."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what spoils a prediction."""

    state: tuple[float, float, float, float]
    """Of a smoothed state (rad, rad/s)."""
    torque: float
    """Of an unexplained torque on each joint (N m)."""


def noise_of(quantum: float, gravity: float) -> Noise:
    """The noise for an encoder's step (rad) and the torque of gravity on the shoulder (N m)."""
    rows = np.arange(-round(REACH / PERIOD), round(REACH / PERIOD) + 1) * PERIOD
    powers = (rows / REACH)[:, None] ** np.arange(DEGREE + 1)
    spread = quantum / np.sqrt(12.0) * np.sqrt(np.diag(np.linalg.inv(powers.T @ powers)))
    angle, velocity = max(spread[0], LEAST_NOISE[0]), max(spread[1] / REACH, LEAST_NOISE[1])
    return Noise((angle, angle, velocity, velocity), UNEXPLAINED * gravity)


def unknowns_of(setting: Setting, middle: Float[np.ndarray, "15"]) -> Unknowns:
    """What a fit of one session with torques would not know."""
    free = [*SHARED, "offset1", "offset2", "delay", "lag"]
    return make_unknowns([expectations(setting, middle, commanded=True)], middle, [free], {})


def information(
    setting: Setting,
    models: Float[np.ndarray, "plants 15"],
    trial: Trial,
    unknowns: Unknowns,
    noise: Noise,
) -> Float[np.ndarray, "sequences plants unknowns unknowns"]:
    """The information of each sequence on each plant, from a trial whose torques are kept."""
    assert trial.torque is not None
    states, (sequences, plants) = trial.states[:, :, :: round(INTERVAL / PERIOD)], trial.angle.shape
    every, count = OUTPUTS, (states.shape[2] - 1) // OUTPUTS
    starts = states[:, :, : every * count : every]
    last = states[:, :, 1 : every * count + 1].reshape(*starts.shape[:3], every, 4)
    moving = np.abs(last[..., 2:]).max(axis=(-1, -2)) > LEAST_SPEED
    derivative = unknowns.derivative(0)
    which, whose = np.divmod(np.arange(sequences * plants), plants)
    impulse = _impulses(trial.torque[which, whose], count)
    program = _compiled(setting)
    state, torque = np.square(noise.state), np.full(2 * (1 + PIECES), noise.torque**2)

    def run(rows: np.ndarray) -> Any:
        s, p = which[rows], whose[rows]
        return (program(models[p], derivative, state, torque, starts[s, p], impulse[rows], moving[s, p]),)

    (found,) = in_chunks(LANES, len(which), run)
    return found.reshape(sequences, plants, *found.shape[1:])


def covariance(
    unknowns: Unknowns, found: Float[np.ndarray, "*some unknowns unknowns"]
) -> Float[np.ndarray, "*some unknowns unknowns"]:
    """The covariance of z with what is expected of it."""
    inverse: np.ndarray = np.linalg.inv(np.nan_to_num(found) + np.diag(1.0 / unknowns.spread**2))
    return inverse


def _impulses(torques: np.ndarray, count: int) -> np.ndarray:
    """Integrals of the torques around each window, by motion, window and point of the grid."""
    rows = torques.shape[1]
    total = np.concatenate([np.zeros((len(torques), 1, 2)), PERIOD * np.cumsum(torques, axis=1)], axis=1)
    grid = TORQUE_STEP * np.arange(grid_size(FIT_LENGTH)) - HISTORY
    place = np.clip((FIT_LENGTH * np.arange(count)[:, None] + grid) / PERIOD, 0, rows)
    before = np.minimum(place.astype(int), rows - 1)
    part = (place - before)[..., None]
    impulses: np.ndarray = (1 - part) * total[:, before] + part * total[:, before + 1]
    return impulses


@functools.lru_cache(maxsize=4)
def _compiled(setting: Setting) -> Callable[..., Any]:
    extra = _unexplained()

    def window(
        model: Array, derivative: Array, state: Array, torque: Array, start: Array, impulse: Array, moving: Array
    ) -> Array:
        def outputs(z: Array, x: Array, u: Array) -> Array:
            return predict_window(
                setting, OUTPUTS, model + derivative @ z, start + x, impulse + extra @ u.reshape(-1, 2)
            ).ravel()

        zeros = jnp.zeros(derivative.shape[1]), jnp.zeros(4), jnp.zeros(len(torque))
        by_unknown, by_start, by_torque = jax.jacfwd(outputs, (0, 1, 2))(*zeros)
        spread = jnp.diag(jnp.tile(state, OUTPUTS))
        spread += (by_start * state) @ by_start.T + (by_torque * torque) @ by_torque.T
        return jnp.where(moving, by_unknown.T @ jnp.linalg.solve(spread, by_unknown), 0.0)

    windows = jax.vmap(window, (None, None, None, None, 0, 0, 0))
    return jax.jit(jax.vmap(lambda *each: windows(*each).sum(axis=0), (0, None, None, None, 0, 0, 0)))


def _unexplained() -> Float[np.ndarray, "grid pieces"]:
    """Integrals of a torque of 1 from a window's start on: over the whole window, and over each of its pieces."""
    since = TORQUE_STEP * np.arange(grid_size(FIT_LENGTH)) - HISTORY
    length = FIT_LENGTH / PIECES
    pieces = [np.clip(since - piece * length, 0.0, length) for piece in range(PIECES)]
    return np.stack([np.maximum(since, 0.0), *pieces], axis=1)
