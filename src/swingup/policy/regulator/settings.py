"""Where the regulator near the top acts, its costs, and their fixed point; all is chosen, not identified."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from ...common.errors import SwingupError
from ...common.riccati import solve_riccati
from ...common.settings import Range, Settings
from ...plant.base_parameters import base_parameters, geometry_of
from ...plant.plant import Plant
from ...plant.units import TORQUE
from .upright import upright_step

STATE_WEIGHTS = (1.0, 1.0, 0.1, 0.1)
"""q, of the errors of q1, q2 (1/rad²), dq1 and dq2 (s²/rad²) in the costs ∫ eᵀ diag(q) e + r u² dt."""
TORQUE_WEIGHT = 1.0
"""r (1/N²m²)."""
COULOMB_DAMPING = 0.012
"""Coulomb friction cf (N m) counts as damping cf + cf² / this (N m s/rad), one that drives, below 0, as cf."""
DRY_SHARE, DRY_KNEE = 0.7, 10.0
"""The undriven joint's counts besides as a torque that stays: this share of cf arctan(knee q̇), knee in s/rad.
With damping of cf alone and half of the torque it fells half of the acrobots that have it (``lab/adaptive.md``)."""
RICCATI_STEP = 0.005
"""Step h of the recursion (s)."""
RICCATI_STEPS = 4
"""Steps of the recursion at each call."""
Q, R = tuple(RICCATI_STEP * weight for weight in STATE_WEIGHTS), RICCATI_STEP * TORQUE_WEIGHT
"""h q and h r: Q's diagonal and R of one step."""


@dataclass(frozen=True)
class RegulatorSettings(Settings):
    """Where the regulator acts."""

    PART: ClassVar[str] = "regulator"
    enter: Annotated[float, Range(1e-6, 1e6)] = 1.0
    """The regulator takes over where its cost-to-go eᵀPe is below this."""
    leave: Annotated[float, Range(1e-6, 1e6)] = 10.0
    """The policy takes over where the cost-to-go is above this."""
    enter_coulomb: Annotated[float, Range(1e-12, 1e12), TORQUE] = 1e6
    """Coulomb friction of the undriven joint (N m) that halves ``enter``."""
    leave_coulomb: Annotated[float, Range(1e-12, 1e12), TORQUE] = 1e6
    """Coulomb friction (N m) that halves the distance between ``enter`` and ``leave``."""

    def __post_init__(self) -> None:
        super().__post_init__()
        # Else it would give up as soon as it has taken over.
        if self.leave < self.enter:
            raise SwingupError(
                f"regulator setting leave = {self.leave:g} is below enter = {self.enter:g}: use one from there on"
            )


def fixed_point(plant: Plant, driven: int) -> tuple[np.ndarray, np.ndarray]:
    """The cost-to-go P (5, 5) of [e, f] at which the recursion for a plant stays, and K (5,) of u = -K [e, f]."""
    theta, geometry = base_parameters(plant), geometry_of(plant)
    a, d, b = map(np.array, upright_step(theta, geometry, driven, COULOMB_DAMPING, RICCATI_STEP))
    with np.errstate(all="ignore"):
        try:
            found = np.pad(solve_riccati(a, np.outer(b, b) / R, np.diag(Q)), (0, 1))
            P = found[:4, :4]
            weight = R + b @ P @ b
            gains = b @ P @ a / weight
            closed = a - np.outer(b, gains)
            found[:4, 4] = found[4, :4] = np.linalg.solve(np.eye(4) - closed.T, closed.T @ P @ d)
            against = b @ (P @ d + found[:4, 4]) / weight
        except np.linalg.LinAlgError:
            # Both ways in which a plant has no fixed point get the same sentence.
            found = np.full((5, 5), np.nan)
    if not np.isfinite(found).all():
        raise SwingupError("the regulator cannot hold its plant upright: correct the plant, or leave it out")
    return found, np.append(gains, against)
