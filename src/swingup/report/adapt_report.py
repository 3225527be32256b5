"""The page about a policy that was adapted to a domain: swing-ups on draws that it never saw."""

import numpy as np

from ..benchmark.columns import COLUMNS
from ..benchmark.criteria import CAUSES
from ..benchmark.result import Result
from ..loop.domain import Domain
from .figure import Curve, Figure, Panel
from .figures import TIME
from .log_report import STATES, TORQUES, LogReport, Part, Table, shown


def report_adaptation(domain: Domain, result: Result) -> LogReport:
    """Lay an adaptation to a domain out, with its result on the board ``sim2real``, on other draws."""
    low, high = result.success_interval
    lead = (
        f"A policy for the {result.robot} that finds its plant, trained on draws of {domain.name}. On "
        f"{len(result.runs)} other draws it swings up and stays {result.successes} times "
        f"({low:.0%} to {high:.0%}, 95 % interval)."
    )
    ranges = [[name, shown(a, 4), shown(b, 4)] for name, a, b in domain.ranges]
    drawn = Part("Domain", "SI units; each draw takes each number evenly.", [Table(("Name", "From", "To"), ranges)])
    return LogReport(f"Adapted {result.robot}", lead, [_judged(result), drawn])


def _judged(result: Result) -> Part:
    values = [[COLUMNS[name].title, COLUMNS[name].show(value)] for name, value in result.values.items()]
    failed = [(run.case.settings.get("seed"), run.tip) for run in result.runs if not run.success]
    rows = [
        [cause, ", ".join(str(seed) for seed, tip in failed if tip is not None and tip.cause == cause) or "–"]
        for cause in CAUSES
    ]
    figure = None
    if result.trajectory is not None:
        time, x, u = map(np.asarray, (result.trajectory.time, result.trajectory.x, result.trajectory.u))
        motion = zip((*STATES, *TORQUES), (*x.T, *u.T), strict=True)
        panels = [Panel(TIME, label, [Curve("first draw", time, values)]) for label, values in motion]
        figure = Figure(panels, shared=True)
    tables = [Table(("Board sim2real", "Value"), values), Table(("Failed", "Seeds"), rows)]
    return Part("Draws that training did not see", "The first one is drawn.", tables, figure)
