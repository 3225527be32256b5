"""What the site needs besides the pages in docs/: pages whose source lies elsewhere, links to them, and equations.

Nothing is copied by hand: README, cards, examples, the notebook and the source files that pages link to are read
where they are.
"""

import ast
import json
import posixpath
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOK = "examples/08_first_steps.ipynb"

ELSEWHERE = {
    "index.md": "README.md",
    "benchmarks.md": "benchmarks/README.md",
    "policies.md": "src/swingup/zoo/README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
}
"""Pages of the site that are files of the repository outside of docs/."""

PICTURES = {"curves.png": "benchmarks/curves.png"}

LINK = re.compile(r"\[([^\]]*)\]\(([^)#\s]+)(#[^)\s]*)?\)")
SOURCE_NAME = re.compile(r"\.py: (\w+)`$")
"""In the text of a link to a source file: what the link is to, defined in that file."""

SOURCE = re.compile(r"src/swingup/[\w/]+\.py")
MATH = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and pictures whose source is not in docs/."""
    contents = {page: (ROOT / source).read_text(encoding="utf-8") for page, source in ELSEWHERE.items()}
    contents |= {"examples.md": _examples(), "first-steps.md": _notebook()}
    contents |= {_code_page(source): _code(source) for source in _linked_sources()}
    for page, content in contents.items():
        files.append(File.generated(config, page, content=content))
    for picture, source in PICTURES.items():
        files.append(File.generated(config, picture, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point links between files of the repository to pages of the site, and write equations as MathML."""
    uri = page.file.src_uri
    folder = posixpath.dirname(ELSEWHERE.get(uri, f"docs/{uri}"))

    def point(link: re.Match[str]) -> str:
        text, target, anchor = link.group(1), link.group(2), link.group(3) or ""
        path = posixpath.normpath(posixpath.join(folder, target))
        if "://" in target or not (ROOT / path).exists():
            return link.group(0)  # not a file of the repository: MkDocs judges it
        found = _page_of(path)
        name = SOURCE_NAME.search(text)
        if name:
            anchor = f"#{name.group(1).lower()}"
        return f"[{text}]({found}{anchor})" if found else text  # a file that the site does not show

    return MATH.sub(lambda block: convert(block.group(1).strip(), display="block"), LINK.sub(point, markdown))


def _page_of(path: str) -> str | None:
    """The page or picture of the site for a file or folder of the repository."""
    homes = {source: page for page, source in (ELSEWHERE | PICTURES).items()}
    homes |= {"benchmarks": "benchmarks.md", "examples": "examples.md", NOTEBOOK: "first-steps.md"}
    if path in homes:
        return homes[path]
    if path.startswith("examples/"):
        return "examples.md"
    if SOURCE.fullmatch(path):
        return _code_page(path)
    return path.removeprefix("docs/") if path.startswith("docs/") else None


def _code_page(source: str) -> str:
    return source.removeprefix("src/swingup/").removesuffix(".py") + ".md"


def _linked_sources() -> set[str]:
    """The source files that pages in docs/ link to."""
    texts = (path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))
    return {source for text in texts for source in SOURCE.findall(text)}


def _code(source: str) -> str:
    """A source file as Markdown, each of its definitions with a heading that links can point to."""
    text = (ROOT / source).read_text(encoding="utf-8")
    starts = {0: source}
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            starts[min(line.lineno for line in [node, *node.decorator_list]) - 1] = node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            starts[node.lineno - 1] = ast.unparse(target)
    lines, firsts = text.splitlines(), sorted(starts)
    parts = []
    for first, end in zip(firsts, [*firsts[1:], len(lines)], strict=True):
        code = "\n".join(lines[first:end]).strip()
        parts.append(f"{'##' if first else '#'} {starts[first]}\n\n```python\n{code}\n```")
    return "\n\n".join(parts)


def _examples() -> str:
    """All numbered programs on one page."""
    parts = ["# Examples", "Programs of `examples/`; `make examples` runs them all."]
    for path in sorted((ROOT / "examples").glob("[0-9]*.py")):
        parts.append(f"## {path.name}\n\n```python\n{path.read_text(encoding='utf-8')}```")
    return "\n\n".join(parts)


def _notebook() -> str:
    """The notebook's cells as Markdown; it is stored without outputs."""
    cells = json.loads((ROOT / NOTEBOOK).read_text(encoding="utf-8"))["cells"]
    texts = [("".join(cell["source"]), cell["cell_type"]) for cell in cells]
    return "\n\n".join(text if kind == "markdown" else f"```python\n{text}\n```" for text, kind in texts)
