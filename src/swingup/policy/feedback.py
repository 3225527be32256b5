"""Feedback laws in the place of a network: an LQR at the top, alone or after a swing-up that a TVLQR follows.

With e = x - target, angles to the nearest turn, and t from the first call of a run, the driven joint's torque is

    before the hand-over    u(t) - K(t) e(t)      with target x(t)
    at the top              -K e, or 0 where eᵀ S e > c      with target [π, 0, 0, 0]

x(t), u(t) and K(t) are cubics, piece by piece, held after their end. The top's law takes over, for good, in the
first call in which all four |e| are below the threshold. Where the passive joint has dry friction the top's law is
the policies' regulator (``regulator.py``), and no torque where that does not act. The torque is limited to the
motor's; the driven joint's Coulomb friction is then added, and the sum limited. All numbers are in the plant's own
units. Behind a state estimator x is the estimate.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..common.arrays import load_arrays, read_format, save_arrays
from ..common.errors import SwingupError, naming, quoted
from ..common.settings import read_settings
from ..plant.base_parameters import base_parameters
from ..plant.equations import COULOMB_STEEPNESS, NUMPY
from ..plant.plant import Plant, Robot, get_robot
from . import regulator
from .contract import LoopController, guarded
from .estimator import EstimatorSettings
from .guard import GuardChoice, GuardSettings
from .numpy_backend import EstimatedSource, held, numpy_controller, regulator_loop
from .pendulum import PLANT, PendulumPolicy, read_plant, write_plant
from .regulator import RegulatorSettings
from .shipped import load_pendulum_policy

FILE = "feedback.safetensors"
FORMAT, FORMAT_VERSION = "swingup feedback law", 1
GOAL = np.array([math.pi, 0.0, 0.0, 0.0])  # Upright at rest


@dataclass(frozen=True)
class TopLaw:
    """u = -K e, or 0 where eᵀ S e > c."""

    gains: np.ndarray  # K (4,) (N m/rad, N m s/rad)
    cost_to_go: np.ndarray  # S (4, 4)
    largest_cost: np.ndarray  # c, of shape ()


@dataclass(frozen=True)
class SwingUpLaw:
    """The trajectory with its gains, and where the top's law takes over."""

    starts: np.ndarray  # Time of each piece's first sample (s), (pieces,)
    ends: np.ndarray  # Time of its last one (s), (pieces,)
    coefficients: np.ndarray
    """(pieces, 4, 9): powers 0 to 3 of the time since the piece's start, in its lengths, of x, u and K."""
    threshold: np.ndarray  # (4,) (rad, rad/s)


@dataclass(frozen=True)
class FeedbackPolicy:
    """A pendulum's feedback law, with what stands around it; one of ``top`` and ``regulator`` acts at the top."""

    identifier: ClassVar[None] = None

    name: str
    robot: Robot
    plant: Plant
    """The plant that it was designed for."""
    held_plant: Plant
    """The regulator's: without what the torques compensate."""
    top: TopLaw | None
    swing_up: SwingUpLaw | None = None
    regulator: RegulatorSettings | None = None
    estimator: EstimatorSettings | None = None
    guard: GuardSettings | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @property
    def period(self) -> float | None:
        """Time between calls that the estimator expects (s); None for any."""
        return None if self.estimator is None else self.estimator.dt

    @property
    def torque_limit(self) -> float:
        """The motor's (N m)."""
        return float(self.plant.limit(self.robot.joint))

    @property
    def torque_limits(self) -> tuple[float, float]:
        """Largest torques of shoulder and elbow (N m)."""
        limits = [0.0, 0.0]
        limits[self.robot.joint] = self.torque_limit
        return limits[0], limits[1]

    @property
    def coulomb(self) -> float:
        """The driven joint's Coulomb friction, which the torque compensates (N m)."""
        return float((self.plant.cf1, self.plant.cf2)[self.robot.joint])


class FeedbackSource(EstimatedSource):
    """The law's torques for a loop."""

    def __init__(self, policy: FeedbackPolicy) -> None:
        """Take a law."""
        self.policy = policy
        super().__init__(policy.plant, policy.robot.joint, policy.estimator)
        self._regulator: regulator.Loop | None = None
        if policy.regulator is not None:
            known = policy.regulator, policy.held_plant, self._joint, policy.torque_limit
            self._regulator = regulator_loop(*known)
            self._base = (base_parameters(policy.held_plant) / self._base_units).tolist()
        self.reset()

    def reset(self) -> None:
        """Forget the run so far."""
        super().reset()
        self._begun: float | None = None
        self._at_top = self.policy.swing_up is None
        if self._regulator is not None:
            self._regulated = regulator.begin(NUMPY, self._regulator)

    def act(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m) for the state x (4,) at time t (s); NaN on the driven joint if x is not finite."""
        self._begun = t if self._begun is None else self._begun
        limit, u = self.policy.torque_limit, np.zeros(2)
        with np.errstate(all="ignore"):
            seen = self.observed(x, t)
            # Without an estimator the measurement as it is: units would round it.
            x = x if self.constants is None else seen * self._state_units
            error = _error(x, GOAL)
            swing_up = self.policy.swing_up
            if swing_up is not None and (abs(error) < swing_up.threshold).all():
                self._at_top = True
            torque = self._top(seen, error)
            if not self._at_top and swing_up is not None:
                torque = follow(swing_up, x, t - self._begun)
            # Built-in comparisons would hide NaN.
            torque = np.clip(torque, -limit, limit)
            u[self._joint] = torque + self.policy.coulomb * math.atan(COULOMB_STEEPNESS * x[2 + self._joint])
        if not np.isfinite(x).all():
            u[self._joint] = math.nan
        return u

    def _top(self, seen: np.ndarray, error: np.ndarray) -> float:
        """The torque at the top (N m); the regulator follows its plant before the hand-over as well."""
        if self._regulator is not None:
            plant = held(self._regulator, self._base, bool(self._regulated.far))
            self._regulated, torque = regulator.regulate(NUMPY, self._regulator, self._regulated, plant, seen)
            return float(torque) * self._torque_unit if self._regulated.acting else 0.0
        top = self.policy.top
        assert top is not None
        return -float(top.gains @ error) if error @ top.cost_to_go @ error <= top.largest_cost else 0.0


def follow(law: SwingUpLaw, x: np.ndarray, t: float) -> float:
    """The torque (N m) along the trajectory, t s after the first call."""
    t = min(max(t, law.starts[0]), law.ends[-1])
    piece = min(int(np.searchsorted(law.ends, t)), len(law.ends) - 1)  # NaN is behind the last end
    s = (t - law.starts[piece]) / (law.ends[piece] - law.starts[piece])
    now = np.array([1.0, s, s * s, s**3]) @ law.coefficients[piece]
    return float(now[4] - now[5:] @ _error(x, now[:4]))


def _error(x: np.ndarray, target: np.ndarray) -> np.ndarray:
    error: np.ndarray = x - target
    error[:2] -= 2 * math.pi * np.rint(error[:2] / (2 * math.pi))
    return error


RobotPolicy = PendulumPolicy | FeedbackPolicy


def policy_controller(policy: RobotPolicy, guard: GuardChoice = None) -> LoopController[Any]:
    """The controller of a network or of a feedback law; use one object for one pendulum, in one thread."""
    if isinstance(policy, FeedbackPolicy):
        return guarded(FeedbackSource(policy), policy, guard)
    return numpy_controller(policy, guard=guard)


def is_law(source: str | Path) -> bool:
    """Whether a file is that of a feedback law."""
    return read_format(source) == FORMAT


def load_robot_policy(source: str | Path, robot: Robot | str | None = None) -> RobotPolicy:
    """Read a pendulum's policy, as :func:`swingup.load_policy`, or the file of a feedback law.

    Raises:
        SwingupError: it is neither, or damaged, or for another robot.
    """
    if not is_law(source):
        return load_pendulum_policy(source, robot)
    found = read_feedback(source)
    if robot is not None and found.robot != get_robot(robot):
        raise SwingupError(f"feedback law {source} is for the {found.robot.name}, not the {get_robot(robot).name}")
    return found


def write_feedback(path: str | Path, policy: FeedbackPolicy) -> None:
    """Write a law's file, without the guard, which stands in the entry."""
    arrays = {name: value for law in (policy.top, policy.swing_up) if law for name, value in asdict(law).items()}
    head = {"name": policy.name, "robot": policy.robot.name, PLANT: write_plant(policy.plant)}
    head |= {"held_plant": write_plant(policy.held_plant)}
    head |= {part.PART: asdict(part) for part in (policy.regulator, policy.estimator) if part is not None}
    save_arrays(path, FORMAT, FORMAT_VERSION, {**policy.metadata, **head}, arrays)


def read_feedback(path: str | Path) -> FeedbackPolicy:
    """Read a law's file.

    Raises:
        SwingupError: the file is damaged.
    """
    metadata, arrays = load_arrays(path, FORMAT, FORMAT_VERSION)
    with naming(f"feedback law {path}", "; export it again"):
        robot = get_robot(metadata.get("robot", ""))
        plant, held_plant = (read_plant(metadata.get(name), robot) for name in (PLANT, "held_plant"))
        top, swing_up = (_law(kind, arrays) for kind in (TopLaw, SwingUpLaw))
        kinds: tuple[Any, ...] = (RegulatorSettings, EstimatorSettings)
        parts: dict[str, Any] = {kind.PART: read_settings(metadata, kind) for kind in kinds}
        # It goes into Python and C.
        if not re.fullmatch(r"[\w.-]{1,60}", name := str(metadata.get("name")), re.ASCII):
            raise SwingupError(f"name = {quoted(name, 40)}: use letters, digits, . _ and -")
        settings = parts[RegulatorSettings.PART]
        found = FeedbackPolicy(name, robot, plant, held_plant, top, swing_up, **parts, metadata=metadata)
        try:
            # Calls upright and hanging meet every array.
            whole = (top is None) != (settings is None) and np.isfinite(
                [FeedbackSource(found).act(x, 0.0) for x in (GOAL, 0.0 * GOAL)]
            ).all()
        except (ValueError, IndexError):
            whole = False
        if not whole:
            raise SwingupError("its numbers are not a law")
        return found


def _law(kind: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    names = [each.name for each in fields(kind)]
    return kind(**{name: arrays[name] for name in names}) if arrays.keys() >= set(names) else None
