"""The optimal-control baselines by name, designed for a plant."""

import functools
import logging
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ...common.checks import one_of
from ...common.errors import SwingupError
from ...common.types import State, Torque
from ...dynamics.dynamics import UPRIGHT
from ...loop.resolve import resolve
from ...plant.equations import COULOMB_STEEPNESS
from ...plant.plant import LEADERBOARD, Plant, PlantLike, Robot, get_robot
from ...plant.units import C1, DAMPING, STATE, TIME, TORQUE, Scales, scaled, scales_of, similar_plant
from ...policy.estimator import default_estimator
from ...policy.feedback import FeedbackPolicy, SwingUpLaw, TopLaw
from ...policy.pendulum import policy_plant
from ..interface import AbstractController, Time, TimeLike, joint_torques, never, since_first_call
from ..swingups.design import compute_reference, design_model
from ..swingups.reference import Reference, load_reference
from .settings import OPTIMAL_SETTINGS, PUBLISHED_SETTINGS, Optimal, Published, optimal_for, published_for
from .tracking import TVLQR, mpc, riccati_controller, tvlqr
from .upright import (
    HAND_OVER,
    HOLDING_BOUNDS,
    LQR,
    LatchingSwitch,
    holding_regulator,
    passive_friction,
    upright_lqr,
)

EXPORTED = ("lqr", "tvlqr", "tvlqr-score")
"""Those that run without JAX."""

PROBLEMS = dict.fromkeys(("tvlqr", "ilqr-riccati", "ilqr-mpc"), "published") | {"tvlqr-score": "score"}
"""The problem whose swing-up a baseline follows."""

BASELINES = ("lqr", *PROBLEMS)
"""Names of the baselines: the LQR at the top, and controllers that follow a swing-up and end with that LQR.

All settings are the published ones, except those of ``tvlqr-score``, which is ours.
"""

SHIPPED_TRAJECTORIES = {"published": "ilqr", "score": "score"}
"""Endings of the file names, by the optimisation's problem."""

DESIGN_SEED = 0  # Seed of the swing-ups that are computed for other plants
LARGEST_FINAL_ERROR = 0.1  # A swing-up ends within this of upright, in both angles (rad)

_LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class Design:
    """What a baseline is designed from: a similar pendulum in C.1's units, and the settings."""

    robot: Robot
    model: Plant  # The similar pendulum, without dry friction
    with_friction: Plant  # The plant with the dry friction of its passive joint
    scales: Scales  # The plant's units as multiples of C.1's
    published: Published
    optimal: Optimal
    shipped: bool  # Whether the package ships the model's swing-ups; others are computed

    def reference(self, problem: str) -> Reference:
        """The similar pendulum's swing-up that optimises a problem, "published" or "score"."""
        return shipped_reference(self.robot, problem)[0] if self.shipped else _computed_reference(self, problem)

    def compute(self, problem: str, seed: int) -> tuple[Reference, dict[str, Any]]:
        """Optimise this swing-up, see :func:`design.compute_reference`."""
        swingup = self.optimal.swingup if problem == "score" else self.published.swingup
        return compute_reference(self.robot, swingup, seed, self.model)


def design_of(robot: Robot, plant: Plant) -> Design:
    """Settings for a plant; for the leaderboards' the published ones and the shipped swing-ups."""
    published, optimal = PUBLISHED_SETTINGS[robot.name], OPTIMAL_SETTINGS[robot.name]
    model = design_model(plant, robot)
    scales = scales_of(model)
    # The driven joint's friction is compensated around the controller (``InOwnUnits``), which then has none.
    with_friction = model.changed(**{f"cf{2 - robot.joint}": passive_friction(plant.driven(robot), robot)})
    if model == design_model(LEADERBOARD, robot):
        return Design(robot, model, with_friction, scales, published, optimal, shipped=True)
    model.needs_motor(robot)
    settings = published_for(published, scales.time), optimal_for(optimal, scales.time)
    model, with_friction = similar_plant(model, scales), similar_plant(with_friction, scales)
    return Design(robot, model, with_friction, scales, *settings, shipped=False)


def baseline(name: str, robot: Robot | str, plant: PlantLike = LEADERBOARD) -> AbstractController[Any]:
    """A baseline for a robot.

    Args:
        name: one of :data:`BASELINES`.
        robot: which joint is driven.
        plant: what it is designed for: a plant, its name or its file. The leaderboards' has the published settings
            and the shipped swing-up. For another plant the settings are in its own units, and the swing-up is
            computed without Coulomb friction, once in a process. The driven joint's is compensated, the passive
            joint's is counted on by the regulator at the top and by the TVLQR (``upright.py``).

    Raises:
        SwingupError: there is no such baseline, robot or plant.
    """
    robot, name = get_robot(robot), one_of("baseline", name, BASELINES)
    facts = resolve(plant).facts
    design, driven = design_of(robot, facts), facts.driven(robot)
    designed = _designed(name, design)
    # C.1's own units need no conversion, and its published controllers stay as they are, bit for bit.
    if design.shipped and not (driven.cf1 or driven.cf2):
        return designed
    limit, coulomb = float(driven.limit(robot.joint)), float((driven.cf1, driven.cf2)[robot.joint])
    return InOwnUnits(designed, limit, coulomb, design.scales, robot)


def _designed(name: str, design: Design) -> AbstractController[Any]:
    """A baseline for the similar pendulum."""
    model, robot, published, optimal = design.model, design.robot, design.published, design.optimal
    for_score = PROBLEMS.get(name) == "score"
    settings = optimal.lqr if for_score else published.lqr
    lqr, friction = upright_lqr(model, robot, settings), passive_friction(design.with_friction, robot)
    top: AbstractController[Any] = holding_regulator(design.with_friction, robot) if friction else lqr
    if name == "lqr":
        return top
    following: AbstractController[Any]
    reference = design.reference(PROBLEMS[name])
    if name == "ilqr-mpc":
        following, threshold = mpc(reference, model, robot, published.mpc), published.mpc_threshold
    elif name == "ilqr-riccati":
        following, threshold = riccati_controller(reference, model), published.riccati_threshold
    else:
        Qf = np.asarray(lqr.cost_to_go)
        if for_score:
            # Q and R are per second, as those of the LQR at the top, whose cost-to-go the recursion starts from.
            Q, R = reference.dt * np.diag(settings.state_weights), reference.dt * settings.torque_weight
            pieces, threshold = len(reference.torque) // optimal.rows_per_piece, optimal.threshold
        else:
            s = published.tvlqr
            Q, R, pieces, threshold = np.diag(s.state_weights), s.torque_weight, s.pieces, published.tvlqr_threshold
            Qf = Qf if s.final_factor is None else s.final_factor * Q
        following = tvlqr(reference, model, robot, (Q, R, Qf), pieces, friction)
    return LatchingSwitch(following, top, np.array(HAND_OVER if friction else threshold), robot)


def feedback_policy(
    name: str, robot: Robot | str, plant: PlantLike = LEADERBOARD, estimator: bool = False
) -> FeedbackPolicy:
    """A baseline of :data:`EXPORTED` as a law that runs without JAX, in the plant's own units.

    With an estimator before it, this has the defaults.

    Raises:
        SwingupError: the baseline has no such law, or it, the robot or the plant is unknown; or its swing-up does
            not come up.
    """
    robot, facts = get_robot(robot), resolve(plant).facts
    if one_of("baseline", name, BASELINES) not in EXPORTED:
        raise SwingupError(
            f"{name} cannot be exported: use {' or '.join(EXPORTED)}, or run it by swingup.RealAIGymController"
        )
    design = design_of(robot, facts)
    found, scales, swing_up = _designed(name, design), design.scales, None
    if isinstance(found, LatchingSwitch):
        following, threshold = found.first, scales.scaled(found.threshold, *STATE)
        assert isinstance(following, TVLQR)
        if not reaches_upright(design.reference(PROBLEMS[name]), design.model):
            raise SwingupError(f"the swing-up of {name} does not come up on {facts}: give its motor more torque")
        fit, channels = following.fit, (*STATE, TORQUE, TORQUE, TORQUE, DAMPING, DAMPING)
        starts, ends = (scales.scaled(np.asarray(each), TIME) for each in (fit.starts, fit.ends))
        swing_up = SwingUpLaw(starts, ends, scales.scaled(np.asarray(fit.coefficients), *channels), threshold)
        found = found.second
    held = similar_plant(design.with_friction, C1.over(scales))
    parts: dict[str, Any] = {"swing_up": swing_up}
    if isinstance(found, LQR):
        units = 1.0 / np.array([scales.of(unit) for unit in STATE])
        gains = scales.scaled(np.asarray(found.gains), TORQUE, TORQUE, DAMPING, DAMPING)
        cost = np.asarray(found.cost_to_go) * np.outer(units, units)
        parts["top"] = TopLaw(gains, cost, np.array(found.max_cost_to_go))
    else:
        parts |= {"top": None, "regulator": scaled(HOLDING_BOUNDS, scales)}
    own = policy_plant(facts, robot)
    parts["estimator"] = default_estimator(own) if estimator else None
    return FeedbackPolicy(name, robot, own, held, **parts)


def shipped_reference(robot: Robot | str, problem: str = "published") -> tuple[Reference, dict[str, Any]]:
    """The swing-up that the package ships for a robot, and its metadata.

    The problem is "published" for the one that the published baselines follow, "score" for that of ``tvlqr-score``.
    """
    robot = get_robot(robot)
    file = f"{robot.name}-{SHIPPED_TRAJECTORIES[one_of('problem', problem, SHIPPED_TRAJECTORIES)]}.safetensors"
    with resources.as_file(resources.files("swingup") / "zoo" / file) as path:
        return load_reference(path)


@functools.lru_cache(maxsize=32)
def _computed_reference(design: Design, problem: str) -> Reference:
    """A swing-up, computed once in a process; warnings say that it takes long, and when it does not come up."""
    robot = design.robot.name
    _LOGGER.warning(
        f"a swing-up of the {robot} is computed for this plant: half a minute on two free cores, some minutes "
        "where its motor is weak"
    )
    found = design.compute(problem, DESIGN_SEED)[0]
    if not reaches_upright(found, design.model):
        _LOGGER.warning(f"no swing-up of the {robot} was found for this plant: its baselines will fail")
    return found


def reaches_upright(reference: Reference, parameters: Plant) -> bool:
    """Whether a swing-up ends near upright, with torques that the motor has."""
    error = np.abs(np.asarray(reference.states)[-1] - UPRIGHT)[:2].max()
    limit = parameters.limit(reference.robot.joint)
    # The units of a plant are right to rounding.
    return bool(error < LARGEST_FINAL_ERROR and np.abs(reference.torque).max() <= limit * (1 + 1e-9))


def in_real_units(reference: Reference, scales: Scales) -> Reference:
    """A swing-up of a similar pendulum as that of the plant itself."""
    found = scaled(reference, scales)
    # A step's length is a round number of real time.
    return replace(found, dt=round(found.dt, 12))


class InOwnUnits(AbstractController[tuple[Time, Any]]):
    """A controller of the similar pendulum without friction of its driven joint, for the plant itself.

    It sees the plant's state and time in C.1's units.
    """

    controller: AbstractController[Any]
    limit: float  # The plant's motor's (N m)
    coulomb: float  # The driven joint's Coulomb friction, which is added to the torque (N m)
    scales: Scales  # The plant's units; not static, so that plants share a program
    robot: Robot = eqx.field(static=True)

    def init(self) -> tuple[Time, Any]:
        """The time of the first call, and the controller's own memory."""
        return never(), self.controller.init()

    def __call__(self, carry: tuple[Time, Any], t: TimeLike, x: State) -> tuple[tuple[Time, Any], Torque]:
        """The torques (N m)."""
        begun, elapsed = since_first_call(t, carry[0])
        similar = self.scales.similar
        inner, u = self.controller(carry[1], similar(elapsed, TIME), similar(x, *STATE))
        joint = self.robot.joint
        torque = self.scales.scaled(u[joint], TORQUE) + self.coulomb * jnp.arctan(COULOMB_STEEPNESS * x[2 + joint])
        # Neither the compensation nor the units' rounding may exceed the limit.
        return (begun, inner), joint_torques(torque, self.robot, self.limit)
