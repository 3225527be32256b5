"""The steps of an identification, from recordings to solutions: the start's best delay, then all unknowns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..log.recording import Recording
from ..log.windows import Windows
from .fit import Data, Evaluator, Fit, Stage, fit, linearise, start_cost
from .model import MASSES, SHARED, Unknowns, expectations, make_unknowns
from .prediction import INDEX, Setting
from .regression import Spans, cut_spans, regress

OFFSETS = ("offset1", "offset2")
LATENCY = ("delay", "lag")
START_STAGES = (Stage(5, 15, True),)
WARM_STAGES = (Stage(5, 10, False),)


@dataclass(frozen=True)
class Problem:
    """What all fits of an identification share."""

    setting: Setting
    start: Float[np.ndarray, "15"]
    recordings: Sequence[Recording]
    sessions: Sequence[int]
    """Of each recording."""
    known: Mapping[str, float]

    @property
    def count(self) -> int:
        """Number of sessions."""
        return max(self.sessions) + 1

    @property
    def has_scale(self) -> bool:
        """Whether torques or known values fix the common factor of masses and torques."""
        return any(any(recording.driven) for recording in self.recordings) or self.knows_mass

    @property
    def knows_mass(self) -> bool:
        """Whether the user knows a mass: then it fixes the scale, and the torque gain is free."""
        return any(name in self.known for name in MASSES)

    def data(self, windows: Windows) -> Data:
        """Windows with the session of each."""
        return Data(windows, np.asarray(self.sessions, int)[windows.log])

    def driven(self, session: int) -> bool:
        """Whether a torque acts in a session."""
        return any(any(r.driven) for r, s in zip(self.recordings, self.sessions, strict=True) if s == session)

    def unknowns(self, plant: bool) -> Unknowns:
        """All unknowns, or those of the loop alone, with the plant as it is."""
        free = [self._free(session, plant) for session in range(self.count)]
        commanded = [
            all(
                r.commanded or not any(r.driven)
                for r, s in zip(self.recordings, self.sessions, strict=True)
                if s == k
            )
            for k in range(self.count)
        ]
        expected = [expectations(self.setting, self.start, each) for each in commanded]
        known = self.known if plant else {name: value for name, value in self.known.items() if name in LATENCY}
        return make_unknowns(expected, self.start, free, known)

    def _free(self, session: int, plant: bool) -> list[str]:
        driven = self.driven(session)
        loop = [name for name in LATENCY if driven]
        if not plant:
            return loop
        # Without torques, one base parameter stands for the common factor of all.
        base = [name for name in SHARED if name != "k" or self.has_scale]
        gain = driven and (session > 0 or self.knows_mass)
        return [*base, *OFFSETS, *(["gain1"] if gain else []), *loop]


def fit_start(problem: Problem, windows: Windows) -> Float[np.ndarray, "sessions 15"]:
    """The starting plant with the delay and lag that predict best."""
    unknowns = problem.unknowns(plant=False)
    zero = np.clip(np.zeros(len(unknowns.names)), unknowns.low, unknowns.high)
    if not len(windows) or not unknowns.names:
        return unknowns.models(zero)
    return fit(problem.setting, problem.data(windows), unknowns, zero, START_STAGES).models


def fit_all(problem: Problem, windows: Windows, start: Float[np.ndarray, "sessions 15"]) -> Fit:
    """All unknowns, from the better of the starting plant and the linear regression."""
    unknowns, data = problem.unknowns(plant=True), problem.data(windows)
    if not len(windows):
        zero = np.clip(0.0 * unknowns.scale, unknowns.low, unknowns.high)
        return linearise(Evaluator(problem.setting, data, unknowns), zero)
    candidates = [unknowns.position(models) for models in (start, _regressed(problem, start))]
    evaluate = Evaluator(problem.setting.coarse, data, unknowns)
    costs = [start_cost(evaluate, z) for z in candidates]
    return fit(problem.setting, data, unknowns, candidates[int(np.argmin(costs))])


def refit(problem: Problem, windows: Windows, before: Fit) -> Fit:
    """The same with more windows, from a solution."""
    return fit(problem.setting, problem.data(windows), before.unknowns, before.z, WARM_STAGES)


def _regressed(problem: Problem, models: np.ndarray) -> np.ndarray:
    """The start's models with the plant that linear least squares find."""
    parts = [cut_spans(recording) for recording in problem.recordings]
    spans = Spans(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("states", "impulse")))
    if not len(spans.states):
        return models
    found = regress(problem.setting, spans, problem.start, any(any(r.driven) for r in problem.recordings))
    changed = models.copy()
    for name, value in found.values.items():
        changed[:, INDEX[name]] = value
    return changed
