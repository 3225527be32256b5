"""Simple shapes of uniform density: volume, moments of inertia, and where they end."""

import math

import numpy as np

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
"""Shapes, and how many sizes (m) each has: radius; radius and half length along z; or three half axes."""


def volume(shape: str, sizes: np.ndarray) -> float:
    """The volume (m³)."""
    if shape in ("capsule", "cylinder"):
        radius, half = sizes
        return float(math.pi * radius**2 * (2 * half + (4 / 3 * radius if shape == "capsule" else 0.0)))
    a, b, c = np.broadcast_to(sizes, 3)
    return float((8.0 if shape == "box" else 4 / 3 * math.pi) * a * b * c)


def inertia(shape: str, sizes: np.ndarray, mass: float) -> np.ndarray:
    """The inertia (3, 3) about the centre, in the shape's axes (kg m²)."""
    if shape in ("capsule", "cylinder"):
        radius, half = sizes
        # By their share of the volume.
        ends = radius / (radius + 1.5 * half) * mass if shape == "capsule" else 0.0  # both half spheres
        rod = mass - ends
        along = 0.5 * rod * radius**2 + 0.4 * ends * radius**2
        # The centre of a half sphere lies 3/8 of its radius beyond the end of the rod.
        across = rod * (radius**2 / 4 + half**2 / 3) + ends * (0.4 * radius**2 + half**2 + 0.75 * half * radius)
        return np.diag([across, across, along])
    squares = np.square(np.broadcast_to(sizes, 3))
    return np.diag((squares.sum() - squares) * mass / (3 if shape == "box" else 5))


def ends(shape: str, sizes: np.ndarray) -> list[np.ndarray]:
    """Points (3,) at which a link may end: those of the middle line, without a capsule's caps, or a box's faces."""
    if shape == "sphere":
        return [np.zeros(3)]
    halves = np.diag(sizes if len(sizes) == 3 else (0.0, 0.0, sizes[1]))
    return [sign * half for half in halves for sign in (1.0, -1.0)]
