"""The command ``excite``: torques that make a robot show its parameters."""

from dataclasses import replace
from typing import Annotated

from tyro.conf import arg

from ..common.files import check_writable
from ..identification.excite.excite import Excitation, excite
from ..identification.excite.prior import prior_around
from ..loop.domain import Domain, load_domain
from ..plant.plant import load_plant
from .arguments import PLANTS, OptionalDomain, OptionalFloat, optional, word_of
from .output import tell, tell_json


def excite_command(
    out: Annotated[str, arg(metavar="FILE.csv")],
    plant: Annotated[
        str | None, optional("PLANT", f"the robot, as far as it is known: {PLANTS}; default: C.1.")
    ] = None,
    domain: OptionalDomain = None,
    joint: Annotated[str, word_of("joint", "both", "shoulder", "elbow")] = "both",
    duration: float = 10.0,
    torque: OptionalFloat = None,
    speed: OptionalFloat = None,
    angle: float = 3.0,
    alone: bool = False,
    seed: int = 0,
    json: bool = False,
) -> int:
    """Write an excitation for identification, within limits that are checked on plants drawn from a prior.

    The file has time, motion (pos, vel, acc), torques (tau) and feedback gains (K), 500 rows a second. Play
    u = tau + K (x - [pos, vel]) from hanging at rest, and give the robot's log to swingup identify.

    Args:
        out: the excitation's file.
        plant: the robot.
        domain: ranges of what the robot may be: a domain's name or file. Default: around the plant.
        joint: which motors act.
        duration: length (s).
        torque: largest torque (N m). Default: that of the motors.
        speed: largest speed of a joint (rad/s). Default: 20 on design C.1, other plants in their own units.
        angle: largest angle of a joint from hanging (rad).
        alone: for loops without feedback: the torques are played alone.
        seed: seed of the plants that are drawn.
        json: print one JSON object.
    """
    check_writable(out)
    prior = find_prior(plant, domain)
    found = excite(prior, duration, joint, torque, speed, angle, seed, alone)
    found.save(out)
    if json:
        tell_json({"domain": prior.name, "joint": joint, "seed": seed, **found.as_dict()})
    else:
        tell(*excitation_lines(found, prior), f"wrote {out}")
    return 0


def find_prior(plant: str | None, domain: str | None) -> Domain:
    """What the robot may be: a domain, perhaps around another plant, or ranges around a plant.

    Raises:
        SwingupError: there is no such plant or domain.
    """
    if domain is None:
        return prior_around(load_plant(plant or "C.1"))
    found = load_domain(domain)
    return found if plant is None else replace(found, plant=load_plant(plant))


def excitation_lines(found: Excitation, prior: Domain) -> list[str]:
    """What it reaches on all checked plants."""
    torques = [abs(found.torque[:, joint]).max() for joint in (0, 1)]
    pairs = zip(torques, found.limits.torque, strict=True)
    return [
        f"{found.time[-1]:.3g} s, checked on {found.plants} plants of {prior.name}",
        "  largest torque " + ", ".join(f"{u:.3g} of {limit:.3g} N m" for u, limit in pairs),
        f"  largest speed {found.speed:.3g} of {found.limits.speed:.3g} rad/s, "
        f"angle {found.angle:.3g} of {found.limits.angle:.3g} rad",
    ]
