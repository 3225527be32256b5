"""A policy for a pendulum: what its file holds, checked, which every back end takes."""

import functools
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..common.checks import finite_number, one_of
from ..common.errors import SwingupError, naming, quoted
from ..common.settings import Settings, read_settings
from ..plant.base_parameters import BASE_NAMES, FRICTIONS, base_parameters
from ..plant.equations import friction
from ..plant.plant import NAMES, ROBOTS, Plant, Robot, get_robot, make_plant, validated
from ..plant.units import arm_scales, scaled, similar_plant
from .estimator import EstimatorSettings, settings_in_c1
from .file import read_network, write_network
from .guard import GuardSettings
from .identifier import IdentifierSettings, prior
from .network import Network, PendulumStage, PlantStage, fold, stages_for
from .policy import ACTION_SPACE, TASK, Policy
from .regulator import RegulatorSettings, fixed_point
from .spaces import box

PLANT = "plant"  # Key of the plant in a policy file's metadata


def policy_plant(plant: Plant, robot: Robot) -> Plant:
    """The plant of a policy file: the passive joint has no torque."""
    found = validated(plant.driven(robot))
    found.needs_motor(robot)
    return found


def read_plant(given: Any, robot: Robot) -> Plant:
    """The plant that a policy file's metadata holds."""
    if not isinstance(given, Mapping):
        raise SwingupError(
            f"plant {quoted(given)} is not an object of parameters: use those of docs/policy-format.md"
        )
    name = given.get("name", "")
    if not isinstance(name, str):
        raise SwingupError(f"plant name {quoted(name)} is not a text")
    for each in given:
        if each != "name":
            one_of("plant parameter", each, NAMES)
    values = {each: finite_number(f"plant parameter {each}", given[each]) for each in NAMES if each in given}
    return policy_plant(make_plant(values, "its plant", name), robot)


def write_plant(plant: Plant) -> dict[str, Any]:
    """The plant as a policy file's metadata has it."""
    return {"name": plant.name, **plant.values()}


LARGE_DIFFERENCE = 0.1  # From this relative difference of a base parameter on, two plants differ much


def plant_difference(
    made_for: Plant, plant: Plant, robot: Robot, identified: PlantStage | None = None
) -> str | None:
    """One sentence on how a plant differs from the one that a policy was made for; None if it differs little.

    Compared are the base parameters, which alone act in the equations of motion, gravity, the driven joint's torque
    limit, and both joints' friction at 1 rad/s as a part of that limit. A policy that sees the plant that an
    identifier finds is made for more than one: there the inertial parameters and the rotor's are compared with what
    the policy can be told, and friction is left out, since it is compensated. ``identified`` is how the policy sees
    what an identifier finds; None for a policy of one plant.
    """
    # Lengths, gravity and limits are not identified: they count for every policy.
    one, other = _known_facts(made_for, robot), _known_facts(plant, robot)
    if identified is None:
        one, other = one | _identified_facts(made_for), other | _identified_facts(plant)
    limit = made_for.limit(robot.joint)
    # Where a number is 0, the change itself counts.
    changes = {
        name: (other[name] - value) / (limit if name.startswith("friction") else abs(value) or 1.0)
        for name, value in one.items()
    }
    name = max(changes, key=lambda each: abs(changes[each]))
    if not abs(changes[name]) > LARGE_DIFFERENCE:
        return None if identified is None else outside_range_message(identified, plant)
    own = f"{quoted(made_for.name)} " if made_for.name else ""
    more = "the torque limit" if name.startswith("friction") else "it"
    many = sum(abs(change) > LARGE_DIFFERENCE for change in changes.values()) - 1
    others = f"; {many} more differ by over {100 * LARGE_DIFFERENCE:g} %" if many else ""
    return (
        f"the policy was made for a plant {own}with {name} = {one[name]:.4g}, here it is {other[name]:.4g} "
        f"({100 * changes[name]:+.0f} % of {more}{others}): train, refine or export it for this plant"
    )


def outside_range_message(stage: PlantStage, plant: Plant) -> str | None:
    """One sentence on a plant's base parameter that is farthest outside what a policy has seen; None for none."""
    base = base_parameters(plant)
    far = np.abs(base - stage.centre) / stage.scale
    # Friction is compensated: the policy is told what is left of it.
    far[FRICTIONS] = 0.0
    worst = int(np.argmax(far))
    if not far[worst] > stage.clip:
        return None
    low, high = stage.centre[worst] + np.array([-1, 1]) * stage.clip * stage.scale[worst]
    return (
        f"the policy can be told a base parameter {BASE_NAMES[worst]} from {max(low, 0.0):.3g} to {high:.3g}, "
        f"here it is {base[worst]:.3g}: train or refine another on this plant"
    )


def _known_facts(plant: Plant, robot: Robot) -> dict[str, float]:
    """What nothing identifies."""
    names = {"l1": "l1", "l2": "l2", "g": "g", "the torque limit": ("tl1", "tl2")[robot.joint]}
    return {name: float(getattr(plant, attribute)) for name, attribute in names.items()}


def _identified_facts(plant: Plant) -> dict[str, float]:
    """What an identifier can find, with friction at 1 rad/s (N m)."""
    both, elbow, second, first, b1, b2, cf1, cf2, rotor = base_parameters(plant).tolist()
    geared = float(plant.gr) ** 2 * rotor
    return {
        "m1 r1 + m2 l1": first,
        "m2 r2": second,
        "I1 + m2 l1² + gr² Ir": both - elbow + geared,
        "I2 + gr² Ir": elbow + geared,
        "friction of the shoulder": friction(b1, cf1, 1.0, math.atan),
        "friction of the elbow": friction(b2, cf2, 1.0, math.atan),
    }


STATES = box((4,), dtype="float64")
"""States x = [q1, q2, dq1, dq2] (rad, rad/s)."""
TORQUE_SHARE = box((1,), -1.0, 1.0, "float64")
"""Share of the driven joint's torque limit, which the task's environments take."""

_KINDS: tuple[type[Settings], ...] = (EstimatorSettings, GuardSettings, IdentifierSettings, RegulatorSettings)
PARTS = tuple(kind.PART for kind in _KINDS)
"""What may stand around a network: keys of the metadata, and fields of a policy."""


@dataclass(frozen=True)
class PendulumPolicy(Policy):
    """One torque for a state, perhaps behind an estimator or with a regulator.

    Like a policy of any task it has ``predict``, from states x = [q1, q2, dq1, dq2] (rad, rad/s) to actions in
    [-1, 1], whose torque at the driven joint is ``torque_limit`` times as large. That is the network alone, for the
    plant of the file, in the plant's own angles: encoders' ones less ``plant.zeros``.
    :func:`swingup.runtime.load_controller` runs all of it, with encoders' angles and in N m.
    """

    network: Network
    """The network of the file; ``folded`` is what back ends run."""
    robot: Robot
    torque_limit: float
    """Torque of an action of 1 (N m)."""
    plant: Plant
    """The plant that it was made for."""
    estimator: EstimatorSettings | None = None
    guard: GuardSettings | None = None
    identifier: IdentifierSettings | None = None
    """Finds the estimator's plant; without one it is the plant of the file."""
    regulator: RegulatorSettings | None = None
    """Takes over near the top."""
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.estimator is not None:
            # Made for its errors: back ends have its settings in C.1's units, within the same ranges.
            settings_in_c1(self.estimator, self.plant, self.identifier)
        if self.identifier is not None:
            if self.estimator is None:
                raise SwingupError("identifier without an estimator: add estimator, {} for its defaults")
            # Made for its errors: it refuses a plant whose offsets nothing tells.
            prior(self.plant)
        if self.regulator is not None:
            # So is this one: it refuses a plant that the regulator cannot hold.
            fixed_point(similar_plant(self.plant, arm_scales(self.plant)), self.robot.joint)

    observation_space, action_space = STATES, TORQUE_SHARE

    @property
    def task(self) -> str:
        """The robot's name."""
        return self.robot.name

    @property
    def finds_plant(self) -> bool:
        """Whether an identifier finds the plant that the network sees."""
        return self.identifier is not None and self.network.plant_stage is not None

    @functools.cached_property
    def folded(self) -> Network:
        """The network of the state alone: the policy's own, or what a policy that sees its plant is for it."""
        return fold(self.network, base_parameters(self.plant))

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of what stands around the network."""
        return tuple(name for name in PARTS if getattr(self, name) is not None)

    @property
    def period(self) -> float | None:
        """Time between calls that the estimator expects (s); None for any."""
        return None if self.estimator is None else self.estimator.dt

    @property
    def torque_limits(self) -> tuple[float, float]:
        """Largest torques of shoulder and elbow (N m): the motor's, and the compensation's on the passive joint."""
        passive = 0.0 if self.identifier is None else self.identifier.passive_limit
        driven = self.plant.limit(self.robot.joint)
        return (driven, passive) if self.robot.joint == 0 else (passive, driven)


def for_plant(policy: PendulumPolicy, plant: Plant) -> PendulumPolicy:
    """A policy that sees the plant that its identifier finds, for another plant, in that one's units.

    It begins with the plant without friction and rotors' inertia.

    Raises:
        SwingupError: the policy has one plant, or cannot be told this one.
    """
    robot, made_for, motor = policy.robot, policy.plant, plant.limit(1 - policy.robot.joint)
    plant = policy_plant(plant.frictionless(), robot)
    network = replace(policy.network, stages=stages_for(policy.network.stages, made_for, plant))
    if network.plant_stage is None or not policy.finds_plant:
        raise SwingupError("it has a plant of its own: leave plant out here, and judge it on any plant")
    if (reason := outside_range_message(network.plant_stage, plant)) is not None:
        raise SwingupError(reason)
    scales = arm_scales(plant).over(arm_scales(made_for))
    parts = {name: scaled(getattr(policy, name), scales) for name in policy.parts}
    # A joint without a motor gets none from the policy.
    identifier = parts[IdentifierSettings.PART]
    parts[IdentifierSettings.PART] = replace(identifier, passive_limit=min(identifier.passive_limit, motor))
    limit = policy.torque_limit / made_for.limit(robot.joint) * plant.limit(robot.joint)
    return replace(policy, network=network, plant=plant, torque_limit=limit, **parts)


def read_pendulum_policy(path: str | Path, robot: Robot | str | None = None) -> PendulumPolicy:
    """Read a policy file of a pendulum, which must be for the robot if one is given."""
    network, metadata = read_network(path)
    if ACTION_SPACE in metadata:
        raise SwingupError(
            f"policy file {path} is of {quoted(metadata.get(TASK))}, not of a pendulum: "
            "leave out robot and plant; swingup.load_policy(path).predict runs it"
        )
    missing = [name for name in ("robot", "torque_limit", PLANT) if name not in metadata]
    if missing or not network.stages or not isinstance(network.stages[0], PendulumStage):
        what = f"metadata {', '.join(missing)}" if missing else "observation stage 'pendulum' at the start"
        raise SwingupError(f"policy file {path} lacks {what}: see docs/policy-format.md")
    name = metadata["robot"]
    if not isinstance(name, str) or name not in ROBOTS:
        raise SwingupError(f"policy file {path} is for robot {quoted(name)}: {' or '.join(ROBOTS)} is needed")
    if robot is not None and name != get_robot(robot).name:
        raise SwingupError(f"policy file {path} is for {name!r}, not the {get_robot(robot).name}")
    if network.choices is not None:
        raise SwingupError(f"policy file {path} has discrete actions: a pendulum needs a torque")
    if len(network.head.bias) != 1:
        raise SwingupError(f"policy file {path} has {len(network.head.bias)} actions: one is needed")
    with naming(f"policy file {path}", "; see docs/policy-format.md"):
        limit = finite_number("torque_limit", metadata["torque_limit"], 1e-6, 1e6, "N m")
        plant = read_plant(metadata[PLANT], ROBOTS[name])
        motor = plant.limit(ROBOTS[name].joint)
        # Every back end cuts at the motor's limit: the policy would never run as it was trained.
        if limit > motor:
            raise SwingupError(f"torque_limit = {limit:g} N m is above its plant's motor's, {motor:g}: lower it")
        parts: dict[str, Any] = {kind.PART: read_settings(metadata, kind) for kind in _KINDS}
        return PendulumPolicy(network, ROBOTS[name], limit, plant, **parts, metadata=metadata)


def write_pendulum_policy(
    path: str | Path, policy: PendulumPolicy, provenance: Mapping[str, Any], parts: Mapping[str, Any] | None = None
) -> None:
    """Write a policy file of a pendulum: the policy with its parts, and where it comes from.

    ``parts`` (JSON values by their names in ``PARTS``) are written where the policy has none. The provenance (JSON
    values) may be another file's metadata: its robot, torque limit, plant and parts are left out.
    """
    own: dict[str, Any] = {"robot": policy.robot.name, "torque_limit": float(policy.torque_limit)}
    own |= {PLANT: write_plant(policy.plant), **(parts or {})}
    own |= {name: asdict(getattr(policy, name)) for name in policy.parts}
    kept = {name: value for name, value in provenance.items() if name not in own.keys() | set(PARTS)}
    write_network(path, policy.network, {**own, **kept})
