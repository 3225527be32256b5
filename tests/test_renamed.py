"""Former names: they work, and one line says what they are called now."""

import pytest

import swingup
from swingup import renamed
from swingup.plants.domain import load_domain
from swingup.realaigym import load_controller
from swingup.runtime import load_controller as load_numpy_controller


@pytest.fixture
def lines(caplog, monkeypatch):
    """What was logged, in a program that has said nothing before."""
    monkeypatch.setattr(renamed, "_told", set())
    return lambda: [record.getMessage() for record in caplog.records]


@pytest.mark.parametrize(("old", "new"), renamed.RENAMED["controller"].items())
@pytest.mark.parametrize("load", [swingup.get_controller, load_controller, load_numpy_controller])
def test_a_former_name_of_a_controller_loads_with_one_line(lines, load, old, new):
    first, second = load(old, "acrobot"), load(old, "acrobot")
    assert type(first) is type(second) is type(load(new, "acrobot"))
    assert [line for line in lines() if old in line] == [f"swingup: controller {old!r} is now called {new!r}"]


def test_a_name_with_a_new_meaning_says_so(lines):
    swingup.get_controller("ar-eapo", "acrobot")
    swingup.get_controller("ar-eapo", "pendubot")
    assert lines() == [
        "swingup: controller 'ar-eapo' now means the paper's learner alone; the policy that it meant before is "
        "'refined'"
    ]


def test_present_names_and_the_packages_own_calls_say_nothing(lines):
    swingup.get_controller("refined", "acrobot")
    swingup.shipped_policy("acrobot", "ar-eapo")
    swingup.get_controller("tvlqr", "acrobot")
    assert lines() == []


def test_domains(lines):
    assert load_domain("hardware") == load_domain("identified")
    assert lines() == [
        "swingup: domain 'hardware' is now called 'identified'",
    ]
