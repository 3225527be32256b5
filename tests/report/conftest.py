"""The sections of a report, which take a swing-up's compilation."""

import pytest

from swingup.plant.plant import ROBOTS

from .pages import make_section


@pytest.fixture(scope="session")
def sections():
    return [make_section(robot) for robot in ROBOTS.values()]
