"""The least torque limit with which a pendulum swings up in a given time, by iterative LQR.

The search begins at the motor's limit, or above it where that is too weak, with random first torques. Each success
is the first guess of a smaller limit; where that fails, the step is halved. A limit counts where the motion
ends near upright. There may be motions with less torque: the result is an upper bound. The pendulum is the similar
one in C.1's units with a limit of 6 N m throughout: the torque's unit falls, and one compiled program serves
all limits.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...dynamics.dynamics import upright_error
from ...plant.equations import COULOMB_STEEPNESS
from ...plant.plant import TORQUE_LIMIT, Plant, Robot
from ...plant.units import PLANT_UNITS, scales_of, similar_plant
from .design import Search, TrackingWeights, design_model, solve_from_rest
from .ilqr import ILQRSettings, Solution
from .transition import PendulumTransition

STEP = 0.02  # Length of a step in C.1's units (s)
FIRST_STEP, LAST_STEP, UPWARDS = 0.6, 0.95, 1.6  # Factors of the limit: the first one down, the last one, and up
STRONGEST = 20.0  # No limit above this multiple of the motor's is tried
NEAR = (0.1, 0.1, 1.0, 1.0)  # Largest errors at the end, in C.1's units (rad, rad/s)
_WEIGHTS = TrackingWeights(state=(0.0, 0.0, 1e-3, 1e-3), torque=0.01, final=(100.0, 100.0, 10.0, 10.0))
_SETTINGS = ILQRSettings(
    max_iterations=120,
    tolerance=1e-4,
    regularisation=1e-2,
    min_regularisation=1e-8,
    max_regularisation=1e8,
    torque_limit=TORQUE_LIMIT,
    decrease=0.5,
    increase=3.0,
    step_sizes=(1.0, 0.3, 0.1, 0.03),
)
SEARCH = Search(
    _SETTINGS, steps=0, starts=12, amplitude=2.0, waves=(2.0, 4.0, 6.0, 8.0, 10.0, 12.0), sizes=(0.1, 1.0)
)


def least_torque(plant: Plant, robot: Robot, within: float, search: Search = SEARCH) -> float | None:
    """The least torque limit (N m) of a robot's motor that swings up within a time (s); None where none was found.

    The driven joint's Coulomb friction is added; the passive joint's is left out.
    """
    model = design_model(plant, robot)
    scales = scales_of(model)
    similar = similar_plant(model, scales)
    steps = max(100, min(600, round(within / scales.time / STEP)))
    dt, random = within / scales.time / steps, np.random.default_rng(0)

    def tried(level: float, torques: np.ndarray) -> np.ndarray:
        """The torques (k, steps) that come up at a share of the motor's limit; none is an empty array."""
        changes = {name: getattr(similar, name) / level**unit.torque for name, unit in PLANT_UNITS.items()}
        changes |= dict.fromkeys(("tl1", "tl2"), TORQUE_LIMIT)
        with jax.enable_x64(True):
            lighter = jax.tree.map(jnp.asarray, similar.changed(**changes))
            found = _solve(lighter, robot.joint, dt, jnp.asarray(torques), search.settings)
            ends, kept = np.asarray(found.states[:, -1]), np.asarray(found.torque)
        rows: np.ndarray = kept[(np.abs(upright_error(ends)) < NEAR).all(axis=1)]
        return rows

    level, seed = 1.0, 0
    while not len(best := tried(level, search.guesses(steps, seed))):
        level, seed = level * UPWARDS, seed + 1
        if level > STRONGEST:
            return None
    factor = FIRST_STEP
    while factor < LAST_STEP:
        # Some go on as they were, with stronger or weaker swings; others begin anew.
        chosen = np.resize(best, (search.starts - search.starts // 3, steps)) / factor
        chosen[len(best) :] *= random.uniform(0.9, 1.1, (max(0, len(chosen) - len(best)), 1))
        fresh = search.guesses(steps, seed := seed + 1)[: search.starts // 3]
        if len(found := tried(level * factor, np.concatenate([chosen, fresh]).clip(-TORQUE_LIMIT, TORQUE_LIMIT))):
            level, best = level * factor, found
        else:
            factor = factor**0.5
    friction = float((plant.cf1, plant.cf2)[robot.joint]) * np.arctan(COULOMB_STEEPNESS)
    return level * float(model.limit(robot.joint)) + float(friction)


@eqx.filter_jit
def _solve(
    plant: Plant, joint: int, dt: float, torques: Float[Array, "starts n"], settings: ILQRSettings
) -> Solution:
    steps = torques.shape[1]
    transition = PendulumTransition(plant, joint, dt, exact=False)
    zeros = jnp.zeros(steps)
    goal = jnp.array([np.pi, 0.0, 0.0, 0.0])
    cost: Any = _WEIGHTS.cost(jnp.tile(goal, (steps, 1)), zeros, goal)
    return jax.vmap(lambda torque: solve_from_rest(transition, cost, torque, settings))(torques)
