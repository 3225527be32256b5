"""Why a run failed on the robot: what its log shows of wiring, loop and plant, and simulations of what it shows.

``identification/causes.py`` weighs the causes by the log's motion; the clock shows another rate. The policy is then
simulated with the likeliest cause, and without it: with all else that the log shows. A cause is named if the run
failed and the log shows it clearly; simulations say whether the policy bears it.
"""

import contextlib
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..common.errors import SwingupError
from ..identification.causes import INDEX, NOTHING, Expected, Explanation, expected_of, explain, roughness
from ..identification.prediction import integration_of
from ..identification.recording import Recording, read_recording
from ..loop.domain import Domain
from ..loop.resolve import resolve
from ..plant.base_parameters import BASE, base_parameters
from ..plant.plant import ZEROS, PlantLike, Robot, get_robot
from ..policy.feedback import load_robot_policy
from ..policy.guard import choose_guard
from ..policy.shipped import SHIPPED_POLICIES
from .board import TipHistory
from .logged_run import LoggedRun
from .recording import driven_robot

DECISIVE, LIKELY = 10.0, 3.0  # Differences of log evidence from which a cause is sure, and likely
OTHER_RATE = 0.2  # Share by which a period differs from the policy's to be a cause
OWN_SHARE = 0.7  # Share of calls that must be alike for the log to be the policy's
DELAY = 0.006  # Dead time of a loop that says nothing of its own (s)
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
        return "this log shows nothing wrong"

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
        policy: the file of a policy or of a feedback law, or the name of a shipped policy.
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
        robot = load_robot_policy(policy).robot
    driven = driven_robot(recording.name, recording.u) if robot is None else get_robot(robot)
    found = load_robot_policy(policy, driven)
    facts = resolve(found.plant if plant is None else plant, domain)
    # The policy subtracts its plant's zeros: what is left of them is what may be wrong.
    recording = replace(recording, q=recording.q - found.plant.zeros)
    found = replace(found, plant=found.plant.changed(**ZEROS))
    low, high = (end._replace(plant=end.plant.changed(**ZEROS)) for end in (facts.low, facts.high))
    facts = replace(facts, low=low, high=high)
    guard = choose_guard(True, found.guard, found.period, found.plant)
    assert guard is not None
    slower = 0.0 if found.period is None else recording.period - guard.dt
    expected = _expected(facts, slower)
    explanations = explain(recording, integration_of(facts.nominal_plant), expected)
    run, best, name = LoggedRun(recording, driven, found, guard, facts, expected), explanations[0], str(policy)
    # Where the wiring or a zero is wrong, what was measured is not how the run went.
    angles, rates = (part @ best.suspect.angles.T for part in (recording.q, recording.dq))
    angles = angles - best.z[[INDEX["offset1"], INDEX["offset2"]]]
    tip = run.tip(recording.time, np.concatenate([angles, rates], axis=1))
    share, notes = run.own_share(), list(recording.warnings)
    own = share >= OWN_SHARE
    if not own:
        notes.append(
            f"only {share:.0%} of the first torques are those that {name} gives for its states: is it the "
            "log's policy, and does the firmware pass [q1, q2, dq1, dq2] in rad and rad/s?"
        )
    causes = [] if tip.failure is None else _causes(run, explanations, tip, simulate and own)
    rows, open_causes = _differences(best, expected), _blind(explanations, expected)
    return Diagnosis(recording, driven, name, tip.failure, own, run.loop(best), causes, rows, open_causes, notes)


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
    entries = {"offset1": "offset1", "offset2": "offset2", "gain1": "gain", "delay": "delay", "lag": "delay"}
    for name, entry in entries.items():
        if name in facts.names:
            ordinary[INDEX[entry]] += 0.25 * (facts.high.value(name) - facts.low.value(name))
        if name in facts.names and entry != "delay":
            centre[INDEX[entry]] = facts.nominal.value(name)
    return replace(expected, centre=centre, ordinary=ordinary)


def _causes(run: LoggedRun, explanations: Sequence[Explanation], tip: TipHistory, simulate: bool) -> list[Cause]:
    """The causes of a run that went so, likeliest first."""
    nothing = next((each for each in explanations if each.suspect is NOTHING), None)
    least = -math.inf if nothing is None else nothing.evidence
    shown = [each for each in explanations if each.suspect is not NOTHING and each.evidence > least][:3]
    found = []
    for place, each in enumerate(shown):
        rivals = [other.evidence for other in explanations if other is not each]
        margin = each.evidence - max(rivals, default=-math.inf)
        sure = "certain" if margin > DECISIVE else "likely" if margin > LIKELY else "possible"
        name, text = each.suspect.cause, _with_values(each, run.expected)
        cause = Cause(name, text, _odds(each, nothing), sure, REMEDIES[name])
        if place == 0 and simulate and sure != "possible":
            freed = [INDEX[name] for name in each.suspect.free]
            without, period = each.z.copy(), run.recording.period
            without[freed] = run.expected.centre[freed]
            with contextlib.suppress(SwingupError):  # A cause may be of what no pendulum has
                runs = run.simulate(each.suspect, each.z, period), run.simulate(NOTHING, without, period)
                cause = _compared(cause, tip, *runs)
        found.append(cause)
    return [*_other_rate(run, tip, simulate), *_play(run.recording), *found]


def _play(recording: Recording) -> list[Cause]:
    """The elbow's play as a cause, which shows in the angles alone."""
    shoulder, elbow = roughness(recording).tolist()
    floor = 0.3 * max(PLAY, recording.quantum[1])
    if recording.period > PLAY_PERIOD or elbow < PLAY or elbow < PLAY_RATIO * max(shoulder, floor):
        return []
    text = "the elbow's encoder moves in jerks that no stiff arm makes: play, or a soft coupling, at its motor"
    evidence = (
        f"its angle departs from smooth motion within 20 ms by {1e3 * elbow:.2g} mrad (RMS), the shoulder's by "
        f"{1e3 * shoulder:.2g}"
    )
    return [Cause("play", text, evidence, "likely", REMEDIES["play"])]


def _other_rate(run: LoggedRun, tip: TipHistory, simulate: bool) -> list[Cause]:
    """The rate as a cause, which the clock shows."""
    found, wanted, z = run.recording.period, run.guard.dt, run.expected.centre
    # A law without an estimator is for any rate.
    if run.policy.period is None or abs(found / wanted - 1.0) <= OTHER_RATE:
        return []
    text = f"the controller is called every {1e3 * found:.3g} ms, not every {1e3 * wanted:.3g} ms"
    evidence = f"median of {len(run.recording.time) - 1} periods"
    cause = Cause("rate", text, evidence, "certain", REMEDIES["rate"])
    if simulate:
        cause = _compared(cause, tip, run.simulate(NOTHING, z, found), run.simulate(NOTHING, z, wanted))
    return [cause]


def _compared(cause: Cause, tip: TipHistory, having: TipHistory, lacking: TipHistory) -> Cause:
    """The cause with what simulations with and without it do."""
    fails = "succeeds" if having.failure is None else f"fails ({having.failure})"
    alike = ", as the log" if having.failure and having.cause == tip.cause else ""
    rest = "succeeds" if lacking.failure is None else f"fails too ({lacking.failure})"
    text = f"simulated with it, the policy {fails}{alike}; without it, it {rest}"
    return replace(cause, counterfactual=text, confirmed=bool(having.failure) and lacking.failure is None)


def _differences(best: Explanation, expected: Expected) -> list[tuple[str, str, str, str]]:
    """What differs from the assumed plant and loop by more than ordinary."""
    rows = []
    for name, place in INDEX.items():
        spread = math.hypot(expected.ordinary[place], best.sigma[place])
        distance = (best.z[place] - expected.centre[place]) / max(spread, 1e-12)
        if abs(distance) > NOTABLE:
            rows.append((name, f"{expected.centre[place]:.3g}", best.text(name), f"{distance:+.1f}"))
    return rows


def _blind(explanations: Sequence[Explanation], expected: Expected) -> list[str]:
    """Causes whose entries the log leaves open."""

    def is_open(each: Explanation) -> bool:
        places = [INDEX[name] for name in each.suspect.free]
        return bool(places) and bool(np.all(each.sigma[places] > OPEN * expected.free[places]))

    return [each.suspect.cause for each in explanations if is_open(each)]


def _with_values(found: Explanation, expected: Expected) -> str:
    values = [
        f"{name} {found.text(name)} (assumed {expected.centre[INDEX[name]]:.3g})" for name in found.suspect.free
    ]
    return f"{found.suspect.text}{': ' if values else ''}{', '.join(values)}"


def _odds(found: Explanation, nothing: Explanation | None) -> str:
    size = 1e3 * np.median(np.abs(found.errors))
    errors = f"with it, changes of velocity over 0.1 s are explained to {size:.2g} mrad/s (median)"
    if nothing is None:
        return f"{errors}; without it, nothing like it"
    before = 1e3 * np.median(np.abs(nothing.errors))
    return f"{errors}, without it to {before:.2g}; log odds {found.evidence - nothing.evidence:.0f}"
