"""Policies for tests: as controllers in JAX, without what stands around them."""

from swingup.controllers.stack.controller import policy_alone
from swingup.policy.shipped import load_policy


def lone_policy(source, robot=None):
    """The policy alone as a controller in JAX, and its metadata."""
    policy = load_policy(source, robot)
    return policy_alone(policy), dict(policy.metadata)
