"""What several tests of the benchmark share: short rules, and controllers in JAX and in plain Python."""

import dataclasses
import math
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from swingup.benchmark.boards import ROBUSTNESS
from swingup.controllers.interface import AbstractController
from swingup.loop.resolve import resolve

V2 = ROBUSTNESS
BRIEF = dataclasses.replace(
    V2, name="brief", duration=0.8, perturbations=dataclasses.replace(V2.perturbations, spacing=0.1)
)
"""The whole grid, each run of 0.8 s, with pushes that fit into it."""
FRICTION = resolve(domain={"plant": "C.1", "design": "leaderboard", "passive_limit": 0.5})
"""The identified plant in a perfect loop."""


class Memoryless(AbstractController):
    """Torques that are a function of time and state."""

    torques: Callable  # a leaf that is no array, as a network's activation is

    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, self.torques(t, x)


SWINGING = Memoryless(lambda t, x: jnp.ones(2) * (3 * jnp.tanh(x[2] + x[3]) + 0.5 * jnp.cos(3 * t)))
"""Torque with the driven joint's velocity: it pumps energy into the pendulum from any disturbance."""
HANGING = Memoryless(lambda t, x: jnp.zeros(2, x.dtype))


def swinging(x, t):
    return np.ones(2) * (3 * math.tanh(x[2] + x[3]) + 0.5 * math.cos(3 * t))


class Counting(AbstractController):
    """A torque that grows with the calls, on both joints."""

    def init(self):
        return jnp.zeros(())

    def __call__(self, carry, t, x):
        return carry + 1, jnp.array([0.3, 1.0]) * jnp.sin(0.01 * carry + t) * jnp.cos(x[0])


class PlainCounting:
    """The same in plain Python, with a memory in the object."""

    def __init__(self):
        self.calls = 99

    def init(self):
        self.calls = 0

    def get_control_output(self, x, t):
        self.calls += 1
        return np.array([0.3, 1.0]) * math.sin(0.01 * (self.calls - 1) + t) * math.cos(x[0])
