"""The one plant that a policy is said to be made for, when it was trained on a domain of plants."""

from ..physics.plant import Plant
from ..plants.domain import Domain
from ..policy.plant_facts import policy_plant
from ..robots import Robot


def known_plant(domain: Domain, robot: Robot) -> Plant | None:
    """The plant in the middle of a domain's ranges, if the domain names its plant; None for the leaderboards'.

    Domains around C.1 as identified that name no plant keep the estimator that their policies have always had.
    """
    if domain.plant is None:
        return None
    return policy_plant(domain.middle_plant, robot)
