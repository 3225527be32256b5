"""What a robot may be before it is identified: models drawn from a domain, and a domain around a plant."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ...loop.domain import Domain, make_domain
from ...plant.plant import NAMES as PLANT_NAMES
from ...plant.plant import Plant
from ..fit.prediction import INDEX, in_loop, vector_of
from ..fit.unknowns import MASSES
from ..plant_domain import domain_of

BASE_SPREAD = 0.2
"""Base parameters around a plant that a drawing or a fit of another specimen gives: this part lower or higher."""
ROTOR = (0.5, 2.5)
FRICTION = (0.4, 1.6)
"""Rotors' inertia and Coulomb friction, as multiples. Source: fits of one robot in several sessions."""
LEAST_FRICTION = 0.02
"""Coulomb friction may reach this part of gravity's torque where the plant has none."""
DELAY, LAG = (0.001, 0.006), (0.001, 0.004)
"""s. Source: fits of recordings."""


def prior_around(plant: Plant) -> Domain:
    """A domain around a plant's facts: as wide as specimens of one design, and sessions of one robot, differ."""
    vector = vector_of(plant)
    # Friction's size is not known, but it is small beside gravity's torque.
    torque = plant.g * vector[INDEX["k"]]
    vector[INDEX["A"]] -= vector[INDEX["B"]]
    around = dict.fromkeys(MASSES[:4], (1 - BASE_SPREAD, 1 + BASE_SPREAD)) | {
        "Ir": ROTOR,
        "cf1": FRICTION,
        "cf2": FRICTION,
    }
    ranges = {name: (low * vector[INDEX[name]], high * vector[INDEX[name]]) for name, (low, high) in around.items()}
    for joint in ("1", "2"):
        low, high = ranges[f"cf{joint}"]
        ranges[f"cf{joint}"] = (min(low, high), max(low, high, LEAST_FRICTION * torque))
        damping = vector[INDEX[f"b{joint}"]]
        ranges[f"b{joint}"] = (min(damping, 0.0), max(3 * damping, 0.002 * torque))
    loop = {"delay": DELAY, "lag": LAG, "offset1": (0.0, 0.0), "offset2": (0.0, 0.0)}
    found = make_domain({**domain_of(plant, ranges | loop), "plant": plant}, f"around {plant.name}")
    # The domain's one torque limit is that of the stronger motor; here each motor keeps its own.
    low, high = (
        end._replace(plant=end.plant.changed(tl1=plant.tl1, tl2=plant.tl2)) for end in (found.low, found.high)
    )
    return replace(found, low=low, high=high)


def draw_models(domain: Domain, count: int, seed: int) -> Float[np.ndarray, "count 15"]:
    """Models of plants and loops, uniform on the domain's ranges; the first is the middle of all ranges."""
    random = np.random.default_rng(seed)
    names = [name for name, _, _ in domain.ranges]
    low, high = (np.array([row[place] for row in domain.ranges]) for place in (1, 2))
    part = np.concatenate([np.full((1, len(names)), 0.5), random.random((count - 1, len(names)))])
    return np.stack([_model(domain, dict(zip(names, low + row * (high - low), strict=True))) for row in part])


def corner_models(domain: Domain) -> Float[np.ndarray, "corners 15"]:
    """Models of the plants at the ends of the domain's ranges, with the largest torque gains."""
    # A motor that delivers more than it is asked for moves the arm furthest.
    highest = {name: high for name, _, high in domain.ranges if name in ("gain1", "gain2")}
    return np.stack([_model(domain, highest, plant) for plant in domain.corners()])


def _model(domain: Domain, values: dict[str, float], plant: Plant | None = None) -> np.ndarray:
    """A model's vector; loop values that the domain does not have are typical ones."""
    own = {name: value for name, value in values.items() if name in PLANT_NAMES}
    return in_loop(vector_of(domain.plant.changed(**own) if plant is None else plant), values)
