"""A study as a file: a page, or a figure."""

from pathlib import Path

from ..common.files import write_atomically
from .files import check_suffix
from .plot_study import plot_study
from .study import Study
from .study_page import render_study
from .style import FIGURE_FORMATS, render

STUDY_FORMATS = (".html", *FIGURE_FORMATS)


def save_study(study: Study, out: str | Path) -> None:
    """Write a study whole or not at all, in the format that the file's name ends in.

    Raises:
        SwingupError: an unknown suffix, a missing library, or a file that cannot be written.
    """
    suffix = check_suffix(out, STUDY_FORMATS)
    if suffix == ".html":
        write_atomically(out, render_study(study).encode())
    else:
        write_atomically(out, render(plot_study(study), suffix))
