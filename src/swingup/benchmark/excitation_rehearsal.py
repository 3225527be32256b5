"""Would identification find the truth? An excitation is played on a known plant, and its log is identified.

The truth is a specimen of the plant: its parameters are drawn from what is left open about it (``prior_around``),
its loop from the plant's file or a domain. The log is what the robot would write down, and the fit starts from the
plant as it is believed to be. A motor's gain scales all that a fit finds: the truth is divided by the first one.
"""

import dataclasses
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ..common.checks import check_seeds
from ..common.errors import SwingupError
from ..common.table import read_table
from ..controllers.interface import PythonController
from ..identification.excitation import PERIOD
from ..identification.identify import identify
from ..identification.results import TITLES, prior_around
from ..loop.domain import Domain
from ..loop.draw import draw
from ..loop.resolve import resolve
from ..plant.base_parameters import BASE_NAMES, base_parameters
from ..plant.plant import PlantLike, get_robot
from .recording import save_trajectory
from .rollout import Scenario, Trajectory
from .runner import run_one

LOOP = "recorded"  # The loop of a plant whose file has none, as in ``rehearse``
CLOSE, SMALL, ZERO = 0.1, 0.01, 0.005
"""A parameter passes within this share of its truth, or of what gravity makes large; a zero within this (rad)."""
RATE = 3.0  # Damping counts as a torque at this speed (rad/s)
NAMES = ("time", *(f"{each}{joint}" for each in ("pos", "vel", "tau") for joint in (1, 2)))
GAINS = tuple(f"K{joint}{entry}" for joint in (1, 2) for entry in (1, 2, 3, 4))


@dataclass(frozen=True)
class Found:
    """One parameter: the truth, what was found, its 95 % interval, and how far it may be off."""

    name: str
    truth: float
    value: float
    interval: tuple[float, float]
    tolerance: float

    @property
    def passes(self) -> bool:
        """Whether the value is near the truth, and its interval says so."""
        low, high = self.interval
        return abs(self.value - self.truth) <= self.tolerance and high - low <= 4 * self.tolerance


class Player:
    """u = tau + K (x - [pos, vel]) by the rows' times, and what the robot would write down."""

    def __init__(self, rows: Float[np.ndarray, "rows 15"], limits: tuple[float, float]) -> None:
        """Take the excitation's columns, and the motors' limits (N m)."""
        self._rows, self._limits = rows, np.array(limits)
        self.log: list[list[float]] = []

    def reset(self) -> None:
        """Begin a run."""
        self.log.clear()

    def get_control_output(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m)."""
        row = self._rows[min(int(t / PERIOD + 0.5), len(self._rows) - 1)]
        u = row[5:7] + row[7:].reshape(2, 4) @ (x - row[1:5])
        u = np.clip(u, -self._limits, self._limits)
        self.log.append([t, *x, *u])
        return u


def rehearse_identification(plant: PlantLike | Domain, excitation: str | Path, seed: int = 0) -> list[Found]:
    """Identify a specimen of a plant from its log of an excitation.

    Args:
        plant: the plant as it is believed to be.
        excitation: a file of ``excite``.
        seed: of the specimen and the noise.

    Raises:
        SwingupError: there is no such plant, the file is not an excitation, or its log says nothing.
    """
    check_seeds(seed, 1)
    facts = resolve(plant, LOOP)
    prior = prior_around(facts) if facts.knows_plant else facts
    rows = _read(excitation)
    believed = prior.nominal_plant
    with jax.enable_x64(True):
        specimen, disturbance = draw(prior, jax.random.key(seed), get_robot("pendubot"))
        specimen = specimen.changed(tl1=believed.tl1, tl2=believed.tl2)
        pushes = dataclasses.replace(disturbance.pushes, amplitude=0 * disturbance.pushes.amplitude)
        # Without a second session a fit takes both motors' gains for equal.
        loop = dataclasses.replace(disturbance.loop, gain2=disturbance.loop.gain1)
        disturbance = dataclasses.replace(disturbance, pushes=pushes, loop=loop)
        scenario = Scenario(specimen, disturbance, substeps=prior.substeps)
    player = Player(rows, (float(believed.tl1), float(believed.tl2)))
    run_one(PythonController(player), scenario, PERIOD, len(rows), prior.depth)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "rehearsal.csv"
        rows = np.array(player.log)
        save_trajectory(log, Trajectory(rows[:, 0], rows[:, 1:5], rows[:, 5:]))
        found = identify([log], start=believed, seed=seed)
    truths = dict(zip(BASE_NAMES, (base_parameters(specimen) / float(loop.gain1)).tolist(), strict=True))
    tolerances = _tolerances(base_parameters(believed), believed.g, believed.gr)
    truths["A"] -= truths["B"]
    for joint, zero in enumerate(specimen.zeros, 1):
        truths[f"offset{joint}"] = float(zero) + float(getattr(loop, f"offset{joint}"))
        tolerances[f"offset{joint}"] = ZERO
    values, intervals = found.estimates.values, found.estimates.intervals
    parameters = []
    for name, truth in truths.items():
        title, tolerance = TITLES.get(name, name), tolerances[name]
        if title in intervals:
            tolerance = tolerance if name.startswith("offset") else max(CLOSE * abs(truth), tolerance)
            parameters.append(Found(title, truth, values[title], intervals[title], tolerance))
    return parameters


def _read(path: str | Path) -> np.ndarray:
    try:
        table = read_table(path, [[(name,)] for name in (*NAMES, *GAINS)])
    except SwingupError as error:
        raise SwingupError(f"{path} is not an excitation ({error}): swingup excite writes one") from None
    return np.column_stack(list(table.values.values()))


def _tolerances(theta: np.ndarray, gravity: float, gear: float) -> dict[str, Any]:
    """What is small beside gravity's torque, or beside the elbow's inertia for the rotors."""
    torque = SMALL * gravity * float(theta[3])
    small = {"b1": torque / RATE, "b2": torque / RATE, "cf1": torque, "cf2": torque}
    small["Ir"] = SMALL * float(theta[1]) / gear**2
    return {name: small.get(name, 0.0) for name in BASE_NAMES}
