"""Fixtures and options that all layers share."""

import os
import tempfile

COMPILED = tempfile.TemporaryDirectory(prefix="swingup-tests-")
"""What several tests and their commands need is compiled once a worker. JAX reads this when it is imported."""
os.environ |= {"JAX_COMPILATION_CACHE_DIR": COMPILED.name, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1"}

import jax  # noqa: E402
import pytest  # noqa: E402

from swingup.physics.parameters import ROBOTS  # noqa: E402


@pytest.fixture(params=list(ROBOTS.values()), ids=list(ROBOTS))
def robot(request):
    """Each robot in turn."""
    return request.param


@pytest.fixture
def x64():
    """Double precision for one test, as the package's entry points use it: never a global flag."""
    with jax.enable_x64(True):
        yield


def pytest_sessionfinish(session):
    """Where everything is installed, as on CI (SWINGUP_NO_SKIPS), a skipped test is a failure."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("SWINGUP_NO_SKIPS") and reporter is not None and reporter.stats.get("skipped"):
        reporter.write_line("tests were skipped although SWINGUP_NO_SKIPS is set: see -rs", red=True)
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
