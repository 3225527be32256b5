"""Optimal swing-ups of many plants at once, continued from the nominal plant's.

A swing-up is optimal for the cost of ``optimal``; the leaderboards' plant's is shipped. Each plant p(λ) moves along
the line from the nominal plant, λ = 0, to its target, λ = 1. At each step iterative LQR starts from the
swing-up of the plant before, followed by feedback on the new plant. A plant has a step of its own: it grows after a
swing-up that ends upright, and falls after one that does not. Plants lie side by side in one compiled program.

The result is the local optimum that the nominal one turns into. It proves nothing where a plant is not reached:
another swing-up may exist. Steps are single ones of RK4, so that stiff Coulomb friction, for which
``dynamics.integrate.stable_substeps`` is above 1, cannot be reached.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from ...common.errors import SwingupError
from ...common.types import Scalar
from ...dynamics.dynamics import UPRIGHT
from ...plant.equations import StateFloats
from ...plant.plant import LEADERBOARD, NAMES, Plant, Robot, get_robot, validated
from ...plant.units import DAMPING, STATE, TIME, TORQUE
from ..swingups.design import followed, motion, solve_from_rest
from ..swingups.ilqr import ILQRSettings, feedback_gains
from ..swingups.reference import Reference
from ..swingups.transition import PendulumTransition
from .baselines import design_of, reaches_upright
from .settings import OPTIMAL_SETTINGS
from .tracking import riccati_controller
from .upright import LatchingSwitch, holding_regulator

_SOLVER = ILQRSettings(
    # A step needs no more precision: the next one starts from its end.
    max_iterations=25,
    tolerance=1e-4,
    regularisation=1e-3,
    min_regularisation=1e-9,
    max_regularisation=1e10,
    torque_limit=2e3,  # N m/s: of the rate, which is the input here
    decrease=0.3,
    increase=4.0,
    step_sizes=(1.0, 0.3, 0.1, 0.03),
)


@dataclass(frozen=True)
class ContinuationSettings:
    """How plants move, and which swing-ups count."""

    extra: float = 0.2  # Time after the nominal swing-up (s): other plants need longer to come to rest
    final: StateFloats = (20.0, 20.0, 1.0, 1.0)
    """On squared errors of the last angles (rad) and velocities (rad/s). They are softer than the problem's own,
    since a regulator takes over there."""
    gain_weights: StateFloats = (0.2, 0.2, 0.02, 0.02)
    """Added to the state's weights for the gains: the cost has no weight on q2, so that its own gains are weak."""
    gain_final: StateFloats = (10.0, 10.0, 1.0, 1.0)
    """Final weights for the gains. Larger ones make the gains near the end so large that steps fail."""
    first_step: float = 0.1  # First step of λ
    largest_step: float = 0.1  # Longer steps leap to other motions, of twice the cost
    smallest_step: float = 0.01  # A plant whose step falls below this is given up
    growth: float = 1.5  # A step is multiplied by this after a swing-up that counts
    shrinkage: float = 0.4  # A step is multiplied by this after one that does not
    rounds: int = 40  # Most steps of a plant, failed ones included
    max_cost: float = 0.25
    """A swing-up of larger cost does not count: it is another motion than the nominal one, whose cost is 0.15."""
    max_speed: float = 14.0
    """A swing-up with a faster joint does not count (rad/s): it spins where the nominal one swings."""
    max_error: StateFloats = (0.15, 0.15, 0.7, 0.7)
    """A swing-up that ends farther from upright at rest does not count (rad, rad/s): no regulator
    reaches it."""
    batch: int = 64
    """Plants side by side in a call. Smaller calls are filled up: all share one compilation."""
    solver: ILQRSettings = _SOLVER


class SwingUps(eqx.Module):
    """A swing-up for each of n plants, from hanging at rest."""

    robot: Robot = eqx.field(static=True)
    dt: Annotated[float, TIME] = eqx.field(static=True)  # Time between rows (s)
    plants: Plant  # The plants at which they stand, leaves of shape (n,): the targets where they were reached
    reached: Float[Any, "n"]  # λ of these plants: 1 at the target, 0 at the nominal plant
    cost: Float[Any, "n"]  # NaN where no step was taken
    states: Annotated[Float[Any, "n rows+1 4"], *STATE]  # [q1, q2, dq1, dq2] (rad, rad/s)
    torque: Annotated[Float[Any, "n rows"], TORQUE]  # N m
    gains: Annotated[Float[Any, "n rows 4"], TORQUE, TORQUE, DAMPING, DAMPING]
    """K (N m/rad, N m s/rad) of u + K (x - x_i)."""

    def reference(self, index: int) -> Reference:
        """One plant's swing-up as a trajectory to follow or to save."""
        return Reference(self.robot, self.dt, self.states[index, :-1], self.torque[index], self.gains[index])

    def controller(self, index: int, plant: Plant) -> LatchingSwitch:
        """Follows one plant's swing-up by time, and hands over to the regulator of the plant with its friction.

        It does not recover from throws. It is an upper bound: no adaptive controller knows more of its plant.
        """
        following = riccati_controller(self.reference(index), plant)
        # No accepted swing-up ends farther away. A third and two thirds of it held one or two plants fewer of 240
        # drawn ones, of both robots.
        hand_over = np.array(ContinuationSettings().max_error)
        return LatchingSwitch(following, holding_regulator(plant, self.robot), hand_over, self.robot)


def continue_swingups(
    robot: Robot | str,
    targets: Plant,
    settings: ContinuationSettings | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
    nominal: Plant = LEADERBOARD,
) -> SwingUps:
    """Compute optimal swing-ups of many plants.

    The targets' leaves have the shape (n,). ``progress`` is called with the number of plants that are done, reached
    or given up, and of all. The continuations begin at the nominal plant, in C.1's units.
    """
    robot, settings = get_robot(robot), settings or ContinuationSettings()
    targets = _checked(targets)
    number = np.size(targets.m1)
    found, steps = nominal_swingups(robot, number, settings, nominal), np.full(number, settings.first_step)
    # The bounds are numbers of C.1's swing-up.
    if nominal != LEADERBOARD:
        settings = _bounds_about(found, settings)
    for _ in range(settings.rounds):
        pending = np.flatnonzero((found.reached < 1.0) & (steps >= settings.smallest_step))
        progress(number - len(pending), number)
        if not len(pending):
            break
        for start in range(0, len(pending), settings.batch):
            part = pending[start : start + settings.batch]
            tried = _try_step(found, part, steps[part], targets, settings, nominal)
            good = accepted(tried, settings)
            grown = np.minimum(steps[part] * settings.growth, settings.largest_step)
            steps[part] = np.where(good, grown, steps[part] * settings.shrinkage)
            for rows, new in zip(*map(jax.tree.leaves, (found, tried)), strict=True):
                rows[part[good]] = new[good]
    return found


def accepted(tried: SwingUps, settings: ContinuationSettings) -> np.ndarray:
    """Which swing-ups count: finite, cheap, slow, upright in the end, and with torques that the motor has."""
    error = np.abs(tried.states[:, -1] - UPRIGHT)
    upright = np.all(error < np.array(settings.max_error), axis=1)
    able = np.all(np.abs(tried.torque) <= _torque_limit(tried)[:, None], axis=1)
    slow = np.abs(tried.states[..., 2:]).max(axis=(1, 2)) <= settings.max_speed
    # A comparison with NaN is false: a motion that diverged does not count.
    return (tried.cost < settings.max_cost) & slow & upright & able & np.isfinite(tried.gains).all(axis=(1, 2))


def nominal_swingups(
    robot: Robot, number: int, settings: ContinuationSettings, plant: Plant = LEADERBOARD
) -> SwingUps:
    """A plant's swing-up for the score, shipped or sought, for n plants; it rests upright for the extra time."""
    reference = design_of(robot, plant).reference("score")
    if not reaches_upright(reference, plant.driven(robot)):
        raise SwingupError(
            f"no swing-up of the {robot.name} is found for the plant {plant}: its motor may be too weak"
        )
    # The last gains hold it upright while it rests: other plants use this time to come to rest.
    more = round(settings.extra / OPTIMAL_SETTINGS[robot.name].swingup.dt)
    states = np.concatenate([reference.states, np.tile(UPRIGHT, (more + 1, 1))])
    torque = np.append(reference.torque, np.zeros(more))
    gains = np.concatenate([reference.gains, np.tile(reference.gains[-1], (more, 1))])
    nominal = jax.tree.map(lambda value: np.full(number, float(value)), plant.driven(robot))
    rows = [np.tile(array, (number,) + (1,) * array.ndim) for array in (states, torque, gains)]
    return SwingUps(robot, reference.dt, nominal, np.zeros(number), np.full(number, np.nan), *rows)


def _try_step(
    found: SwingUps,
    part: np.ndarray,
    steps: np.ndarray,
    targets: Plant,
    settings: ContinuationSettings,
    nominal: Plant,
) -> SwingUps:
    """Swing-ups of the plants one step on, from those found so far; whether they count is not asked."""
    near, ends = jax.tree.map(lambda leaf: leaf[part], (found, targets))
    reached = np.minimum(near.reached + steps, 1.0)
    begin = nominal.driven(found.robot)
    # Written so that λ = 1 is the target to the last bit.
    plants = jax.tree.map(lambda start, end: (1.0 - reached) * start + reached * end, begin, ends)
    moved = replace(near, plants=plants, reached=reached)
    # A call that is smaller than a batch repeats its plants.
    filled = jax.tree.map(lambda leaf: leaf[np.arange(settings.batch) % len(part)], moved)
    with jax.enable_x64(True):
        optimised = _optimised(filled, settings)
        return jax.tree.map(lambda leaf: np.asarray(leaf)[: len(part)], optimised)


@jax.jit(static_argnames="settings")
def _optimised(swingups: SwingUps, settings: ContinuationSettings) -> SwingUps:
    """Swing-ups of other plants, improved for these."""
    robot, dt = swingups.robot, swingups.dt
    problem = OPTIMAL_SETTINGS[robot.name].swingup
    weights = replace(problem.weights, final=settings.final)
    problem = replace(problem, steps=swingups.torque.shape[1], weights=weights)
    cost, leaving = problem.cost(problem.steps), problem.pendulum_cost(problem.steps, settings.gain_final)
    leaving = replace(leaving, state_weights=leaving.state_weights + np.array(settings.gain_weights))

    def one(swingup: SwingUps, limit: Scalar) -> SwingUps:
        pendulum = PendulumTransition(swingup.plants, robot.joint, dt)
        first = followed(pendulum, leaving, swingup.states[:-1], swingup.torque, swingup.gains, limit)
        solution = solve_from_rest(problem.transition(pendulum), cost, first, settings.solver)
        x, u = motion(solution)
        gains = feedback_gains(pendulum, leaving, x, u)
        return replace(swingup, cost=solution.cost, states=x, torque=u, gains=gains)

    return jax.vmap(one)(swingups, _torque_limit(swingups))


def _bounds_about(nominal: SwingUps, settings: ContinuationSettings) -> ContinuationSettings:
    """The bounds on cost and speed, which are those of C.1's swing-up, about that of another plant."""
    first = jax.tree.map(lambda leaf: leaf[np.zeros(settings.batch, int)], nominal)
    with jax.enable_x64(True):
        found = _optimised(first, settings)
    cost, speed = float(found.cost[0]), float(np.abs(found.states[0, :, 2:]).max())
    # C.1's bounds are about 1.6 times its cost, 0.16, and 1.3 times the rate of its fastest joint, 10.4 rad/s.
    max_cost, max_speed = max(settings.max_cost, 1.7 * cost), max(settings.max_speed, 1.3 * speed)
    return replace(settings, max_cost=max_cost, max_speed=max_speed)


def _torque_limit(swingups: SwingUps) -> Float[Any, "n"]:
    """The driven joint's (N m), of each plant."""
    return swingups.plants.limit(swingups.robot.joint)


def _checked(targets: Plant) -> Plant:
    """The plants in NumPy, each of them a pendulum."""
    arrays: dict[str, Any] = {name: np.asarray(getattr(targets, name), np.float64) for name in NAMES}
    shape = arrays[NAMES[0]].shape
    for name, array in arrays.items():
        if array.ndim != 1 or not len(array) or array.shape != shape:
            raise SwingupError(
                f"parameter {name} has shape {array.shape}: give every parameter one value for each plant"
            )
    for values in zip(*arrays.values(), strict=True):
        validated(Plant(*values))
    return Plant(**arrays)
