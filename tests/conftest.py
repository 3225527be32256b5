"""Fixtures and options that all layers share."""

import ctypes
import dataclasses
import functools
import gc
import importlib.metadata
import os
import shutil
import signal
import sys
from pathlib import Path

gc.disable()  # until all tests are collected: nearly all that is imported stays

COMPILED = Path(__file__).parents[1] / ".pytest_cache" / "jax"
"""Compiled programs, which all workers and later runs share, unless the user names a folder. JAX reads the variable
when it is imported. What a killed process left half-written is compiled anew: pyproject.toml ignores that
warning."""
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(COMPILED))
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.02"
CHEAP = ["--xla_backend_optimization_level=0", "--xla_cpu_parallel_codegen_split_count=1"]
"""Tests mostly compile: with these flags two to five times as fast. ``make slow`` runs without them, and so does
``XLA_FLAGS= make test``; a jaxlib that no longer knows a flag stops with its name: delete it here."""
if importlib.metadata.version("jaxlib").startswith("0.10."):
    CHEAP.append("--xla_cpu_use_fusion_emitters=false")  # the latest jaxlib has no other way, and no flag
os.environ.setdefault("XLA_FLAGS", " ".join(CHEAP))

import jax  # noqa: E402
import pytest  # noqa: E402

from swingup.benchmark.boards import ROBUSTNESS, UPTIME  # noqa: E402
from swingup.benchmark.robustness_board import change_grid  # noqa: E402
from swingup.plant.plant import NAMES, ROBOTS  # noqa: E402


@pytest.fixture(params=list(ROBOTS.values()), ids=list(ROBOTS))
def robot(request):
    return request.param


@pytest.fixture(
    params=[ROBOTS["acrobot"], pytest.param(ROBOTS["pendubot"], marks=pytest.mark.slow)], ids=list(ROBOTS)
)
def either_robot(request):
    """For what does not depend on the robot and takes seconds: the acrobot, and the pendubot in the slow tests."""
    return request.param


@pytest.fixture(scope="session")
def similar():
    """From a plant to one that moves alike: lengths × 0.25 and masses × 0.1; T × 0.5 and torques × 0.025."""
    powers = {
        "l": (1, 0),
        "r": (1, 0),
        "m": (0, 1),
        "I": (2, 1),
        "b": (1.5, 1),
        "c": (1, 1),
        "t": (1, 1),
        "z": (0, 0),
    }

    def make(plant):
        names = set(NAMES) - {"g", "gr"}
        factors = {name: 0.25 ** powers[name[0]][0] * 0.1 ** powers[name[0]][1] for name in names}
        return dataclasses.replace(plant, **{name: getattr(plant, name) * factors[name] for name in names})

    return make


@pytest.fixture
def x64():
    """Double precision for one test, as the package's entry points use it: never a global flag."""
    with jax.enable_x64(True):
        yield


@pytest.fixture
def own_signals():
    """Handlers that a command sets go; and SIGINT, which a shell's background jobs inherit as ignored, acts."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture(scope="session")
def small_grid():
    """Rules of IROS 2024 with all six criteria, but fewer values and repetitions: 52 simulations, each of 4 s."""
    noises = "velocity_noise=0:0.5:3:3", "torque_noise=0:1.1:3:3"
    changes = *noises, "torque_response=0.1:2:3", "delay=0:0.04:3", "perturbations=8"
    grid = functools.reduce(change_grid, changes, ROBUSTNESS)
    model = {
        name: dataclasses.replace(each, sweep=dataclasses.replace(each.sweep, count=2))
        for name, each in grid.model.items()
    }
    pushes = dataclasses.replace(grid.perturbations, spacing=0.5)
    return dataclasses.replace(grid, name="robustness", duration=4.0, model=model, perturbations=pushes)


@pytest.fixture(scope="session")
def brief_minute():
    """Rules of ICRA 2025 with 9 s of the minute and two throws, of which the first comes as late as ever."""
    return dataclasses.replace(UPTIME, duration=9.0, throws=2)


OFFLINE = [
    "--no-sandbox", "--headless", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip


@pytest.fixture(scope="module")
def chromium():
    """A browser; starting one takes half a second, so that a module's tests share it."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if (path := shutil.which("chromium")) is None:
        pytest.skip("chromium is not installed")
    with playwright.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=path, args=OFFLINE)
        yield browser
        browser.close()


TRIM = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
"""glibc's; other C libraries have none."""
MAPS, MOST_MAPS = Path("/proc/self/maps"), 20_000
"""Mapped regions of memory. Linux permits 65,530 a process, and XLA, which maps several a program, then crashes."""


@pytest.fixture(scope="module", autouse=True)
def trimmed_memory(request):
    """After a module of slow tests many compiled programs are dropped, and freed memory goes back to the system."""
    yield
    if request.config.option.markexpr == "slow":
        if MAPS.exists() and MAPS.read_bytes().count(b"\n") > MOST_MAPS:
            jax.clear_caches()
            gc.collect()
        if TRIM is not None:
            TRIM(0)  # glibc would keep gigabytes


LONGEST = (
    "test_command_lines_run_in_their_order", "test_the_default_preset_learns_to_swing_up",
    "test_from_two_logs_to_a_header",
)  # fmt: skip
"""Tests that take minutes: they begin first, so that no process waits for the last of them in the end."""


def pytest_collection_modifyitems(items):
    """Long tests first; all others keep their order."""
    items.sort(key=lambda item: item.name not in LONGEST)


def pytest_collection_finish():
    """What was imported stays: the collector, which JAX makes dear, need not walk through it, nor often."""
    gc.collect()
    gc.freeze()
    gc.enable()
    gc.set_threshold(20_000, 10, 10)


def pytest_sessionfinish(session):
    """Where everything is installed, as on CI (SWINGUP_NO_SKIPS), a skipped test is a failure."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("SWINGUP_NO_SKIPS") and reporter is not None and reporter.stats.get("skipped"):
        reporter.write_line("tests were skipped although SWINGUP_NO_SKIPS is set: see -rs", red=True)
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
