"""Which folder this is: RealAIGym's or CloudPendulum's, by the file that defines its controller."""

from dataclasses import dataclass
from pathlib import Path

from ..common.errors import SwingupError
from ..export.folder import FORMS, PACKAGE

PATTERNS = {form: entry.format(name="*") for form, (entry, _) in FORMS.items()}
"""Forms of exported folders, and the file that each has."""


@dataclass(frozen=True)
class Folder:
    """An exported folder."""

    entry: Path
    """The file that defines its controller."""
    form: str
    """``realaigym`` or ``cloudpendulum``."""

    @property
    def policy(self) -> Path | None:
        """The policy file; None where it is not a folder of ours."""
        name = self.entry.stem.partition("_")[2]
        file = self.entry.parent / PACKAGE.format(name=name) / "policy.safetensors"
        return file if file.is_file() else None


def find_folder(path: str | Path) -> Folder:
    """Find a folder's controller; the path may be that of its file, where it has several."""
    place = Path(path)
    if not place.exists():
        raise SwingupError(f"no such folder: {path}; swingup export POLICY --to realaigym --out FOLDER writes one")
    files = [place] if place.is_file() else sorted(place.iterdir())
    found = [
        Folder(file.resolve(), form) for form, pattern in PATTERNS.items() for file in files if file.match(pattern)
    ]
    if len(found) > 1:
        names = " or ".join(each.entry.name for each in found[:4])
        raise SwingupError(f"{path} holds {len(found)} controllers: name a file in it, {names}")
    if not found:
        kinds = " or ".join(f"{pattern} ({form})" for form, pattern in PATTERNS.items())
        raise SwingupError(f"{path} holds no controller: a folder of swingup export has {kinds}")
    return found[0]
