"""The design of swing-ups: iterative LQR from hanging at rest, for any problem and any plant.

An iteration from one guess may end in a local optimum that hangs. A search therefore optimises many random first
torques side by side on a coarse grid. The cheapest motion is followed by feedback on the fine grid and improved
there. Where it does not come up, a longer one is sought. The result is a local optimum. There may be better ones,
and the search proves nothing where no motion comes up.
"""

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.errors import SwingupError
from ...common.types import Scalar
from ...dynamics.dynamics import UPRIGHT
from ...plant.equations import StateFloats
from ...plant.plant import LEADERBOARD, ZEROS, Plant, Robot, get_robot
from .ilqr import Cost, ILQRSettings, Solution, Status, feedback_gains, forward, solve
from .reference import Reference
from .transition import AbstractTransition, PendulumTransition, TorqueRateTransition, unpack

SEARCHED_ERROR = 0.05  # A search is over when a motion ends this close to upright, in both angles (rad)

RESTING_STATE = np.append(UPRIGHT, 0.0)  # [π, 0, 0, 0, 0]: upright at rest, without torque


@dataclass(frozen=True)
class TrackingWeights:
    """Weights of an iLQR's tracking cost: of the mean over the stages, and of the final state."""

    state: StateFloats
    torque: float
    final: StateFloats

    def cost(self, states: Any, torque: Any, final_state: Any) -> Cost:
        """The cost of deviating from targets for each stage and for the end."""
        return Cost(np.array(self.state), self.torque, np.array(self.final), states, torque, final_state)


@dataclass(frozen=True)
class Search:
    """The first torques, and their optimisation on a coarse grid."""

    settings: ILQRSettings
    steps: int  # Steps of the coarse grid
    starts: int  # Guesses
    amplitude: float
    """Largest standard deviation of a guess's sines (N m). Large guesses end in worse optima."""
    waves: tuple[float, ...]  # Periods of the sines in the whole duration
    sizes: tuple[float, float] = (0.0, 1.0)
    """The amplitude of each guess is multiplied by a number between these."""
    first_torque: float = 0.0  # The torque at t = 0 is drawn from ± this (N m), where its rate is what costs
    spread: float = 0.0
    """The best result is optimised again from torques at t = 0 that differ by up to this (N m)."""
    final: StateFloats | None = None  # Final weights on the coarse grid; None for the problem's own
    durations: tuple[float, ...] = (1.0,)
    """Multiples of the problem's duration. The next one is tried where a motion does not end upright."""

    def guesses(self, rows: int, seed: int) -> Float[np.ndarray, "starts rows"]:
        """Random sums of slow sines, zero in the last fifth of the time (N m)."""
        random, time = np.random.default_rng(seed), np.linspace(0.0, 1.0, rows)
        shape = (self.starts, len(self.waves), 1)
        size = self.amplitude * random.uniform(*self.sizes, (self.starts, 1, 1)) * random.normal(size=shape)
        phase = random.uniform(0.0, 2 * np.pi, shape)
        waves = size * np.sin(2 * np.pi * np.array(self.waves)[:, None] * time + phase)
        torque: np.ndarray = waves.sum(axis=1) * (time < 0.8)
        if self.first_torque:
            torque[:, 0] = random.uniform(-self.first_torque, self.first_torque, self.starts)
        return torque


@dataclass(frozen=True)
class SwingupProblem:
    """A trajectory optimisation from hanging at rest to upright."""

    weights: TrackingWeights
    settings: ILQRSettings
    dt: float  # Length of a step (s)
    steps: int
    rate: float | None = None
    """Weight of the square of the torque's rate, which is then the input that the settings limit. All weights of
    stages are then per second. None: the torque is the input."""
    final_torque: float = 0.0  # Weight of the square of the last torque, where its rate has a weight
    gain_regularisation: float = 0.0  # μ of the backward pass for the feedback gains: 0 for LQ-optimal ones
    first_torque: float = 0.0  # Without a search the first guess is uniform between 0 and this (N m)
    search: Search | None = None

    def pendulum_cost(self, steps: int, final: StateFloats | None = None) -> Cost:
        """The cost on a grid without that of the torque's rate, perhaps with other final weights."""
        # J is a mean over the steps; times the duration it is the integral of the weights.
        unit = 1.0 if self.rate is None else self.dt * self.steps
        weights = np.array([*self.weights.state, self.weights.torque]) * unit
        last = np.array(self.weights.final if final is None else final)
        return Cost(weights[:4], weights[4], last, np.tile(UPRIGHT, (steps, 1)), np.zeros(steps), UPRIGHT)

    def cost(self, steps: int, final: StateFloats | None = None) -> Cost:
        """The cost of a motion; the arguments are those of :meth:`pendulum_cost`."""
        cost = self.pendulum_cost(steps, final)
        if self.rate is None:
            return cost
        state = np.append(cost.state_weights, cost.torque_weight)
        last = np.append(cost.final_weights, self.final_torque)
        rate = self.dt * self.steps * self.rate
        return Cost(state, rate, last, np.tile(RESTING_STATE, (steps, 1)), cost.torque, RESTING_STATE)

    def transition(self, pendulum: PendulumTransition) -> AbstractTransition:
        """The step that the cost is of: with the torque's rate as its input where that has a weight."""
        return pendulum if self.rate is None else TorqueRateTransition(pendulum)


def design_model(plant: Plant, robot: Robot) -> Plant:
    """The model that baselines are designed with: a robot's plant without Coulomb friction, which no plan can use.

    Its slope at rest would appear in a linear model as a damping of some 10 N m s/rad, by which a regulator would
    take the joint for frozen. Rotors and viscous friction stay.
    """
    return plant.driven(robot).changed(cf1=0.0, cf2=0.0, **ZEROS)


def compute_reference(
    robot: Robot | str, problem: SwingupProblem, seed: int, plant: Plant = LEADERBOARD
) -> tuple[Reference, dict[str, Any]]:
    """Optimise a swing-up from hanging at rest, with its provenance: JSON values for the file.

    It takes a minute or two, or longer where it does not come up. The problem is in the units of the plant. The
    seed is that of the first torques, which NumPy draws.
    """
    robot = get_robot(robot)
    model = design_model(plant, robot)
    # Tolerances of 1e-6 and 1e-8 of the cost are at and below the rounding of single precision.
    with jax.enable_x64(True):
        if problem.search is None:
            torque = np.random.default_rng(seed).uniform(0.0, problem.first_torque, problem.steps)
        else:
            problem, torque = _searched(problem, problem.search, model, robot, seed)
        pendulum, cost = PendulumTransition(model, robot.joint, problem.dt), problem.cost(problem.steps)
        found = solve_from_rest(problem.transition(pendulum), cost, jnp.asarray(torque), problem.settings)
        x, u = motion(found)
        gains = _gains(pendulum, problem.pendulum_cost(problem.steps), x, u, problem.gain_regularisation)
        # The last state has no torque: a row needs both.
        rows = map(np.asarray, (x[:-1], u, gains))
    return Reference(robot, problem.dt, *rows), {
        "seed": seed,
        "cost": float(found.cost),
        "iterations": int(found.iterations),
        "status": Status(int(found.status)).name.lower(),
        "gain_regularisation": problem.gain_regularisation,
    }


@eqx.filter_jit
def solve_from_rest(
    transition: AbstractTransition, cost: Cost, torque: Float[Array, "n"], settings: ILQRSettings
) -> Solution:
    """Optimise a motion that begins hanging at rest, from a guess of its torques (N m)."""
    if not isinstance(transition, TorqueRateTransition):
        return solve(transition, cost, jnp.zeros(4), torque, settings)
    # The torque is a state then: the guess becomes its first value and its rates.
    rates = jnp.diff(torque, append=torque[-1]) / transition.pendulum.dt
    return solve(transition, cost, jnp.zeros(5).at[4].set(torque[0]), rates, settings)


def motion(found: Solution) -> tuple[Float[Array, "n+1 4"], Float[Array, "n"]]:
    """The pendulum's states and the torques (N m), whichever is the input."""
    with_rate = found.states.shape[-1] == 5
    return found.states[:, :4], found.states[:-1, 4] if with_rate else found.torque


@eqx.filter_jit
def followed(
    pendulum: PendulumTransition,
    cost: Cost,
    x: Float[Any, "n 4"],
    u: Float[Any, "n"],
    gains: Float[Any, "n 4"],
    limit: Scalar | float,
) -> Float[Array, "n"]:
    """Torques within a limit (N m) that follow a motion by feedback on another plant or grid than its own."""
    return forward(pendulum, cost, unpack(x[0]), u, limit, (unpack(x), unpack(gains))).u


def _searched(
    problem: SwingupProblem, search: Search, model: Plant, robot: Robot, seed: int
) -> tuple[SwingupProblem, Float[np.ndarray, "n"]]:
    """The problem with the shortest duration that comes up, or the longest one, and first torques (N m) for it."""
    motor = float(model.limit(robot.joint))
    for factor in search.durations:
        longer, steps = replace(problem, steps=round(problem.steps * factor)), round(search.steps * factor)
        pendulum = PendulumTransition(model, robot.joint, longer.dt * longer.steps / steps)
        grid = longer.transition(pendulum), longer.cost(steps, search.final)
        # With its rate as the input the torque has a row at the end as well, which nothing follows.
        first = search.guesses(steps + (problem.rate is not None), seed)[:, :steps]
        found = _cheapest(_solve_all(*grid, first, search.settings), seed)
        if search.spread:
            found = _cheapest(_solve_all(*grid, _restarts(*grid, found, search), search.settings), seed)
        x, u = map(np.asarray, motion(found))
        if np.abs(x[-1] - UPRIGHT)[:2].max() < SEARCHED_ERROR and np.abs(u).max() <= motor:
            break
    gains = np.asarray(_gains(pendulum, longer.pendulum_cost(steps, search.final), x, u))
    place = np.arange(longer.steps) * steps / longer.steps
    # Torques and gains hold over a coarse step; the states change within it.
    held = place.astype(int)
    states = np.stack([np.interp(place, np.arange(steps + 1), column) for column in x.T], axis=1)
    # Where the torque's rate is the input, the settings limit the rate: the torque has the motor's own limit.
    limit = longer.settings.torque_limit if longer.rate is None else motor
    fine, cost = PendulumTransition(model, robot.joint, longer.dt), longer.pendulum_cost(longer.steps)
    return longer, np.asarray(followed(fine, cost, states, u[held], gains[held], limit))


def _cheapest(solutions: Solution, seed: int) -> Solution:
    costs = np.asarray(solutions.cost)
    if not np.isfinite(costs).any():
        raise SwingupError(f"no first torque of seed {seed} leads to a finite cost: use another seed")
    return jax.tree.map(lambda rows: rows[np.nanargmin(costs)], solutions)


@eqx.filter_jit
def _restarts(
    transition: AbstractTransition, cost: Cost, solution: Solution, search: Search
) -> Float[Any, "starts n"]:
    """Torques that start differently at t = 0, where they cost nothing, and return to a solution by feedback."""
    gains = unpack(feedback_gains(transition, cost, solution.states, solution.torque))
    about = unpack(solution.states[:-1]), gains

    def one(first: Scalar) -> Float[Any, "n"]:
        start = unpack(solution.states[0].at[4].set(first))
        return forward(transition, cost, start, solution.torque, search.settings.torque_limit, about).x[4]

    spread = jnp.linspace(-search.spread, search.spread, search.starts)
    return jax.vmap(one)(solution.states[0, 4] + spread)


@eqx.filter_jit
def _solve_all(
    transition: AbstractTransition, cost: Cost, torques: Float[Any, "starts n"], settings: ILQRSettings
) -> Solution:
    return jax.vmap(lambda torque: solve_from_rest(transition, cost, torque, settings))(jnp.asarray(torques))


_gains = eqx.filter_jit(feedback_gains)
