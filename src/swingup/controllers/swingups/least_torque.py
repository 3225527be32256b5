"""The least torque limit with which a pendulum swings up in a given time, by feedback laws and iterative LQR.

Saturated linear feedback with random gains pumps a pendulum up. A cross-entropy search finds gains whose motions
come near upright. Their torques are first guesses for iterative LQR, and so is each success for a smaller limit;
where that fails, the step is halved. A limit counts where the motion ends near upright. There may be motions with
less torque: the result is an upper bound. The pendulum is the similar one in C.1's units with a limit of 6 N m
throughout: the torque's unit falls, and one compiled program serves all limits.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...dynamics.dynamics import UPRIGHT, upright_error
from ...plant.equations import COULOMB_STEEPNESS
from ...plant.plant import TORQUE_LIMIT, Plant, Robot
from ...plant.units import PLANT_UNITS, scales_of, similar_plant
from .design import TrackingWeights, design_model, solve_from_rest
from .ilqr import ILQRSettings
from .transition import PendulumTransition, unpack

STEP = 0.02  # Length of a step in C.1's units (s)
DOWNWARDS, LAST_STEP, UPWARDS = 0.6, 0.95, 1.6  # Factors of the limit: the first one down, the last one, and up
STRONGEST = 20.0  # No limit above this multiple of the motor's is tried
NEAR = (0.1, 0.1, 1.0, 1.0)  # Largest errors at the end, in C.1's units (rad, rad/s)
DISTANCE = (1.0, 1.0, 0.05, 0.05)  # Weights of a squared distance from upright
KICK = 10  # Steps of a law's first torque, without which it would hang for ever
LAW = (6.0, 6.0, 1.2, 1.2, 6.0)  # Sizes of gains (N m/rad, N m s/rad) and of the first torque (N m)
_WEIGHTS = TrackingWeights(state=(0.0, 0.0, 1e-3, 1e-3), torque=0.01, final=(100.0, 100.0, 10.0, 10.0))
_SETTINGS = ILQRSettings(
    max_iterations=300,
    tolerance=1e-4,
    regularisation=1e-2,
    min_regularisation=1e-8,
    max_regularisation=1e8,
    torque_limit=TORQUE_LIMIT,
    decrease=0.5,
    increase=3.0,
    step_sizes=(1.0, 0.3, 0.1, 0.03),
)


class Effort(NamedTuple):
    """How long the search is."""

    starts: int = 16  # Motions that are optimised at a limit
    tries: int = 2  # At each limit
    generations: int = 5  # Of laws before each try
    laws: int = 2048  # In a generation
    kept: int = 64  # Laws from which the next generation is drawn


EFFORT = Effort()


def least_torque(plant: Plant, robot: Robot, within: float, effort: Effort = EFFORT) -> float | None:
    """The least torque limit (N m) of a robot's motor that swings up within a time (s); None where none was found.

    The driven joint's Coulomb friction is added; the passive joint's is left out.
    """
    model = design_model(plant, robot)
    scales = scales_of(model)
    duration = within / scales.time
    steps = max(100, min(600, round(duration / STEP)))
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
        self.elite = np.zeros((0, len(LAW)))

    def least_level(self) -> float | None:
        """The least limit with which a motion came up; None where none did."""
        level, count = 1.0, self.effort.starts // 2
        while not len(best := self.came_up(level, self.pumped(level)[: self.effort.starts])):
            level *= UPWARDS
            if level > STRONGEST:
                return None
        factor = DOWNWARDS
        while factor < LAST_STEP:
            for _ in range(self.effort.tries):
                # Some go on as they were, with stronger or weaker swings.
                known = np.resize(best, (count, self.steps)) / factor
                known[len(best) :] *= self.random.uniform(0.9, 1.1, (max(0, count - len(best)), 1))
                fresh = self.pumped(level * factor)[:count]
                if len(found := self.came_up(level * factor, np.concatenate([known, fresh]))):
                    level, best = level * factor, found
                    break
            else:
                factor = factor**0.5
        return level

    def plant(self, level: float) -> Plant:
        """The plant whose torques are as weak as at a limit."""
        changes = {name: getattr(self.similar, name) / level**unit.torque for name, unit in PLANT_UNITS.items()}
        changes |= dict.fromkeys(("tl1", "tl2"), TORQUE_LIMIT)
        return jax.tree.map(jnp.asarray, self.similar.changed(**changes))

    def pumped(self, level: float) -> Float[np.ndarray, "kept steps"]:
        """Torques of the laws that come nearest to upright at a limit, after some generations."""
        laws, half, plant = self.effort.laws, self.effort.laws // 2, self.plant(level)
        for _ in range(self.effort.generations):
            size = 10 ** self.random.uniform(-0.7, 0.7, (laws, 1))
            kick = self.random.choice([-1, 1], laws) * self.random.uniform(0.1, 1.0, laws)
            drawn = np.column_stack([size * self.random.normal(size=(laws, 4)), kick]) * LAW
            if len(self.elite):
                near = np.resize(self.elite, (half, len(LAW))) * self.random.normal(1.0, 0.2, (half, len(LAW)))
                drawn = np.concatenate([self.elite, near, drawn])[:laws]
            distances, torques = _pump(plant, self.joint, self.dt, jnp.asarray(drawn), self.steps)
            best = np.asarray(distances).argsort()[: self.effort.kept]
            self.elite = drawn[best]
        return np.asarray(torques)[best]

    def came_up(self, level: float, torques: Float[np.ndarray, "starts steps"]) -> Float[np.ndarray, "found steps"]:
        """Optimised torques at a limit, those that end near upright."""
        guesses = jnp.asarray(torques.clip(-TORQUE_LIMIT, TORQUE_LIMIT))
        ends, kept = map(np.asarray, _solve(self.plant(level), self.joint, self.dt, guesses))
        rows: np.ndarray = kept[(np.abs(upright_error(ends)) < NEAR).all(axis=1)]
        return rows


@eqx.filter_jit
def _pump(
    plant: Plant, joint: int, dt: float, laws: Float[Array, "laws 5"], steps: int
) -> tuple[Float[Array, "laws"], Float[Array, "laws steps"]]:
    """The motion of each law: its least distance from upright, and the torques until there, after rest."""
    transition, time = PendulumTransition(plant, joint, dt, exact=False), jnp.arange(steps)

    def motion(law: Float[Array, "5"]) -> tuple[Array, Array]:
        def step(x: Float[Array, "4"], row: Array) -> tuple[Array, tuple[Array, Array]]:
            torque = jnp.clip(x @ law[:4] + law[4] * (row < KICK), -TORQUE_LIMIT, TORQUE_LIMIT)
            x = jnp.stack(transition.step(unpack(x), torque))
            return x, (x, torque)

        x, torques = jax.lax.scan(step, jnp.zeros(4), time)[1]
        # The mirrored motion comes up on the other side.
        errors = jnp.stack([x - UPRIGHT, x + UPRIGHT]) ** 2 @ jnp.array(DISTANCE)
        side, end = jnp.unravel_index(errors.argmin(), errors.shape)
        late = time - (steps - 1 - end)
        return errors.min(), (1 - 2 * side) * jnp.where(late < 0, 0.0, torques[jnp.maximum(late, 0)])

    return jax.vmap(motion)(laws)


@eqx.filter_jit
def _solve(
    plant: Plant, joint: int, dt: float, torques: Float[Array, "starts steps"]
) -> tuple[Float[Array, "starts 4"], Float[Array, "starts steps"]]:
    """Last states and torques of the motions that iterative LQR makes of guesses."""
    steps = torques.shape[1]
    transition = PendulumTransition(plant, joint, dt, exact=False)
    cost: Any = _WEIGHTS.cost(jnp.tile(UPRIGHT, (steps, 1)), jnp.zeros(steps), jnp.asarray(UPRIGHT))
    found = jax.vmap(lambda torque: solve_from_rest(transition, cost, torque, _SETTINGS))(torques)
    return found.states[:, -1], found.torque
