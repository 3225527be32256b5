"""Results as lines of text."""

from statistics import median

from ..benchmark.board_rows import OURS
from ..benchmark.columns import COLUMNS, PERFORMANCE
from ..benchmark.evaluate import Evaluation
from ..benchmark.leaderboard import Board
from ..benchmark.plausibility import Plausibility
from ..benchmark.recorded_uptime import RecordedUptime
from ..benchmark.robustness import Robustness
from ..benchmark.sim2real import Sim2Real
from ..benchmark.trials import Trials
from ..benchmark.uptime import Uptime
from .arguments import plant_note
from .output import aligned, to_last


def evaluation_lines(result: Evaluation, judged: str, rules: str) -> list[str]:
    """The criteria of one swing-up, how high the tip came, and why the run failed if it did."""
    disturbed = "" if result.disturbance is None else ", disturbed"
    success = "success" if result.criteria.success else "failure"
    values = [(COLUMNS[name].title, COLUMNS[name].show(getattr(result.criteria, name))) for name in PERFORMANCE]
    return [
        f"{result.robot}, {judged} (rules {rules}{disturbed}{plant_note(result.plant, result.robot)})",
        aligned("Swing-up", success, result.tip.failure or ""),
        *(aligned(title, value) for title, value in values),
        aligned("Highest tip [m]", f"{result.tip.highest:.3f}", f"{result.tip.percent:.1f} % of l1 + l2"),
    ]


def comparison_lines(board: Board, trained: str) -> list[str]:
    """A performance board in short lines, the score first, with a mark at the policy that was trained just now."""
    origin = {OURS: "shipped", "paper": "published, paper", "board": "published, public leaderboard"}
    lines = [f"One swing-up of 10 s of the {board.robot} (rules {board.rules}); 1 is perfect", ""]
    lines.append(f"{'score':>9}{'up after':>12}{'energy':>12}   controller")
    for row in board.rows:
        time, energy = (COLUMNS[name].show(row.values[name]) for name in ("swingup_time", "energy"))
        mine = row.controller == trained and row.source == OURS
        of = row.remark or "trained just now" if mine else origin[row.source]
        score = COLUMNS["score"].show(row.values["score"])
        mark = ">" if mine else ""
        lines.append(f"{mark:<3}{score:>6}{time:>10} s{energy:>10} J   {row.controller} ({of})")
    return lines


def recorded_uptime_lines(result: RecordedUptime) -> list[str]:
    """The uptime of a recording, and how high the tip came."""
    return [
        f"{result.robot}, {result.controller} (rules {result.rules}{plant_note(result.plant, result.robot)})",
        aligned("Uptime score", f"{result.uptime:.3f}", f"up for {result.time_up:.2f} s of {result.span:.2f} s"),
        aligned("Highest tip [m]", f"{result.highest_tip:.3f}", f"{result.highest_tip_percent:.1f} % of l1 + l2"),
    ]


def plausibility_lines(found: Plausibility) -> list[str]:
    """The rate of a recording, and what cannot be physics."""
    warnings = [f"  warning: {each.name}: {each.text}" for each in found.warnings]
    return [aligned("Rate of the log [Hz]", f"{found.rate:.4g}"), *warnings]


def robustness_lines(result: Robustness, judged: str) -> list[str]:
    """Percentages with their intervals, and how many simulations the controller lost."""
    plant = plant_note(result.plant, result.robot)
    head = f"{result.robot}, {judged} (rules {result.rules}, seed {_seeds(result.seeds)}{plant})"
    lines = [head]
    for name, value in {**result.percent, "overall": result.overall}.items():
        column, interval = COLUMNS[name], result.intervals.get(name)
        extra = " to ".join(column.show(end) for end in interval) if interval else ""
        lines.append(aligned(column.title, column.show(value), extra))
    lines.append(aligned("Simulations", str(len(result.results))))
    if result.faults:
        number = len(result.faults)
        lines.append(f"  {number} simulations without an answer; the first: {result.faults[0].fault}")
    return lines


def uptime_lines(result: Uptime, judged: str) -> list[str]:
    """The score, its interval, and the faults of single seeds."""
    extra = f"{result.interval[0]:.3f} to {result.interval[1]:.3f}" if result.interval else ""
    faults, plant = zip(result.seeds, result.faults, strict=True), plant_note(result.plant, result.robot)
    drawn = "" if result.domain is None else f", domain {result.domain.name}"
    lines = [
        f"{result.robot}, {judged} (rules {result.rules}{drawn}, seed {_seeds(result.seeds)}{plant})",
        aligned("Uptime score", f"{result.uptime:.3f}", extra),
    ]
    if result.domain is not None:
        stopped = [stop for stop in result.stops if stop is not None]
        lines.append(aligned("Best", f"{result.best:.3f}"))
        lines.append(aligned("Stopped by the robot", f"{len(stopped)} of {len(result.stops)}"))
    lines += [] if result.note is None else [f"  {result.note}"]
    return lines + [f"  seed {number}: {fault}" for number, fault in faults if fault]


def sim2real_lines(result: Sim2Real, judged: str) -> list[str]:
    """Successes with their interval, means and extremes, and the faults of single seeds."""
    runs = result.runs
    seeds, (low, high) = tuple(run.seed for run in runs), result.interval
    times = [run.criteria.swingup_time or 0.0 for run in runs if run.success]
    middle = COLUMNS["swingup_time"].show(median(times) if times else None)
    plant = plant_note(result.domain.plant, result.robot)
    rows = (
        ("Success", f"{result.successes} of {len(runs)}", f"{low:.0%} to {high:.0%}"),
        ("Score (rules hardware)", f"{result.score:.3f}", ""),
        ("Swing-up time [s]", middle, "median of the successes"),
        ("Largest speed [rad/s]", f"{max(run.speed for run in runs):.1f}", ""),
        ("Largest angle [rad]", f"{max(run.angle for run in runs):.1f}", ""),
    )
    return [
        f"{result.robot}, {judged} (domain {result.domain.name}, seed {_seeds(seeds)}{plant})",
        *(aligned(*row, width=12) for row in rows),
        *(f"  seed {run.seed}: {run.fault}" for run in runs if run.fault),
    ]


def trials_lines(result: Trials, judged: str) -> list[str]:
    """Successes and scores with their intervals, extremes, and the faults of single seeds."""
    runs = result.runs
    (low, high), seeds = result.success_interval, tuple(run.seed for run in runs)
    extra = f"{result.interval[0]:.3f} to {result.interval[1]:.3f}" if result.interval else ""
    stopped = sum(run.stop is not None for run in runs)
    rows = (
        ("Success", f"{result.successes} of {len(runs)}", f"{low:.0%} to {high:.0%}"),
        ("Mean score", f"{result.score:.3f}", extra),
        ("Best score", f"{result.best:.3f}", ""),
        ("Stopped by the robot", f"{stopped} of {len(runs)}", ""),
        ("Largest speed [rad/s]", f"{max(run.speed for run in runs):.1f}", ""),
    )
    drawn = f"domain {result.domain.name}, seed {_seeds(seeds)}{plant_note(result.domain.plant, result.robot)}"
    return [
        f"{result.robot}, {judged} (rules {result.rules}, {drawn})",
        *(aligned(*row, width=12) for row in rows),
        *(f"  seed {run.seed}: {run.fault}" for run in runs if run.fault),
    ]


def _seeds(seeds: tuple[int, ...]) -> str:
    return f"{seeds[0]}{to_last(seeds[0], len(seeds))}"
