"""Policies of files for tests, in JAX, without what stands around them."""

from swingup.controllers.stack.controller import policy_alone
from swingup.controllers.stack.policy import make_policy
from swingup.policy.file import read_network
from swingup.policy.shipped import load_policy


def lone_policy(source, robot=None):
    """The policy alone as a controller in JAX, and its metadata."""
    policy = load_policy(source, robot)
    return policy_alone(policy), dict(policy.metadata)


def load_any_policy(path):
    """The policy of a file of any task, and its metadata."""
    network, metadata = read_network(path)
    return make_policy(network), metadata
