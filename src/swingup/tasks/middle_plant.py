"""The one plant that a policy is said to be made for, when it was trained on a domain of plants."""

from ..physics.parameters import NAMES, Parameters, Robot
from ..plants.domain import Domain
from ..policy.plant_facts import PolicyPlant, policy_plant


def middle_plant(domain: Domain, robot: Robot) -> PolicyPlant | None:
    """The plant in the middle of a domain's ranges, if the domain names its plant; None for the leaderboards'.

    Domains around C.1 as identified that name no plant keep the estimator that their policies have always had.
    """
    if domain.plant is None:
        return None
    return policy_plant(domain.middle_parameters, robot, domain.plant.name)


def known_plant(domain: Domain, robot: Robot) -> Parameters | None:
    """The parameters of :func:`middle_plant`, if there is one."""
    plant = middle_plant(domain, robot)
    return None if plant is None else Parameters(**{name: getattr(plant, name) for name in NAMES})
