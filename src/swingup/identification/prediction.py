"""Open-loop predictions over windows, and their derivatives with respect to the model's parameters.

The plant is its base parameters θ (``plant.base_parameters``), which is all that motion and torques can tell of
masses, centres of mass and inertias. The torque that acts is gain times the command, ``delay`` late, through a
first-order lag:

    lag du/dt = gain command(t - delay) - u.

Angles are measured with constant offsets: q = measured - offset.
"""

import functools
import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common import DISPATCH, cores
from ..dynamics.integrate import implicit_step
from ..plant.base_parameters import BASE_NAMES, Geometry, base_parameters, friction_of, geometry_of, lumped
from ..plant.equations import COULOMB_STEEPNESS
from ..plant.plant import Plant
from .segments import HISTORY, INTERVAL, TORQUE_STEP, Segments

NAMES = (*BASE_NAMES, "offset1", "offset2", "gain1", "gain2", "delay", "lag")
"""Entries of a model's vector, in order: θ, and the loop (rad, s)."""
INDEX = {name: place for place, name in enumerate(NAMES)}

CHUNK = 128
"""Windows that one call of the compiled program predicts; fewer are filled up, so that it compiles once."""
LAG_MEMORY = 0.03  # time that a lag remembers (s)
MINIMUM_LAG = 3e-4  # shortest lag of a model (s)
MAXIMUM_ERROR = 1e3
"""An error that is not finite counts as this (rad, rad/s), and so does a larger one in scores."""


class Integration(NamedTuple):
    """The known geometry of a plant, and how its motion is integrated; hashable, since it is compiled in."""

    geometry: Geometry
    steepness: float  # slope of the smoothed Coulomb friction (s/rad)
    step: float  # step of integration (s); an interval holds a whole number of them

    @property
    def coarse(self) -> "Integration":
        """The integration with steps twice as long, for the first stages of a fit."""
        return self._replace(step=2.0 * self.step)


def integration_of(p: Plant) -> Integration:
    """The setting for a plant: 1 ms on C.1, 0.5 ms on links of 5 cm.

    Speeds of a pendulum grow with sqrt(g / l). The friction's slope is per speed, and steps are per time. With
    steps twice as long, predictions over 0.25 s change by 1e-4 rad, a third of the angles' quantum.
    """
    scale = min(1.0, math.sqrt(float(p.l1 + p.l2) / 0.5 * 9.81 / float(p.g)))
    # A whole number of steps of the torques' grid, whose sums are then exact at both ends of a step.
    step = TORQUE_STEP * min(2, max(1, round(0.001 * scale / TORQUE_STEP)))
    return Integration(geometry_of(p), COULOMB_STEEPNESS * scale, step)


def vector_of(p: Plant, delay: float = 0.004, lag: float = 0.002) -> Float[np.ndarray, "15"]:
    """A model's vector from a plant's parameters, with its zeros as offsets, and gains of 1."""
    return np.append(base_parameters(p), [*p.zeros, 1.0, 1.0, delay, lag])


def in_loop(model: Float[np.ndarray, "15"], values: Mapping[str, float]) -> Float[np.ndarray, "15"]:
    """A model's vector with known values of its loop, by the names of its entries; other names are ignored.

    Offsets of the loop come on top of the plant's zeros.
    """
    changed = model.copy()
    for name in NAMES[len(BASE_NAMES) :]:
        if name in values:
            changed[INDEX[name]] = values[name] + (model[INDEX[name]] if name.startswith("offset") else 0.0)
    changed[INDEX["lag"]] = max(changed[INDEX["lag"]], MINIMUM_LAG)
    return changed


def predict(setting: Integration, model: Float[np.ndarray, "15"], windows: Segments) -> np.ndarray:
    """The windows' states after the start, [windows, outputs, 4], predicted from their first states."""
    return _predicted(setting, False, model, windows)


def predict_with_jacobian(
    setting: Integration, model: Float[np.ndarray, "15"], windows: Segments
) -> tuple[np.ndarray, np.ndarray]:
    """Predictions with derivatives with respect to the model's vector, [windows, outputs, 4, 15]."""
    both = _predicted(setting, True, model, windows)
    return both[..., 0], both[..., 1:]


def _predicted(setting: Integration, derivatives: bool, model: np.ndarray, windows: Segments) -> np.ndarray:
    outputs = len(windows.offsets) - 1
    if not len(windows):
        return np.zeros((0, outputs, 4, 1 + len(NAMES)) if derivatives else (0, outputs, 4))
    program, start = _compiled(setting, outputs, derivatives), windows.states[:, 0]
    (found,) = in_chunks(CHUNK, len(windows), lambda rows: (program(model, start[rows], windows.impulse[rows]),))
    return found


def in_chunks(size: int, count: int, run: Callable[[np.ndarray], Any]) -> list[np.ndarray]:
    """Run a compiled program on ``size`` rows at a time, on a thread for each core; the last chunk is filled up."""

    def part(first: int) -> list[np.ndarray]:
        rows = np.arange(first, first + size)
        with jax.enable_x64(True), DISPATCH:  # 64 bits are a setting of the thread
            found = run(np.where(rows < count, rows, 0))
        return [np.asarray(each)[: count - first] for each in found]

    with ThreadPoolExecutor(cores()) as pool:
        parts = list(pool.map(part, range(0, count, size)))
    return [np.concatenate(each) for each in zip(*parts, strict=True)]


@functools.lru_cache(maxsize=16)
def _compiled(setting: Integration, outputs: int, derivatives: bool) -> Callable[..., Any]:
    rollout = functools.partial(predict_window, setting, outputs)

    def both(model: Array, start: Array, impulse: Array) -> Array:
        # Forwards, since a window has more outputs than the model has entries.
        pushed = functools.partial(jax.jvp, lambda each: rollout(each, start, impulse), (model,))
        states, slopes = jax.vmap(lambda tangent: pushed((tangent,)), out_axes=(None, -1))(jnp.eye(len(NAMES)))
        return jnp.concatenate([states[..., None], slopes], axis=-1)

    return jax.jit(jax.vmap(both if derivatives else rollout, (None, 0, 0)))


def predict_window(setting: Integration, outputs: int, model: Array, start: Array, impulse: Array) -> Array:
    """States at the output times of one window, in measured angles."""
    m = dict(zip(NAMES, model, strict=True))
    plant, friction = lumped(model, setting.geometry), friction_of(model)
    torques = acting_torques(setting, outputs, m["delay"], m["lag"], impulse)
    torques = torques * jnp.stack([m["gain1"], m["gain2"]])
    x = (start[0] - m["offset1"], start[1] - m["offset2"], start[2], start[3])

    def step(x: Any, u: Array) -> Any:
        return implicit_step(plant, friction, x, (u[0], u[1]), setting.step, setting.steepness), None

    def interval(x: Any, u: Array) -> Any:
        x, _ = jax.lax.scan(step, x, u)
        return x, jnp.stack(x)

    _, states = jax.lax.scan(interval, x, torques.reshape(outputs, -1, 2))
    return states + jnp.stack([m["offset1"], m["offset2"], jnp.zeros(()), jnp.zeros(())])


def acting_torques(
    setting: Integration, outputs: int, delay: Array, lag: Array, impulse: Float[Array, "grid 2"]
) -> Float[Array, "steps 2"]:
    """Mean torque of each step (N m): the command, late and through the lag, from its integral on a grid."""
    stride, memory = round(setting.step / TORQUE_STEP), round(LAG_MEMORY / setting.step)
    steps = outputs * round(INTERVAL / setting.step)
    # The first step that is needed starts a memory's length before the window, and a delay earlier.
    shift = (HISTORY - memory * setting.step - delay) / TORQUE_STEP
    whole = jnp.floor(shift)
    part = shift - whole
    length = (steps + memory) * stride + 2
    near = jax.lax.dynamic_slice_in_dim(impulse, whole.astype(jnp.int32), length)
    total = (1.0 - part) * near[:-1] + part * near[1:]
    mean = jnp.diff(total[::stride], axis=0) / setting.step
    # The lag's response to a step of torque, averaged over each of the steps that follow.
    a = setting.step / lag
    after = jnp.exp(-a * jnp.arange(memory))
    weights = jnp.concatenate([(1.0 - (1.0 - jnp.exp(-a)) / a)[None], (1.0 - jnp.exp(-a)) ** 2 / a * after])
    # The response after the memory's end is cut off: without this the mean torque would be too small.
    weights = weights / weights.sum()
    rows = jnp.arange(steps)[:, None] + memory - jnp.arange(memory + 1)
    return jnp.einsum("k,skj->sj", weights, mean[rows])
