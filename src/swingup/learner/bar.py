"""A bar for ``learn``: a notebook's in a notebook, else a terminal's on standard error."""

import contextlib
import html
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

Show = Callable[[int, str], object]  # Shows frames so far, and a line of figures


@contextlib.contextmanager
def progress_bar(total: int, done: int) -> Iterator[Show]:
    """Show a bar from ``done`` to ``total`` frames; it stays when it is full."""
    console = Console(stderr=True)
    if console.is_jupyter:
        # IPython is there, and its own widgets may not be.
        from IPython.display import HTML, display

        handle = display(HTML(""), display_id=True)
        yield lambda frames, line: handle.update(
            HTML(f"<progress value={frames - done} max={total - done}></progress> {html.escape(line)}")
        )
        return
    columns = BarColumn(bar_width=20), TimeRemainingColumn(), TextColumn("{task.description}", markup=False)
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("compiling", total=total - done)
        yield lambda frames, line: bar.update(task, completed=frames - done, description=line)
