"""Fixtures that all layers share."""

import jax
import pytest

from swingup.physics.parameters import ROBOTS


@pytest.fixture(params=list(ROBOTS.values()), ids=list(ROBOTS))
def robot(request):
    """Each robot in turn."""
    return request.param


@pytest.fixture
def x64():
    """Double precision for one test, as the package's entry points use it: never a global flag."""
    with jax.enable_x64(True):
        yield
