"""Every board of several trainings of one recipe, with means over the trainings.

Usage: python benchmarks/adaptive_seeds.py ROBOT FILE.safetensors [FILE.safetensors ...]
[--rows benchmarks/runs/ROBOT-adapt.jsonl]

Measures each file on each board and on the plants of `adaptive.py`, and prints a table with a column for each file
and the mean over them with Student's 95 % interval. The rows' file keeps what was measured: a measure that it has
already of a file of this content is not measured again.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterable
from functools import partial
from hashlib import sha256
from pathlib import Path
from statistics import fmean

from adaptive import table
from adaptive_boards import BOARDS
from adaptive_plants import FULL, Judge

from swingup.benchmark.boards import ROBUSTNESS
from swingup.benchmark.values import mean_interval
from swingup.common.errors import SwingupError
from swingup.common.files import write_atomically
from swingup.plant.plant import ROBOTS
from swingup.policy.pendulum import read_pendulum_policy

Rows = dict[tuple[str, str], float]
"""A number from 0 to 1 for each measure and file, by its label."""


def read_rows(path: Path) -> Rows:
    """What was measured before."""
    if not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {(row["measure"], row["file"]): row["value"] for row in rows}


def write_rows(path: Path, rows: Rows) -> None:
    """Keep what was measured."""
    lines = [json.dumps({"measure": one, "file": file, "value": value}) for (one, file), value in rows.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, "".join(line + "\n" for line in lines).encode())


def measures(robot: str, path: str) -> dict[str, Callable[[], float]]:
    """What a file is measured by: the boards, and the shares of plants held."""
    policy = read_pendulum_policy(path, robot)
    judge = Judge(policy, ROBUSTNESS, 0, 1)

    def held(plants: str) -> float:
        return float(judge.held(FULL, plants).mean())

    def board(name: str) -> float:
        return BOARDS[name](judge.variants[FULL], robot, path)[0]

    found: dict[str, Callable[[], float]] = {f"plants held, {name}": partial(held, name) for name in judge.sets}
    return found | {name: partial(board, name) for name in BOARDS}


def label(path: str) -> str:
    """A file by its name and its content."""
    return f"{Path(path).name} {sha256(Path(path).read_bytes()).hexdigest()[:8]}"


def lines(rows: Rows, names: Iterable[str], files: list[str]) -> list[list[str]]:
    """A line for each measure: every file, and the mean."""
    found = []
    for name in names:
        values = [rows[name, file] for file in files]
        mean = f"{fmean(values):.3f}"
        if len(values) > 1:
            mean += " ({:.3f} to {:.3f})".format(*mean_interval(values, 0.0, 1.0))
        found.append([name, *(f"{value:.3f}" for value in values), mean])
    return found


def main() -> int:
    """Measure and print; bad input ends in one line and status 2."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", choices=list(ROBOTS))
    parser.add_argument("files", nargs="+")
    parser.add_argument("--rows", type=Path)
    options = parser.parse_args()
    path = options.rows or Path(__file__).parent / "runs" / f"{options.robot}-adapt.jsonl"
    rows, labels, every = read_rows(path), [], {}
    try:
        for file in options.files:
            # Reading it as a policy first: what is no file ends in one line.
            every = measures(options.robot, file)
            labels.append(label(file))
            for name, measure in every.items():
                if (name, labels[-1]) not in rows:
                    rows[name, labels[-1]] = measure()
                    print(f"{labels[-1]}, {name}: {rows[name, labels[-1]]:.3f}", file=sys.stderr, flush=True)
                    write_rows(path, rows)
    except SwingupError as error:
        print(f"adaptive_seeds.py: error: {error}", file=sys.stderr)
        return 2
    header = ["", *(Path(file).name for file in options.files), "mean (95 % interval)"]
    print(table(header, lines(rows, every, labels)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
