"""Identifiers in policy files: what is read and written, and what is refused."""

import dataclasses

import pytest

from policies import lone_policy
from swingup.common.errors import SwingupError
from swingup.controllers.stack.controller import (
    make_controller,
    policy_of,
    save_controller,
)
from swingup.policy.estimator.settings import EstimatorSettings
from swingup.policy.identifier.settings import IdentifierSettings
from swingup.policy.pendulum import read_pendulum_policy, write_pendulum_policy

from .references import sighted_policy

OTHER = IdentifierSettings(passive_limit=0.2)


@pytest.fixture
def file(tmp_path):
    """A policy file with metadata of one's choice."""

    def write(**metadata):
        path = tmp_path / "p.safetensors"
        write_pendulum_policy(path, policy_of(sighted_policy()), metadata)
        return path

    return write


def test_the_loop_is_the_estimators(file):
    found = read_pendulum_policy(file(estimator={"dt": 0.004, "max_delay_steps": 7}, identifier={}))
    assert found.identifier == IdentifierSettings()
    loop = make_controller(found).loop.finding
    assert (loop.period, loop.max_delay_steps) == (0.004, 7)
    assert read_pendulum_policy(file(estimator={})).identifier is None


@pytest.mark.parametrize("limit", [0, 0.3])
def test_the_passive_joints_motor_may_be_left_alone(file, limit):
    found = read_pendulum_policy(file(estimator={}, identifier={"passive_limit": limit}))
    assert found.identifier.passive_limit == limit
    # The guard leaves that joint as much.
    assert found.torque_limits == (limit, found.plant.limit(1))


def test_a_plant_without_gravity_on_a_link_is_refused(file):
    policy = read_pendulum_policy(file(estimator={}, identifier={}))
    with pytest.raises(SwingupError, match="nothing to find the offsets by"):
        dataclasses.replace(policy, plant=dataclasses.replace(policy.plant, r2=0.0))


def test_round_trip(file, tmp_path):
    estimator = EstimatorSettings(dt=0.0025)
    policy = dataclasses.replace(policy_of(sighted_policy()), estimator=estimator, identifier=OTHER)
    write_pendulum_policy(tmp_path / "q.safetensors", policy, {"identifier": {"passive_limit": 0.7}})
    found = read_pendulum_policy(tmp_path / "q.safetensors")
    assert (found.estimator, found.identifier) == (estimator, OTHER)
    # From JAX, with the old metadata as provenance, as refine writes.
    save_controller(tmp_path / "again.safetensors", *lone_policy(tmp_path / "q.safetensors"))
    assert read_pendulum_policy(tmp_path / "again.safetensors").identifier == OTHER
    made = make_controller(found)
    assert made.loop.finding.passive_limit == OTHER.passive_limit
    # 25 % of m2 r2 from m2 and from r2.
    variance = 2 * (0.25 * found.plant.m2 * found.plant.r2) ** 2
    assert made.loop.finding.covariance[2, 2] == pytest.approx(variance)
    assert make_controller(found, estimator=False).policy is not None


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({}, "identifier without an estimator: add estimator, {} for its defaults"),
        ({"estimator": {}, "identifier": None}, "identifier None is not an object of settings"),
        (
            {"estimator": {}, "identifier": {"gate": 1}},
            "unknown identifier setting 'gate': use some of passive_limit",
        ),
        ({"estimator": {}, "identifier": {"passive_limit": -1}}, "setting passive_limit = -1: use a number from 0"),
    ],
)
def test_what_cannot_work(file, metadata, message):
    with pytest.raises(SwingupError, match=message) as caught:
        read_pendulum_policy(file(**{"identifier": {}, **metadata}))
    assert "\n" not in str(caught.value)
