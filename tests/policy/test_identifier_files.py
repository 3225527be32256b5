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
from swingup.plant.base_parameters import Spread
from swingup.policy.identifier_settings import IdentifierSettings, default_identifier
from swingup.policy.pendulum import read_pendulum_policy, write_pendulum_policy
from swingup.policy.settings import EstimatorSettings

from .references import sighted_policy

OTHER = IdentifierSettings(dt=0.0025, span=3, max_delay_steps=30, spread=Spread(inertial=0.1, rotor=2e-4))


@pytest.fixture
def file(tmp_path):
    """A policy file with metadata of one's choice."""

    def write(**metadata):
        path = tmp_path / "p.safetensors"
        write_pendulum_policy(path, policy_of(sighted_policy()), metadata)
        return path

    return write


def test_the_loop_is_the_estimators(file):
    found = read_pendulum_policy(file(estimator={}, identifier={}))
    assert found.identifier == IdentifierSettings()
    found = read_pendulum_policy(file(estimator={"dt": 0.004, "max_delay_steps": 7}, identifier={"gate": 4}))
    assert found.identifier == IdentifierSettings(dt=0.004, max_delay_steps=7, gate=4.0)
    assert default_identifier(found.estimator) == dataclasses.replace(found.identifier, gate=3.0)
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
    write_pendulum_policy(tmp_path / "q.safetensors", policy, {"identifier": {"span": 7}})
    found = read_pendulum_policy(tmp_path / "q.safetensors")
    assert (found.estimator, found.identifier) == (estimator, OTHER)
    # From JAX, with the old metadata as provenance, as refine writes.
    save_controller(tmp_path / "again.safetensors", *lone_policy(tmp_path / "q.safetensors"))
    assert read_pendulum_policy(tmp_path / "again.safetensors").identifier == OTHER
    made = make_controller(found)
    assert made.identifier.settings == OTHER
    # 10 % of m2 r2 from m2 and from r2.
    assert made.identifier.covariance[2, 2] == pytest.approx(2 * (0.1 * found.plant.m2 * found.plant.r2) ** 2)
    assert make_controller(found, estimator=False).policy is not None


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({}, "identifier without an estimator: add estimator, {} for its defaults"),
        ({"estimator": {}, "identifier": None}, "identifier None is not an object of settings"),
        ({"estimator": {}, "identifier": {"spam": 1}}, "unknown identifier setting 'spam': use some of dt, span,"),
        ({"estimator": {}, "identifier": {"span": 2.5}}, "identifier setting span = 2.5: use a whole number"),
        ({"estimator": {}, "identifier": {"passive_limit": -1}}, "setting passive_limit = -1: use a number from 0"),
        ({"estimator": {}, "identifier": {"offset": 0}}, "identifier setting offset = 0: use a number from 1e-06"),
        ({"estimator": {}, "identifier": {"gate": "3"}}, "identifier setting gate = '3': use a number from"),
        (
            {"estimator": {}, "identifier": {"dt": 0.004}},
            "has dt = 0.004 s and max_delay_steps = 25",
        ),
        ({"estimator": {}, "identifier": {"max_delay_steps": 3}}, "give the identifier the estimator's"),
        ({"estimator": {}, "identifier": {"spread": 0.1}}, "identifier spread 0.1 is not an object of settings"),
        (
            {"estimator": {}, "identifier": {"spread": {"rotors": 1}}},
            "unknown identifier spread setting 'rotors'",
        ),
        ({"estimator": {}, "identifier": {"spread": {"rotor": 0}}}, "identifier spread setting rotor = 0: use a"),
    ],
)
def test_what_cannot_work(file, metadata, message):
    with pytest.raises(SwingupError, match=message) as caught:
        read_pendulum_policy(file(**{"identifier": {}, **metadata}))
    assert "\n" not in str(caught.value)
