"""What a user should know of an identification: what the logs leave open and why, in one line each."""

from collections.abc import Sequence

from .fit.estimate import Problem
from .fit.model import MASSES
from .log.recording import Recording
from .results import DEAD_TIME, NARROW, OFFSET_SIZE, TITLES, Estimates

FEW_WINDOWS = 10


def make_notes(
    recordings: Sequence[Recording], problem: Problem, estimates: Estimates, fitted: int, judged: int
) -> tuple[str, ...]:
    """Warnings of the logs, and what the fit leaves open.

    Args:
        recordings: all logs.
        problem: of the fit.
        estimates: its estimates.
        fitted: number of windows of the fit.
        judged: number of held-out windows.
    """
    notes = [warning for recording in recordings for warning in recording.warnings]
    if fitted < FEW_WINDOWS:
        notes.append(f"only {fitted} windows have a joint faster than 1 rad/s: the logs determine next to nothing")
    if not judged:
        notes.append("no held-out window has a joint faster than 1 rad/s: there are no errors to report")
    notes.append("of masses and centres of mass, motion tells m1 r1 + m2 l1, m2 r2 and I1 + m2 l1^2 alone")
    notes.append(_scale(problem))
    delay, lag, total = (estimates.determined.get(name, False) for name in ("delay", "lag", DEAD_TIME))
    if total and not (delay and lag):
        notes.append("of delay and lag the logs determine the sum, not the parts")
    unknown = [name for name, sure in estimates.determined.items() if not sure and name in estimates.intervals]
    if unknown:
        limits = f"{100 * NARROW:g} % of the value, or {1e3 * NARROW * OFFSET_SIZE:g} mrad of an offset"
        notes.append(f"not determined (interval wider than {limits}): {', '.join(unknown)}")
    return tuple(notes)


def _scale(problem: Problem) -> str:
    if problem.knows_mass:
        masses = ", ".join(TITLES.get(name, name) for name in MASSES if name in problem.known)
        return f"the known {masses} fixes the scale"
    if problem.has_scale and "gain1" in problem.known:
        return "the known torque gain fixes the scale of masses, inertias and frictions"
    if problem.has_scale:
        return (
            "masses, inertias and frictions are relative to the torque: if the motors deliver less than the log "
            "says, all are smaller by that factor (fix one scale with --known)"
        )
    return (
        "free fall determines ratios alone: m1 r1 + m2 l1 is the starting plant's (fix one scale with --known, or "
        "add a log with torques)"
    )
