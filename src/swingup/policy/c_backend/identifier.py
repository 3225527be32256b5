"""What a C header has of the identifier: its numbers, and what other parts of the program say of it."""

import math

import numpy as np

from ...physics.base_parameters import BASE, Known, base_parameters, lumped
from ...physics.equations import COULOMB_STEEPNESS, mass_entries
from ...physics.momentum import CLOSE
from ...physics.plant import Plant
from ..compensation import LEAST_GAIN
from ..identifier_settings import (
    AGE_CAUTION,
    FARTHEST,
    LONGEST_STEP,
    MOST_DEVIATION,
    MOST_OFFSET,
    SHORTEST_STEP,
    STUDENT,
    UNEVEN_FADING,
    UNEVEN_STEP,
    IdentifierSettings,
    prior,
)
from ..pendulum import PendulumPolicy
from ..stages import PlantStage
from ..template import asset, fill
from .numbers import braces

PROGRAM = {
    "FIELDS": """\
    swingup_identifier identifier;
    swingup_plant plant; /* the model: what was found until the last call */
""",
    "ANGLE1": "measured[0] - c->identifier.offsets[0]",
    "ANGLE2": "measured[1] - c->identifier.offsets[1]",
    "INTERVAL": "swingup_interval(&c->identifier, h)",
    "AGE": "c->identifier.age",
    "BELIEVE": "    swingup_believe(&c->plant, &c->identifier);\n",
    "BELIEVED": "&c->plant, ",
    "IDENTIFY": "    swingup_identify(&c->identifier, measured, c->delay_steps, c->called ? pause : -1.0);\n",
    "NOTE": "    swingup_note(&c->identifier, c->torques[0], u[1 - SWINGUP_DRIVEN]);\n",
    "COMPENSATE": "    swingup_compensate(&c->estimator.identifier, seen, u);\n",
    "BEGIN": "    swingup_begin(&c->estimator.identifier);\n",
    "READER": """\
/* The nine base parameters found so far, ordered as docs/policy-format.md has them; at first the file's plant's. */
static inline const double *swingup_base_parameters(const swingup_controller *c)
{
    return c->estimator.identifier.base;
}

""",
    "FOUND": """\
 * swingup_base_parameters(&controller) are nine numbers: what the identifier has found of the plant so far.
""",
}
"""What other parts say of an identifier, by the gaps of their texts."""
PLAIN = {"ANGLE1": "measured[0]", "ANGLE2": "measured[1]", "INTERVAL": "h", "AGE": "0"}
"""What the estimator says without an identifier of its angles, of the time between them, and of their age."""
SIGHTED = {
    "TOLD": "_for",
    "SIGHT": ", const double base[9]",
    "BASE": ", base",
    "KNOWN": ", c->estimator.identifier.told",
    "FOLDED": """\
/* The policy for the plant of its file. */
static inline double swingup_policy(const double x[4])
{
    static const double base[9] = @THETA@;
    return swingup_policy_for(x, base);
}

""",
}
"""What they say of a policy that is told the identified plant."""
REGULATED = {"SHOWN": ", const double base[9]", "KNOWN": SIGHTED["KNOWN"], "THETA": ""}
"""What they say of a regulator that is told it."""
INPUTS = """\
    for (i = 0; i < 9; i++) {
        static const double centre[9] = @CENTRE@, scale[9] = @SCALE@;
        observation[i + @SIZE@] = swingup_clip((base[i] - centre[i]) / scale[i], @CLIP@);
    }
"""


def calls(policy: PendulumPolicy) -> dict[str, str]:
    """What other parts of a header say of the identifier, by their gaps; nothing without one."""
    said = dict.fromkeys([*PROGRAM, *SIGHTED, "SHOWN"], "") | PLAIN
    if policy.identifier is not None:
        said |= PROGRAM if policy.regulator is None else PROGRAM | REGULATED
    if is_told(policy):
        said |= SIGHTED | {"FOLDED": fill(SIGHTED["FOLDED"], {"THETA": braces(base_parameters(policy.plant))})}
    return said


def is_told(policy: PendulumPolicy) -> bool:
    """Whether the network of a header sees the identified plant."""
    return policy.identifier is not None and policy.network.plant_stage is not None


def plant_inputs(stage: PlantStage, size: int) -> str:
    """The inputs that a stage appends to ``size`` numbers."""
    pair = {"CENTRE": braces(stage.centre), "SCALE": braces(stage.scale)}
    return fill(INPUTS, pair | {"SIZE": str(size), "CLIP": repr(float(stage.clip))})


def identified_model(settings: IdentifierSettings, plant: Plant, joint: int) -> str:
    """The identifier about a nominal plant whose driven joint is ``joint``, and the model that it finds."""
    base = base_parameters(plant)
    known = {"L1": plant.l1, "GRAVITY": plant.g, "GEAR": plant.gr, "RATIO": base[2] / base[3]}
    known |= {"STEEPNESS": COULOMB_STEEPNESS, "CLOSE": CLOSE}
    values = _numbers(settings) | _arrays(settings, plant, joint)
    values |= {name: repr(float(value)) for name, value in known.items()}
    return "\n".join(fill(asset(__package__, file), values) for file in ("identifier.h", "identified_model.h"))


def _numbers(s: IdentifierSettings) -> dict[str, str]:
    numbers = {
        "DT": s.dt,
        "WEIGHT": s.pole,
        "RELATIVE": s.relative_floor,
        "GATE2": s.gate**2,
        "HOLD": s.hold,
        "STUDENT": STUDENT,
        "ALIKE": s.alike,
        "RISE": 1.0 - math.exp(-s.dt / s.rise),
        "FALL": 1.0 - math.exp(-s.dt / s.fall),
        "MARGIN": s.margin,
        "FARTHEST": FARTHEST,
        "LONGEST": LONGEST_STEP * s.dt,
        "SHORTEST": SHORTEST_STEP * s.dt,
        "PASSIVE_LIMIT": s.passive_limit,
        "LEAST_GAIN": LEAST_GAIN,
        "MOST_OFFSET": MOST_OFFSET,
        "AGE_CAUTION": AGE_CAUTION,
        "UNEVEN_FADING": UNEVEN_FADING,
        "UNEVEN2": UNEVEN_STEP**2,
    }
    counts = {"SPAN": s.span, "COMMANDS": s.past}
    return {name: repr(float(value)) for name, value in numbers.items()} | {
        name: str(count) for name, count in counts.items()
    }


def _arrays(s: IdentifierSettings, plant: Plant, joint: int) -> dict[str, str]:
    mean, covariance = prior(plant, s)
    driven = np.arange(2) == joint
    deviation = np.where(driven, s.driven_deviation, s.passive_deviation)
    nominal = lumped(mean[:BASE], Known(plant.l1, plant.g, plant.gr))
    arrays = {
        "MEAN": mean,
        "VARIANCE": deviation**2,
        "MOST": (MOST_DEVIATION * deviation) ** 2,
        "FLOOR": np.where(driven, s.driven_floor, s.passive_floor) ** 2,
        "DRIFT": s.walk**2 * s.dt * np.diagonal(covariance),
        "STRETCHED": np.array(mass_entries(nominal, 1.0)),
        "FOLDED": np.array(mass_entries(nominal, -1.0)),
    }
    return {name: braces(values) for name, values in arrays.items()} | {
        "PRIOR": ",\n".join(f"    {braces(row)}" for row in covariance)
    }
