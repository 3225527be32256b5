"""Swing-ups that are nearly optimal for the RealAI score: this package's own upper reference, not a published one.

The score's penalties tanh(π c/n)/5 are replaced by their slopes about the optimum, which makes velocity cost,
torque cost and smoothness quadratic in [q1, q2, dq1, dq2, u] and the torque's rate. A small cost of q1's
error stands for the swing-up time. The energy is left out: near the optimum it is within 2 % of the least possible.
Many random first torques are optimised side by side on a coarse grid, and the cheapest result on a fine one.
The result is a local optimum for the nominal plant; there may be better ones.
"""

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..errors import SwingupError
from ..physics.angles import UPRIGHT
from ..physics.equations import StateFloats
from ..physics.plant import Plant, PlantLike
from ..robots import Robot, get_robot
from ..types import Scalar
from .ilqr import ILQRSettings, Solution, Status, feedback_gains, solve
from .lqr import LQRSettings
from .model import model_of
from .reference import Reference
from .riccati_passes import Cost, forward
from .scalar_algebra import unpack
from .torque_rate import TorqueRateTransition
from .transition import PendulumTransition

_COARSE = ILQRSettings(
    max_iterations=150,
    tolerance=1e-6,
    regularisation=1e-3,
    min_regularisation=1e-8,
    max_regularisation=1e10,
    torque_limit=1e3,  # N m/s: of the rate, which is the input here; the torques stay below 6 N m by their cost
    decrease=0.5,
    increase=3.0,
    step_sizes=(1.0, 0.3, 0.1, 0.03, 0.01),
)
_FINE = replace(_COARSE, max_iterations=300, tolerance=1e-8, regularisation=1e-6, min_regularisation=1e-10)
_LQR = LQRSettings(state_weights=(0.64, 0.56, 0.13, 0.037), torque_weight=0.82, max_cost_to_go=1000.0)


@dataclass(frozen=True)
class ScoreProblem:
    """A trajectory optimisation from hanging at rest to upright. A weight is the fall of the score per unit."""

    velocity: float
    """Per rad²/s of ∫ (dq1² + dq2²) dt."""
    torque: float
    """Per N²m²s of ∫ u² dt."""
    rate: float
    """Per N²m²/s of ∫ (du/dt)² dt: the smoothness is nearly its root, times 2 ms over the root of 10 s."""
    angle: float
    """Per rad² s of ∫ (q1 - π)² dt."""
    duration: float
    """s"""
    coarse_final: StateFloats = (50.0, 50.0, 2.0, 2.0)
    """On squared errors of the last angles (rad) and velocities (rad/s), on the coarse grid and on the fine one."""
    fine_final: StateFloats = (1000.0, 1000.0, 100.0, 100.0)
    final_torque: float = 1.0
    coarse_dt: float = 0.01
    """Lengths of the steps (s); the fine one is the judge's, and the coarse one a multiple of it."""
    fine_dt: float = 0.002
    coarse: ILQRSettings = _COARSE
    fine: ILQRSettings = _FINE
    starts: int = 48
    """Random first torques."""
    first_torque: float = 1.5
    """The torque at t = 0 is drawn from ± this (N m)."""
    amplitude: float = 1.0
    """Size of the sines of a random first torque (N m)."""
    spread: float = 1.0
    """The best result is optimised again from torques at t = 0 that differ by up to this (N m)."""


@dataclass(frozen=True)
class Optimal:
    """All settings for one robot."""

    swingup: ScoreProblem
    lqr: LQRSettings = _LQR
    """Weights of both regulators, along the trajectory and at the top: those of the published TVLQR."""
    threshold: StateFloats = (0.02, 0.02, 0.05, 0.05)
    """|errors| below which the LQR takes over (rad, rad/s). The torque then hardly changes."""
    rows_per_piece: int = 4
    """Rows in a piece of the cubic fit. A cubic meets four rows exactly, so that tracking costs no score."""


OPTIMAL = {
    "acrobot": Optimal(ScoreProblem(velocity=1.2e-3, torque=0.029, rate=4e-4, angle=1e-3, duration=1.8)),
    "pendubot": Optimal(ScoreProblem(velocity=1.36e-3, torque=0.0265, rate=2.3e-4, angle=3e-4, duration=2.0)),
}
"""By the robot's name."""

RESTING = np.append(UPRIGHT, 0.0)
"""[π, 0, 0, 0, 0]: upright at rest, without torque."""


def compute_optimal_reference(
    robot: Robot | str, problem: ScoreProblem, seed: int, plant: PlantLike | None = None
) -> tuple[Reference, dict[str, Any]]:
    """Optimise a swing-up for the score; takes one or two minutes.

    Args:
        robot: which joint is driven.
        problem: weights and settings.
        seed: of the first torques, which NumPy draws.
        plant: the pendulum, in whose units the problem is; None for the leaderboards'.

    Returns:
        The trajectory with rows of the judge's time step, and its provenance: JSON values for the file. Its
        gains are LQ-optimal for the problem's weights without that of the torque's rate.

    Raises:
        SwingupError: there is no such plant, or no first torque led to a finite cost.
    """
    robot = get_robot(robot)
    parameters = model_of(plant, robot)
    first = first_torques(problem, seed)
    with jax.enable_x64(True):
        coarse = _transition(parameters, robot, problem.coarse_dt), coarse_cost(problem)
        rough = _cheapest(_solve_all(*coarse, first, problem.coarse), seed)
        rough = _cheapest(_solve_all(*coarse, _restarts(*coarse, rough, problem), problem.coarse), seed)
        # The coarse torques, held over the fine steps, give the same trajectory up to the integrator's error.
        held = np.repeat(np.asarray(rough.states)[:, 4], round(problem.coarse_dt / problem.fine_dt))
        rows = round(problem.duration / problem.fine_dt)
        cost, transition = fine_cost(problem), _transition(parameters, robot, problem.fine_dt)
        # The fine grid ends at the last coarse row, which was repeated as well: the rest is cut.
        fine = _cheapest(_solve_all(transition, cost, held[None, : rows + 1], problem.fine), seed)
        x, u = np.asarray(fine.states), np.asarray(fine.states)[:-1, 4]
        weights = Cost(
            cost.state_weights[:4], cost.state_weights[4], cost.final_weights[:4], x[:-1, :4], u, x[-1, :4]
        )
        gains = np.asarray(eqx.filter_jit(feedback_gains)(transition.pendulum, weights, x[:, :4], u))
    return Reference(robot, problem.fine_dt, x[:-1, :4], u, gains), {
        "problem": "score",
        "seed": seed,
        "starts": problem.starts,
        "cost": float(fine.cost),
        "iterations": int(fine.iterations),
        "status": Status(int(fine.status)).name.lower(),
        "gain_regularisation": 0.0,
    }


def first_torques(problem: ScoreProblem, seed: int) -> Float[np.ndarray, "starts n+1"]:
    """Random sums of slow sines, zero in the last fifth, each with its own first torque (N m); coarse rows."""
    random, rows = np.random.default_rng(seed), round(problem.duration / problem.coarse_dt) + 1
    time = np.linspace(0.0, 1.0, rows)
    scale = problem.amplitude * random.uniform(0.3, 3.0, (problem.starts, 1, 1))
    amplitude = scale * random.normal(size=(problem.starts, 5, 1))
    phase = random.uniform(0.0, 2 * np.pi, (problem.starts, 5, 1))
    frequency = 2 * np.pi * 0.6 * np.arange(1, 6)[:, None]
    torque = np.sum(amplitude * np.sin(frequency * time + phase), axis=1) * (time < 0.8)
    torque[:, 0] = random.uniform(-problem.first_torque, problem.first_torque, problem.starts)
    return torque


def coarse_cost(problem: ScoreProblem) -> Cost:
    """The cost on the coarse grid."""
    return _cost(problem, problem.coarse_dt, problem.coarse_final)


def fine_cost(problem: ScoreProblem) -> Cost:
    """The cost on the fine grid. Its final weights are larger, because a final error disturbs the hand-over."""
    return _cost(problem, problem.fine_dt, problem.fine_final)


def _cheapest(solutions: Solution, seed: int) -> Solution:
    costs = np.asarray(solutions.cost)
    if not np.isfinite(costs).any():
        raise SwingupError(f"no first torque of seed {seed} leads to a finite cost: use another seed")
    return jax.tree.map(lambda rows: rows[np.nanargmin(costs)], solutions)


@eqx.filter_jit
def _restarts(
    transition: TorqueRateTransition, cost: Cost, solution: Solution, problem: ScoreProblem
) -> Float[Any, "starts n+1"]:
    """Torques that start differently at t = 0, where they cost nothing, and return to a solution by feedback."""
    gains = unpack(feedback_gains(transition, cost, solution.states, solution.torque))
    about = unpack(solution.states[:-1]), gains

    def one(first: Scalar) -> Float[Any, "n+1"]:
        start = unpack(solution.states[0].at[4].set(first))
        rolled = forward(transition, cost, start, solution.torque, problem.coarse.torque_limit, about)
        return jnp.append(rolled.x[4], rolled.last[4])

    spread = jnp.linspace(-problem.spread, problem.spread, problem.starts)
    return jax.vmap(one)(solution.states[0, 4] + spread)


def _cost(problem: ScoreProblem, dt: float, final: StateFloats) -> Cost:
    rows = round(problem.duration / dt)
    # J is a mean over the steps; times the duration it is the integral of the weights.
    state = problem.duration * np.array([problem.angle, 0.0, problem.velocity, problem.velocity, problem.torque])
    last = np.array([*final, problem.final_torque])
    return Cost(
        state,
        problem.duration * problem.rate,
        last,
        np.tile(RESTING, (rows, 1)),
        np.zeros(rows),
        RESTING,
    )


def _transition(parameters: Plant, robot: Robot, dt: float) -> TorqueRateTransition:
    return TorqueRateTransition(PendulumTransition(parameters, robot.joint, dt))


@eqx.filter_jit
def _solve_all(
    transition: TorqueRateTransition, cost: Cost, torques: Float[Any, "starts n+1"], settings: ILQRSettings
) -> Solution:
    def one(torque: Float[Any, "n+1"]) -> Solution:
        x0 = jnp.zeros(5).at[4].set(torque[0])
        return solve(transition, cost, x0, jnp.diff(torque) / transition.pendulum.dt, settings)

    return jax.vmap(one)(jnp.asarray(torques))
