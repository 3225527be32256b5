"""The leaderboards' plant in plain floats: no friction, no motor inertia.

The state is x = [q1, q2, dq1, dq2] (rad, rad/s). ``physics/dynamics.py`` has the whole model, in JAX; this is the
estimator's, written for one call at a time: a dozen numbers are fastest as Python's own.
"""

import math
from dataclasses import dataclass
from importlib import resources

from ..errors import SwingupError

Four = tuple[float, float, float, float]

MODEL = "physics/models/design_C.1_model_1.0.yml"
"""The identified model's file, inside the package."""


@dataclass(frozen=True)
class Plant:
    """What the equations of motion are made of."""

    shoulder: float
    """I1 + I2 + m2 l1², the configuration-independent part of M11 (kg m²)."""
    elbow: float
    """I2, inertia of link 2 about the elbow (kg m²)."""
    coupling: float
    """m2 l1 r2 (kg m²)."""
    gravity1: float
    """(m1 r1 + m2 l1) g (N m)."""
    gravity2: float
    """m2 r2 g (N m)."""


def make_plant(values: dict[str, float]) -> Plant:
    """The plant with parameters by RealAIGym's names (SI, inertias about the joints).

    Raises:
        SwingupError: one is missing.
    """
    try:
        m1, m2, l1, r1, r2, I1, I2, g = (values[name] for name in ("m1", "m2", "l1", "r1", "r2", "I1", "I2", "g"))
    except KeyError as error:
        raise SwingupError(f"the model lacks parameter {error}: add it in SI units") from error
    return Plant(
        shoulder=I1 + I2 + m2 * l1 * l1,
        elbow=I2,
        coupling=m2 * l1 * r2,
        gravity1=(m1 * r1 + m2 * l1) * g,
        gravity2=m2 * r2 * g,
    )


def nominal_plant() -> Plant:
    """The plant that the policies were trained for and that their estimator believes in."""
    root = resources.files(__package__.rpartition(".")[0])
    return make_plant(parse_flat_yaml((root / MODEL).read_text(encoding="utf-8")))


def parse_flat_yaml(text: str) -> dict[str, float]:
    """The numbers of a flat YAML map, one ``name: value`` a line, without PyYAML; what is no number is left out.

    Raises:
        SwingupError: a line is neither blank, a comment, nor ``name: value``.
    """
    values = {}
    for line in text.splitlines():
        content = line.partition("#")[0].strip()
        if not content or content == "---":
            continue
        name, colon, value = content.partition(":")
        if not colon or line[:1].isspace():
            raise SwingupError(f"{content[:40]!r} is no line of a flat map: write 'name: value'")
        try:
            values[name.strip()] = float(value)
        except ValueError:
            continue
    return values


def acceleration(plant: Plant, x: Four, u1: float, u2: float) -> tuple[float, float]:
    """q̈ (rad/s²) of M(q) q̈ = G(q) + u - C(q, q̇) q̇; NaN where an angle is not finite."""
    q1, q2, dq1, dq2 = x
    if not math.isfinite(q1 + q2):  # for which math.sin raises an error
        return math.nan, math.nan
    cosine, sine = plant.coupling * math.cos(q2), plant.coupling * math.sin(q2)
    m11, m12, m22 = plant.shoulder + 2 * cosine, plant.elbow + cosine, plant.elbow
    weight = plant.gravity2 * math.sin(q1 + q2)
    force1 = u1 - plant.gravity1 * math.sin(q1) - weight + sine * dq2 * (2 * dq1 + dq2)
    force2 = u2 - weight - sine * dq1 * dq1
    determinant = m11 * m22 - m12 * m12
    return (m22 * force1 - m12 * force2) / determinant, (m11 * force2 - m12 * force1) / determinant


def torque_response(plant: Plant, x: Four, u1: float, u2: float) -> tuple[float, float]:
    """∂q̈/∂u · u = M(q)⁻¹ u (rad/s²)."""
    cosine = plant.coupling * math.cos(x[1]) if math.isfinite(x[1]) else math.nan
    m11, m12, m22 = plant.shoulder + 2 * cosine, plant.elbow + cosine, plant.elbow
    determinant = m11 * m22 - m12 * m12
    return (m22 * u1 - m12 * u2) / determinant, (m11 * u2 - m12 * u1) / determinant


def midpoint_step(plant: Plant, x: Four, u1: float, u2: float, dt: float) -> Four:
    """One step of the explicit midpoint rule over dt (s)."""
    q1, q2, dq1, dq2 = x
    a1, a2 = acceleration(plant, x, u1, u2)
    half = 0.5 * dt
    v1, v2 = dq1 + half * a1, dq2 + half * a2
    a1, a2 = acceleration(plant, (q1 + half * dq1, q2 + half * dq2, v1, v2), u1, u2)
    return q1 + dt * v1, q2 + dt * v2, dq1 + dt * a1, dq2 + dt * a2
