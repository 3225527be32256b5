"""Results as lines of text, the same for every board."""

from collections.abc import Iterator
from statistics import median

from ..benchmark.columns import COLUMNS
from ..benchmark.criteria import CAUSES
from ..benchmark.leaderboard import OURS, Table
from ..benchmark.result import Result
from .arguments import plant_note
from .output import aligned


def result_lines(result: Result, judged: str) -> list[str]:
    """Successes, the board's values with their intervals, what else the runs show, and warnings."""
    drawn = "" if result.domain is None else f", domain {result.domain.name}"
    seeds = f", seed {result.seeds[0]}" if result.seeds else ""
    seeds += f" to {result.seeds[-1]}" if len(result.seeds) > 1 else ""
    plant = plant_note(result.plant, result.robot)
    values = []
    for name, value in result.values.items():
        column, interval = COLUMNS[name], result.intervals.get(name)
        extra = " to ".join(column.show(end) for end in interval) if interval else ""
        values.append(aligned(column.title, column.show(value), extra))
    return [
        f"{result.robot}, {judged} (board {result.board}{drawn}{seeds}{plant})",
        aligned("Success", *_success(result)),
        *values,
        *(aligned(*row) for row in _runs(result)),
        *_failures(result),
        *(f"  warning: {each}" for each in result.warnings),
        *([] if result.note is None else [f"  {result.note}"]),
    ]


def _success(result: Result) -> tuple[str, str]:
    number = len(result.runs)
    if number == 1:
        tip = result.runs[0].tip
        return ("yes" if result.successes else "no"), (tip.failure or "") if tip else ""
    low, high = result.success_interval
    return f"{result.successes} of {number}", f"{low:.0%} to {high:.0%}"


WHAT_TO_TRY = {
    "never up": "swingup compare your log with the plant; swingup refine --recipe adapt --domain FILE",
    "beyond a limit": "swingup refine --recipe adapt --domain FILE; swingup export --velocity-limit sets a guard's",
    "fell": "identify friction and delay from more logs; the passive joint's dry friction fells most",
    "up late": "watch one: --seed SEED --seeds 1 --save run.csv; then as for runs that are never up",
    "stopped": "read the reason; limits and patience of a guard are options of swingup export",
}
"""Advice for each of a failure's causes."""
MOST_SEEDS = 8
"""Seeds of failures that a line names."""


def _failures(result: Result) -> Iterator[str]:
    """How many runs failed for each cause, at which seeds, the first of them in words, and what to try."""
    if len(result.runs) < 2 or len(result.seeds) != len(result.runs):
        return
    failed = [(seed, run.tip) for seed, run in zip(result.seeds, result.runs, strict=True) if not run.success]
    for cause in CAUSES:
        those = [(seed, tip.failure) for seed, tip in failed if tip is not None and tip.cause == cause]
        if those:
            seeds = ", ".join(str(seed) for seed, _ in those[:MOST_SEEDS])
            more = ", ..." if len(those) > MOST_SEEDS else ""
            yield f"  {len(those)} failed, {cause} (seed {seeds}{more}): {those[0][1]}"
            yield f"    try: {WHAT_TO_TRY[cause]}"


def _runs(result: Result) -> Iterator[tuple[str, str, str]]:
    """What single runs show: title, value, remark."""
    runs, times = result.runs, [run.criteria.swingup_time for run in result.runs if run.criteria]
    known = [time for time in times if time is not None]
    if len(runs) == 1 and runs[0].tip is not None:
        yield "Highest tip [m]", f"{runs[0].tip.highest:.3f}", f"{runs[0].tip.percent:.1f} % of l1 + l2"
    if len(runs) > 1 and times:
        middle = COLUMNS["swingup_time"].show(median(known) if known else None)
        yield "Swing-up time [s]", middle, "median of the successes"
    for title, name in (("Largest speed [rad/s]", "speed"), ("Largest angle [rad]", "angle")):
        values = [value for run in runs if (value := getattr(run, name)) is not None]
        if result.domain is not None and values:
            yield title, f"{max(values):.1f}", ""
    if result.domain is not None:
        stopped = sum(run.stop is not None for run in runs)
        yield "Stopped by the robot", f"{stopped} of {len(runs)}", ""
    if result.faults:
        yield "Without an answer", f"{len(result.faults)} of {len(runs)}", f"the first: {result.faults[0].fault}"
    if result.call_time is not None:
        yield "One call [ms]", f"{1000 * result.call_time:.3g}", "on this machine"
    if result.rate is not None:
        yield "Rate of the log [Hz]", f"{result.rate:.4g}", ""


def comparison_lines(table: Table, trained: str) -> list[str]:
    """A performance table in short lines, the score first, with a mark at the policy that was trained just now."""
    origin = {OURS: "shipped", "paper": "published, paper", "board": "published, public leaderboard"}
    lines = [f"One swing-up of 10 s of the {table.robot} (board {table.board}); 1 is perfect", ""]
    lines.append(f"{'score':>9}{'up after':>12}{'energy':>12}   controller")
    for row in table.rows:
        time, energy = (COLUMNS[name].show(row.values[name]) for name in ("swingup_time", "energy"))
        mine = row.controller == trained and row.source == OURS
        of = row.remark or "trained just now" if mine else origin[row.source]
        score = COLUMNS["score"].show(row.values["score"])
        mark = ">" if mine else ""
        lines.append(f"{mark:<3}{score:>6}{time:>10} s{energy:>10} J   {row.controller} ({of})")
    return lines
