"""States in which episodes begin: a record of how many there are of each kind, and one sampler."""

import functools
import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.types import Key, State
from ..dynamics.dynamics import UPRIGHT, total_energy
from ..dynamics.integrate import rk4_step, rk4_steps, stable_substeps
from ..plant.base_parameters import BASE_NAMES
from ..plant.plant import Plant, Robot
from ..plant.units import STATE, scales_of, similar_plant
from .loop import LOOP_DT
from .supervisors import PID, ROBOT_THROW, ROBOT_THROWER, THROWER, WITHOUT_DERIVATIVE, Thrower, throwing_torque

TURNS = ((0.1, 0.4, 0.4, 0.1), (0.1, 0.8, 0.1))
"""Chosen: probabilities of q1 = -3π, -π, π or 3π and of q2 = -2π, 0 or 2π upright before a throw."""
PASSING = (0.4, 0.5, 2.5, 2.0)  # Standard deviations of states that pass over the top (rad, rad/s)
LARGEST_COST_TO_GO = 1.0  # Largest cost-to-go of a regulator in a state near the top
STILL = 0.7  # Largest angle of the upper link in a state of rest (rad)
EXCESS_ENERGY = 2.0
"""Largest energy of a winnable state above that of upright (J): a controller first has to brake more away."""


@dataclass(frozen=True)
class Starts:
    """Weights of the kinds of states in which episodes begin; sizes are in C.1's units."""

    thrown: float = 0.0  # After throws of the board of global policies
    thrown_on_robot: float = 0.0  # After throws of that board's real robot, which are weaker and longer
    anywhere: float = 0.0  # In any configuration, with velocities of all sizes
    near_top: float = 0.0  # Near upright, where a regulator's cost-to-go is uniform up to LARGEST_COST_TO_GO
    passing: float = 0.0  # On the way over the top, normally distributed about upright with PASSING
    hanging: float = 0.0  # Normally distributed about hanging at rest
    speed: float = 10.0  # Largest standard deviation of the velocities of anywhere (rad/s)
    spread: float = 0.05  # Standard deviation of hanging (rad, rad/s)

    def counts(self, number: int) -> dict[str, int]:
        """How many of a number of states are of each kind, in the order in which the sampler returns them."""
        weights = np.array([getattr(self, kind) for kind in KINDS])
        ends = np.round(number * np.cumsum(weights) / weights.sum()).astype(int)
        return dict(zip(KINDS, np.diff(ends, prepend=0).tolist(), strict=True))


KINDS = ("thrown", "thrown_on_robot", "anywhere", "near_top", "passing", "hanging")
"""Kinds of starts, in the order of the sampler's rows."""


def sample_starts(
    random: np.random.Generator,
    plant: Plant,
    starts: Starts,
    number: int,
    cost_to_go: Float[np.ndarray, "4 4"] | None = None,
) -> Float[np.ndarray, "number 4"]:
    """Draw states (rad, rad/s) in a plant's own units, in the order of :data:`KINDS`; angles are not wrapped.

    The plant has the robot's torque limits. States near the top need the cost-to-go of the plant's regulator.
    """
    counts = starts.counts(number)
    thrown = thrown_states(random, plant, counts["thrown"])
    on_robot = thrown_states(random, plant, counts["thrown_on_robot"], ROBOT_THROWER, ROBOT_THROW)
    anywhere = anywhere_states(random, counts["anywhere"], starts.speed)
    near_top = np.zeros((0, 4)) if cost_to_go is None else _near_top(random, counts["near_top"], cost_to_go)
    passing = UPRIGHT + np.array(PASSING) * random.normal(size=(counts["passing"], 4))
    hanging = starts.spread * random.normal(size=(counts["hanging"], 4))
    assert cost_to_go is not None or not counts["near_top"]
    anywhere, passing, hanging = (
        np.asarray(scales_of(plant).scaled(each, *STATE)) for each in (anywhere, passing, hanging)
    )
    return np.concatenate([thrown, on_robot, anywhere, near_top, passing, hanging])


def thrown_states(
    random: np.random.Generator, plant: Plant, number: int, thrower: Thrower = THROWER, duration: float = 0.2
) -> Float[np.ndarray, "number 4"]:
    """States after throws of an upright pendulum, from which a controller has to recover; in the plant's own units.

    It is the similar pendulum that is thrown: the periods of the PID and of the loop scale here, too. A throw lasts
    for ``duration`` (s), in the time of design C.1.
    """
    if not number:
        return np.zeros((0, 4))
    scales = scales_of(plant)
    similar = similar_plant(plant, scales)
    turns = [random.choice(len(odds), number, p=odds) - len(odds) // 2 for odds in TURNS]
    # Full turns matter: the PID's error is not wrapped.
    upright = np.stack([np.pi * (2 * turns[0] + 1), 2 * np.pi * turns[1]], axis=1)
    x0 = np.concatenate([upright, np.zeros((number, 2))], axis=1) + 0.05 * random.normal(size=(number, 4))
    # Any last error: the throw before it aimed elsewhere, so that the first derivative saturates.
    targets, last = random.uniform(-np.pi, np.pi, (number, 2)), random.uniform(-6.0, 6.0, (number, 2))
    starts = jnp.asarray(targets), jnp.asarray(last), jnp.asarray(x0)
    steps = round(duration / LOOP_DT)
    thrown = np.asarray(_thrown(thrower, similar, *starts, steps, stable_substeps(similar, LOOP_DT)))
    return np.asarray(scales.scaled(thrown, *STATE))


def anywhere_states(random: np.random.Generator, number: int, speed: float) -> Float[np.ndarray, "number 4"]:
    """States in any configuration; the velocities' standard deviation is uniform up to ``speed`` (rad/s)."""
    # Normally distributed velocities of one size would hardly contain slow motions.
    rates = random.uniform(0, speed, (number, 1)) * random.normal(size=(number, 2))
    return np.concatenate([random.uniform(-np.pi, np.pi, (number, 2)), rates], axis=1)


def _near_top(
    random: np.random.Generator, number: int, cost_to_go: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "number 4"]:
    """States about upright whose costs-to-go are uniform up to ``LARGEST_COST_TO_GO``."""
    directions = random.normal(size=(number, 4))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = np.sqrt(LARGEST_COST_TO_GO * random.uniform(size=(number, 1)))
    # With S = L Lᵀ, errors L⁻ᵀ z have the costs zᵀ z.
    errors = np.linalg.solve(np.linalg.cholesky(cost_to_go).T, (sizes * directions).T)
    return UPRIGHT + errors.T


def still_states(
    random: np.random.Generator, base: Float[np.ndarray, "plants 9"], robot: Robot, number: int
) -> Float[np.ndarray, "plants number 4"]:
    """States at rest below, in which a constant torque of the driven joint may hold plants of these θ (rad)."""
    k, m2r2 = (base[:, BASE_NAMES.index(name), None] for name in ("k", "m2r2"))
    shape = len(base), number
    upper = random.uniform(-STILL, STILL, shape)
    # No motor turns the undriven joint: gravity does not either. Its torque there is g m2 r2 sin(q1 + q2), on the
    # shoulder g k sin(q1) more.
    balance = 0.0 if robot.joint == 0 else -np.arcsin(np.clip(k / m2r2 * np.sin(upper), -1.0, 1.0))
    return np.stack([upper, balance - upper, *np.zeros((2, *shape))], axis=-1)


def winnable_states(key: Key, plant: Plant, number: int, steps: int, uniform_share: float) -> Float[Array, "n 4"]:
    """About ``number`` states (rad, rad/s) from which some torque of the elbow leads upright, by up to ``steps``.

    They are found backwards in time, in steps of 10 ms: there the directions that run away from upright draw near
    it, and random torques spread the states over all that can still be held. Some of the paths only ever give
    energy, forwards, and so begin low. For a share ``uniform_share`` of the states the time to upright is uniform,
    for the others its logarithm. States that are too fast are left out.
    """
    keys = jax.random.split(key, 9)
    paths = 4096
    # A quarter of the paths always gives energy where it can, and a quarter never does so on purpose.
    giving = jnp.clip(jax.random.uniform(keys[0], (paths,), minval=-0.5, maxval=1.5), 0.0, 1.0)
    # Torques that last from one step to a hundred: fast swings and slow ones.
    changing = 10.0 ** jax.random.uniform(keys[1], (paths,), minval=-2.0, maxval=0.0)
    strength = jnp.sqrt(jax.random.uniform(keys[2], (paths,)))

    def backwards(carry: tuple[Array, Array], key: Key) -> tuple[tuple[Array, Array], Array]:
        x, level = carry
        change, draw, give = jax.random.split(key, 3)
        drawn = jax.random.uniform(draw, (paths,), minval=-1.0, maxval=1.0)
        level = jnp.where(jax.random.bernoulli(change, changing), drawn, level)
        # At rest the sign of a rate says nothing.
        gives = jax.random.bernoulli(give, giving) & (jnp.abs(x[:, 3]) > 0.5)
        u2 = plant.tl2 * strength * jnp.where(gives, jnp.sign(x[:, 3]), level)
        u = jnp.stack([jnp.zeros(paths), u2], axis=-1)
        x = jax.vmap(lambda x, u: rk4_step(plant, x, u, -0.01))(x, u)
        return (x, level), x

    upright = jnp.array([math.pi, 0.0, 0.0, 0.0])
    begin = upright + 1e-3 * jax.random.normal(keys[3], (paths, 4)), jnp.zeros(paths)
    _, states = jax.lax.scan(backwards, begin, jax.random.split(keys[4], steps))
    log_time = jax.random.uniform(keys[5], (number,), maxval=math.log(steps))
    evenly = jax.random.randint(keys[6], (number,), 0, steps)
    is_even = jax.random.bernoulli(keys[7], uniform_share, (number,))
    times = jnp.where(is_even, evenly, jnp.floor(jnp.exp(log_time)).astype(int) - 1)
    found = states[times, jax.random.randint(keys[8], (number,), 0, paths)]
    energies = jax.vmap(lambda x: total_energy(plant, x))(found)
    return found[energies < total_energy(plant, upright) + EXCESS_ENERGY]


@functools.partial(jax.jit, static_argnums=(5, 6))
@functools.partial(jax.vmap, in_axes=(None, None, 0, 0, 0, None, None))
def _thrown(
    thrower: Thrower,
    plant: Plant,
    target: Float[Array, "2"],
    last: Float[Array, "2"],
    x: State,
    steps: int,
    substeps: int,
) -> State:
    """State after one throw by a PID whose throw before ended with the error ``last``."""

    def step(carry: tuple[State, PID], _: None) -> tuple[tuple[State, PID], None]:
        x, pid = carry
        pid, u = throwing_torque(thrower, plant, pid, target, x)
        return (rk4_steps(plant, x, jnp.clip(u, -thrower.limit, thrower.limit), LOOP_DT, substeps), pid), None

    # Past the first two calls of the run, as in all throws but the first.
    pid = PID(jnp.array(WITHOUT_DERIVATIVE), jnp.zeros_like(last), last)
    (x, _), _ = jax.lax.scan(step, (x, pid), length=steps)
    return x
