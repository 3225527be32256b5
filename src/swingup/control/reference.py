"""Swing-up trajectories: computed by iterative LQR, and stored in documented files without pickle.

The optimisation starts from tiny random torques: another seed may end in another local optimum.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..arrays import load_arrays, save_arrays
from ..checks import positive_number
from ..errors import SwingupError
from ..physics.plant import Plant, PlantLike
from ..robots import Robot, get_robot
from ..version import __version__
from .ilqr import ILQRSettings, Solution, Status, feedback_gains, solve
from .model import model_of
from .published import SwingupProblem
from .riccati_passes import Cost
from .search import follow, search
from .transition import PendulumTransition

REFERENCE_FORMAT = "swingup trajectory"
REFERENCE_VERSION = 1

NEAR = 0.05
"""A search is over when a motion ends this close to upright, in both angles (rad)."""

RECOMPUTE = "compute it again with swingup trajectory"


class Reference(eqx.Module):
    """A trajectory x_{n+1} = f(x_n, u_n) of the driven joint's torques, with feedback gains along it."""

    robot: Robot = eqx.field(static=True)
    dt: float
    """Time between rows (s)."""
    states: Float[Any, "rows 4"]
    """[q1, q2, dq1, dq2] (rad, rad/s)"""
    torque: Float[Any, "rows"]
    """N m"""
    gains: Float[Any, "rows 4"]
    """K (N m/rad, N m s/rad) of u + K (x - x_i)."""

    @property
    def time(self) -> Float[np.ndarray, "rows"]:
        """Time of each row (s)."""
        return self.dt * np.arange(len(self.torque))


REFERENCE_ARRAYS = ("states", "torque", "gains")


def compute_reference(
    robot: Robot | str, problem: SwingupProblem, seed: int, plant: PlantLike | None = None
) -> tuple[Reference, dict[str, Any]]:
    """Optimise a swing-up from hanging at rest; takes a minute or two.

    Args:
        robot: which joint is driven.
        problem: weights and settings.
        seed: of the first torques, which NumPy draws uniformly from [0, problem.first_torque], or of the search.
        plant: the pendulum, in whose units the problem is; None for the leaderboards'.

    Returns:
        The trajectory, and its provenance: JSON values for the file.

    Raises:
        SwingupError: there is no such plant, or the search led to no finite cost.
    """
    robot = get_robot(robot)
    parameters = model_of(plant, robot)
    transition = PendulumTransition(parameters, robot.joint, problem.dt)
    with jax.enable_x64(True):
        first = _first_torques(parameters, robot, problem, seed)
        cost = problem.cost(len(first))
        solution = _solve(transition, cost, jnp.asarray(first), problem.settings)
        mu = problem.gain_regularisation
        gains = eqx.filter_jit(feedback_gains)(transition, cost, solution.states, solution.torque, mu)
        solution, gains = jax.tree.map(np.asarray, (solution, gains))
    # The last state has no torque: a row needs both.
    reference = Reference(robot, problem.dt, solution.states[:-1], solution.torque, gains)
    return reference, {
        "seed": seed,
        "cost": float(solution.cost),
        "iterations": int(solution.iterations),
        "status": Status(int(solution.status)).name.lower(),
        "gain_regularisation": problem.gain_regularisation,
    }


def _first_torques(parameters: Plant, robot: Robot, problem: SwingupProblem, seed: int) -> np.ndarray:
    if problem.search is None:
        return np.random.default_rng(seed).uniform(0.0, problem.first_torque, problem.steps)
    for stretch in problem.search.durations:
        steps = round((problem.steps + 1) * stretch) - 1
        settings = replace(problem.search, steps=round(problem.search.steps * stretch))
        transition = PendulumTransition(parameters, robot.joint, problem.dt * steps / settings.steps)
        found = search(transition, problem.cost(settings.steps), settings, seed)
        if found.miss < NEAR:
            break
    transition = PendulumTransition(parameters, robot.joint, problem.dt)
    return follow(found, transition, problem.cost(steps), problem.settings.torque_limit, steps)


@eqx.filter_jit
def _solve(transition: PendulumTransition, cost: Cost, torque: Float[Any, "n"], settings: ILQRSettings) -> Solution:
    return solve(transition, cost, jnp.zeros(4), torque, settings)


def save_reference(path: str | Path, reference: Reference, provenance: dict[str, Any]) -> None:
    """Write a trajectory file; ``provenance`` (JSON values) is kept under its own names, but for robot and dt.

    Raises:
        SwingupError: the file cannot be written.
    """
    head = {"robot": reference.robot.name, "dt": reference.dt, "version": __version__}
    arrays = {name: np.asarray(getattr(reference, name), np.float64) for name in REFERENCE_ARRAYS}
    save_arrays(path, REFERENCE_FORMAT, REFERENCE_VERSION, {**provenance, **head}, arrays)


def load_reference(path: str | Path) -> tuple[Reference, dict[str, Any]]:
    """Read a trajectory file and its metadata.

    Raises:
        SwingupError: the file cannot be read, is truncated, or is no trajectory file of this version.
    """
    metadata, arrays = load_arrays(path, REFERENCE_FORMAT, REFERENCE_VERSION, REFERENCE_ARRAYS.__contains__)
    missing = [name for name in ("robot", "dt") if name not in metadata]
    missing += [name for name in REFERENCE_ARRAYS if name not in arrays]
    if missing:
        raise SwingupError(f"trajectory file {path} lacks {', '.join(missing)}: {RECOMPUTE}")
    dt, rows = metadata["dt"], arrays["torque"].shape
    dt = positive_number(f"trajectory file {path} has dt", dt, 1.0, "s")
    for name in REFERENCE_ARRAYS:
        array, shape = arrays[name], rows if name == "torque" else (*rows, 4)
        if len(rows) != 1 or rows[0] < 2 or array.shape != shape:
            raise SwingupError(f"trajectory file {path} has {name} of shape {array.shape}: {RECOMPUTE}")
        if array.dtype.kind != "f" or not np.isfinite(array).all():
            raise SwingupError(
                f"trajectory file {path} has values in {name} that are not finite numbers: {RECOMPUTE}"
            )
    fields = {name: arrays[name].astype(np.float64) for name in REFERENCE_ARRAYS}
    return Reference(robot=get_robot(metadata["robot"]), dt=dt, **fields), metadata
