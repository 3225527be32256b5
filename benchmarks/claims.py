"""List the claims of ``benchmarks/README.md`` that are older than the code they rest on.

Usage: python benchmarks/claims.py [--repeat]

Exit status 1 if there are some. A commit that only moves or renames code counts, too: the list says what to measure
again before a release, not what is wrong.

``--repeat`` asks of older claims about trainings whether they would come out again: short trainings (``SHORT``)
run by the code of the claim's day and by today's, and their metrics and weights are compared bit for bit. Where all
are the same, the claim's row may say "same bits" and the day. It takes minutes.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from safetensors.numpy import load_file

from swingup.learner.metrics import read_metrics

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"\[(.+?)\]\((.+?)\)")
DAY = re.compile(r"\d{4}-\d\d-\d\d")
SHORT = {
    "paper.md": ["acrobot --preset paper --seed 1 --frames 65536"],
    "curves.md": ["acrobot --frames 65536", "pendubot --frames 65536"],
    "fast.md": ["acrobot --preset fast --frames 262144", "pendubot --preset fast --frames 262144"],
    "plants.md": [
        "acrobot --plant A.0 --frictionless --preset small --frames 131072",
        "pendubot --plant cloudpendulum --frictionless --preset small --frames 131072",
    ],
    "untuned.md": [
        "--env Acrobot-v1 --seed 720 --frames 32768",
        "--env Pendulum-v1 --seed 720 --frames 32768",
        "--env MountainCarContinuous-v0 --seed 720 --frames 32768",
    ],
    "ablations.md": [
        "acrobot --schedule constant --frames 65536",
        "acrobot --schedule constant --frames 65536 --gain none --discount 0.99 0.99 --no-centre-values",
    ],
    "continuing-claims.md": ["--env swingup.continuing:swingup/ContinuingWalker2d-v0 --seed 20 --frames 20000"],
    "continuing-stream.md": [
        "--env swingup.continuing:swingup/ContinuingSwimmer-v0 --resets never --seed 2 --frames 20000"
    ],
    "mujoco.md": ["--env Hopper-v5 --preset continuing --seed 20 --frames 20000"],
    "ppo.md": ["--env CartPole-v1 --preset ppo --num-envs 8 --num-steps 256 --frames 20480"],
}
"""Options of `swingup train`, by the page of a claim that trainings like these have made."""
CLOCK = {"seconds", "frames_per_second", "longest_pause"}


class Claim(NamedTuple):
    """A row of the tables."""

    text: str
    page: str
    figure: str
    command: str
    measured: str
    """The day of the code that made the figure, and perhaps a later one whose code has the same bits."""
    folders: list[str]
    met: str

    @property
    def date(self) -> str:
        """The day whose code the claim stands for."""
        return DAY.findall(self.measured)[-1]


def read_claims() -> list[Claim]:
    """The rows of all tables."""
    found = []
    for line in (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("| ["):
            claim, figure, command, measured, folders, met = (cell.strip() for cell in line.strip("|").split("|"))
            [(text, page)] = LINK.findall(claim)
            found.append(Claim(text, page, figure, command.strip("`"), measured, folders.split(), met))
    return found


def git(*words: str) -> str:
    """What a command of git prints."""
    return subprocess.run(["git", "-C", ROOT, *words], capture_output=True, text=True, check=True).stdout


def changed_since(claim: Claim) -> int:
    """Number of commits after the claim's day in the folders that it rests on."""
    folders = [f"src/swingup/{name}" for name in claim.folders]
    return len(git("log", "--format=%h", f"--since={claim.date}T23:59:59", "--", *folders).split())


@contextmanager
def code_of(date: str, folder: Path) -> Iterator[Path]:
    """A checkout of the last code of a day."""
    commit = git("rev-list", "-1", f"--until={date}T23:59:59", "HEAD").strip()
    git("worktree", "add", "--detach", str(folder), commit)
    try:
        yield folder
    finally:
        git("worktree", "remove", "--force", str(folder))


def train(options: str, checkout: Path, out: Path) -> None:
    """Train in a folder with a checkout's code."""
    words = [sys.executable, "-m", "swingup", "train", *options.split(), "--out", str(out)]
    env = os.environ | {"PYTHONPATH": str(checkout / "src")}
    subprocess.run(words, env=env, cwd=out.parent, stdout=subprocess.DEVNULL, check=True)


def difference(before: Path, now: Path) -> str | None:
    """Where two runs' metrics or weights differ first, of what both have; None if nowhere."""
    rows = [read_metrics(run / "metrics.jsonl") for run in (before, now)]
    if len(rows[0]) != len(rows[1]):
        return f"{len(rows[1])} evaluations, were {len(rows[0])}"
    for old, new in zip(*rows, strict=True):
        for name in sorted(old.keys() & new.keys() - CLOCK):
            if old[name] != new[name]:
                return f"{name} is {new[name]} after {new['frames']:,} frames, was {old[name]}"
    for file in sorted(before.glob("last*.safetensors")):
        old, new = load_file(file), load_file(now / file.name)
        for name in old:
            if not np.array_equal(old[name], new[name], equal_nan=True):
                return f"{name} of {file.name}"
    return None


def repeat(claim: Claim) -> None:
    """Print whether the short trainings of a claim have the same bits by its day's code and today's."""
    with tempfile.TemporaryDirectory() as folder, code_of(claim.date, Path(folder) / "code") as checkout:
        for number, options in enumerate(SHORT[claim.page]):
            runs = [Path(folder) / f"{when}-{number}" for when in ("before", "now")]
            for code, run in zip((checkout, ROOT), runs, strict=True):
                train(options, code, run)
            found = difference(*runs)
            print(f"    swingup train {options}: {found or f'as on {claim.date}, bit for bit'}", flush=True)


def main() -> int:
    """Print the list; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", action="store_true")
    options = parser.parse_args()
    claims = read_claims()
    older = [(claim, count) for claim in claims if (count := changed_since(claim))]
    for claim, count in older:
        print(f"{claim.date}  {count:4} commits since  {claim.text}: {claim.command}", flush=True)
        if options.repeat and claim.page in SHORT:
            repeat(claim)
    print(f"{len(older)} of {len(claims)} claims are older than the code they rest on")
    return bool(older)


if __name__ == "__main__":
    sys.exit(main())
