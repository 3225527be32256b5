"""From a prior and limits to an excitation: the fixed motion whose log tells most, as strong as the limits allow.

The plant in the middle of the prior follows each motion by feedback; its torques and its motion, with the same
feedback, are what a robot plays. So other plants move alike. Each is played on plants drawn from the prior and on
the corners of its ranges, and made smaller until all of them keep the limits. Of what is left, the excitation has
the largest determinant of Yᵀ Y, with the matrix Y of the linear regression that ``identify`` starts from
(D-optimality).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...common.checks import check_seeds, finite_number, one_of
from ...common.errors import SwingupError
from ...common.table import write_columns
from ...loop.domain import Domain
from ...plant.units import VELOCITY, scales_of
from ..fit.prediction import NAMES, Integration, integration_of
from ..fit.regression import OFFSETS, SPAN, regression_matrix
from ..log.segments import INTERVAL
from .rollouts import Sequences, corner_models, draw_models, simulate
from .waves import PERIOD, multisines

JOINTS = {"both": (1.0, 1.0), "shoulder": (1.0, 0.0), "elbow": (0.0, 1.0)}
"""Joints that are driven."""
DURATIONS = (3.0, 60.0)
"""Shortest and longest excitation (s)."""
SPEED = 20.0
"""Largest speed of a joint (rad/s) on design C.1 if none is given: the public loop stops there. It scales."""
NATURAL_FREQUENCY = 0.75
"""Frequency of small swings (Hz) on design C.1. It scales, too."""
CHECKED_PLANTS = 64
"""Plants drawn from the prior on which the limits must hold, beside its corners."""
STRENGTHS = np.geomspace(1.0, 0.1, 10)
"""Multiples of a motion that are tried, until one keeps the limits."""
STIFFNESS, DAMPING = 2.0, 0.5
"""Feedback: kp as a multiple of gravity's torque per radian; kd as the damping ratio of a joint alone."""


@dataclass(frozen=True)
class ExcitationLimits:
    """What the robot may do."""

    torque: tuple[float, float]
    """Largest torque of each motor (N m); 0 on a joint that is not driven."""
    speed: float
    """Largest speed of either joint (rad/s)."""
    angle: float
    """Largest angle of either joint from hanging (rad)."""


@dataclass(frozen=True)
class Excitation:
    """Torques, the motion they make in the middle of the prior, and the feedback around it."""

    torque: Float[np.ndarray, "rows 2"]
    """N m, rows ``PERIOD`` apart."""
    state: Float[np.ndarray, "rows 4"]
    """Motion of the plant in the middle of the prior (rad, rad/s)."""
    feedback: Float[np.ndarray, "2 2"]
    """kp of both joints (N m/rad), kd of both (N m s/rad); 0 where the torques are played alone."""
    limits: ExcitationLimits
    angle: float
    """Largest angle over all checked plants (rad)."""
    speed: float
    """Largest speed over all checked plants (rad/s)."""
    plants: int
    """Number of checked plants."""

    @property
    def time(self) -> Float[np.ndarray, "rows"]:
        """Times of the rows (s)."""
        return PERIOD * np.arange(len(self.torque))

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        torque = np.abs(self.torque).max(axis=0).tolist()
        return {
            "duration": len(self.torque) * PERIOD,
            "limits": vars(self.limits) | {"torque": list(self.limits.torque)},
            "reached": {"torque": torque, "speed": self.speed, "angle": self.angle},
            "plants": self.plants,
            "feedback": {"kp": self.feedback[0].tolist(), "kd": self.feedback[1].tolist()},
        }

    def save(self, path: str | Path) -> None:
        """Write time, motion, torques and gains K of u = tau + K (x - motion), under RealAIGym's names.

        CloudPendulum's desired motions have the same names of time, pos, vel and acc.
        """
        acceleration = np.gradient(self.state[:, 2:], PERIOD, axis=0)
        table = np.column_stack([self.time, self.state, acceleration, self.torque])
        names = ["time", *(f"{each}{joint}" for each in ("pos", "vel", "acc", "tau") for joint in (1, 2))]
        columns = dict(zip(names, table.T, strict=True))
        # The loop that plays the file knows one matrix K a row; each motor here sees its own joint alone.
        for joint in (0, 1):
            gains = np.zeros(4)
            # K multiplies the state minus the motion, the feedback the motion minus the state.
            gains[[joint, 2 + joint]] = -self.feedback[:, joint]
            columns |= {f"K{joint + 1}{entry + 1}": np.full(len(table), gains[entry]) for entry in range(4)}
        write_columns(path, columns)


def excite(
    domain: Domain,
    duration: float = 10.0,
    joint: str = "both",
    torque: float | None = None,
    speed: float | None = None,
    angle: float = 3.0,
    seed: int = 0,
    alone: bool = False,
) -> Excitation:
    """Find an excitation.

    Args:
        domain: ranges of the plant and its loop before it is identified.
        duration: length of the excitation (s), 3 to 60; rounded to 0.05 s.
        joint: ``both``, or the one joint that is driven: ``shoulder`` or ``elbow``.
        torque: largest torque (N m); None for that of the motors.
        speed: largest speed of a joint (rad/s); None for 20 rad/s on design C.1, other plants in their own units.
        angle: largest angle of a joint from hanging (rad).
        seed: seed of the prior's draws; equal seeds give equal excitations.
        alone: whether the torques will be played without feedback; plants that differ then move apart.
    """
    check_seeds(seed, 1)
    limits, plant = _limits(domain, joint, torque, speed, angle), domain.nominal_plant
    length = INTERVAL * round(finite_number("duration", duration, *DURATIONS, "s") / INTERVAL)
    drawn = draw_models(domain, CHECKED_PLANTS, seed)
    # Steps twice as long change predictions by 1e-4 rad (prediction.py), nothing beside how far the plants differ.
    setting, models = integration_of(plant).coarse, np.concatenate([drawn, corner_models(domain)])
    frequency = scales_of(plant).scaled(NATURAL_FREQUENCY, VELOCITY)
    motions = multisines(length, frequency, min(limits.angle, np.pi), np.array(JOINTS[joint]))
    candidates = _within_limits(setting, models, motions, limits, alone)
    if not candidates:
        raise SwingupError(
            f"no motion keeps all plants of {domain.name} within {limits.angle:g} rad and {limits.speed:g} rad/s: "
            "allow more, narrow the prior, or ask for a shorter excitation"
        )
    return max(candidates, key=lambda each: _information(setting, each.state))


def _limits(
    domain: Domain, joint: str, torque: float | None, speed: float | None, angle: float
) -> ExcitationLimits:
    driven, plant = JOINTS[one_of("joint", joint, JOINTS)], domain.nominal_plant
    motors = [float(plant.tl1), float(plant.tl2)]
    most = [motor if torque is None else finite_number("torque", torque, 1e-6, motor, "N m") for motor in motors]
    usual = scales_of(plant).scaled(SPEED, VELOCITY)
    return ExcitationLimits(
        torque=(most[0] * driven[0], most[1] * driven[1]),
        speed=usual if speed is None else finite_number("speed", speed, 0.1, 1e3, "rad/s"),
        angle=finite_number("angle", angle, 0.1, 100.0, "rad"),
    )


def _within_limits(
    setting: Integration, models: np.ndarray, motions: np.ndarray, limits: ExcitationLimits, alone: bool
) -> list[Excitation]:
    """Each motion as strong as the limits allow on all models; without those that are too fast even when small."""
    feedback, torque, found = _feedback(setting, models[0]), np.array(limits.torque), []
    # The torques are those of a motion under feedback in any case; played alone, they lack its corrections.
    played = np.zeros((2, 2)) if alone else feedback
    for strength in STRENGTHS:
        rest = np.zeros((*motions.shape[:2], 2))
        middle = simulate(setting, models[:1], Sequences(rest, strength * motions, feedback, torque), keep=True)
        sequences = Sequences(middle.torque[:, 0], middle.states[:, 0], played, torque)
        reached = simulate(setting, models, sequences)
        angle, speed = reached.angle.max(axis=1), reached.speed.max(axis=1)
        holds = (angle <= limits.angle) & (speed <= limits.speed)
        for row in np.flatnonzero(holds):
            tau, motion = sequences.torque[row], sequences.reference[row]
            found.append(Excitation(tau, motion, played, limits, float(angle[row]), float(speed[row]), len(models)))
        motions = motions[~holds]
        if not len(motions):
            break
    return found


def _feedback(setting: Integration, model: np.ndarray) -> np.ndarray:
    """Kp and kd of both joints, for the inertia of each while the other is stiff."""
    m = dict(zip(NAMES, model, strict=True))
    elbow = m["B"] + setting.geometry.gr**2 * m["Ir"]
    straight = m["A"] - m["B"] + 2 * setting.geometry.l1 * m["m2r2"] + elbow
    stiffness = np.full(2, STIFFNESS * setting.geometry.g * m["k"])
    return np.stack([stiffness, DAMPING * 2 * np.sqrt(stiffness * np.array([straight, elbow]))])


def _information(setting: Integration, states: Float[np.ndarray, "rows 4"]) -> float:
    """The logarithm of det(Yᵀ Y), which falls with the volume of the parameters' covariance."""
    time = PERIOD * np.arange(len(states))
    points = SPAN * np.arange(1, int(time[-1] / SPAN))[:, None] + OFFSETS
    spans = np.stack([np.interp(points, time, column) for column in states.T], axis=-1)
    matrix = regression_matrix(setting, spans)
    return float(np.linalg.slogdet(matrix.T @ matrix)[1])
