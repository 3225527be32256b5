"""Controllers with the interface that RealAIGym's simulator and its real-robot loop call, with NumPy alone.

Nothing is inherited from its package, so that it need not be installed. The order is RealAIGym's: the outer
``get_control_output`` filters the measurement, calls the controller, which adds friction compensation before its
guard, and keeps the histories; wrappers (combined and testing controllers) call the inner forms, whose names end in
an underscore. Histories hold at least the last minute of a loop at 500 Hz, which RealAIGym's runs last at most.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..common.checks import is_number
from ..common.errors import SwingupError, quoted
from ..common.files import make_folder, write_atomically
from ..plant.equations import friction
from ..policy.contract import LoopController, four_numbers
from ..policy.feedback import FeedbackSource
from ..policy.guard import Fault
from ..policy.numpy_backend import NumpyPolicy

SAVED_FILE = "controller_swingup.json"  # Where save writes
KEPT_ENTRIES = 30_000  # Entries of a history that are always kept; at most twice as many are
NO_TORQUES = np.zeros(2)  # Gravity compensation, of every call (N m)


class Filter:
    """A filter of measurements with the interface of RealAIGym's, and its histories."""

    def __init__(self, inner: Any = None) -> None:
        """Wrap an object with ``get_filtered_state(x, u)`` or a function of (x, u); None changes nothing."""
        self._inner, self._call = inner, getattr(inner, "get_filtered_state", inner)
        self.init()

    def init(self) -> None:
        """Begin a run, and call the filter's own ``init()`` if it has one."""
        self.x_hist: list[np.ndarray] = []
        """Measurements so far."""
        self.x_filt_hist: list[np.ndarray] = []
        """What the controller saw."""
        if hasattr(self._inner, "init"):
            self._inner.init()

    def get_filtered_state(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What the controller sees for the measurement x (4,) after the torques u (2,)."""
        # Copies: a foreign filter may keep or alter what it is given.
        seen = x.copy() if self._call is None else four_numbers(self._call(x.copy(), u.copy())).copy()
        _keep((self.x_hist, x), (self.x_filt_hist, seen))
        return seen


class RealAIGymController:
    """A controller as RealAIGym calls it.

    ``init()`` begins a run: it clears memory and histories. ``reset()`` also removes the friction compensation, as
    RealAIGym's own controllers do; call ``init()`` after it.
    """

    def __init__(self, controller: LoopController[Any], name: str = "swingup") -> None:
        """Wrap a policy's controller (``runtime.load_controller``) or another's (``swingup.loop_controller``)."""
        self.disturbance_intervals: list[Any] = []
        """Intervals in which the run is disturbed on purpose: none."""
        self._controller, self._dt = controller, 0.002
        self.robot, self.guard = controller.robot, controller.guard
        self.passive_limit = controller.passive_limit
        """Largest torque on the passive joint (N m)."""
        self._about: dict[str, Any] = {"controller": name}
        if isinstance(controller.inner, NumpyPolicy | FeedbackSource):
            policy, keys = controller.inner.policy, ("version", "command", "seed")
            origin = {key: policy.metadata[key] for key in keys if key in policy.metadata}
            self._about |= {"torque_limit": policy.torque_limit, "policy": origin}
            # The time between calls (s), for callers that give no time.
            self._dt = policy.period or self._dt
        self.filter = Filter()
        self.reset()
        self.init()

    @property
    def fault(self) -> Fault | None:
        """Why the safety guard stopped the controller; None while it acts, or without a guard."""
        return self._controller.fault

    def init(self) -> None:
        """Begin a run."""
        self.filter.init()
        self.x_hist: list[np.ndarray] = []
        """Measurements so far."""
        self.u_hist: list[np.ndarray] = [np.zeros(2)]
        """Zeros, then the torques so far: one entry more than there were steps."""
        self.u_fric_hist: list[np.ndarray] = []
        """Friction compensation so far (N m)."""
        self.u_grav_hist: list[np.ndarray] = []
        """Gravity compensation so far: zeros."""
        self.init_()

    def init_(self) -> None:
        """Clear the controller's own memory."""
        self._steps = 0
        self._controller.reset()

    def reset(self) -> None:
        """No friction compensation, and no memory."""
        self.set_friction_compensation()
        self.reset_()

    reset_ = init_

    def get_control_output(self, x: Sequence[float] | np.ndarray, t: float | None = None) -> np.ndarray:
        """The torques [u1, u2] (N m), a new float64 array, for the state x measured at time t (s)."""
        measured = four_numbers(x).copy()
        seen = self.filter.get_filtered_state(measured, self.u_hist[-1])
        # Of a broken rate nothing is known; behind an estimator the controller goes on without it.
        rates = np.where(np.isfinite(seen[2:]), seen[2:], 0.0)
        compensation = friction(self._damping, self._coulomb, rates, np.arctan)
        u = self._act(seen, t, measured, compensation)
        # A stopped controller gives no compensation either.
        if self.fault is not None:
            compensation = np.zeros(2)
        _keep(
            (self.x_hist, measured),
            (self.u_fric_hist, compensation),
            (self.u_grav_hist, NO_TORQUES),
            (self.u_hist, u),
        )
        # RealAIGym's loop adds to the result and clips it in place: the history must not change with it.
        return u.copy()

    def get_control_output_(self, x: Sequence[float] | np.ndarray, t: float | None = None) -> np.ndarray:
        """The controller's own torques; without a time, calls are counted as steps."""
        state = four_numbers(x).copy()
        return self._act(state, t, state)

    def save(self, directory: str | Path) -> None:
        """Write what this controller is to ``controller_swingup.json`` in a folder."""
        settings = {"damping": self._damping.tolist(), "coulomb_fric": self._coulomb.tolist()}
        text = json.dumps({"robot": self.robot.name, **self._about, **settings}, indent=2)
        make_folder(directory)
        write_atomically(Path(directory) / SAVED_FILE, (text + "\n").encode())

    save_ = save

    def set_filter(self, filter: Any = None) -> None:
        """Filter measurements from now on, after ``reset()`` as well; a state estimator needs no filter.

        A filter is an object with ``get_filtered_state(x, u)``, as RealAIGym's, or a function of the measurement x
        and the last torques u; None for none.
        """
        self.filter = Filter(filter)

    def set_friction_compensation(
        self, damping: Sequence[float] = (0.0, 0.0), coulomb_fric: Sequence[float] = (0.0, 0.0)
    ) -> None:
        """Add damping q̇ + coulomb_fric arctan(100 q̇) to the torques, for both joints (N m s/rad, N m).

        The sum is within the controller's limits, which on the passive joint may be 0.

        Raises:
            SwingupError: these are not two finite numbers each.
        """
        self._damping, self._coulomb = _two("damping", damping), _two("coulomb_fric", coulomb_fric)

    def _ignored(self, *arguments: Any, **settings: Any) -> None:
        """Nothing: these controllers count on gravity, start from anywhere, and have one goal and no parameters.

        RealAIGym's own filters need its package; see ``set_filter``.
        """

    set_gravity_compensation = set_filter_args = set_parameters = set_start = set_goal = _ignored

    def get_forecast(self) -> tuple[list[Any], list[Any], list[Any]]:
        """Nothing is forecast, or planned beforehand."""
        return [], [], []

    get_init_trajectory = get_forecast

    def _act(
        self, x: np.ndarray, t: float | None, measured: np.ndarray, added: np.ndarray | None = None
    ) -> np.ndarray:
        now = self._steps * self._dt if t is None else float(t)
        self._steps += 1
        return np.array(self._controller(x, now, measured, added), np.float64)


def _keep(*entries: tuple[list[np.ndarray], np.ndarray]) -> None:
    """Add to histories, which must not grow for ever."""
    for history, entry in entries:
        history.append(entry)
        # Many at a time: a list moves all that stays at each deletion.
        if len(history) > 2 * KEPT_ENTRIES:
            del history[:KEPT_ENTRIES]


def _two(name: str, given: Any) -> np.ndarray:
    values = list(given) if isinstance(given, list | tuple | np.ndarray) else []
    if len(values) != 2 or not all(map(is_number, values)):
        raise SwingupError(f"{name} = {quoted(given)}: two finite numbers are needed, for shoulder and elbow")
    return np.array(values, np.float64)
