"""Why a run failed on the robot: what its log shows of wiring, loop and plant, and simulations of what it shows.

``identification/causes.py`` weighs the causes by the log's motion; the clock shows another rate. The policy is then
simulated with the likeliest cause, and without it: with all else that the log shows. A cause is named if the run
failed and the log shows it clearly; simulations say whether the policy bears it.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..controllers.interface import PythonController
from ..dynamics.integrate import stable_substeps
from ..identification.causes import (
    INDEX,
    NAMES,
    NOTHING,
    Expected,
    Explanation,
    Suspect,
    expected_of,
    explain,
    roughness,
)
from ..identification.prediction import integration_of
from ..identification.recording import Recording, read_recording, sensors
from ..loop.disturbance import Disturbance, Effects, Pushes
from ..loop.domain import Domain
from ..loop.loop import Loop
from ..loop.resolve import resolve
from ..plant.base_parameters import BASE, BASE_NAMES, base_parameters
from ..plant.files import representative
from ..plant.plant import ZEROS, Plant, PlantLike, Robot, get_robot
from ..policy.guard import Fault, Guard, GuardSettings, choose_guard
from ..policy.numpy_backend import numpy_controller
from ..policy.pendulum import PendulumPolicy
from ..policy.shipped import SHIPPED_POLICIES, load_pendulum_policy
from ..policy.wiring import WiringWatch
from .board import TipHistory
from .boards import HARDWARE
from .recording import driven_robot
from .rollout import Scenario
from .runner import run_one
from .swing_up_board import SwingUpBoard, follow_tip

DECISIVE, LIKELY = 10.0, 3.0  # Differences of log evidence from which a cause is sure, and likely
OTHER_RATE = 0.2  # Share by which a period differs from the policy's to be a cause
LATE = 1.5  # Periods longer than this multiple of the median are late
SATURATED = 0.995  # Share of a limit from which a torque counts as saturated
REPLAYED = 1.0  # Time from the start over which the policy's torques are computed again (s)
ALIKE = 0.1  # Share of the limit within which a torque is the policy's
OWN_SHARE = 0.7  # Share of calls that must be alike for the log to be the policy's
DELAY = 0.006  # Dead time of a loop that says nothing of its own (s)
HOLD = 2.0  # Time at the end in which the tip must be up (s)
MAX_DURATION = 10.0  # Longest simulated run (s)
PLAY, PLAY_RATIO, PLAY_PERIOD = 2.5e-4, 2.5, 0.005
"""The elbow has play from this roughness (rad), if it is as many times the shoulder's, in loops up to this period
(s): slower ones do not show it. Recordings without play have up to 1.2e-3 rad and 1.5 times the shoulder's."""
NOTABLE = 3.0  # Ordinary spreads from which a difference is shown
OPEN = 0.5  # Share of the spread of a freed entry above which the log could not have shown a cause

REMEDIES = {
    "rate": "call the controller at its own rate, or train for this one",
    "joints swapped": "swap encoders or motors where the firmware reads and writes them, or the cables; link 1 "
    "moved by hand must change q1, and a torque u1 must act on the shoulder",
    "encoder 1 reversed": "change the sign of q1 and its rate in the firmware: they must grow with a positive u1",
    "encoder 2 reversed": "change the sign of q2 and its rate in the firmware: they must grow as q1 does",
    "motor reversed": "change the sign of the torque in the firmware: a positive torque must raise its angle",
    "zero 1": "set the shoulder's zero with the arm hanging at rest, or subtract the offset",
    "zero 2": "set the elbow's zero with the links in line, or subtract the offset",
    "delay": "shorten the way from encoder to motor (bus, filters, prints), or train with it (delay in the file)",
    "torque constant": "correct the torque constant or gear ratio in the firmware; a weight on a level arm tells",
    "supply": "check supply, current limit and the motors' top speed, or train with less torque (tl1, tl2, sag)",
    "friction": "look for rubbing cables and tight bearings; then identify the plant again, and train with it",
    "play": "tighten couplings and belts of the elbow: with its motor held, link 2 must not move freely",
    "spring": "lay cables so that they do not pull: the arm must hang straight down",
    "mass": "weigh the links, or identify the plant again (swingup identify), and train with it",
}
"""What to do against each cause."""

UNITS = {
    "A": "kg m²", "B": "kg m²", "m2r2": "kg m", "k": "kg m", "Ir": "kg m²", "b1": "N m s/rad", "b2": "N m s/rad",
    "cf1": "N m", "cf2": "N m", "offset1": "rad", "offset2": "rad", "gain": "", "delay": "s", "spring1": "N m/rad",
    "spring2": "N m/rad", "load1": "N m", "load2": "N m", "stiction": "", "sag": "N m s/rad", "lost": "",
    "link1": "", "link2": "",
}  # fmt: skip


@dataclass(frozen=True)
class Cause:
    """One cause of a failure, with its evidence."""

    name: str
    text: str  # What is wrong
    evidence: str  # In numbers
    sure: str  # certain, likely or possible
    remedy: str
    counterfactual: str | None = None  # What simulations with and without it do
    confirmed: bool | None = None  # Whether it fails with the cause and succeeds without; None if not simulated


@dataclass(frozen=True)
class Diagnosis:
    """What a log shows of a policy's run."""

    recording: Recording
    robot: Robot
    policy: str
    failure: str | None  # How the run failed; None if it succeeded
    own: bool  # Whether the torques are the policy's: without that no cause of its failure is named
    loop: Mapping[str, str]  # Facts of the loop, by title
    causes: Sequence[Cause]  # Likeliest first
    differences: Sequence[tuple[str, str, str, str]]  # Entry, assumed, found, and their distance in spreads
    blind: Sequence[str]  # Causes that this log could not have shown
    notes: Sequence[str]

    @property
    def named(self) -> Cause | None:
        """The cause of the failure, if the log shows one."""
        sure = self.failure and self.own and self.causes and self.causes[0].sure != "possible"
        return self.causes[0] if sure else None

    @property
    def answer(self) -> str:
        """The answer in one sentence."""
        if self.failure is None:
            return "the run succeeded: there is nothing to explain"
        if self.named is not None:
            return f"{self.named.name}: {self.named.text}"
        if not self.own:
            return "the torques of this log are not the policy's: see the notes"
        return "nothing is wrong that this log shows"

    @property
    def lines(self) -> list[str]:
        """The answer, and what supports it, one line each."""
        found = [f"run: {self.failure or 'up and held'}", f"answer: {self.answer}"]
        for each in self.causes:
            found.append(f"{each.name} ({each.sure}): {each.evidence}")
            found += [f"  {each.counterfactual}"] if each.counterfactual else []
            found += [f"  do: {each.remedy}"]
        if self.blind:
            found.append(f"this log could not have shown: {', '.join(self.blind)}")
        return [*found, *self.notes]

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "log": self.recording.name,
            "robot": self.robot.name,
            "policy": self.policy,
            "failure": self.failure,
            "answer": self.answer,
            "named": None if self.named is None else self.named.name,
            "causes": [dataclasses.asdict(each) for each in self.causes],
            "loop": dict(self.loop),
            "differences": [list(each) for each in self.differences],
            "not_shown": list(self.blind),
            "notes": list(self.notes),
        }


def diagnose(
    log: str | Path,
    policy: str | Path,
    plant: PlantLike | Domain | None = None,
    domain: Domain | str | None = None,
    robot: Robot | str | None = None,
    columns: Sequence[str] = (),
    simulate: bool = True,
) -> Diagnosis:
    """Say why a policy's run failed, from its log: what the controller saw and commanded, row by row.

    Args:
        log: the log, as :func:`~swingup.identification.recording.read_recording` reads it.
        policy: the policy's file, or the name of a shipped one.
        plant: the plant that the policy is for, with the loop of its file; None for that of the policy's file.
        domain: the loop that the plant's file lacks. What a cause is not may lie in its ranges.
        robot: which joint is driven; None where the log's torques or the policy say it.
        columns: words that map the log's columns.
        simulate: whether the policy is simulated with the cause and without it.

    Raises:
        SwingupError: the log cannot be read, there is no such policy, plant or domain, or it is for another robot.
    """
    recording = read_recording(log, columns)
    if robot is None and str(policy) not in SHIPPED_POLICIES:
        robot = load_pendulum_policy(policy).robot
    driven = driven_robot(recording.name, recording.u) if robot is None else get_robot(robot)
    found = load_pendulum_policy(policy, driven)
    facts = resolve(found.plant if plant is None else plant, domain)
    # The policy subtracts its plant's zeros: what is left of them is what may be wrong.
    recording = replace(recording, q=recording.q - found.plant.zeros)
    found = replace(found, plant=found.plant.changed(**ZEROS))
    low, high = (end._replace(plant=end.plant.changed(**ZEROS)) for end in (facts.low, facts.high))
    facts = replace(facts, low=low, high=high)
    guard = choose_guard(True, found.guard, found.period, found.plant)
    assert guard is not None
    expected = _expected(facts, recording.period - guard.dt)
    explanations = explain(recording, integration_of(facts.nominal_plant), expected)
    return _Case(recording, driven, found, guard, facts, expected, explanations, simulate).diagnosis(str(policy))


def _expected(facts: Domain, slower: float) -> Expected:
    """What is expected of the plant and its loop, whose period is longer than the policy's by ``slower`` (s)."""
    plant, loop = facts.nominal
    delay = float(loop.delay + loop.lag) if {"delay", "lag"} & {*facts.names} else DELAY
    # Each turn of a slow loop makes torques later.
    delay += max(0.0, slower)
    limit = max(float(plant.tl1), float(plant.tl2))
    expected = expected_of(plant, delay, (limit, limit))
    low, high = (base_parameters(end.plant) for end in (facts.low, facts.high))
    ordinary, centre = expected.ordinary.copy(), expected.centre.copy()
    # Ranges of the domain are ordinary: two spreads reach their ends.
    ordinary[INDEX["delay"]] += 0.5 * abs(slower)
    ordinary[:BASE] = np.maximum(ordinary[:BASE], 0.25 * np.abs(high - low))
    for name, entry in (
        ("offset1", "offset1"),
        ("offset2", "offset2"),
        ("gain1", "gain"),
        ("delay", "delay"),
        ("lag", "delay"),
    ):
        if name in facts.names:
            ordinary[INDEX[entry]] += 0.25 * (facts.high.value(name) - facts.low.value(name))
        if name in facts.names and entry != "delay":
            centre[INDEX[entry]] = facts.nominal.value(name)
    return replace(expected, centre=centre, ordinary=ordinary)


@dataclass(frozen=True)
class _Case:
    """All that is known when the answer is put together."""

    recording: Recording
    robot: Robot
    policy: PendulumPolicy
    guard: GuardSettings
    facts: Domain
    expected: Expected
    explanations: Sequence[Explanation]
    simulates: bool

    @property
    def plant(self) -> Plant:
        return self.facts.nominal_plant

    def diagnosis(self, name: str) -> Diagnosis:
        recording, best = self.recording, self.explanations[0]
        states = np.concatenate([recording.q, recording.dq], axis=1)
        # Where the wiring or a zero is wrong, what was measured is not how the run went.
        angles, rates = (part @ best.suspect.angles.T for part in (recording.q, recording.dq))
        true = np.concatenate([angles - best.z[[INDEX["offset1"], INDEX["offset2"]]], rates], axis=1)
        tip = self._tip(recording.time, true)
        share, notes = self._own_share(states), list(recording.warnings)
        own = share >= OWN_SHARE
        if not own:
            notes.append(
                f"only {share:.0%} of the first torques are those that {name} gives for its states: is it the "
                "log's policy, and does the firmware pass [q1, q2, dq1, dq2] in rad and rad/s?"
            )
        causes = [] if tip.failure is None else self._causes(tip, self.simulates and own)
        return Diagnosis(
            recording=recording,
            robot=self.robot,
            policy=name,
            failure=tip.failure,
            own=own,
            loop=self._loop(states),
            causes=causes,
            differences=self._differences(),
            blind=self._blind(),
            notes=notes,
        )

    def _causes(self, tip: TipHistory, simulate: bool) -> list[Cause]:
        nothing = next((each for each in self.explanations if each.suspect is NOTHING), None)
        least = -math.inf if nothing is None else nothing.evidence
        shown = [each for each in self.explanations if each.suspect is not NOTHING and each.evidence > least][:3]
        found = []
        for place, each in enumerate(shown):
            rivals = [other.evidence for other in self.explanations if other is not each]
            margin = each.evidence - max(rivals, default=-math.inf)
            sure = "certain" if margin > DECISIVE else "likely" if margin > LIKELY else "possible"
            cause = Cause(
                each.suspect.cause,
                _with_values(each, self.expected),
                _odds(each, nothing),
                sure,
                REMEDIES[each.suspect.cause],
            )
            found.append(
                self._simulated(cause, each, tip) if place == 0 and simulate and sure != "possible" else cause
            )
        return [*self._other_rate(tip, simulate), *self._play(), *found]

    def _play(self) -> list[Cause]:
        """The elbow's play as a cause, which shows in the angles alone."""
        shoulder, elbow = roughness(self.recording).tolist()
        floor = 0.3 * max(PLAY, self.recording.quantum[1])
        if self.recording.period > PLAY_PERIOD or elbow < PLAY or elbow < PLAY_RATIO * max(shoulder, floor):
            return []
        text = "the elbow's encoder moves in jerks that no stiff arm makes: play, or a soft coupling, at its motor"
        evidence = (
            f"its angle departs from smooth motion within 20 ms by {1e3 * elbow:.2g} mrad (RMS), the shoulder's by "
            f"{1e3 * shoulder:.2g}"
        )
        return [Cause("play", text, evidence, "likely", REMEDIES["play"])]

    def _other_rate(self, tip: TipHistory, simulate: bool) -> list[Cause]:
        """The rate as a cause, which the clock shows."""
        wanted = self.guard.dt
        if abs(self.recording.period / wanted - 1.0) <= OTHER_RATE:
            return []
        text = (
            f"the controller is called every {1e3 * self.recording.period:.3g} ms, not every {1e3 * wanted:.3g} ms"
        )
        cause = Cause(
            "rate", text, f"median of {len(self.recording.time) - 1} periods", "certain", REMEDIES["rate"]
        )
        if not simulate:
            return [cause]
        z = self.expected.centre
        return [
            self._compared(cause, tip, self._run(NOTHING, z, self.recording.period), self._run(NOTHING, z, wanted))
        ]

    def _simulated(self, cause: Cause, found: Explanation, tip: TipHistory) -> Cause:
        without = found.z.copy()
        freed = [INDEX[name] for name in found.suspect.free]
        without[freed] = self.expected.centre[freed]
        runs = (self._run(found.suspect, found.z), self._run(NOTHING, without))
        return self._compared(cause, tip, *runs)

    def _compared(self, cause: Cause, tip: TipHistory, having: TipHistory, lacking: TipHistory) -> Cause:
        fails = "succeeds" if having.failure is None else f"fails ({having.failure})"
        alike = ", as the log" if having.failure and having.cause == tip.cause else ""
        rest = "succeeds" if lacking.failure is None else f"fails too ({lacking.failure})"
        text = f"simulated with it, the policy {fails}{alike}; without it, it {rest}"
        return replace(cause, counterfactual=text, confirmed=bool(having.failure) and lacking.failure is None)

    def _run(self, suspect: Suspect, z: np.ndarray, period: float | None = None) -> TipHistory:
        """A simulated run of the policy, wired as the suspect says, with the plant and the loop of z."""
        p = dict(zip(NAMES, z.tolist(), strict=True))
        plant = representative(
            dict(zip(BASE_NAMES, np.maximum(self.expected.base(z), 0.0).tolist(), strict=True)), self.plant
        )
        limits = [limit * (1.0 - p["lost"]) for limit in self.expected.limits]
        plant = plant.changed(tl1=limits[0], tl2=limits[1])
        dt = self.recording.period if period is None else period
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
        effects = Effects(
            drive=True, sensors=True, differences=seen["velocities"] == "differences", loads=True, sag=True
        )
        none = np.zeros((2, 1))
        pushes = Pushes(none, none + 1.0, none)
        disturbance = Disturbance(loop, delay, pushes, np.zeros(2, np.uint32), effects)
        scenario = Scenario(plant, disturbance, substeps=stable_substeps(plant, dt))
        steps = int(min(self.recording.duration, MAX_DURATION) / dt)
        controller = PythonController(_Wired(numpy_controller(self.policy, guard=self.guard), suspect))
        with jax.enable_x64(True):
            rows = run_one(controller, jax.tree.map(np.asarray, scenario), dt, steps, delay + 2)
        good = np.isfinite(rows.x).all(axis=1)
        return self._tip(rows.time[good], rows.x[good])

    def _tip(self, time: np.ndarray, states: np.ndarray) -> TipHistory:
        hold = HOLD if time[-1] > 2.0 * HOLD else None
        board: SwingUpBoard = replace(HARDWARE, duration=float(time[-1]), limits=None, hold=hold)
        return follow_tip(time, states, float(self.plant.l1), float(self.plant.l2), board)

    def _own_share(self, states: np.ndarray) -> float:
        """Share of the first calls in which the policy gives the log's torque for the log's state."""
        controller, joint = numpy_controller(self.policy, guard=self.guard), self.robot.joint
        limit, alike = self.policy.torque_limits[joint], []
        for t, x, u in zip(self.recording.time, states, self.recording.u, strict=True):
            own = controller(x, float(t))[joint]
            # What comes after a stop is the robot's, with a guard or without.
            if t > REPLAYED or controller.fault is not None:
                break
            alike.append(abs(own - u[joint]) < ALIKE * limit)
        return float(np.mean(alike)) if alike else 1.0

    def _fault(self, states: np.ndarray) -> Fault | None:
        """What the policy's guard stops on, at the log's rows."""
        policy, joint = self.policy, self.robot.joint
        watch = WiringWatch(policy.plant, joint, policy.torque_limits[joint], policy.period)
        guard = Guard(self.guard, joint, policy.torque_limits, watch)
        for t, x, u in zip(self.recording.time, states, self.recording.u, strict=True):
            if not guard.accepts_measurement(float(t), x):
                return guard.fault
            guard.limit_torques(u)
        return None

    def _loop(self, states: np.ndarray) -> dict[str, str]:
        """Facts of the loop."""
        recording, joint = self.recording, self.robot.joint
        periods, best = np.diff(recording.time), self.explanations[0]
        late = float(np.mean(periods > LATE * recording.period))
        saturated = float(np.mean(np.abs(recording.u[:, joint]) >= SATURATED * self.policy.torque_limits[joint]))
        place = INDEX["delay"]
        fault = self._fault(states)
        return {
            "Period": f"{1e3 * recording.period:.3g} ms (the policy's: {1e3 * self.guard.dt:.3g} ms)",
            "Late calls": f"{late:.1%} take more than {LATE:g} periods, the longest {1e3 * periods.max():.3g} ms",
            "From measurement to torque": f"{1e3 * best.z[place]:.2g} ± {1e3 * best.sigma[place]:.1g} ms "
            f"(expected: {1e3 * self.expected.centre[place]:.2g} ms)",
            "Saturated calls": f"{saturated:.0%} at the limit of {self.policy.torque_limits[joint]:g} N m",
            "Guard": "does not stop it" if fault is None else str(fault),
        }

    def _differences(self) -> list[tuple[str, str, str, str]]:
        """What differs from the assumed plant and loop by more than ordinary."""
        best, expected, rows = self.explanations[0], self.expected, []
        for name, place in INDEX.items():
            spread = math.hypot(expected.ordinary[place], best.sigma[place])
            distance = (best.z[place] - expected.centre[place]) / max(spread, 1e-12)
            if abs(distance) > NOTABLE:
                found = f"{best.z[place]:.3g} ± {best.sigma[place]:.1g} {UNITS[name]}".rstrip()
                rows.append((name, f"{expected.centre[place]:.3g}", found, f"{distance:+.1f}"))
        return rows

    def _blind(self) -> list[str]:
        """Causes whose entries the log leaves open."""
        free = self.expected.free
        return [
            each.suspect.cause
            for each in self.explanations
            if each.suspect.free
            and all(each.sigma[INDEX[name]] > OPEN * free[INDEX[name]] for name in each.suspect.free)
        ]


class _Wired:
    """A controller whose encoders and motors are wired as a suspect says."""

    def __init__(self, controller: Any, suspect: Suspect) -> None:
        self._controller, self._angles, self._torques = controller, suspect.angles.T, suspect.torques

    def reset(self) -> None:
        self._controller.reset()

    def __call__(self, x: np.ndarray, t: float) -> np.ndarray:
        u: np.ndarray = self._torques @ self._controller(
            np.concatenate([self._angles @ x[:2], self._angles @ x[2:]]), t
        )
        return u


def _with_values(found: Explanation, expected: Expected) -> str:
    values = [
        f"{name} {found.value(name):.3g} ± {found.sigma[INDEX[name]]:.1g} {UNITS[name]}".rstrip()
        + f" (assumed {expected.centre[INDEX[name]]:.3g})"
        for name in found.suspect.free
    ]
    return f"{found.suspect.text}{': ' if values else ''}{', '.join(values)}"


def _odds(found: Explanation, nothing: Explanation | None) -> str:
    size = 1e3 * np.median(np.abs(found.errors))
    errors = f"with it, changes of velocity over 0.1 s are explained to {size:.2g} mrad/s (median)"
    if nothing is None:
        return f"{errors}; without it, nothing like it"
    before = 1e3 * np.median(np.abs(nothing.errors))
    return f"{errors}, without it to {before:.2g}; log odds {found.evidence - nothing.evidence:.0f}"
