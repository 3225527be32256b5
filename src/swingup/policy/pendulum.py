"""A policy for a pendulum: what its file holds, checked, which every back end takes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ..common.checks import finite_number
from ..common.errors import SwingupError, naming, quoted
from ..common.settings import Settings, read_settings
from ..plant.base_parameters import base_parameters
from ..plant.plant import ROBOTS, Plant, Robot, get_robot
from ..plant.units import arm_scales, scaled, similar_plant
from .estimator.settings import EstimatorSettings
from .file import read_network, write_network
from .guard.settings import GuardSettings
from .identifier.settings import IdentifierSettings, prior
from .network.layers import Network, fold
from .network.stages import PendulumStage, stages_for
from .plant_facts import PLANT, beyond, policy_plant, read_plant, write_plant
from .regulator.settings import RegulatorSettings, fixed_point

_KINDS: tuple[type[Settings], ...] = (EstimatorSettings, GuardSettings, IdentifierSettings, RegulatorSettings)
PARTS = tuple(kind.PART for kind in _KINDS)
"""What may stand around a network: keys of the metadata, and fields of a policy."""


@dataclass(frozen=True)
class PendulumPolicy:
    """One torque for a state, perhaps behind an estimator or with a regulator."""

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
        if self.identifier is not None:
            if self.estimator is None:
                raise SwingupError("identifier without an estimator: add estimator, {} for its defaults")
            # Made for its errors: it refuses a plant whose offsets nothing tells.
            prior(self.plant)
        if self.regulator is not None:
            # So is this one: it refuses a plant that the regulator cannot hold.
            fixed_point(similar_plant(self.plant, arm_scales(self.plant)), self.robot.joint)

    @property
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
    robot, made_for, plant = policy.robot, policy.plant, policy_plant(plant.frictionless(), policy.robot)
    network = replace(policy.network, stages=stages_for(policy.network.stages, made_for, plant))
    if network.plant_stage is None or policy.identifier is None:
        raise SwingupError("it has a plant of its own: leave plant out here, and judge it on any plant")
    if (reason := beyond(network.plant_stage, plant)) is not None:
        raise SwingupError(reason)
    scales = arm_scales(plant).over(arm_scales(made_for))
    parts = {name: scaled(getattr(policy, name), scales) for name in policy.parts}
    limit = policy.torque_limit / made_for.limit(robot.joint) * plant.limit(robot.joint)
    return replace(policy, network=network, plant=plant, torque_limit=limit, **parts)


def read_pendulum_policy(path: str | Path, robot: Robot | str | None = None) -> PendulumPolicy:
    """Read a policy file of a pendulum, which must be for the robot if one is given."""
    network, metadata = read_network(path)
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


def write_pendulum_policy(path: str | Path, policy: PendulumPolicy, provenance: Mapping[str, Any]) -> None:
    """Write a policy file of a pendulum.

    The policy's own metadata is left out. Its robot, torque limit, plant and ``PARTS`` replace those in the
    provenance (JSON values). A part that the policy lacks is taken from there, unless the policy's own metadata has
    that part: then it was removed, and is not written.
    """
    own: dict[str, Any] = {"robot": policy.robot.name, "torque_limit": float(policy.torque_limit)}
    own |= {PLANT: write_plant(policy.plant)}
    own |= {name: asdict(getattr(policy, name)) for name in policy.parts}
    # Provenance is another file's metadata, whose parts would come back otherwise.
    removed = {name for name in PARTS if name in policy.metadata}
    kept = {name: value for name, value in provenance.items() if name not in removed | own.keys()}
    write_network(path, policy.network, {**own, **kept})
