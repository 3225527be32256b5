"""Files of plants: YAML, URDF and MJCF, and the bodies that simulations need.

Motion tells m1 r1 + m2 l1, m2 r2, I1 + m2 l1² and I2, not the masses. A fitted plant's numbers may be those of no
body, whose inertia about its joint is at least m r²; simulations of bodies refuse them. Among the pendulums that
move alike there is usually one that could be built.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..common.errors import SwingupError
from ..common.files import write_map
from .base_parameters import BASE_NAMES, base_parameters
from .model_files.files import is_buildable, write_model
from .plant import MODEL_FILES, PARAMETER_FILES, PLANT_FILES, Plant, validated

INERTIA_MARGIN = 1.05
"""Inertia above that of a point mass, m r²."""


def save_plant(path: str | Path, plant: Plant, comments: Sequence[str] = ()) -> None:
    """Write a plant to a file, whose name says the format: YAML, URDF or MJCF.

    ``load_plant`` reads the same numbers from it. Where they are those of no body, a URDF or an MJCF has bodies
    that move alike, and the numbers beside them. Comments are lines of text above a YAML file's values.

    Raises:
        SwingupError: the file cannot be written, or no body moves as the plant does.
    """
    plant = validated(plant)
    values = plant.values()
    if str(path).lower().endswith(MODEL_FILES):
        base = dict(zip(BASE_NAMES, base_parameters(plant).tolist(), strict=True))
        alike = plant if is_buildable(values) else representative(base, plant)
        write_model(path, Path(plant.name or path).name, alike.values(), values)
        return
    if not str(path).lower().endswith(PARAMETER_FILES):
        raise SwingupError(f"cannot write {path}: name {PLANT_FILES}")
    write_map(path, values, *comments)


def representative(base: Mapping[str, float], start: Plant) -> Plant:
    """A pendulum with these base parameters and frictions, whose links could be built if such a pendulum exists.

    Its masses are near those of the start, whose lengths, gravity and limits it has.
    """
    l1, shoulder = float(start.l1), base["A"] - base["B"]
    # Bodies in a simulation have no geared rotors: a part of the elbow's inertia is theirs (``without_rotors``).
    least = INERTIA_MARGIN * base["m2r2"] ** 2 / (base["B"] - float(start.gr) * base["Ir"])
    # Link 1 keeps a part of the inertia and of the moment, so that both stay positive.
    most = min(0.95 * shoulder / l1**2, 0.98 * base["k"] / l1)
    # Where link 2 is too heavy for its inertia, the masses cannot be consistent: the equations still hold.
    m2 = float(np.clip(start.m2, least, most)) if 0 < least < most else most
    rest, I1 = base["k"] - m2 * l1, shoulder - m2 * l1**2
    # At a given m1 r1, m1 r1² falls with m1: heavy enough, link 1 can be built.
    m1 = max(float(start.m1), INERTIA_MARGIN * rest**2 / I1)
    links = {"m1": m1, "m2": m2, "r1": rest / m1, "r2": base["m2r2"] / m2, "I1": I1, "I2": base["B"]}
    others = {name: base[name] for name in ("Ir", "b1", "b2", "cf1", "cf2")}
    return validated(start.changed(**links, **others, name=""))
