"""Policies for tests, of files and untrained, in JAX, without what stands around them."""

import functools

import jax

from swingup.areapo.initial import init_actor
from swingup.controllers.stack.policy import make_policy, policy_alone
from swingup.policy.file import read_network
from swingup.policy.shipped import load_policy


def lone_policy(source, robot=None):
    """The policy alone as a controller in JAX, and its metadata."""
    policy = load_policy(source, robot)
    return policy_alone(policy), dict(policy.metadata)


@functools.partial(jax.jit, static_argnums=(0, 1))
def new_actor(size, layers, seed=0):
    """An untrained actor of one action: one program costs less than compiling operation by operation."""
    return init_actor(jax.random.key(seed), size, 1, layers, -1.0)


def load_any_policy(path):
    """The policy of a file of any task, and its metadata."""
    network, metadata = read_network(path)
    return make_policy(network), metadata
