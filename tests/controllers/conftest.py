"""The robot of the controllers' tests."""

import pytest


@pytest.fixture
def robot(either_robot):
    """One compiles for seconds: the other one is in the slow tests."""
    return either_robot
