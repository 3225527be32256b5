"""Run the notebook of first steps and store it with its outputs, which the site shows.

Usage: python docs/store_notebook.py [NOTEBOOK]. The default is examples/08_first_steps.ipynb. Needs nbclient and
ipykernel. The training takes a minute or two.
"""

import base64
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from notebook_page import FINENESS, NOTEBOOK, pixels

KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}
"""The name that every installation of Jupyter has, in place of the one of the environment that ran the notebook."""


def run(path: Path) -> Any:
    """The notebook with the outputs of a run in an empty folder, without what changes with each run."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": folder}}).execute()
    notebook.metadata = nbformat.from_dict({"kernelspec": KERNEL, "language_info": {"name": "python"}})
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # the times at which it ran
        if cell.cell_type == "code":
            cell.outputs = _joined(cell.outputs)
    return notebook


def _joined(outputs: list[Any]) -> list[Any]:
    """Outputs whose figures have a size to show them in, and whose printed text is one output.

    Jupyter divides what a cell prints by the time at which it comes.
    """
    joined: list[Any] = []
    for output in outputs:
        if joined and output.output_type == joined[-1].output_type == "stream" and output.name == joined[-1].name:
            joined[-1].text += output.text
            continue
        if "image/png" in output.get("data", {}):
            width, height = pixels(base64.b64decode(output.data["image/png"]))
            output.metadata = {"image/png": {"width": width // FINENESS, "height": height // FINENESS}}
        joined.append(output)
    return joined


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else NOTEBOOK
    nbformat.write(run(target), target)
