"""A policy as a single C99 header: no allocation, no library but the standard's own mathematics.

``assets/policy.h`` is the program; this module fills in the numbers and unrolls nothing but the layers.
"""

import itertools

import numpy as np

from ..errors import SwingupError
from ..robots import TORQUE_LIMIT
from ..runtime.plant import nominal_plant
from ..runtime.policy_file import NormaliseStage, PendulumPolicy, PendulumStage, Stage
from ..runtime.settings import LOST, EstimatorSettings, kalman_gains
from ..version import __version__
from .template import asset, fill

LAYER = """\
static inline void swingup_layer_{index}(const swingup_real x[{inputs}], swingup_real y[{outputs}])
{{
    swingup_real sum[{outputs}];
    int k, j;
    for (j = 0; j < {outputs}; j++) {{
        sum[j] = swingup_bias_{index}[j];
    }}
    for (k = 0; k < {inputs}; k++) {{
        const swingup_real value = x[k];
        if (value != 0) {{
            for (j = 0; j < {outputs}; j++) {{
                sum[j] += swingup_weight_{index}[k][j] * value;
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


def c_header(policy: PendulumPolicy) -> str:
    """The header's text.

    Raises:
        SwingupError: the policy has an observation that this program does not write.
    """
    layers = policy.file.layers
    names = ["input", *(f"layer_{index}" for index in range(len(layers)))]
    sizes = [len(layer.bias) for layer in layers]
    behind = "a policy behind its state estimator" if policy.estimator else "a policy"
    rate = f"every {policy.estimator.dt:g} s" if policy.estimator else "at the loop's rate"
    values = {
        "ABOUT": f"{behind} for the {policy.robot.name}, written by swingup {__version__}.".capitalize(),
        "RATE": rate,
        "DRIVEN": str(policy.robot.joint),
        "TORQUE_LIMIT": repr(policy.torque_limit),
        "INPUTS": str(layers[0].weight.shape[1]),
        "ARRAYS": "\n\n".join(_arrays(index, layer.weight, layer.bias) for index, layer in enumerate(layers)),
        "LAYERS": "\n".join(_layer(index, len(layers), layer.weight) for index, layer in enumerate(layers)),
        "BUFFERS": "\n".join(f"    swingup_real {name}[{n}];" for name, n in zip(names[1:], sizes, strict=True)),
        "OBSERVE": "".join(map(_observe, policy.file.stages)).rstrip("\n"),
        "CALLS": "\n".join(
            f"    swingup_layer_{index}({before}, {after});"
            for index, (before, after) in enumerate(itertools.pairwise(names))
        ),
        "RESULT": names[-1],
        "CONTROLLER": _controller(policy),
    }
    return fill(asset("policy.h"), values)


def _controller(policy: PendulumPolicy) -> str:
    if policy.estimator is None:
        return asset("alone.h")
    return fill(asset("estimator.h"), _estimator_values(policy.estimator))


def _estimator_values(settings: EstimatorSettings) -> dict[str, str]:
    plant, gains = nominal_plant(), kalman_gains(settings)
    numbers = {
        "DT": settings.dt,
        "MOTOR_LIMIT": TORQUE_LIMIT,
        "COUPLING": plant.coupling,
        "SHOULDER": plant.shoulder,
        "ELBOW": plant.elbow,
        "GRAVITY1": plant.gravity1,
        "GRAVITY2": plant.gravity2,
        "GAIN_QQ": gains[0, 0],
        "GAIN_QV": gains[0, 1],
        "GAIN_VQ": gains[1, 0],
        "GAIN_VV": gains[1, 1],
        "FADING": np.exp(-settings.dt / settings.memory),
        "SCALE2": settings.residual_scale**2,
        "CAUTION": settings.caution,
        "LOST": LOST * settings.velocity_noise,
    }
    texts = {name: repr(float(value)) for name, value in numbers.items()}
    return texts | {"DEPTH": str(settings.longest_dead_time + 1)}


def _observe(stage: Stage) -> str:
    if isinstance(stage, PendulumStage):
        text = WRAPPED if stage.angles == "wrapped" else SINCOS
        return fill(text, {"SCALE": repr(float(stage.velocity_scale))})
    if isinstance(stage, NormaliseStage):
        numbers = {"MEAN": _braces(stage.mean), "DEVIATION": _braces(stage.deviation)}
        return fill(NORMALISE, numbers | {"SIZE": str(len(stage.mean)), "CLIP": repr(float(stage.clip))})
    raise SwingupError(f"a header cannot have the observation stage {type(stage).__name__}: export to NumPy")


def _arrays(index: int, weight: np.ndarray, bias: np.ndarray) -> str:
    outputs, inputs = weight.shape
    rows = ",\n".join(_braces(column, "f") for column in weight.T)
    return (
        f"static const float swingup_bias_{index}[{outputs}] = {_braces(bias, 'f')};\n"
        f"static const float swingup_weight_{index}[{inputs}][{outputs}] = {{\n{rows}\n}};"
    )


def _layer(index: int, depth: int, weight: np.ndarray) -> str:
    outputs, inputs = weight.shape
    result = "sum[j] > 0 ? sum[j] : 0" if index < depth - 1 else "sum[j]"
    return LAYER.format(index=index, inputs=inputs, outputs=outputs, result=result)


def _braces(values: np.ndarray, suffix: str = "") -> str:
    """An initialiser; decimals that C reads back as the same numbers."""
    return "{" + ", ".join(f"{np.format_float_scientific(value)}{suffix}" for value in values) + "}"
