"""Results as text: lines for one, and tables for people, JSON, CSV or Markdown."""

import csv
import html
import io
import json
import re
from collections.abc import Callable, Iterator, Sequence
from statistics import median

from ..benchmark.board import CAUSES, Result
from ..benchmark.leaderboard import ON_ROBOT, OURS, Table
from ..benchmark.values import COLUMNS
from ..common.errors import one_line, printable
from ..controllers.interface import layers
from ..controllers.registry import has_estimator
from ..controllers.stack.policy import PolicyController
from ..controllers.stack.regulator import RegulatingController
from ..plant.plant import LEADERBOARD, Plant, torque_over_gravity
from ..policy.shipped import is_policy
from ..report.log_report import Part
from .output import tell, tell_table


def plant_note(plant: Plant, robot: str) -> str:
    """What a result's headline says of its plant; nothing of the leaderboards'."""
    if plant == LEADERBOARD:
        return ""
    return f", plant {plant}, torque/gravity {torque_over_gravity(plant.driven(robot)):.2f}"


def judged_name(name: str, controller: object) -> str:
    """A controller's name, with a note on what was judged: with an estimator or without, or a policy alone."""
    if has_estimator(controller):
        return f"{name}, with estimator"
    if any(isinstance(layer, RegulatingController) for layer in layers(controller)):
        return f"{name}, without estimator"
    return name + (", policy alone" if isinstance(controller, PolicyController) else "")


def aligned(title: str, value: str, extra: str = "") -> str:
    """One row of a result: its title, its value, and a remark in brackets."""
    return f"  {title:<26}{value:>12}{f'   ({extra})' if extra else ''}"


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
    "no swing-up": "check the plant with a log: swingup compare LOG --plant FILE",
    "beyond a limit": "set a guard's limit: swingup export --velocity-limit",
    "fell": "identify friction and delay from more logs; the passive joint's dry friction fells most",
    "up late": "watch one: --seed SEED --seeds 1 --save run.csv; then as for runs without a swing-up",
    "stopped": "read the reason; swingup export --velocity-limit sets a guard's, --no-guard leaves the guard out",
}
"""Advice for each of a failure's causes."""
REFINED, REFINE = (
    ("no swing-up", "beyond a limit"),
    "; swingup refine ROBOT --recipe adapt --plant FILE --out FILE",
)
"""Causes against which a policy can be refined, and the advice."""
MAX_SHOWN_SEEDS = 8
"""Seeds of failures that a line names."""


def _failures(result: Result) -> Iterator[str]:
    """How many runs failed for each cause, at which seeds, the first of them in words, and what to try."""
    if len(result.seeds) != len(result.runs):
        return
    failed = [(seed, run.tip) for seed, run in zip(result.seeds, result.runs, strict=True) if not run.success]
    for cause in CAUSES:
        those = [(seed, tip.failure) for seed, tip in failed if tip is not None and tip.cause == cause]
        if those:
            seeds = ", ".join(str(seed) for seed, _ in those[:MAX_SHOWN_SEEDS])
            more = ", ..." if len(those) > MAX_SHOWN_SEEDS else ""
            if len(result.runs) > 1:  # a single run's failure stands beside its success
                yield f"  {len(those)} failed, {cause} (seed {seeds}{more}): {those[0][1]}"
            refine = REFINE if cause in REFINED and is_policy(result.controller) else ""
            yield f"    try: {WHAT_TO_TRY[cause]}{refine}"


def _runs(result: Result) -> Iterator[tuple[str, str, str]]:
    """What single runs show: title, value, remark."""
    runs, times = result.runs, [run.criteria.swingup_time for run in result.runs if run.criteria]
    known = [time for time in times if time is not None]
    if len(runs) == 1 and runs[0].tip is not None:
        yield "Highest tip [m]", f"{runs[0].tip.highest:.3f}", f"{runs[0].tip.percent:.1f} % of l1 + l2"
    if len(runs) > 1 and known:
        yield "Median of the successes", COLUMNS["swingup_time"].show(median(known)), "swing-up time [s]"
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
        took, longest = result.call_time, result.call_time.longest
        more = (
            "" if longest == took.median else f"; 99 % {1000 * took.percentile:.3g}, longest {1000 * longest:.3g}"
        )
        yield "One call [ms]", f"{1000 * took.median:.3g}", f"on this machine{more}"
    if result.rate is not None:
        yield "Rate of the log [Hz]", f"{result.rate:.4g}", ""


def comparison_lines(table: Table, trained: str) -> list[str]:
    """A performance table in short lines, the score first, with a mark at the policy that was trained just now."""
    origin = {OURS: "shipped", "paper": "published, paper", "board": "published, public leaderboard"}
    heading = f"{'score':>9}{'up after':>12}{'energy':>12}   controller"
    lines = [f"One swing-up of 10 s of the {table.robot} (board {table.board}); 1 is perfect", "", heading]
    for row in table.rows:
        score, time, energy = (COLUMNS[name].show(row.values[name]) for name in ("score", "swingup_time", "energy"))
        mine = row.controller == trained and row.source == OURS
        of = row.remark or "trained just now" if mine else origin[row.source]
        lines.append(f"{'>' if mine else '':<3}{score:>6}{time:>10} s{energy:>10} J   {row.controller} ({of})")
    return lines


def show_tables(tables: Sequence[Table]) -> None:
    """Print tables for people."""
    for table in tables:
        headings = ["Controller", "Source", *(COLUMNS[name].heading for name in table.columns)]
        ours = [index for index, row in enumerate(table.rows) if row.source == OURS]
        tell_table(headings, _rows(table), texts=2, title=_title(table), bold=ours)
        tell(*_remarks(table))


def show_parts(parts: Sequence[Part], notes: Sequence[str]) -> None:
    """Print the tables of a report about logs, and its notes."""
    for part in parts:
        for table in part.tables:
            tell_table(table.heads, table.rows, title=part.title)
    tell(*notes)


def tables_as_csv(tables: Sequence[Table]) -> str:
    """One table for all boards, with the columns of each."""
    rows = [row for table in tables for row in table.as_dicts()]
    columns = list(dict.fromkeys(name for row in rows for name in row if name != "remark"))
    text = io.StringIO()
    writer = csv.DictWriter(text, [*columns, "remark"], lineterminator="\n")
    writer.writeheader()

    def cell(value: object) -> object:
        # Line ends in a name are quoted; escape sequences would reach the terminal that shows the table.
        return "\n".join(map(printable, value.split("\n"))) if isinstance(value, str) else value

    writer.writerows({name: cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue().rstrip("\n")


TABLE_FORMATS: dict[str, Callable[[Sequence[Table]], str]] = {
    "json": lambda tables: json.dumps([row for table in tables for row in table.as_dicts()], indent=2),
    "csv": tables_as_csv,
    "markdown": lambda tables: "\n\n".join(map(_markdown, tables)),
}
"""Texts of several tables: one list of rows, one table with the columns of all, or a table each."""


def _markdown(table: Table) -> str:
    def line(cells: Sequence[str], mark: str = "") -> str:
        return "| " + " | ".join(f"{mark}{_markdown_text(text)}{mark}" for text in cells) + " |"

    heads = ["Controller", "Source", *(COLUMNS[name].title for name in table.columns)]
    rule = "|---|---|" + "---:|" * len(table.columns)
    rows = [line(cells, "**" if cells[1] == OURS else "") for cells in _rows(table)]
    remarks = [f"\n{_markdown_text(remark)}" for remark in _remarks(table)]
    return "\n".join([f"### {_title(table)}\n", line(heads), rule, *rows, *remarks])


def _markdown_text(text: str) -> str:
    """Text in one line, which may be cut, that Markdown and HTML show as it is."""
    return re.sub(r"([\\`*_|\[\]])", r"\\\1", html.escape(one_line(text, 1000), quote=False))


def _rows(table: Table) -> list[list[str]]:
    shown = [[COLUMNS[name].show(row.values[name]) for name in table.columns] for row in table.rows]
    return [[row.controller, row.source, *cells] for row, cells in zip(table.rows, shown, strict=True)]


def _remarks(table: Table) -> list[str]:
    remarks = [f"{row.controller}: {row.remark}" for row in table.rows if row.remark]
    if any(row.source == ON_ROBOT for row in table.rows):
        remarks.append(f"Rows of source {ON_ROBOT!r} were measured on the real robot; ours are simulated.")
    return remarks if table.note is None else [*remarks, table.note]


def _title(table: Table) -> str:
    seed = "" if table.seed is None else f", seed {table.seed}"
    return f"Board {table.board}, {table.robot}{seed}{plant_note(table.plant, table.robot)}"
