"""A policy as a single C99 header: no allocation, no library but the standard's own mathematics.

``assets/policy.h`` is the program; this module fills in the numbers and unrolls nothing but the layers.
"""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from ...errors import SwingupError
from ...version import __version__
from ..guard import BRAKED, PUSHING, SENTENCES, STANDSTILLS, GuardSettings, Reason
from ..network import check_plain
from ..pendulum import PendulumPolicy
from ..stages import NormaliseStage, PendulumStage, PlantStage, Stage
from ..template import NAME, asset, check_export_name, fill
from .estimator import estimator_values
from .identifier import calls, is_told, plant_inputs
from .numbers import braces
from .regulator import regulator_values

# The loop skips zeros, of which a ReLU makes many. Weights lie by input: the inner loop reads them in order.
LAYER = """\
static inline void swingup_layer_{index}(const swingup_real x[{inputs}], swingup_real y[{outputs}])
{{
    swingup_real sum[{outputs}];
    int k, j;
    for (j = 0; j < {outputs}; j++) {{
        sum[j] = (swingup_real)swingup_bias_{index}[j];
    }}
    for (k = 0; k < {inputs}; k++) {{
        const swingup_real value = x[k];
        if (value != 0) {{
            for (j = 0; j < {outputs}; j++) {{
                sum[j] += (swingup_real)swingup_weight_{index}[k][j] * value;
            }}
        }}
    }}
    for (j = 0; j < {outputs}; j++) {{
        y[j] = {result};
    }}
}}
"""

WRAPPED = """\
    for (i = 0; i < 2; i++) {
        double angle = fmod(x[i], 2.0 * SWINGUP_PI);
        angle = angle < 0.0 ? angle + 2.0 * SWINGUP_PI : angle;
        observation[i] = (angle - SWINGUP_PI) / SWINGUP_PI;
        observation[i + 2] = swingup_clip(x[i + 2], @SCALE@) / @SCALE@;
    }
"""

SINCOS = """\
    for (i = 0; i < 2; i++) {
        observation[2 * i] = sin(x[i]);
        observation[2 * i + 1] = cos(x[i]);
        observation[i + 4] = swingup_clip(x[i + 2], @SCALE@) / @SCALE@;
    }
"""

NORMALISE = """\
    for (i = 0; i < @SIZE@; i++) {
        static const double mean[@SIZE@] = @MEAN@, deviation[@SIZE@] = @DEVIATION@;
        observation[i] = swingup_clip((observation[i] - mean[i]) / deviation[i], @CLIP@);
    }
"""

GUARDED = """\
The safety guard stops the controller for good at a limit or a broken measurement, until swingup_reset:
 * swingup_guard_reason(&controller) is then not 0, and swingup_guard_sentence(&controller) says why."""
UNGUARDED = "A torque is NaN where the state is not finite: check what you send to a motor."


def c_header(policy: PendulumPolicy, name: str = NAME) -> str:
    """The header's text.

    Args:
        policy: what the policy file holds.
        name: what all names in it begin with; headers with different names go into one program.

    Raises:
        SwingupError: the name is no identifier, or the policy has an observation or hidden layers that this program
            does not write.
    """
    check_export_name(name)
    check_plain(policy.network, "a C header")
    # A network that is told the plant keeps the inputs that others fold.
    network = policy.network if is_told(policy) else policy.folded
    layers = network.layers
    names = ["input", *(f"layer_{index}" for index in range(len(layers)))]
    sizes = [len(layer.bias) for layer in layers]
    around = {
        "state estimator": policy.estimator,
        "identifier": policy.identifier,
        "safety guard": policy.guard,
    }
    parts = " and its ".join(name for name, part in around.items() if part is not None)
    what = "a policy" if policy.regulator is None else "a policy with its regulator"
    about = f"{what}{f' behind its {parts}' if parts else ''} for the {policy.robot.name}"
    values = {
        "ABOUT": f"{about}, written by swingup {__version__}.".capitalize(),
        "RATE": f"every {policy.period:g} s" if policy.period else "at the loop's rate",
        "UNSOUND": GUARDED if policy.guard else UNGUARDED,
        "PASSIVE": "for its friction" if policy.torque_limits[1 - policy.robot.joint] else "0",
        "DRIVEN": str(policy.robot.joint),
        "TORQUE_LIMIT": repr(policy.torque_limit),
        "INPUTS": str(layers[0].weight.shape[1]),
        "ARRAYS": "\n\n".join(_arrays(index, layer.weight, layer.bias) for index, layer in enumerate(layers)),
        "LAYERS": "\n".join(_layer(index, len(layers), layer.weight) for index, layer in enumerate(layers)),
        "BUFFERS": "\n".join(f"    swingup_real {name}[{n}];" for name, n in zip(names[1:], sizes, strict=True)),
        "OBSERVE": _observe(network.stages).rstrip("\n"),
        "CALLS": "\n".join(
            f"    swingup_layer_{index}({before}, {after});"
            for index, (before, after) in enumerate(itertools.pairwise(names))
        ),
        "RESULT": names[-1],
        "CONTROLLER": _controller(policy),
    } | calls(policy)
    text = fill(asset(__package__, "policy.h"), values)
    # Two headers in one program must not share a name.
    return text.replace(f"{NAME}_", f"{name}_").replace(f"{NAME.upper()}_", f"{name.upper()}_")


def _controller(policy: PendulumPolicy) -> str:
    estimator, guard, said = policy.estimator, policy.guard, calls(policy)
    parts = [
        _acting(policy, said),
        _part("estimator.h", said | estimator_values(estimator, policy)) if estimator else _part("direct.h"),
        _part("guard.h", _guard_values(guard, policy)) if guard else _part("unguarded.h"),
        _part("controller.h", said | {"SENTENCES": ", ".join(f'"{text}"' for text in SENTENCES)}),
    ]
    return "\n".join(parts)


def _acting(policy: PendulumPolicy, said: dict[str, str]) -> str:
    """The policy, with its regulator if it has one."""
    if policy.regulator is not None:
        return _part("regulator.h", regulator_values(policy.regulator, policy) | said)
    return _part("alone.h", said)


def _part(file: str, values: Mapping[str, str] | None = None) -> str:
    return fill(asset(__package__, file), values or {})


def _guard_values(settings: GuardSettings, policy: PendulumPolicy) -> dict[str, str]:
    limits = policy.torque_limits
    numbers = {
        "PERIOD": settings.dt,
        "ANGLE_LIMIT": settings.angle_limit,
        "VELOCITY_LIMIT": settings.velocity_limit,
        "LONGEST_PAUSE": settings.longest_pause,
        "STALE_TIME": settings.stale_time,
        "STUCK_TIME": settings.stuck_time,
        "RATE": settings.rate(limits[policy.robot.joint]),
        "BRAKING": settings.braking,
        "BRAKED": BRAKED * settings.velocity_limit,
        "PUSHING": PUSHING,
    }
    texts = {name: repr(float(value)) for name, value in numbers.items()}
    reasons = "\n".join(f"#define SWINGUP_GUARD_{reason.name} {reason.value}" for reason in Reason)
    return texts | {"LIMITS": braces(np.array(limits)), "STANDSTILLS": str(STANDSTILLS), "REASONS": reasons}


def _observe(stages: Sequence[Stage]) -> str:
    texts, size = [], 4
    for stage in stages:
        texts.append(_stage(stage, size))
        size = stage.size(size)
    return "".join(texts)


def _stage(stage: Stage, before: int) -> str:
    if isinstance(stage, PendulumStage):
        return _pendulum(stage)
    if isinstance(stage, NormaliseStage):
        numbers = {"MEAN": braces(stage.mean), "DEVIATION": braces(stage.deviation)}
        return fill(NORMALISE, numbers | {"SIZE": str(before), "CLIP": repr(float(stage.clip))})
    if isinstance(stage, PlantStage):
        return plant_inputs(stage, before)
    raise SwingupError(f"a header cannot have the observation stage {type(stage).__name__}: export to NumPy")


def _pendulum(stage: PendulumStage) -> str:
    return fill(WRAPPED if stage.angles == "wrapped" else SINCOS, {"SCALE": repr(stage.velocity_scale)})


def _arrays(index: int, weight: np.ndarray, bias: np.ndarray) -> str:
    outputs, inputs = weight.shape
    rows = ",\n".join(braces(column, "f") for column in weight.T)
    # That of a folded layer has more digits.
    kind, suffix = ("double", "") if bias.dtype == np.float64 else ("float", "f")
    return (
        f"static const {kind} swingup_bias_{index}[{outputs}] = {braces(bias, suffix)};\n"
        f"static const float swingup_weight_{index}[{inputs}][{outputs}] = {{\n{rows}\n}};"
    )


def _layer(index: int, depth: int, weight: np.ndarray) -> str:
    outputs, inputs = weight.shape
    result = "sum[j] > 0 ? sum[j] : 0" if index < depth - 1 else "sum[j]"
    return LAYER.format(index=index, inputs=inputs, outputs=outputs, result=result)
