"""The contract of all back ends: what a loop may expect of a policy, whatever runs it.

A controller is called with the measured state x = [q1, q2, dq1, dq2] (rad, rad/s) at the time t (s) and gives the
torques u = [u1, u2] (N m) of shoulder and elbow.

- Back ends differ by at most 5e-5 N m, and by 1e-11 where both compute in double precision throughout. Behind an
  estimator, rounding feeds back: 1e-9 over a whole run.
- A policy that sees its plant runs as the ordinary policy that it is for the plant of its file. Behind an
  identifier it is told the plant found so far, which depends on its own torques: 1e-9 holds where it reacts little
  to the plant. A strong reaction lets rounding grow in a replay, whose motion does not follow the torques. The
  shipped ``adaptive`` keeps to 1e-6 in double precision where the motors are given the same torques.
- The torque of the driven joint is NaN where the state is not finite, so that no clipping hides a broken sensor.
  The passive joint has 0, or the friction compensation of an identifier.
- Behind a safety guard no torque is ever NaN: the guard stops the controller instead (``policy/guard.py``).
- ``reset()`` forgets the run: what follows repeats the first run bit for bit.

``tests/policy/test_conformance.py`` holds every back end to it, ``tests/policy/test_guard.py`` the guards in NumPy
and in C. ONNX graphs and the page's JavaScript run the network alone, folded for the plant of the file: without
estimator, identifier, regulator and guard. Hidden layers of ReLU run everywhere, others in JAX and NumPy alone
(``policy/network.py: check_plain``). JAX has the same contract without hidden state, ``init() -> memory`` and
``(memory, t, x) -> (memory, u)``; a C header has it as ``swingup_reset`` and ``swingup_control``. JAX has no guard:
it judges.
"""

from typing import Protocol

import numpy as np


class LoopController(Protocol):
    """A controller as a loop calls it; one object serves one pendulum."""

    def reset(self) -> None:
        """Forget the run so far."""

    def __call__(
        self,
        x: np.ndarray,
        t: float,
        measured: np.ndarray | None = None,
        added: np.ndarray | None = None,
    ) -> np.ndarray:
        """The torques (2,) for the state x (4,) at time t (s).

        Where a filter made x of what was measured, ``measured`` is that (4,): a guard looks at it. ``added`` (2,)
        are torques that the caller adds (N m), such as a friction compensation of its own: a guard limits the sum.
        """
