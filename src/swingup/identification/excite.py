"""From a prior and limits to an excitation, with how well each parameter would be determined."""

import numpy as np
from jaxtyping import Float

from ..checks import finite_number, one_of, whole_number
from ..physics.units import scales_of
from ..plants.domain import Domain
from .excitation import Excitation, Limits, Prospect
from .excitation_search import Search, check_on_many, find_best
from .information import covariance, information, noise_of, unknowns_of
from .model import SHARED, Unknowns
from .prediction import INDEX, NAMES, Setting, setting_of
from .prior import corner_models, draw_models
from .reading import TITLES
from .trial import try_out
from .windows import INTERVAL

JOINTS = {"both": (1.0, 1.0), "shoulder": (1.0, 0.0), "elbow": (0.0, 1.0)}
"""Joints that are driven."""
SHORTEST, LONGEST = 3.0, 60.0
"""Durations (s)."""
SPEED = 20.0
"""Largest speed of a joint (rad/s) on design C.1 if none is given: the public loop stops there. It scales."""
QUANTUM = 3.81e-4
"""Step of an encoder (rad) if none is given: that of design C.1's robot."""
SEARCH_PLANTS, CHECKED_PLANTS, REPORTED_PLANTS = 8, 64, 8
"""Plants drawn for the search, the check, and what is said of the parameters."""
STIFFNESS, DAMPING = 2.0, 0.5
"""Feedback: kp in gravity's torque a radian, and kd in 2 sqrt(kp M) of a joint alone."""


def excite(
    domain: Domain,
    duration: float = 10.0,
    joint: str = "both",
    torque: float | None = None,
    speed: float | None = None,
    angle: float = 3.0,
    quantum: float | None = None,
    seed: int = 0,
    alone: bool = False,
) -> Excitation:
    """Find an excitation.

    Args:
        domain: ranges of the plant and its loop before it is identified.
        duration: of the excitation (s), 3 to 60; rounded to 0.05 s.
        joint: ``both``, or the one joint that is driven: ``shoulder`` or ``elbow``.
        torque: largest torque (N m); None for that of the motors.
        speed: largest speed of a joint (rad/s); None for 20 rad/s on design C.1, other plants in their own units.
        angle: largest angle of a joint from hanging (rad).
        quantum: step of the encoders (rad); None for the domain's, or 3.81e-4.
        seed: of the search and of the prior's draws; equal seeds give equal excitations.
        alone: whether the torques will be played without feedback; plants that differ then move apart.

    Raises:
        SwingupError: an argument makes no sense, or no motion keeps the limits on all plants.
    """
    limits = _limits(domain, joint, torque, speed, angle)
    search = _prepare(domain, duration, limits, quantum, seed, alone)
    many = np.concatenate([draw_models(domain, CHECKED_PLANTS, seed + 2), corner_models(domain)])
    play, reached = check_on_many(search, find_best(search, seed), many, domain.name)
    models = draw_models(domain, REPORTED_PLANTS, seed + 1)
    trial = try_out(search.setting, models, play, keep=True)
    found = information(search.setting, models, trial, search.unknowns, search.noise)[0]
    return Excitation(
        torque=play.torque[0],
        state=play.reference[0],
        feedback=play.feedback,
        limits=limits,
        angle=reached[0],
        speed=reached[1],
        plants=len(many),
        prospects=_prospects(search.unknowns, found, models),
        quantum=_quantum(domain, quantum),
    )


def _limits(domain: Domain, joint: str, torque: float | None, speed: float | None, angle: float) -> Limits:
    driven = JOINTS[one_of("joint", joint, JOINTS)]
    motors = [min(domain.middle(name), domain.middle("torque_limit")) for name in ("tl1", "tl2")]
    most = [motor if torque is None else finite_number("torque", torque, 1e-6, motor, "N m") for motor in motors]
    usual = SPEED * scales_of(domain.middle_parameters).velocity
    return Limits(
        torque=(most[0] * driven[0], most[1] * driven[1]),
        speed=usual if speed is None else finite_number("speed", speed, 0.1, 1e3, "rad/s"),
        angle=finite_number("angle", angle, 0.1, 100.0, "rad"),
    )


def _prepare(
    domain: Domain, duration: float, limits: Limits, quantum: float | None, seed: int, alone: bool
) -> Search:
    length = finite_number("duration", duration, SHORTEST, LONGEST, "s")
    seed, plant = whole_number("seed", seed, 0, 2**32 - 3), domain.middle_parameters
    setting, models = setting_of(plant).coarse, draw_models(domain, SEARCH_PLANTS, seed)
    gravity = setting.gravity * float(models[0, INDEX["first"]])
    return Search(
        setting=setting,
        limits=limits,
        duration=INTERVAL * round(length / INTERVAL),
        own=0.75 * scales_of(plant).velocity,
        models=models,
        unknowns=unknowns_of(setting, models[0]),
        noise=noise_of(_quantum(domain, quantum), gravity),
        feedback=_feedback(setting, models[0], gravity),
        alone=alone,
    )


def _feedback(setting: Setting, model: np.ndarray, gravity: float) -> np.ndarray:
    """Kp and kd of both joints, for the inertia of each while the other is stiff."""
    m = dict(zip(NAMES, model, strict=True))
    elbow = m["elbow"] + setting.gear**2 * m["rotor"]
    inertia = np.array([m["shoulder"] + 2 * setting.l1 * m["second"] + elbow, elbow])
    stiffness = np.full(2, STIFFNESS * gravity)
    return np.stack([stiffness, DAMPING * 2 * np.sqrt(stiffness * inertia)])


def _quantum(domain: Domain, given: float | None) -> float:
    if given is not None:
        return finite_number("quantum", given, 0.0, 0.1, "rad")
    own = [domain.middle(name) for name in ("quantum1", "quantum2") if name in domain.names]
    return max(own) if own else QUANTUM


def _prospects(
    unknowns: Unknowns, found: Float[np.ndarray, "plants unknowns unknowns"], models: Float[np.ndarray, "plants 15"]
) -> dict[str, Prospect]:
    spread = np.sqrt(np.diagonal(covariance(unknowns, found), axis1=1, axis2=2)) * unknowns.scale
    prospects = {}
    for place, name in enumerate(unknowns.names[: len(SHARED)]):
        relative = 1.96 * spread[:, place] / np.maximum(np.abs(models[:, INDEX[name]]), 1e-12)
        prospects[TITLES.get(name, name)] = Prospect(float(np.median(relative)), float(relative.max()))
    return prospects
