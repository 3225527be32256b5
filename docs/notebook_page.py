"""The notebook as a page of the site: its text and code with the outputs that are stored in it."""

import base64
import json
import re
import struct
from html import escape
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

NOTEBOOK = Path(__file__).resolve().parent.parent / "examples" / "08_first_steps.ipynb"
PAGE = "first-steps"
COLOUR = re.compile(r"\x1b\[[0-9;]*m")
"""A terminal's colours, which tracebacks and progress lines may have."""
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
FINENESS = 2
"""Pixels of a stored figure for each pixel of the page, so that fine screens show it sharp."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the page and its figures."""
    markdown, figures = render(json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"])
    files.append(File.generated(config, f"{PAGE}.md", content=markdown))
    for name, png in figures.items():
        files.append(File.generated(config, name, content=png))
    return files


def render(cells: list[dict[str, Any]]) -> tuple[str, dict[str, bytes]]:
    """The cells as Markdown, and their figures as PNG files by name."""
    parts: list[str] = []
    figures: dict[str, bytes] = {}
    title = ""
    for cell in cells:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            title = (HEADING.findall(text) or [title])[-1]
            parts.append(text)
            continue
        parts.append(f"```python\n{text}\n```")
        for output in cell["outputs"]:
            png = output.get("data", {}).get("image/png")
            if png is None:
                parts.append(_printed(output))
            else:
                name = f"{PAGE}-{len(figures) + 1}.png"
                figures[name] = base64.b64decode("".join(png))
                parts.append(_figure(name, figures[name], title))
    return "\n\n".join(parts), figures


def _printed(output: dict[str, Any]) -> str:
    """The text of an output as a block of its own."""
    text = "".join(output.get("text") or output.get("data", {}).get("text/plain", ""))
    return f"<pre class='output'>{escape(COLOUR.sub('', text)).rstrip()}</pre>"


def pixels(png: bytes) -> tuple[int, int]:
    """Width and height of a PNG file, which are bytes 16 to 23 of it."""
    width, height = struct.unpack(">II", png[16:24])
    return width, height


def _figure(name: str, png: bytes, title: str) -> str:
    """A picture in the size for which it was drawn."""
    return f"![{title}]({name}){{ width={pixels(png)[0] // FINENESS} }}"
