"""The least torque limit with which a pendulum swings up in a given time: evolution of torques that switch.

At the least limit a torque is always at one limit or the other: a motion is the times between its switches. On each
of several islands the best few motions survive, and the others are mutants of them, until one comes near upright.
Half of the islands begin with the best of a larger limit, the others with saturated linear feedback. It pumps a
pendulum up with gains that a cross-entropy search finds. Where no island succeeds, the step to the smaller limit
is halved. There may be motions with less torque: the result is an upper bound.

The pendulum is the similar one in C.1's units with a limit of 6 N m throughout: the torque's unit falls, and one
compiled program serves all limits.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.types import Flag, Key, Scalar, State
from ...dynamics.dynamics import UPRIGHT
from ...plant.equations import COULOMB_STEEPNESS
from ...plant.plant import TORQUE_LIMIT, Plant, Robot
from ...plant.units import PLANT_UNITS, scales_of, similar_plant
from .design import design_model
from .transition import PendulumTransition, unpack

STEP = 0.02  # Length of a step in C.1's units (s)
DOWNWARDS, LAST_STEP, UPWARDS = 0.6, 0.95, 1.6  # Factors of the limit: the first one down, the last one, and up
STRONGEST = 20.0  # No limit above this multiple of the motor's is tried
DISTANCE = (1.0, 1.0, 0.05, 0.05)  # Weights of a squared distance from upright, in C.1's units
NEAR = 0.02  # Squared distance that counts as upright: 0.1 rad in both joints
KICK = 10  # Steps of a law's first torque, without which it would hang for ever
LAW = (6.0, 6.0, 1.2, 1.2, 6.0)  # Sizes of gains (N m/rad, N m s/rad) and of the first torque (N m)
PIECES, LAST_PIECES = 24, 20.0  # Times between switches; length of those that a law lacks (steps)
LEAST_CHANGE, LARGEST_CHANGE = np.log(0.003), np.log(0.3)  # Of the relative spread of mutants


class Effort(NamedTuple):
    """How long the search is at a limit."""

    generations: int = 40  # Of motions
    islands: int = 16
    members: int = 128  # Of an island
    survivors: int = 4
    laws: int = 2048  # In a generation of laws, of which five make one search


EFFORT = Effort()
LAW_GENERATIONS, KEPT_LAWS = 5, 64


def least_torque(plant: Plant, robot: Robot, within: float, effort: Effort = EFFORT) -> float | None:
    """The least torque limit (N m) of a robot's motor that swings up within a time (s); None where none was found.

    The driven joint's Coulomb friction is added; the passive joint's is left out.
    """
    model = design_model(plant, robot)
    scales = scales_of(model)
    duration = within / scales.time
    steps = max(100, round(duration / STEP))
    search = _Search(similar_plant(model, scales), robot.joint, steps, duration / steps, effort)
    with jax.enable_x64(True):
        level = search.least_level()
    if level is None:
        return None
    friction = float((plant.cf1, plant.cf2)[robot.joint]) * np.arctan(COULOMB_STEEPNESS)
    return level * float(model.limit(robot.joint)) + float(friction)


class _Search:
    """A search over limits, which are shares of the motor's."""

    def __init__(self, similar: Plant, joint: int, steps: int, dt: float, effort: Effort) -> None:
        self.similar, self.joint, self.steps, self.dt, self.effort = similar, joint, steps, dt, effort
        self.random = np.random.default_rng(0)
        self.laws = np.zeros((0, len(LAW)))

    def least_level(self) -> float | None:
        """The least limit with which a motion came up; None where none did."""
        level, factor = 1.0, DOWNWARDS
        while (found := self.came_up(level, np.zeros((0, PIECES)))) is None:
            level *= UPWARDS
            if level > STRONGEST:
                return None
        while factor < LAST_STEP:
            if (lower := self.came_up(level * factor, found)) is None:
                factor = factor**0.5
            else:
                level, found = level * factor, lower
        return level

    def plant(self, level: float) -> Plant:
        """The plant whose torques are as weak as at a limit."""
        changes = {name: getattr(self.similar, name) / level**unit.torque for name, unit in PLANT_UNITS.items()}
        changes |= dict.fromkeys(("tl1", "tl2"), TORQUE_LIMIT)
        return jax.tree.map(jnp.asarray, self.similar.changed(**changes))

    def came_up(
        self, level: float, known: Float[np.ndarray, "known pieces"]
    ) -> Float[np.ndarray, "n pieces"] | None:
        """The motions of each island's best at a limit, the best island first; None where none comes up."""
        effort, plant = self.effort, self.plant(level)
        fresh = self.pumped(plant)
        first = np.concatenate([known[: effort.islands // 2], fresh])[: effort.islands]
        start = np.repeat(np.resize(first, (effort.islands, 1, PIECES)), effort.members, axis=1)
        key = jax.random.key(int(self.random.integers(2**31)))
        distances, best = _evolve(plant, self.joint, self.dt, jnp.asarray(start), key, self.steps, effort)
        order = np.asarray(distances).argsort()
        return np.asarray(best)[order] if distances[order[0]] < NEAR else None

    def pumped(self, plant: Plant) -> Float[np.ndarray, "laws pieces"]:
        """The switches of the laws that come nearest to upright, after some generations."""
        number, half = self.effort.laws, self.effort.laws // 2
        for _ in range(LAW_GENERATIONS):
            size = 10 ** self.random.uniform(-0.7, 0.7, (number, 1))
            kick = self.random.choice([-1, 1], number) * self.random.uniform(0.1, 1.0, number)
            drawn = np.column_stack([size * self.random.normal(size=(number, 4)), kick]) * LAW
            if len(self.laws):
                near = np.resize(self.laws, (half, len(LAW))) * self.random.normal(1.0, 0.2, (half, len(LAW)))
                drawn = np.concatenate([self.laws, near, drawn])[:number]
            distances, torques = _pump(plant, self.joint, self.dt, jnp.asarray(drawn), self.steps)
            best = np.asarray(distances).argsort()[:KEPT_LAWS]
            self.laws = drawn[best]
        return np.stack([switches(row) for row in np.asarray(torques)[best]])


def switches(torques: Float[np.ndarray, "steps"]) -> Float[np.ndarray, "pieces"]:
    """Steps between the changes of a torque's sign. The first sign is lost: the mirrored motion is as good."""
    signs = np.sign(torques[torques != 0.0])
    ends = np.append(np.flatnonzero(np.diff(signs)) + 1, len(signs))
    lengths = np.diff(ends, prepend=0).astype(np.float64)[:PIECES]
    return np.append(lengths, np.full(PIECES - len(lengths), LAST_PIECES))


def _distance(
    transition: PendulumTransition, torque_of: Callable[[State, Scalar], Scalar], rows: Float[Array, "steps"]
) -> tuple[Scalar, Float[Array, "steps"]]:
    """The least distance from upright of a motion from rest, and its torques."""

    def step(carry: tuple[State, Scalar], row: Scalar) -> tuple[tuple[State, Scalar], Scalar]:
        x, least = carry
        torque = torque_of(x, row)
        x = jnp.stack(transition.step(unpack(x), torque))
        # The mirrored motion comes up on the other side.
        distances = jnp.stack([x - UPRIGHT, x + UPRIGHT]) ** 2 @ jnp.array(DISTANCE)
        return (x, jnp.minimum(least, distances.min())), torque

    (_, least), torques = jax.lax.scan(step, (jnp.zeros(4), jnp.array(jnp.inf)), rows)
    # A motion that diverges must not end the search: NaN is no least.
    return jnp.where(jnp.isfinite(least), least, jnp.inf), torques


@eqx.filter_jit
def _pump(
    plant: Plant, joint: int, dt: float, laws: Float[Array, "laws 5"], steps: int
) -> tuple[Float[Array, "laws"], Float[Array, "laws steps"]]:
    """The least distance from upright of each law's motion, and its torques."""
    transition = PendulumTransition(plant, joint, dt, exact=False)

    def motion(law: Float[Array, "5"]) -> tuple[Scalar, Float[Array, "steps"]]:
        def torque_of(x: State, row: Scalar) -> Scalar:
            return jnp.clip(x @ law[:4] + law[4] * (row < KICK), -TORQUE_LIMIT, TORQUE_LIMIT)

        return _distance(transition, torque_of, jnp.arange(steps))

    return jax.vmap(motion)(laws)


@eqx.filter_jit
def _evolve(
    plant: Plant,
    joint: int,
    dt: float,
    members: Float[Array, "islands members pieces"],
    key: Key,
    steps: int,
    effort: Effort,
) -> tuple[Float[Array, "islands"], Float[Array, "islands pieces"]]:
    """Each island's best motion with its distance, once one comes up or after all generations."""
    transition = PendulumTransition(plant, joint, dt, exact=False)
    shape = islands, number, pieces = members.shape
    signs, edges = TORQUE_LIMIT * jnp.array([1.0, -1.0] * (pieces // 2)), jnp.arange(steps + 1.0)

    def distance(lengths: Float[Array, "pieces"]) -> Scalar:
        ends, sums = (jnp.cumsum(jnp.append(0.0, each)) for each in (lengths, signs * lengths))
        # A step in which the torque changes has its mean.
        return _distance(transition, lambda _, torque: torque, jnp.diff(jnp.interp(edges, ends, sums)))[0]

    def goes_on(carry: tuple[Any, ...]) -> Flag:
        generation, _, _, distances = carry
        return (generation < effort.generations) & jnp.all(distances >= NEAR)

    def advance(carry: tuple[Any, ...]) -> tuple[Any, ...]:
        generation, key, members, _ = carry
        key, parent, some, size, change = jax.random.split(key, 5)
        found = jax.vmap(jax.vmap(distance))(members)
        order = jnp.argsort(found, axis=1)[:, : effort.survivors]
        best = jnp.take_along_axis(members, order[..., None], axis=1)
        parents = jax.random.randint(parent, shape[:2], 0, effort.survivors)
        sizes = jnp.exp(jax.random.uniform(size, (islands, number, 1), minval=LEAST_CHANGE, maxval=LARGEST_CHANGE))
        share, chance = jnp.split(jax.random.uniform(some, (islands, number, pieces + 1)), [1], axis=2)
        changes = jnp.where(chance < share, sizes * jax.random.normal(change, shape), 0.0)
        mutants = jnp.take_along_axis(best, parents[..., None], axis=1) * jnp.exp(changes)
        return generation + 1, key, mutants.at[:, : effort.survivors].set(best), found.min(axis=1)

    start = (jnp.array(0), key, members, jnp.full(islands, jnp.inf))
    _, _, members, distances = jax.lax.while_loop(goes_on, advance, start)
    return distances, members[:, 0]
