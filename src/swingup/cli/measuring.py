"""The command ``plant``: a plant from a model file or from a ruler and a scale, and files of it."""

import itertools
from collections.abc import Sequence
from typing import Annotated

from tyro.conf import Positional, UseAppendAction

from ..plant.measured import MeasuredPlant, measured_plant
from ..plant.model_files.bodies import READINGS
from ..plant.plant import Plant, is_model_file
from ..plant.robots import ROBOTS
from ..plant.save import save_plant
from ..plant.units import torque_over_gravity
from .arguments import PLANTS, PlantOutputs, check_plant_outputs, named_values, optional, word_of
from .output import tell, tell_json, tell_table

ROWS = {
    "m": "mass (kg)",
    "l": "length (m)",
    "r": "centre of mass from the joint (m)",
    "I": "inertia about the joint (kg m²)",
    "b": "damping (N m s/rad)",
    "cf": "Coulomb friction (N m)",
    "tl": "torque limit (N m)",
}
"""Numbers that both links or both joints have."""


def plant_command(
    source: Positional[
        Annotated[str | None, optional("PLANT", f"{PLANTS}; without it the values say all.")]
    ] = None,
    /,
    set: Annotated[UseAppendAction[tuple[tuple[str, ...], ...]], optional("NAME=VALUE...")] = (),
    inertia: Annotated[str | None, word_of("inertia", *READINGS), optional()] = None,
    out: PlantOutputs = (),
    json: bool = False,
) -> int:
    """Read a plant from a URDF, an MJCF or measured values, show it, and write it as YAML, URDF or MJCF.

    From a ruler and a scale: --set m1=0.5 l1=0.2 m2=0.6 l2=0.3 motor=1 gr=6. Without more, links are rods.

    Args:
        source: the plant.
        set: values in SI units, which replace the plant's: m1, l1, r1, I1, b1, cf1, tl1, those of link 2, Ir, gr
            and g, as in a parameter file; Ic1 and Ic2, inertias about the centres of mass; motor, the torque of
            both motors before the gears.
        inertia: what the inertias of a URDF or an MJCF are about: the centre of mass, or the joint, as in
            RealAIGym's files.
        out: files to write, .yml, .urdf or .xml.
        json: print one JSON object.
    """
    check_plant_outputs(out)
    found = measured_plant(source, named_values("--set", itertools.chain(*set), "m1=0.5"), inertia)
    for each in sorted(out, key=is_model_file, reverse=True):  # which may not hold every plant
        save_plant(each, found.plant, ["SI units, inertias about the joints.", *found.notes])
    if json:
        tell_json({"plant": found.plant.name, **found.plant.values(), "notes": found.notes})
    else:
        _show(found)
        tell(*(f"wrote {each}: use it with --plant {each}" for each in out))
    return 0


def _show(found: MeasuredPlant) -> None:
    plant = found.plant
    rows = [[f"{text}", f"{name}1, {name}2", *_pair(plant, name)] for name, text in ROWS.items()]
    tell_table(["", "names", "link 1", "link 2"], rows, texts=2, title=str(plant))
    ratios = ", ".join(f"{name} {torque_over_gravity(plant.driven(robot)):.3g}" for name, robot in ROBOTS.items())
    tell(
        f"rotors Ir = {plant.Ir:.4g} kg m², gear ratio gr = {plant.gr:.4g}, gravity g = {plant.g:.4g} m/s²",
        f"torque over gravity: {ratios}",
        *found.notes,
    )


def _pair(plant: Plant, name: str) -> Sequence[str]:
    return [f"{getattr(plant, f'{name}{link}'):.4g}" for link in (1, 2)]
