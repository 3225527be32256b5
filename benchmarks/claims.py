"""List the claims of ``benchmarks/README.md`` that are older than the code they rest on.

Exit status 1 if there are some. A commit that only moves or renames code counts, too: the list says what to measure
again before a release, not what is wrong.
"""

import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"\[(.+?)\]\((.+?)\)")


class Claim(NamedTuple):
    """A row of the tables."""

    text: str
    page: str
    figure: str
    command: str
    date: str
    folders: list[str]
    met: str


def read_claims() -> list[Claim]:
    """The rows of all tables."""
    found = []
    for line in (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("| ["):
            claim, figure, command, date, folders, met = (cell.strip() for cell in line.strip("|").split("|"))
            [(text, page)] = LINK.findall(claim)
            found.append(Claim(text, page, figure, command.strip("`"), date, folders.split(), met))
    return found


def changed_since(claim: Claim) -> int:
    """Number of commits after the claim's day in the folders that it rests on."""
    folders = [f"src/swingup/{name}" for name in claim.folders]
    log = ["git", "-C", str(ROOT), "log", "--format=%h", f"--since={claim.date}T23:59:59", "--", *folders]
    return len(subprocess.run(log, capture_output=True, text=True, check=True).stdout.split())


if __name__ == "__main__":
    claims = read_claims()
    older = [(claim, count) for claim in claims if (count := changed_since(claim))]
    for claim, count in older:
        print(f"{claim.date}  {count:4} commits since  {claim.text}: {claim.command}")
    print(f"{len(older)} of {len(claims)} claims are older than the code they rest on")
    sys.exit(bool(older))
