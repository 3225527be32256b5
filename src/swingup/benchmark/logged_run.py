"""A policy's run on a robot with its log: how it went, what its calls show, and simulations of it.

A simulated run has the wiring of a suspect, and the plant and the loop of a fit (``identification/causes.py``).
"""

from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ..controllers.interface import PythonController
from ..dynamics.integrate import stable_substeps
from ..identification.causes import INDEX, NAMES, Expected, Explanation, Suspect
from ..identification.recording import Recording, sensors
from ..loop.disturbance import Disturbance, Effects, Pushes
from ..loop.domain import Domain
from ..loop.loop import Loop
from ..plant.base_parameters import BASE_NAMES
from ..plant.files import representative
from ..plant.plant import Plant, Robot
from ..policy.feedback import RobotPolicy, policy_controller
from ..policy.guard import Fault, Guard, GuardSettings
from ..policy.wiring import WiringWatch
from .board import TipHistory
from .boards import HARDWARE
from .rollout import Scenario
from .runner import run_one
from .swing_up_board import SwingUpBoard, follow_tip

LATE = 1.5  # Periods longer than this multiple of the median are late
SATURATED = 0.995  # Share of a limit from which a torque counts as saturated
REPLAYED = 1.0  # Time from the start over which the policy's torques are computed again (s)
ALIKE = 0.1  # Share of the limit within which a torque is the policy's
HOLD = 2.0  # Time at the end in which the tip must be up (s)
MAX_DURATION = 10.0  # Longest simulated run (s)
SIMULATED = Effects(drive=True, sensors=True, loads=True, sag=True)


@dataclass(frozen=True)
class LoggedRun:
    """A log of a policy's run, the policy, and the plant in its loop as they are assumed."""

    recording: Recording
    robot: Robot
    policy: RobotPolicy
    guard: GuardSettings
    facts: Domain
    expected: Expected

    @property
    def plant(self) -> Plant:
        """The assumed plant."""
        return self.facts.nominal_plant

    @property
    def states(self) -> Float[np.ndarray, "rows 4"]:
        """The states that the controller saw (rad, rad/s)."""
        return np.concatenate([self.recording.q, self.recording.dq], axis=1)

    def tip(self, time: Float[np.ndarray, "rows"], states: Float[np.ndarray, "rows 4"]) -> TipHistory:
        """How a run with these states went."""
        hold = HOLD if time[-1] > 2.0 * HOLD else None
        board: SwingUpBoard = replace(HARDWARE, duration=float(time[-1]), limits=None, hold=hold)
        return follow_tip(time, states, float(self.plant.l1), float(self.plant.l2), board)

    def own_share(self) -> float:
        """Share of the first calls in which the policy gives the log's torque for the log's state."""
        controller, joint = policy_controller(self.policy, self.guard), self.robot.joint
        limit, alike = self.policy.torque_limits[joint], []
        for t, x, u in zip(self.recording.time, self.states, self.recording.u, strict=True):
            own = controller(x, float(t))[joint]
            # What comes after a stop is the robot's, with a guard or without.
            if t > REPLAYED or controller.fault is not None:
                break
            alike.append(abs(own - u[joint]) < ALIKE * limit)
        return float(np.mean(alike)) if alike else 1.0

    def fault(self) -> Fault | None:
        """What the policy's guard stops on, at the log's rows."""
        policy, joint = self.policy, self.robot.joint
        watch = WiringWatch(policy.plant, joint, policy.torque_limits[joint], policy.period)
        guard = Guard(self.guard, joint, policy.torque_limits, watch)
        for t, x, u in zip(self.recording.time, self.states, self.recording.u, strict=True):
            if not guard.accepts_measurement(float(t), x):
                return guard.fault
            guard.limit_torques(u)
        return None

    def loop(self, best: Explanation) -> dict[str, str]:
        """Facts of the loop by title, with the delay of the best explanation."""
        recording, joint = self.recording, self.robot.joint
        periods, limit, delay = np.diff(recording.time), self.policy.torque_limits[joint], INDEX["delay"]
        late = float(np.mean(periods > LATE * recording.period))
        saturated = float(np.mean(np.abs(recording.u[:, joint]) >= SATURATED * limit))
        fault, period = self.fault(), self.policy.period
        own = "any" if period is None else f"{1e3 * period:.3g} ms"
        return {
            "Period": f"{1e3 * recording.period:.3g} ms (the policy's: {own})",
            "Late calls": f"{late:.1%} take more than {LATE:g} periods, the longest {1e3 * periods.max():.3g} ms",
            "From measurement to torque": f"{1e3 * best.z[delay]:.2g} ± {1e3 * best.sigma[delay]:.1g} ms "
            f"(expected: {1e3 * self.expected.centre[delay]:.2g} ms)",
            "Saturated calls": f"{saturated:.0%} at the limit of {limit:g} N m",
            "Guard": "does not stop it" if fault is None else str(fault),
        }

    def simulate(self, suspect: Suspect, z: Float[np.ndarray, "entries"], dt: float) -> TipHistory:
        """A run of the policy, called every dt (s), wired as the suspect says, with the plant and the loop of z."""
        p = dict(zip(NAMES, z.tolist(), strict=True))
        theta = np.maximum(self.expected.base(z), 0.0).tolist()
        limits = [limit * (1.0 - p["lost"]) for limit in self.expected.limits]
        plant = representative(dict(zip(BASE_NAMES, theta, strict=True)), self.plant)
        plant = plant.changed(tl1=limits[0], tl2=limits[1])
        lag = min(float(self.facts.nominal.loop.lag), p["delay"])
        seen = sensors([self.recording])
        loop = Loop(
            lag=lag, gain1=p["gain"], gain2=p["gain"], offset1=p["offset1"], offset2=p["offset2"], sag=p["sag"],
            spring1=p["spring1"], spring2=p["spring2"], load1=p["load1"], load2=p["load2"],
            stiction1=p["stiction"] * p["cf1"], stiction2=p["stiction"] * p["cf2"],
            quantum1=float(seen["quantum1"]), quantum2=float(seen["quantum2"]), velocities=str(seen["velocities"]),
        )  # fmt: skip
        # Half a period of every dead time is that of the torque's own step.
        delay = max(0, round((p["delay"] - lag) / dt - 0.5))
        effects = SIMULATED._replace(differences=loop.velocities == "differences")
        none = np.zeros((2, 1))
        disturbance = Disturbance(loop, delay, Pushes(none, none + 1.0, none), np.zeros(2, np.uint32), effects)
        scenario = Scenario(plant, disturbance, substeps=stable_substeps(plant, dt))
        steps = int(min(self.recording.duration, MAX_DURATION) / dt)
        controller = PythonController(_Wired(policy_controller(self.policy, self.guard), suspect))
        with jax.enable_x64(True):
            rows = run_one(controller, jax.tree.map(np.asarray, scenario), dt, steps, delay + 2)
        good = np.isfinite(rows.x).all(axis=1)
        return self.tip(rows.time[good], rows.x[good])


@dataclass(frozen=True)
class _Wired:
    """A controller whose encoders and motors are wired as a suspect says."""

    controller: Any
    suspect: Suspect

    def reset(self) -> None:
        self.controller.reset()

    def __call__(self, x: np.ndarray, t: float) -> np.ndarray:
        seen = np.concatenate([self.suspect.angles.T @ x[:2], self.suspect.angles.T @ x[2:]])
        return np.asarray(self.suspect.torques @ self.controller(seen, t))
