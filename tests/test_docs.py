"""The documentation runs: Python blocks, command lines, the notebook; and the API page has every public name.

Comments in the pages' source, which readers do not see, say what a block needs. Before a block,
``<!-- run first: CODE -->`` gives code to run in the same namespace, ``<!-- slow -->`` leaves the block to the slow
tests, and ``<!-- not run: REASON -->`` excludes it. Each block runs by itself, in an empty folder.
"""

import contextlib
import functools
import json
import re
import shlex
import shutil
import sys
import types
from pathlib import Path

import numpy as np
import pytest

import swingup
from swingup.areapo.config import HYPERPARAMETERS
from swingup.benchmark.boards import BOARDS
from swingup.cli import commands, judging, main, pendulums
from swingup.controllers.baselines.baselines import Design, shipped_reference
from swingup.identification import excitation
from swingup.policy.shipped import shipped_file
from swingup.report.page import make_section

ROOT = Path(swingup.__file__).parents[2]
OTHERS = "README.md", "CONTRIBUTING.md", "lab/authors.md", "src/swingup/zoo/README.md"
PAGES = [
    *map(ROOT.joinpath, OTHERS),
    *(page for name in ("benchmarks", "docs") for page in sorted((ROOT / name).glob("*.md"))),
]
NOTEBOOK = ROOT / "examples" / "08_first_steps.ipynb"

pytestmark = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="the pages are only in a checkout")

COMMENT = r"<!-- (?P<kind>run first|slow|not run)(?::\s+(?P<text>.*?))?\s+-->\n+"
BLOCK = re.compile(rf"(?P<comments>(?:{COMMENT})*)^```python\n(?P<code>.*?)^```$", re.MULTILINE | re.DOTALL)
LANGUAGES = {"", "c", "math", "python"}
"""Languages of fenced blocks; another one needs a test first."""


def python_blocks():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in BLOCK.finditer(text):
            line = text[: match.start("code")].count("\n") + 1
            comments = {each["kind"]: each["text"] for each in re.finditer(COMMENT, match["comments"], re.DOTALL)}
            # Empty lines above, so that a traceback names the page's own line.
            source = "\n" * (line - 1) + match["code"]
            marks = [pytest.mark.slow] if "slow" in comments else []
            if "not run" not in comments:
                yield pytest.param(page, comments.get("run first"), source, id=f"{page.name}:{line}", marks=marks)


def command_lines():
    """Lines of indented blocks that call swingup, without comments, once each."""
    lines = {}
    for page in PAGES:
        for line in page.read_text(encoding="utf-8").splitlines():
            if line.startswith("    swingup "):
                lines.setdefault(" ".join(shlex.split(line, comments=True)[1:]), page.name)
    return [pytest.param(line, id=f"{page}: {line}") for line, page in lines.items()]


@pytest.mark.parametrize(("page", "first", "source"), list(python_blocks()))
def test_python_block_runs(page, first, source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = types.ModuleType("block_of_a_page")
    monkeypatch.setitem(sys.modules, module.__name__, module)  # where dataclasses look for their own names
    if first:
        exec(compile(first, f"{page.name} (run first)", "exec"), vars(module))
    exec(compile(source, str(page), "exec"), vars(module))


@pytest.mark.parametrize("line", command_lines())
def test_command_line_parses(line):
    assert callable(commands.parse(shlex.split(line.partition(" > ")[0])))


LEFT_OUT = {
    "watch cart": "Gymnasium draws it with pygame, which is not installed",
    "--scheduler": "a cluster",
    "--recipe recover": "six minutes; tests/refine has it",
    "--recipe adapt": "an hour; tests/refine has it",
    "q1=theta1+180:deg": "a log of other columns; tests/identification has such",
    "make-controller log.csv": "minutes; tests/cli has it, and benchmarks/unseen.md",
    "identify --rehearse": "it fails for a short excitation; tests/benchmark has it",
}
"""Command lines that do not run here, and why."""
SHORTER = {
    r"--seeds \d+": "--seeds 1",
    r"--frames \d+": "--frames 16384",
    r"--trials \d+": "--trials 1",
    r"--duration \d+": "--duration 3",
    "--real-time": "--real-time --duration 1",
    r"( preset| policy_layers)=([^ ,]+),\S+": r"\1=\2",  # one sweep keeps its two values
}
"""Options that are shortened before a command line runs."""
ADDED = {"--frames": ("16384", ("demo", "train", "sweep")), "--seeds": ("1", ("evaluate",))}
"""Options that are added to some commands where a line leaves them out: the defaults take long."""
MINE = """
def controller(x, t):
    return [0.0, -0.5 * x[3]]


def brake(x, t):
    return [-0.5 * x[2], 0.0]
"""


def shortened(line):
    """The command line with short runs, which must not take what the page says."""
    for pattern, text in SHORTER.items():
        line = re.sub(pattern, text, line)
    for option, (value, names) in ADDED.items():
        if line.startswith(names) and not {option, "--episodes", "--check"} & {*line.split()}:
            line += f" {option} {value}"
    return line


@pytest.fixture
def brief_searches(monkeypatch):
    """Searches that end before they found much: whether they find it is for the tests of each of them."""
    found = {problem: shipped_reference("acrobot", problem)[0] for problem in ("published", "score")}
    monkeypatch.setattr(Design, "compute", lambda self, problem, seed: (found[problem], {}))
    monkeypatch.setattr(excitation, "CHECKED_PLANTS", 8)
    monkeypatch.setattr(pendulums, "least_torque", lambda plant, robot, within: 0.7)


@pytest.mark.slow
@pytest.mark.usefixtures("brief_searches")
def test_command_lines_run_in_their_order(tmp_path, monkeypatch, small_grid, brief_minute):
    """All run in one folder, since some read what others wrote: no two trainings may name the same."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    few = ("ar-eapo", "tvlqr")  # test_the_papers_boards has everybody
    for name, board in {"robustness": small_grid, "uptime": brief_minute}.items():
        monkeypatch.setitem(BOARDS, name, board)
    monkeypatch.setattr("swingup.benchmark.leaderboard.default_entrants", lambda board: few)
    monkeypatch.setattr(judging, "make_section", functools.partial(make_section, entrants=few))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))  # of the sweeps' workers
    monkeypatch.syspath_prepend(tmp_path)
    shutil.copy(shipped_file("acrobot", "ar-eapo"), "best.safetensors")
    shutil.copy(ROOT / "src" / "swingup" / "loop" / "domains" / "identified.yml", "mine.yml")
    Path("mine.py").write_text(MINE, encoding="utf-8")
    logs = ROOT / "examples" / "logs"
    shutil.copytree(logs, "examples/logs")
    for name, number in {"free-fall": 1, "excitation": 2, "a": 1, "b": 2, "c": 3}.items():
        shutil.copy(logs / f"C1-excitation-{number}.csv", f"{name}.csv")
    assert main(["evaluate", "acrobot", "--save", "robot.csv"]) == 0
    assert main(shlex.split("evaluate acrobot --plant B.0 --controller ar-eapo --save b0.csv")) == 0
    shutil.copy("robot.csv", "odd.csv")
    rows = np.loadtxt("robot.csv", delimiter=",", skiprows=1)
    np.savetxt("minute.csv", np.insert(rows, [5] * 4, 0.0, axis=1), delimiter=",")
    lines = [param.values[0] for param in command_lines()]
    assert all(any(text in line for line in lines) for text in LEFT_OUT)
    for line in lines:
        if not any(text in line for text in LEFT_OUT):
            command, _, file = line.partition(" > ")
            with contextlib.ExitStack() as stack:
                if file:
                    stack.enter_context(contextlib.redirect_stdout(stack.enter_context(open(file, "w"))))
                assert main(shlex.split(shortened(command))) == 0, line


def test_commands_named_in_sentences_exist(capsys):
    named = {}
    for page in PAGES:
        prose = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for command, words in re.findall(r"`swingup ([a-z0-9-]+)([^`]*)`", prose):
            named.setdefault(command, set()).update(re.findall(r"--[a-z][a-z-]*", words))
    for command, options in named.items():
        assert main([command, "--help"]) == 0
        assert options <= {*re.findall(r"--[a-z][a-z-]*", capsys.readouterr().out)}, command


def test_the_page_of_hyperparameters_says_what_each_does():
    text = (ROOT / "docs" / "hyperparameters.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)`", text, re.MULTILINE) == list(HYPERPARAMETERS)


def test_pages_name_what_is_there():
    """Links [`file: name`](../src/swingup/file), the public names, languages of blocks, small pictures."""
    texts = {page: page.read_text(encoding="utf-8") for page in PAGES}
    links = r"\[`([\w/]+\.py)(?:: (\w+))?`\]\(\.\./src/swingup/([^)]*)\)"
    found = [link for text in texts.values() for link in re.findall(links, text)]
    assert len(found) > 25
    for file, name, target in found:
        assert file == target
        source = (ROOT / "src" / "swingup" / file).read_text(encoding="utf-8")
        assert not name or re.search(rf"^(def |class )?{name}\b", source, re.MULTILINE), f"{file}: {name}"
    documented = re.findall(r"^::: swingup\.(\w+)$", texts[ROOT / "docs" / "api.md"], re.MULTILINE)
    assert set(documented) == set(swingup.__all__) - {"__version__"}
    for page, text in texts.items():
        assert set(re.findall(r"^```(.*)$", text, re.MULTILINE)) <= LANGUAGES, page.name
    pictures = [path for folder in ("benchmarks", "docs") for path in (ROOT / folder).glob("*.png")]
    assert [path.name for path in pictures if path.stat().st_size > 300_000] == []


def check_notebook(cells):
    outputs = [output for cell in cells if cell["cell_type"] == "code" for output in cell["outputs"]]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
    printed = "".join("".join(output.get("text", "")) for output in outputs)
    assert re.search(r"shipped: score 0\.[67]", printed)
    # Nothing names the machine on which it ran.
    assert re.findall(r"(?<![\w.])/\w+/|\b[A-Z]:\\|~/", printed) == []


def test_the_notebook_is_stored_with_its_outputs():
    assert NOTEBOOK.stat().st_size < 400_000
    check_notebook(json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"])


@pytest.mark.slow
# Of nbclient's own dependencies, not of the notebook's code, which runs in a process of its own.
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_the_notebook_runs(tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    check_notebook(notebook.cells)
