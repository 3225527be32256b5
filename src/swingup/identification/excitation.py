"""Excitations: of a dozen fixed motions the one with the most information, as strong as the limits allow.

A robot plays torques and motion of the plant in the middle of the prior, with its feedback, so that other plants
move alike. Each motion is made smaller until plants from the prior and the corners of its ranges keep the limits.
The excitation then has the largest determinant of Yᵀ Y, with the matrix Y of the linear regression that
``identify`` starts from (D-optimality).
"""

import functools
import itertools
import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.checks import check_seeds, finite_number, one_of
from ..common.errors import SwingupError
from ..common.table import write_columns
from ..dynamics.integrate import implicit_step
from ..loop.domain import Domain, PlantInLoop
from ..loop.draw import draw_values
from ..loop.resolve import resolve
from ..plant.base_parameters import friction_of, lumped
from ..plant.plant import PlantLike
from ..plant.units import VELOCITY, scales_of
from .prediction import INDEX, NAMES, Integration, in_chunks, in_loop, integration_of, vector_of
from .regression import OFFSETS, SPAN, regression_matrix
from .results import prior_around
from .segments import INTERVAL

PERIOD = 0.002  # between rows (s): 500 Hz
WAVES = 6  # sinusoids of each joint
RISE = 0.5  # time in which the motion rises and falls (s)
REST = 0.05  # part of the time at the end at rest
BAND = (0.2, 6.0)  # frequencies, as multiples of the pendulum's own
TILTS = (-2.0, -1.5, -1.0, -0.5)
"""Exponents of the amplitudes. Accelerations grow with the square of the frequency: the first motions swing widely,
the last ones shake."""
SHARES = ((1.0, 1.0), (1.0, 0.5), (0.5, 1.0))  # parts of the reach for shoulder and elbow


def multisines(duration: float, own: float, reach: float, driven: Float[np.ndarray, "2"]) -> np.ndarray:
    """A dozen fixed motions, each a sum of sinusoids: angles (rad) and velocities (rad/s), [motions, rows, 4].

        q_j(t) = reach share_j w(t) s_j(t) / max |s_j|,    s_j(t) = Σ_k f_k^tilt sin(2π f_k t + φ_k)

    w rises from 0 within a moment, is 1, and falls to 0 before the end. Frequencies lie around those of the
    pendulum's own swings, and no frequency drives both joints, so that their motions are unlike. The phases are
    Schroeder's: the sum has low peaks. Sources: Swevers, Ganseman, Tükel, de Schutter and Van Brussel, Optimal
    robot excitation and identification (IEEE Transactions on Robotics and Automation 13, 1997); Schroeder,
    Synthesis of low-peak-factor signals (IEEE Transactions on Information Theory 16, 1970).

    ``own`` is the frequency of the pendulum's small swings (Hz), ``reach`` the largest angle (rad). A joint moves
    where it is driven (1, otherwise 0).
    """
    time = PERIOD * np.arange(round(duration / PERIOD))
    # Every other frequency is the elbow's.
    relative = np.geomspace(*BAND, 2 * WAVES).reshape(WAVES, 2).T[..., None]
    number = np.arange(WAVES)[:, None]
    waves = np.sin(2 * np.pi * own * relative * time - np.pi * number * (number + 1) / WAVES)
    window = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(time, (1.0 - REST) * duration - time) / RISE, 0.0, 1.0))
    motions = []
    for tilt, share in itertools.product(TILTS, SHARES):
        signal = np.sum(relative**tilt * waves, axis=1)
        signal *= (reach * driven * share)[:, None] * window / np.abs(signal).max(1, keepdims=True)
        motions.append(np.concatenate([signal, np.gradient(signal, PERIOD, axis=1)]).T)
    return np.stack(motions)


LANES = 256  # motions that one call of the compiled program simulates


def draw_models(domain: Domain, count: int, seed: int) -> Float[np.ndarray, "count 15"]:
    """Models of plants and loops, uniform on the domain's ranges; the first is the middle of all ranges."""
    with jax.enable_x64(True):
        keys = jax.random.split(jax.random.key(seed), count - 1)
        batch = jax.tree.map(np.asarray, jax.jit(jax.vmap(partial(draw_values, domain)))(keys))
    rows = (jax.tree.map(operator.itemgetter(row), tuple(batch)) for row in range(count - 1))
    drawn = (domain.nominal, *itertools.starmap(PlantInLoop, rows))
    # Loop values that the domain does not have are typical ones.
    loops = ({name: each.value(name) for name in domain.names} for each in drawn)
    return np.stack([in_loop(vector_of(each.plant), loop) for each, loop in zip(drawn, loops, strict=True)])


def corner_models(domain: Domain) -> Float[np.ndarray, "corners 15"]:
    """Models of the plants at the ends of the domain's ranges, with the largest torque gains."""
    # A motor that delivers more than its command moves the arm furthest.
    gains = {name: domain.high.value(name) for name in domain.names if name in ("gain1", "gain2")}
    return np.stack([in_loop(vector_of(plant), gains) for plant in domain.corners()])


class Sequences(NamedTuple):
    """Torques and motions, with the feedback that all are played with; rows are ``PERIOD`` apart."""

    torque: Float[np.ndarray, "sequences rows 2"]  # tau (N m)
    reference: Float[np.ndarray, "sequences rows 4"]  # q_ref, dq_ref (rad, rad/s)
    feedback: Float[np.ndarray, "2 2"]  # kp of both joints (N m/rad), kd of both (N m s/rad)
    limits: Float[np.ndarray, "2"]  # N m; 0 on a joint that is not driven


class Rollouts(NamedTuple):
    """Motions by sequence and plant."""

    angle: Float[np.ndarray, "sequences plants"]
    """Largest angle of a joint (rad); infinite where the motion diverged."""
    speed: Float[np.ndarray, "sequences plants"]
    """Largest speed of a joint (rad/s); infinite where the motion diverged."""
    states: Float[np.ndarray, "sequences plants rows 4"]  # before each row; empty where they are not kept
    torque: Float[np.ndarray, "sequences plants rows 2"]  # commands (N m); empty where they are not kept


def simulate(
    setting: Integration, models: Float[np.ndarray, "plants 15"], sequences: Sequences, keep: bool = False
) -> Rollouts:
    """Play every sequence on every plant, from hanging at rest.

    The torque of a driven joint is a sequence's and a feedback's, within the limit:

        u = clip(tau + kp (q_ref - q) + kd (dq_ref - dq), -limit, limit)

    Delay and lag are left out: they shift the motion by milliseconds. ``keep`` the states and torques of each row,
    which may need gigabytes.
    """
    count, plants = len(sequences.torque), len(models)
    which, whose = np.divmod(np.arange(count * plants), plants)
    program = _compiled(setting, keep)

    def run(rows: np.ndarray) -> Any:
        torque, reference, feedback, limits = sequences
        return program(models[whose[rows]], torque[which[rows]], reference[which[rows]], feedback, limits)

    found = in_chunks(LANES, len(which), run)
    parts = [part.reshape(count, plants, *part.shape[1:]) for part in found]
    reached = [np.nan_to_num(part, nan=np.inf) for part in parts[:2]]
    return Rollouts(*reached, *map(np.nan_to_num, parts[2:]))


@functools.lru_cache(maxsize=4)
def _compiled(setting: Integration, keep: bool) -> Callable[..., Any]:
    substeps = round(PERIOD / setting.step)

    def rollout(model: Array, torque: Array, reference: Array, feedback: Array, limits: Array) -> Any:
        plant, friction = lumped(model, setting.geometry), friction_of(model)
        gains = jnp.stack([model[INDEX["gain1"]], model[INDEX["gain2"]]])

        def row(carry: Any, now: Any) -> Any:
            (x, angle, speed), (tau, ref) = carry, now
            before = jnp.stack(x)
            u = tau + feedback[0] * (ref[:2] - before[:2]) + feedback[1] * (ref[2:] - before[2:])
            u = jnp.clip(u, -limits, limits)
            acting = u * gains
            for _ in range(substeps):
                x = implicit_step(plant, friction, x, (acting[0], acting[1]), setting.step, setting.steepness)
            angle = jnp.maximum(angle, jnp.maximum(jnp.abs(x[0]), jnp.abs(x[1])))
            speed = jnp.maximum(speed, jnp.maximum(jnp.abs(x[2]), jnp.abs(x[3])))
            return (x, angle, speed), (before, u) if keep else (before[:0], u[:0])

        zero = jnp.zeros(())
        (_, angle, speed), kept = jax.lax.scan(row, ((zero,) * 4, zero, zero), (torque, reference))
        return angle, speed, *kept

    return jax.jit(jax.vmap(rollout, (0, 0, 0, None, None)))


JOINTS = {"both": (1.0, 1.0), "shoulder": (1.0, 0.0), "elbow": (0.0, 1.0)}  # joints that are driven
DURATIONS = (3.0, 60.0)  # shortest and longest excitation (s)
SPEED = 20.0
"""Largest speed of a joint (rad/s) on design C.1 if none is given: the public loop stops there. It scales."""
NATURAL_FREQUENCY = 0.75  # frequency of small swings (Hz) on design C.1. It scales, too.
CHECKED_PLANTS = 64  # plants drawn from the prior on which the limits must hold, beside its corners
STRENGTHS = np.geomspace(1.0, 0.1, 10)  # multiples of a motion that are tried, until one keeps the limits
STIFFNESS, DAMPING = 2.0, 0.5
"""Feedback: kp as a multiple of gravity's torque per radian; kd as the damping ratio of a joint alone."""


@dataclass(frozen=True)
class ExcitationLimits:
    """What the robot may do."""

    torque: tuple[float, float]  # Largest torque of each motor (N m); 0 on a joint that is not driven
    speed: float  # Largest speed of either joint (rad/s)
    angle: float  # Largest angle of either joint from hanging (rad)


@dataclass(frozen=True)
class Excitation:
    """Torques, the motion they make in the middle of the prior, and the feedback around it."""

    torque: Float[np.ndarray, "rows 2"]  # N m, rows PERIOD apart
    state: Float[np.ndarray, "rows 4"]  # Motion of the plant in the middle of the prior (rad, rad/s)
    feedback: Float[np.ndarray, "2 2"]
    """kp of both joints (N m/rad), kd of both (N m s/rad); 0 where the torques are played alone."""
    limits: ExcitationLimits
    angle: float  # Largest angle over all checked plants (rad)
    speed: float  # Largest speed over all checked plants (rad/s)
    plants: int  # Number of checked plants
    prior: str = ""  # Name of the domain that they were drawn from
    zeros: tuple[float, float] = (0.0, 0.0)  # What the encoders show where the pendulum hangs (rad)

    @property
    def time(self) -> Float[np.ndarray, "rows"]:
        """Times of the rows (s)."""
        return PERIOD * np.arange(len(self.torque))

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        torque = np.abs(self.torque).max(axis=0).tolist()
        return {
            "duration": len(self.torque) * PERIOD,
            "limits": vars(self.limits) | {"torque": list(self.limits.torque)},
            "reached": {"torque": torque, "speed": self.speed, "angle": self.angle},
            "domain": self.prior,
            "plants": self.plants,
            "feedback": {"kp": self.feedback[0].tolist(), "kd": self.feedback[1].tolist()},
        }

    def save(self, path: str | Path) -> None:
        """Write time, motion, torques and gains K of u = tau + K (x - motion), under RealAIGym's names.

        Angles are those that the plant's encoders show, from their zeros. CloudPendulum's desired motions have the
        same names of time, pos, vel and acc.
        """
        acceleration = np.gradient(self.state[:, 2:], PERIOD, axis=0)
        shown = self.state + np.append(self.zeros, [0.0, 0.0])
        table = np.column_stack([self.time, shown, acceleration, self.torque])
        names = ["time", *(f"{each}{joint}" for each in ("pos", "vel", "acc", "tau") for joint in (1, 2))]
        columns = dict(zip(names, table.T, strict=True))
        # The loop that plays the file knows one matrix K a row; each motor here sees its own joint alone.
        for joint in (0, 1):
            gains = np.zeros(4)
            # K multiplies the state minus the motion, the feedback the motion minus the state.
            gains[[joint, 2 + joint]] = -self.feedback[:, joint]
            columns |= {f"K{joint + 1}{entry + 1}": np.full(len(table), gains[entry]) for entry in range(4)}
        write_columns(path, columns)


def excite(
    plant: PlantLike | Domain | None = None,
    domain: Domain | str | None = None,
    duration: float = 10.0,
    joint: str = "both",
    torque: float | None = None,
    speed: float | None = None,
    angle: float = 3.0,
    seed: int = 0,
    alone: bool = False,
) -> Excitation:
    """Find an excitation.

    Args:
        plant: the robot's approximate parameters: a plant, its name or its file. Without ranges it is taken for
            another specimen of the robot's design.
        domain: the loop around the plant; without a plant, ranges of the plant and its loop. None for both: C.1.
        duration: length of the excitation (s), 3 to 60; rounded to 0.05 s.
        joint: ``both``, or the one joint that is driven: ``shoulder`` or ``elbow``.
        torque: largest torque (N m); None for that of the motors.
        speed: largest speed of a joint (rad/s); None for 20 rad/s on design C.1, other plants in their own units.
        angle: largest angle of a joint from hanging (rad).
        seed: seed of the prior's draws; equal seeds give equal excitations.
        alone: whether the torques will be played without feedback; plants that differ then move apart.
    """
    check_seeds(seed, 1)
    prior = resolve(plant, domain)
    if prior.knows_plant and not (plant is None and domain):
        prior = prior_around(prior)
    limits, middle = limits_for(prior, joint, torque, speed, angle), prior.nominal_plant
    length = INTERVAL * round(finite_number("duration", duration, *DURATIONS, "s") / INTERVAL)
    drawn = draw_models(prior, CHECKED_PLANTS, seed)
    # Steps twice as long change predictions by 1e-4 rad (prediction.py), nothing beside how far the plants differ.
    setting, models = integration_of(middle).coarse, np.concatenate([drawn, corner_models(prior)])
    frequency = scales_of(middle).scaled(NATURAL_FREQUENCY, VELOCITY)
    motions = multisines(length, frequency, min(limits.angle, np.pi), np.array(JOINTS[joint]))
    candidates = _within_limits(setting, models, motions, limits, alone)
    if not candidates:
        raise SwingupError(
            f"no motion keeps all plants of {prior.name} within {limits.angle:g} rad and {limits.speed:g} rad/s: "
            "allow more, narrow the prior, or ask for a shorter excitation"
        )
    best = max(candidates, key=lambda each: information(setting, each.state))
    return replace(best, prior=prior.name, zeros=(float(middle.zero1), float(middle.zero2)))


def limits_for(
    domain: Domain, joint: str, torque: float | None = None, speed: float | None = None, angle: float = 3.0
) -> ExcitationLimits:
    """The limits of an excitation, as :func:`excite` takes them: by default those of the plant and its motors."""
    driven, plant = JOINTS[one_of("joint", joint, JOINTS)], domain.nominal_plant
    # The weakest motors of the domain: the file commands a real one.
    motors = [float(domain.low.plant.tl1), float(domain.low.plant.tl2)]
    if not any(motor * acts for motor, acts in zip(motors, driven, strict=True)):
        raise SwingupError(f"{domain.name} has no motor at joint = {joint!r}: name another, or give tl1 or tl2")
    used = [
        finite_number("torque", torque, 1e-6, motor, "N m") if torque is not None and acts and motor else motor
        for motor, acts in zip(motors, driven, strict=True)
    ]
    default = scales_of(plant).scaled(SPEED, VELOCITY)
    return ExcitationLimits(
        torque=(used[0] * driven[0], used[1] * driven[1]),
        speed=default if speed is None else finite_number("speed", speed, 0.1, 1e3, "rad/s"),
        angle=finite_number("angle", angle, 0.1, 100.0, "rad"),
    )


def _within_limits(
    setting: Integration, models: np.ndarray, motions: np.ndarray, limits: ExcitationLimits, alone: bool
) -> list[Excitation]:
    """Each motion as strong as the limits allow on all models; without those that are too fast even when small."""
    feedback, torque, found = _feedback(setting, models[0]), np.array(limits.torque), []
    # The torques are those of a motion under feedback in any case; played alone, they lack its corrections.
    played = np.zeros((2, 2)) if alone else feedback
    for strength in STRENGTHS:
        rest = np.zeros((*motions.shape[:2], 2))
        middle = simulate(setting, models[:1], Sequences(rest, strength * motions, feedback, torque), keep=True)
        sequences = Sequences(middle.torque[:, 0], middle.states[:, 0], played, torque)
        reached = simulate(setting, models, sequences)
        angle, speed = reached.angle.max(axis=1), reached.speed.max(axis=1)
        holds = (angle <= limits.angle) & (speed <= limits.speed)
        for row in np.flatnonzero(holds):
            tau, motion = sequences.torque[row], sequences.reference[row]
            found.append(Excitation(tau, motion, played, limits, float(angle[row]), float(speed[row]), len(models)))
        motions = motions[~holds]
        if not len(motions):
            break
    return found


def _feedback(setting: Integration, model: np.ndarray) -> np.ndarray:
    """Kp and kd of both joints, for the inertia of each while the other is stiff."""
    m = dict(zip(NAMES, model, strict=True))
    elbow = m["B"] + setting.geometry.gr**2 * m["Ir"]
    straight = m["A"] - m["B"] + 2 * setting.geometry.l1 * m["m2r2"] + elbow
    stiffness = np.full(2, STIFFNESS * setting.geometry.g * m["k"])
    return np.stack([stiffness, DAMPING * 2 * np.sqrt(stiffness * np.array([straight, elbow]))])


def information(setting: Integration, states: Float[np.ndarray, "rows 4"]) -> float:
    """The logarithm of det(Yᵀ Y), which falls with the volume of the parameters' covariance."""
    time = PERIOD * np.arange(len(states))
    points = SPAN * np.arange(1, int(time[-1] / SPAN))[:, None] + OFFSETS
    spans = np.stack([np.interp(points, time, column) for column in states.T], axis=-1)
    matrix = regression_matrix(setting, spans)
    return float(np.linalg.slogdet(matrix.T @ matrix)[1])
