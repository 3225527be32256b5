"""What a state estimator expects of the measurement and of the loop, as a policy file's metadata has it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np

from ..errors import SwingupError

SettingsT = TypeVar("SettingsT")

ESTIMATOR = "estimator"
"""Where a policy file's metadata holds the estimator's settings."""
FRONT_END = "front_end"
"""Where it holds those of the front end."""
STEEPNESS = 100.0
"""Slope of RealAIGym's smoothed Coulomb friction, cf arctan(100 q̇) (s/rad)."""
DOUBLINGS = 50
"""2^50 measurements: far more than any filter needs to become steady."""
LOST = 100
"""An estimated rate so many standard deviations off the measured one is no estimate: a measurement has jumped."""


@dataclass(frozen=True)
class EstimatorSettings:
    """What the estimator expects of the measurement and of the loop; every value is chosen, not identified."""

    dt: float = 0.002
    """Time between calls (s). After a longer pause the estimator starts anew from what it is shown."""
    position_noise: float = 1e-4
    """Standard deviation of the measured angles (rad): that of an encoder of 2^14 counts is 1.1e-4."""
    velocity_noise: float = 0.25
    """Standard deviation of the measured velocities (rad/s)."""
    acceleration_noise: float = 50.0
    """Standard deviation of what the model does not know of the accelerations (rad/s²)."""
    longest_dead_time: int = 25
    """Longest dead time that is considered (steps)."""
    residual_scale: float = 1e-4
    """A miss of a predicted angle far above this counts little more (rad): a push must not decide a dead time."""
    caution: float = 20.0
    """Log likelihood that a dead time must gain for each step that it is longer."""
    memory: float = 5.0
    """Time in which evidence on the dead time fades (s)."""

    def __post_init__(self) -> None:
        """Refuse what cannot work.

        Raises:
            SwingupError: a value is no number of its range.
        """
        for field in fields(self):
            name, value = field.name, getattr(self, field.name)
            kinds = int if name == "longest_dead_time" else int | float
            least = 0 if name in ("longest_dead_time", "caution") else 1e-6
            most = 0.1 if name == "dt" else 1000
            if not isinstance(value, kinds) or isinstance(value, bool) or not least <= value <= most:
                kind = "whole number" if kinds is int else "number"
                raise SwingupError(f"estimator setting {name} = {value!r}: use a {kind} of {least:g} to {most:g}")


@dataclass(frozen=True)
class FrontEndSettings:
    """How measurements are filtered, how far apart the remembered ones are, and what friction is made up for."""

    dt: float = 0.002
    """Time between calls (s). After a longer pause the memory starts anew from what is measured."""
    velocity_weight: float = 1.0
    """Weight of the newest velocity in the low-pass v ← v + w (measured - v); 1 is no filter."""
    dead_band: float = 0.0
    """Filtered velocities below it are seen as 0 (rad/s)."""
    spacing: int = 5
    """Calls from one remembered measurement to the next; a remembered torque is the mean over as many."""
    damping: tuple[float, float] = (0.0, 0.0)
    """b of the friction b q̇ + cf arctan(100 q̇) that is made up for, of shoulder and elbow (N m s/rad)."""
    coulomb: tuple[float, float] = (0.0, 0.0)
    """cf of that friction (N m)."""
    passive_limit: float = 0.5
    """Largest torque on the passive joint (N m)."""

    def __post_init__(self) -> None:
        """Refuse what cannot work, and make tuples of lists.

        Raises:
            SwingupError: a value is no number of its range.
        """
        for name in ("damping", "coulomb"):
            values = getattr(self, name)
            pair = tuple(values) if isinstance(values, Sequence) and not isinstance(values, str) else ()
            if len(pair) != 2 or not all(_is_number(value, 0.0, 10.0) for value in pair):
                raise SwingupError(f"front end's {name} = {values!r}: two numbers of 0 to 10 are needed")
            object.__setattr__(self, name, pair)
        ranges = {
            "dt": (1e-6, 0.1), "velocity_weight": (1e-6, 1.0), "dead_band": (0.0, 10.0), "spacing": (1, 1000),
            "passive_limit": (0.0, 1000.0),
        }  # fmt: skip
        for name, (least, most) in ranges.items():
            value = getattr(self, name)
            whole = name != "spacing" or isinstance(value, int)
            if not (whole and _is_number(value, least, most)):
                kind = "whole number" if name == "spacing" else "number"
                raise SwingupError(f"front end's {name} = {value!r}: a {kind} of {least:g} to {most:g} is needed")


def kalman_gains(settings: EstimatorSettings) -> np.ndarray:
    """Steady-state Kalman gains (2, 2) of one joint: a double integrator whose acceleration is unsure.

    K = P (P + R)⁻¹ with the solution P of P = A (P - K P) Aᵀ + Q, the covariance of a prediction. It is found for
    any noise by doubling: step k gives P after 2^k measurements.
    """
    dt = settings.dt
    # In units of the measured noise, so that R = I.
    scale = np.array([settings.position_noise, settings.velocity_noise])
    A = (np.array([[1.0, dt], [0.0, 1.0]]) * scale / scale[:, None]).T
    into = settings.acceleration_noise * np.array([0.5 * dt**2, dt]) / scale
    G, P = np.eye(2), np.outer(into, into)
    for _ in range(DOUBLINGS):
        W = np.linalg.inv(np.eye(2) + G @ P)
        A, G, P = A @ W @ A, G + A @ W @ G @ A.T, P + A.T @ P @ W @ A
        G, P = 0.5 * (G + G.T), 0.5 * (P + P.T)
    return scale[:, None] * (P @ np.linalg.inv(P + np.eye(2))) / scale


def read_settings(metadata: Mapping[str, Any]) -> EstimatorSettings | None:
    """The settings that a policy file's metadata holds under ``estimator``; None if there is no such key.

    Raises:
        SwingupError: it holds something else, an unknown setting, or a value out of range.
    """
    return read_object(metadata, ESTIMATOR, EstimatorSettings)


def read_front_end(metadata: Mapping[str, Any]) -> FrontEndSettings | None:
    """The settings that a policy file's metadata holds under ``front_end``; None if there is no such key.

    Raises:
        SwingupError: it holds something else, an unknown setting, or a value out of range.
    """
    return read_object(metadata, FRONT_END, FrontEndSettings)


def read_object(metadata: Mapping[str, Any], key: str, kind: type[SettingsT]) -> SettingsT | None:
    """Settings of a kind that a policy file's metadata holds under a key; None if there is no such key.

    Raises:
        SwingupError: it holds something else, an unknown setting, or a value out of range.
    """
    if key not in metadata:
        return None
    given, known = metadata[key], [field.name for field in fields(kind)]  # type: ignore[arg-type]  # a dataclass
    if not isinstance(given, Mapping):
        raise SwingupError(f"{key} {given!r} is no object of settings: use {{}} for the defaults")
    unknown = [name for name in given if name not in known]
    if unknown:
        raise SwingupError(f"unknown {key} setting {unknown[0]!r}: use some of {', '.join(known)}")
    return kind(**given)


def _is_number(value: Any, least: float, most: float) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most
