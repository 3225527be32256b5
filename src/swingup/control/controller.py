"""The one interface of all controllers: explicit state, so that whole closed loops compile and batch."""

import abc
from typing import Generic, TypeVar

import equinox as eqx

from ..types import Scalar, State, Torque

Carry = TypeVar("Carry")


class AbstractController(eqx.Module, Generic[Carry]):
    """A controller of the double pendulum: ``init() -> carry``, then ``(carry, t, x) -> (carry, u)``."""

    @abc.abstractmethod
    def init(self) -> Carry:
        """What the controller remembers before the first step."""

    @abc.abstractmethod
    def __call__(self, carry: Carry, t: Scalar, x: State) -> tuple[Carry, Torque]:
        """The torques [u1, u2] (N m) for the state x measured at time t (s), and what to remember."""
