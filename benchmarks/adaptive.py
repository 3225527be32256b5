"""The evidence for a controller that identifies its plant: model errors, ablations, nominal plant, errors, boards.

Usage: python benchmarks/adaptive.py ROBOT CONTROLLER.safetensors
[--section models ablations failing nominal errors boards] [--out runs/adaptive] [--seed 10] [--seeds 5]

Prints a Markdown table for each section:

- models: successes on the board's grid of model errors, on the midpoints between its values, and on joint draws of
  all parameters within half their ranges; then the cells of the grid that fail;
- ablations: the same, and the other criteria of the robustness board, with one part of the controller off;
- failing: for 20 plants that the controller does not hold, the error that the motor can bring back upright
  (``holding_range.py``), whether the same controller told the plant holds it, and the score of the plant's own
  optimal swing-up and LQR;
- nominal: adaptation on minus adaptation off on the nominal plant, in points;
- errors: errors of the base parameters against time over the joint draws, and a picture;
- boards: this controller beside the shipped ones on every board, by the boards' own functions.

ROBOT-SECTION.jsonl in the folder has the rows of each section, ROBOT-errors.png the picture. --seed and --seeds
are those of noise and pushes, but for the boards, which have their own.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from adaptive_boards import board_lines, board_rows
from adaptive_errors import TIMES, draw_errors, error_lines, error_rows, follow_errors
from adaptive_failing import failing_lines, failing_rows
from adaptive_plants import ALL, FULL, GRID, JOINT, MIDPOINTS, NOMINAL_CRITERIA, OFF, TOLD, Judge

from swingup.benchmark.boards import ROBUSTNESS
from swingup.benchmark.robustness_board import RANDOM_CRITERIA
from swingup.benchmark.values import mean_interval, share_interval
from swingup.common.errors import SwingupError
from swingup.common.files import write_atomically
from swingup.controllers.registry import get_controller
from swingup.plant.plant import ROBOTS
from swingup.policy.pendulum import read_pendulum_policy

Rows = list[dict[str, Any]]
Section = tuple[Rows, str]

SECTIONS = ("models", "ablations", "failing", "nominal", "errors", "boards")
SHIPPED = ("ar-eapo", "global")
"""Controllers that the boards compare with."""


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown, numbers to the right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def share(successes: np.ndarray) -> str:
    """A share of successes (%)."""
    return f"{100 * successes.mean():.1f}"


def models(judge: Judge) -> Section:
    """Successes on plants that are not the nominal one, and cells of the grid that fail."""
    rows: Rows = []
    for name, cases in judge.sets.items():
        settings = [{**case.settings, "plants": name} for case in cases]
        held = judge.held(FULL, name).tolist()
        rows += [{**each, "success": success} for each, success in zip(settings, held, strict=True)]
    return rows, models_text(rows)


def models_text(rows: Rows) -> str:
    """Grid and midpoints by parameter, joint draws with the interval of their share, and cells that fail."""

    def successes(plants: str, *parameters: str) -> np.ndarray:
        chosen = [row for row in rows if row["plants"] == plants and row["parameter"] in parameters]
        return np.array([row["success"] for row in chosen])

    names = list(dict.fromkeys(row["parameter"] for row in rows if row["plants"] == GRID))
    lines = [[name, share(successes(GRID, name)), share(successes(MIDPOINTS, name))] for name in names]
    grid, midpoints, joint = successes(GRID, *names), successes(MIDPOINTS, *names), successes(JOINT, ALL)
    lines.append(["**all**", f"**{share(grid)}**", f"**{share(midpoints)}**"])
    low, high = share_interval(int(joint.sum()), len(joint))
    failing = [row for row in rows if row["plants"] == GRID and not row["success"]]
    cells = ", ".join(f"{row['parameter']} = {row['value']:.3g}" for row in failing)
    texts = [
        table(["plants held (%)", GRID, MIDPOINTS], lines),
        f"Grid minus midpoints: {100 * (grid.mean() - midpoints.mean()):+.1f} points.",
        f"Joint draws: {share(joint)} % of {len(joint)} ({100 * low:.1f} to {100 * high:.1f}).",
        f"Not held on the grid ({len(failing)}): {cells or 'none'}.",
    ]
    return "\n\n".join(texts)


def ablations(judge: Judge) -> Section:
    """Every variant on every criterion."""
    rows: Rows = []
    for variant in judge.variants:
        found: dict[str, float] = {name: 100 * float(judge.held(variant, name).mean()) for name in judge.sets}
        found |= _percent(judge, variant)
        overall = fmean([found["grid"], *(found[name] for name in NOMINAL_CRITERIA)]) / 100
        rows.append({"variant": variant, **found, "overall": overall})
    names = [name for name in rows[0] if name not in ("variant", "overall")]
    lines = [[row["variant"], *(f"{row[name]:.1f}" for name in names), f"{row['overall']:.3f}"] for row in rows]
    header = ["successes (%)", *(name.replace("_", " ") for name in names), "overall (0 to 1)"]
    return rows, table(header, lines)


def failing(judge: Judge) -> Section:
    """What else holds plants that the controller does not."""
    rows = failing_rows(judge)
    nobody = ", ".join(line[0] for row, line in zip(rows, failing_lines(rows), strict=True) if not holds(row))
    header = [
        "not held",
        "the motor brings back (rad)",
        "held if told the plant",
        "held by the optimum",
        "the optimum's score",
    ]
    return rows, f"{table(header, failing_lines(rows))}\n\nHeld by neither: {nobody or 'none'}."


def holds(row: dict[str, Any]) -> bool:
    """Whether anybody holds the plant of a row."""
    return bool(row[TOLD] or row["held"])


def nominal(judge: Judge) -> Section:
    """Adaptation on against off where the plant is the nominal one, seed by seed."""
    by_seed = {variant: [_percent(judge, variant, seed) for seed in judge.seeds] for variant in (FULL, OFF)}
    rows: Rows = [
        {"criterion": name, "seed": seed, "on": on[name], "off": off[name]}
        for name in NOMINAL_CRITERIA
        for seed, on, off in zip(judge.seeds, by_seed[FULL], by_seed[OFF], strict=True)
    ]
    return rows, nominal_table(rows)


def _percent(judge: Judge, variant: str, seed: int | None = None) -> dict[str, float]:
    """The criteria (%) where the plant is the nominal one, with all seeds or with one."""
    seeds = list(judge.seeds) if seed is None else [seed]
    values = replace(ROBUSTNESS, criteria=NOMINAL_CRITERIA).summarise(judge.nominal(variant).runs, seeds)[0]
    return {name: value for name, value in values.items() if value is not None}


def nominal_table(rows: Rows) -> str:
    """Means over the seeds, and the mean of their differences with its interval."""
    lines = []
    for name in dict.fromkeys(row["criterion"] for row in rows):
        on, off = (np.array([row[side] for row in rows if row["criterion"] == name]) for side in ("on", "off"))
        change = on - off
        text = f"{change.mean():+.1f}"
        if name in RANDOM_CRITERIA and len(change) > 1:
            low, high = mean_interval(change.tolist(), -100.0, 100.0)
            text += f" ({low:+.1f} to {high:+.1f})"
        lines.append([name.replace("_", " "), f"{on.mean():.1f}", f"{off.mean():.1f}", text])
    return table(["nominal plant", "adaptation on (%)", "off (%)", "difference (points)"], lines)


def errors(judge: Judge, picture: Path) -> Section:
    """Errors of the identified base parameters over the joint draws, in a table and a picture."""
    time, bands = follow_errors(judge.variants[FULL], judge.sets[JOINT], judge.rules)
    draw_errors(picture, time, bands)
    header = ["error, median (90 % band)", *(f"{at:g} s" for at in TIMES)]
    return error_rows(time, bands), table(header, error_lines(time, bands))


def boards(judge: Judge) -> Section:
    """The boards of this controller and of the shipped ones."""
    robot = judge.policy.robot.name
    controllers = {FULL: judge.variants[FULL]} | {name: get_controller(name, robot) for name in SHIPPED}
    rows = board_rows(controllers, robot)
    return rows, table(["mean (95 % interval)", *controllers], board_lines(rows))


def main() -> int:
    """Run the sections, print their tables and write their rows; bad input ends in one line and status 2."""
    try:
        run_sections(read_options())
    except SwingupError as error:
        print(f"adaptive.py: error: {error}", file=sys.stderr)
        return 2
    return 0


def read_options() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", choices=list(ROBOTS))
    parser.add_argument("controller", help="a policy file with an identifier")
    parser.add_argument("--section", nargs="+", choices=SECTIONS, default=SECTIONS)
    parser.add_argument("--out", type=Path, default=Path("runs/adaptive"))
    parser.add_argument("--seed", type=int, default=10, help="first seed of noise and pushes, but for the boards")
    parser.add_argument("--seeds", type=int, default=5)
    return parser.parse_args()


def run_sections(options: argparse.Namespace) -> None:
    """Run what was asked for.

    Raises:
        SwingupError: the controller's file cannot be used.
    """
    policy = read_pendulum_policy(options.controller, options.robot)
    judge = Judge(policy, ROBUSTNESS, options.seed, options.seeds)
    options.out.mkdir(parents=True, exist_ok=True)
    picture = options.out / f"{options.robot}-errors.png"
    run: dict[str, Callable[[Judge], Section]] = {
        "models": models, "ablations": ablations, "failing": failing, "nominal": nominal,
        "errors": partial(errors, picture=picture), "boards": boards,
    }  # fmt: skip
    for name in SECTIONS:
        if name in options.section:
            rows, text = run[name](judge)
            content = "".join(json.dumps(row) + "\n" for row in rows)
            write_atomically(options.out / f"{options.robot}-{name}.jsonl", content.encode())
            print(f"## {options.robot}: {name}\n\n{text}\n", flush=True)


if __name__ == "__main__":
    sys.exit(main())
