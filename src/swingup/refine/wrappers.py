"""The parts around a refined policy: estimator, identifier and regulator."""

from dataclasses import asdict, replace
from typing import Any, NamedTuple

from ..controllers.interface.controller import AbstractController
from ..controllers.stack.controller import PolicyController, make_controller, plant_of, policy_of
from ..policy.estimator.settings import EstimatorSettings, default_estimator
from ..policy.identifier.settings import IdentifierSettings
from ..policy.regulator.settings import RegulatorSettings

HAND_OVER = {
    "acrobot": RegulatorSettings(),
    "pendubot": RegulatorSettings(enter=0.04, enter_coulomb=0.01, leave_coulomb=5e-4),
}
"""Chosen on plants that no board has (``docs/refining.md``)."""
ACCELERATION_NOISE = 10.0
"""The estimator's where the model is the plant found (rad/s²): such a model errs less. Chosen likewise."""


class Wrappers(NamedTuple):
    """Settings of the parts around a policy; None for those that it has not."""

    estimator: EstimatorSettings | None = None
    identifier: IdentifierSettings | None = None
    regulator: RegulatorSettings | None = None

    def metadata(self) -> dict[str, Any]:
        """The same in a policy file."""
        parts = (self.estimator, self.identifier, self.regulator)
        return {part.PART: asdict(part) for part in parts if part is not None}


def default_wrappers(controller: PolicyController) -> Wrappers:
    """The parts in a refined policy's file: an estimator, and for a policy that sees its plant what finds that."""
    estimator = default_estimator(plant_of(controller))
    if not controller.policy.sees_plant:
        return Wrappers(estimator)
    estimator = replace(estimator, acceleration_noise=ACCELERATION_NOISE)
    return Wrappers(estimator, IdentifierSettings(), HAND_OVER[controller.robot.name])


def wrapped(controller: PolicyController) -> AbstractController[Any]:
    """What progress is judged by: the policy alone, or with all of its parts if it sees its plant."""
    parts = default_wrappers(controller)
    if parts.identifier is None:
        return controller
    return make_controller(replace(policy_of(controller), **parts._asdict()))
