"""A pendulum's policy as a single C99 header: a comment, the policy's data, and the runtime.

The runtime is plain C: ``policy/contract.h`` and what it includes, one file for each part. Behind any
data each of them compiles by itself; what they do is decided there, not here.
"""

import math
from dataclasses import asdict

import numpy as np

from ..common import __version__
from ..common.errors import SwingupError
from ..plant.base_parameters import BASE, base_parameters, lumped
from ..plant.equations import COULOMB_STEEPNESS, mass_entries
from ..plant.momentum import CLOSE_RATES
from ..plant.units import C1, arm_scales, scaled, similar_plant
from ..policy import estimator, identifier, regulator, wiring
from ..policy.estimator import EstimatorConstants, estimator_constants
from ..policy.feedback import FeedbackPolicy, RobotPolicy
from ..policy.guard import (
    DEAD_TRAVEL,
    JUMP_RATIO,
    MAX_BRAKED_RATIO,
    MAX_JUMP,
    MAX_STANDSTILLS,
    PUSHING_SHARE,
    REASON_TEXTS,
    WIRING_REASONS,
    GuardSettings,
    Reason,
)
from ..policy.identifier import IdentifierConstants
from ..policy.network import NormaliseStage, PendulumStage, PlantStage
from ..policy.numpy_backend import regulator_loop
from ..policy.pendulum import PendulumPolicy
from ..policy.policy import TaskPolicy
from ..policy.regulator import Loop as Regulator
from ..policy.self_test import loop_test
from .c_task import network_data, plain, sizes, task_data, task_usage, test_data
from .c_text import Data, Precision, header
from .folder import NAME, check_export_name

USAGE = """\
/*
 * {about}, written by swingup {version}.
 *
 * C99 or C++11, in {precision} precision, with <math.h>, <stdint.h> and <string.h>; no allocation, no global state,
 * no other library. Sizes and weights are fixed.
 *
 *     swingup_controller controller;
 *     swingup_self_test(&controller);                 at boot: 0, or the number of the call that fails
 *     swingup_reset(&controller);                     before every run
 *     swingup_control(&controller, t, x, u);          at every step, {rate}
 *
 * x = [q1, q2, dq1, dq2]: shoulder angle from hanging down, elbow angle relative to link 1 (rad), and their rates
 * (rad/s); t is the time (s); u = [u1, u2] are the torques of shoulder and elbow (N m), within the motors' limits,
 * the passive joint's {passive}. Angles are the encoders', whose zeros, {zeros} rad, are subtracted here.
{alone} * The plant is {plant}.
{sizes}{notes} */
"""
ALONE_NOTE = """\
 * swingup_policy(x) is the policy alone: the torque of the driven joint, without memory.
"""
IDENTIFIED_NOTE = """\
 * swingup_base_parameters(&controller) are nine numbers: what the identifier has found of the plant so far.
"""
GUARDED_NOTE = """\
 * The safety guard stops the controller for good at a limit or a broken measurement, until swingup_reset:
 * swingup_guard_reason(&controller) is then not 0, and swingup_guard_sentence(&controller) says why.
"""
UNGUARDED_NOTE = """\
 * A torque is NaN where the state is not finite: check what you send to a motor.
"""


def c_header(policy: TaskPolicy | RobotPolicy, name: str = NAME, precision: Precision = "double") -> str:
    """The header's text, in which all names begin with ``name``: several go into one program."""
    check_export_name(name)
    if isinstance(policy, TaskPolicy):
        data = task_data(policy)
        return header(task_usage(policy, data, precision), data, "task.h", precision, name)
    data = runtime_data(policy)
    return header(_usage(policy, data, precision), data, "loop_test.h", precision, name)


def _usage(policy: RobotPolicy, data: dict[str, Data], precision: Precision) -> str:
    parts = {"state estimator": policy.estimator, "identifier": policy.identifier, "safety guard": policy.guard}
    around = " and its ".join(name for name, part in parts.items() if part is not None)
    if isinstance(policy, FeedbackPolicy):
        what, alone = f"The baseline {policy.name}", ""
    else:
        what, alone = f"A policy{'' if policy.regulator is None else ' with its regulator'}", ALONE_NOTE
    return USAGE.format(
        about=f"{what}{f' behind its {around}' if around else ''} for the {policy.robot.name}",
        alone=alone,
        version=__version__,
        precision=precision,
        plant=plain(policy.plant.name) or "that of the policy",
        sizes=sizes(data, precision, "sizeof(swingup_controller), and the stack of a call"),
        rate=f"every {policy.period:g} s" if policy.period else "at the loop's rate",
        zeros=" and ".join(f"{zero:.6g}" for zero in policy.plant.zeros),
        passive="for its friction" if policy.torque_limits[1 - policy.robot.joint] else "0",
        notes=(IDENTIFIED_NOTE if policy.identifier else "") + (GUARDED_NOTE if policy.guard else UNGUARDED_NOTE),
    )


SHARED_CONSTANTS = (
    "BANDWIDTH", "RELATIVE_FLOOR", "GATE_TIME", "FREEDOM", "RISE_TIME", "FALL_TIME", "MIN_MASS_SHARE",
    "MAX_ANGLE", "MAX_OFFSET", "AGE_MARGIN", "AGE_FADING", "UNEVEN_ANGLE", "MAX_NOISE", "NOISE_TIME",
    "EVEN_TOLERANCE",
)  # fmt: skip
"""Constants of the identifier that the runtime has under the same names."""


def runtime_data(policy: RobotPolicy) -> dict[str, Data]:
    """All that the runtime needs, part by part."""
    parts = {
        "ESTIMATOR": policy.estimator,
        "IDENTIFIER": policy.identifier,
        "REGULATOR": policy.regulator,
        "GUARD": policy.guard,
        "FEEDBACK": policy if isinstance(policy, FeedbackPolicy) else None,
    }
    joint = policy.robot.joint
    reasons: Data = {f"GUARD_{reason.name}": reason.value for reason in Reason}
    found: dict[str, Data] = {
        "the switches": {f"HAS_{name}": int(part is not None) for name, part in parts.items()},
        "the plant": plant_data(policy),
        "the law": feedback_data(policy) if isinstance(policy, FeedbackPolicy) else pendulum_data(policy),
        "the guard's reasons": reasons | {"GUARD_SENTENCES": ", ".join(f'"{text}"' for text in REASON_TEXTS)},
    }
    if policy.estimator is not None:
        constants = estimator_constants(policy.estimator, policy.plant, joint, policy.identifier)
        found["the estimator"] = estimator_data(constants)
        if constants.identifier is not None:
            found["the identifier"] = identifier_data(constants.identifier)
    if policy.regulator is not None:
        held = policy.held_plant if isinstance(policy, FeedbackPolicy) else policy.plant
        known = policy.regulator, held, joint, policy.torque_limit
        found["the regulator"] = regulator_data(regulator_loop(*known))
    if policy.guard is not None:
        found["the guard"] = guard_data(policy.guard, policy)
    return found | {"the self-test": test_data(loop_test(policy))}


def plant_data(policy: RobotPolicy) -> Data:
    """What the policy's plant is, in its base parameters and C.1's units, these units, and what its motors can."""
    scales = arm_scales(policy.plant)
    plant = similar_plant(policy.plant, scales)
    return {
        "TIME_UNIT": scales.time,
        "TORQUE_UNIT": scales.torque,
        "base_units": np.array(scales.base),
        "DRIVEN": policy.robot.joint,
        "L1": plant.l1,
        "GRAVITY": plant.g,
        "GEAR": plant.gr,
        "STEEPNESS": COULOMB_STEEPNESS,
        "theta": base_parameters(plant),
        "limits": np.array(policy.torque_limits),
        "MAX_STANDSTILLS": MAX_STANDSTILLS,
        "zeros": np.array(policy.plant.zeros),
    }


def feedback_data(policy: FeedbackPolicy) -> Data:
    """The law's numbers, in the plant's own units but for the regulator's plant."""
    held = similar_plant(policy.held_plant, arm_scales(policy.plant))
    data: Data = {"TORQUE_LIMIT": policy.torque_limit, "COULOMB": policy.coulomb, "held": base_parameters(held)}
    if policy.top is not None:
        top = policy.top
        data |= {"top_gains": top.gains, "top_cost": top.cost_to_go, "LARGEST_COST": float(top.largest_cost)}
    swing_up = policy.swing_up
    if swing_up is None:
        return data | {"PIECES": 0}
    data |= {"PIECES": len(swing_up.ends), "threshold": swing_up.threshold}
    pieces = {name: getattr(swing_up, name) for name in ("starts", "ends", "coefficients")}
    return data | {f"piece_{name}": np.ravel(value) for name, value in pieces.items()}


def pendulum_data(policy: PendulumPolicy) -> Data:
    """The network and its observation: folded for the plant, unless an identifier tells it another one."""
    network = policy.network if policy.finds_plant else policy.folded
    # The stages: angles and velocities, perhaps normalised, perhaps with the plant behind them; in C.1's units.
    scales = C1.over(arm_scales(policy.plant))
    angles, *others = (scaled(stage, scales) for stage in network.stages)
    kinds = [type(stage) for stage in others]
    # At most one of each, in this order.
    if not isinstance(angles, PendulumStage) or kinds != [k for k in (NormaliseStage, PlantStage) if k in kinds]:
        names = ", ".join(type(stage).__name__ for stage in network.stages)
        raise SwingupError(f"a header cannot have the observation stages {names}: use --to realaigym")
    data: Data = {
        "TORQUE_LIMIT": policy.torque_limit,
        "WRAPPED": int(angles.angles == "wrapped"),
        "VELOCITY_SCALE": angles.velocity_scale,
        "STATE_INPUTS": angles.size(4),
        "SEES_PLANT": int(PlantStage in kinds),
    }
    for stage in others:
        if isinstance(stage, PlantStage):
            data |= {"PLANT_CLIP": stage.clip, "plant_centre": stage.centre, "plant_scale": stage.scale}
    return data | network_data(network)


def estimator_data(constants: EstimatorConstants) -> Data:
    """What the estimator expects of the loop, and the gains of its filters."""
    settings = constants.settings
    return {
        "DT": settings.dt,
        "LONGEST_GAP": settings.longest_gap,
        "MIN_STEP": identifier.MIN_STEP * settings.dt,
        "MAX_STEP": identifier.MAX_STEP * settings.dt,
        "DELAYS": settings.max_delay_steps + 1,
        "PREDICTION_STEPS": estimator.PREDICTION_STEPS,
        "FADING": math.exp(-settings.dt / estimator.EVIDENCE_TIME),
        "OUTLIER_SQUARED": estimator.OUTLIER_SCALE**2,
        "DELAY_PENALTY": estimator.DELAY_PENALTY,
        "RESET_RATE": estimator.RESET_SIGMAS * settings.velocity_noise,
        "gains": np.reshape(constants.gains, (2, 2)),
    }


def identifier_data(constants: IdentifierConstants) -> Data:
    """What the identifier begins with, and how it learns in an estimator's constants."""
    i, driven, mean, covariance = identifier, np.arange(2) == constants.joint, constants.mean, constants.covariance
    deviation = np.where(driven, i.DRIVEN_DEVIATION, i.PASSIVE_DEVIATION)
    nominal = lumped(mean[:BASE], constants.geometry)
    return {
        "UNKNOWNS": len(mean),
        "SPAN": i.row_span(constants.period),
        "COMMANDS": i.command_count(constants.period, constants.max_delay_steps),
        **{name: getattr(i, name) for name in SHARED_CONSTANTS},
        "GATE_SQUARED": i.GATE_SIGMAS**2,
        "CORRELATION": i.POLES / i.BANDWIDTH,
        "CLOSE_RATES": CLOSE_RATES,
        "TILT_RATIO": mean[2] / mean[3],
        "NOISE_GAIN": constants.noise_gain,
        "PASSIVE_LIMIT": constants.passive_limit,
        "MIN_GAIN": identifier.MIN_GAIN,
        "mean": mean,
        "prior": covariance,
        "drift": i.DRIFT**2 * np.diagonal(covariance),
        "initial_variance": deviation**2,
        "min_variance": np.where(driven, i.DRIVEN_FLOOR, i.PASSIVE_FLOOR) ** 2,
        "max_variance": (i.MAX_DEVIATION * deviation) ** 2,
        # Stretched and folded: M11, M12, M22.
        "nominal_mass": np.array([mass_entries(nominal, cos2) for cos2 in (1.0, -1.0)]),
    }


def regulator_data(loop: Regulator) -> Data:
    """The regulator's costs and bounds, and the cost-to-go of the policy's plant."""
    names = "COULOMB_DAMPING", "RICCATI_STEP", "RICCATI_STEPS", "STRONG", "NEAR_DAMPING", "FAR_DAMPING", "TINY"
    laws = {name: getattr(regulator, name) for name in ("WEAK", "NEAR", "FAR")}
    return {
        **{name: getattr(regulator, name) for name in (*names, "FAR_ABOVE", "NEAR_BELOW")},
        **{f"{name}_{what}": law[i] for name, law in laws.items() for i, what in enumerate(("SHARE", "KNEE"))},
        **{name.upper(): value for name, value in asdict(loop.settings).items()},
        "TORQUE_WEIGHT": regulator.R,
        "state_weights": np.array(regulator.Q),
        # Without the row and the column that NumPy's regulator has for the torque.
        "cost_to_go": loop.start[:4, :5],
    }


def guard_data(settings: GuardSettings, policy: RobotPolicy) -> Data:
    """The guard's limits."""
    return {
        **{f"GUARD_{name.upper()}": value for name, value in asdict(settings).items()},
        "GUARD_TORQUE_RATE": settings.rate(policy.torque_limits[policy.robot.joint]),
        "PUSHING_SHARE": PUSHING_SHARE,
        "MAX_JUMP": MAX_JUMP,
        "JUMP_RATE": JUMP_RATIO * settings.velocity_limit,
        "DEAD_TRAVEL": DEAD_TRAVEL,
        "BRAKED_RATE": MAX_BRAKED_RATIO * settings.velocity_limit,
        **_watch_data(policy),
    }


WATCHED_CONSTANTS = (
    "CLOCK_TIME", "PUSH_SHARE", "STRONG_SHARE", "STRONG_BLOCKS", "STILL_SHARE", "HELD_SHARE", "BETTER_SHARE",
    "MANY_SHARE", "MANY_BLOCKS", "MIN_PERIOD", "MAX_PERIOD",
)  # fmt: skip


def _watch_data(policy: RobotPolicy) -> Data:
    """What the guard looks at in the first second."""
    rows = [
        (*each.signs, each.crossed, each.torque, each.exchanged, *reason)
        for each, reason in zip(wiring.WIRINGS, WIRING_REASONS, strict=True)
    ]
    return {
        "WIRINGS": len(wiring.WIRINGS),
        "wirings": np.array(rows, float),
        "PERIOD": policy.period or 0.0,
        "WATCHED_BLOCK": wiring.BLOCK,
        "WATCHED_BLOCKS": wiring.MIN_BLOCKS,
        "WATCHED_LATE": wiring.LATE,
        "WATCHED_FAST": wiring.FAST,
        "WATCHED_WRONG": wiring.WRONG,
        **{name: getattr(wiring, name) for name in WATCHED_CONSTANTS},
    }
