"""Site pages whose source is not in docs/, the table of presets, and the links between files of the repository.

README, cards, examples and linked source files are read where they are, so that no copy can fall behind.
"""

import ast
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent

ELSEWHERE = {
    "index.md": "README.md",
    "benchmarks.md": "benchmarks/README.md",
    "policies.md": "src/swingup/zoo/README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
}
"""Pages of the site that are files of the repository outside of docs/."""
STUDIES = {f"study-{page.name}": f"benchmarks/{page.name}" for page in (ROOT / "benchmarks").glob("[a-z]*.md")}
"""More of them, which readers reach by links: the navigation would be too long with them."""
ELSEWHERE |= STUDIES

LINK = re.compile(r"\[([^\]]*)\]\(([^)#\s]+)(#[^)\s]*)?\)")
SOURCE_NAME = re.compile(r"\.py: (\w+)`$")
"""The definition that a link to a source file names, at the end of the link's text."""

PRESET_TABLE = "<!-- table of presets: docs/hooks.py -->"
SOURCE = re.compile(r"src/swingup/[\w/]+\.py")
PICTURE = re.compile(r".+\.(png|svg|gif|jpe?g)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and pictures whose source is not in docs/."""
    contents = {page: (ROOT / source).read_text(encoding="utf-8") for page, source in ELSEWHERE.items()}
    for page, content in (contents | {"examples.md": _examples()}).items():
        kind = InclusionLevel.NOT_IN_NAV if page in STUDIES else InclusionLevel.UNDEFINED
        files.append(File.generated(config, page, content=content, inclusion=kind))
    linked = {path for page in _sources() for path in _linked(page)}
    for path in sorted(linked):
        if SOURCE.fullmatch(path):
            content, hidden = _code(path), InclusionLevel.NOT_IN_NAV
            files.append(File.generated(config, _code_page(path), content=content, inclusion=hidden))
        elif PICTURE.fullmatch(path) and not path.startswith("docs/"):
            files.append(File.generated(config, _picture(path), abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point links between files of the repository to pages of the site."""
    uri = page.file.src_uri
    source = ELSEWHERE.get(uri, f"docs/{uri}")

    def point(link: re.Match[str]) -> str:
        text, target, anchor = link.group(1), link.group(2), link.group(3) or ""
        path = _path(source, target)
        if path is None:
            return link.group(0)  # MkDocs checks what is no file of the repository
        found = _page_of(path)
        name = SOURCE_NAME.search(text)
        if name:
            anchor = f"#{name.group(1).lower()}"
        return f"[{text}]({found}{anchor})" if found else text  # a file that the site does not show

    return LINK.sub(
        point, markdown.replace(PRESET_TABLE, _preset_table()) if PRESET_TABLE in markdown else markdown
    )


def _preset_table() -> str:
    """The value of each hyperparameter in each preset, and the length of a run."""
    from swingup.areapo.config import HYPERPARAMETERS
    from swingup.learner.presets import PRESETS

    def cell(value: Any) -> str:
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, str):
            return value
        numbers = value if isinstance(value, tuple) else (value,)
        return ", ".join(f"{each:,}".replace(",", " ").removesuffix(".0") for each in numbers)

    rows = [["", *(f"`{name}`" for name in PRESETS)], ["---"] * (len(PRESETS) + 1)]
    for name in HYPERPARAMETERS:
        rows.append([f"`{name}`", *(cell(getattr(preset.config, name)) for preset in PRESETS.values())])
    rows.append(["frames of a run", *(cell(preset.frames) for preset in PRESETS.values())])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _sources() -> list[str]:
    """The repository's files whose links lead to more pages and pictures."""
    pages = sorted((ROOT / "docs").glob("*.md"))
    return [page.relative_to(ROOT).as_posix() for page in pages] + list(ELSEWHERE.values())


def _linked(source: str) -> Iterator[str]:
    """The files of the repository that a Markdown file links to."""
    for link in LINK.finditer((ROOT / source).read_text(encoding="utf-8")):
        path = _path(source, link.group(2))
        if path is not None:
            yield path


def _path(source: str, target: str) -> str | None:
    """The file or folder of the repository that a link in a Markdown file names, if there is one."""
    path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
    return path if "://" not in target and not path.startswith("..") and (ROOT / path).exists() else None


def _page_of(path: str) -> str | None:
    """The page or picture of the site for a file or folder of the repository."""
    homes = {source: page for page, source in ELSEWHERE.items()}
    homes |= {"benchmarks": "benchmarks.md", "examples/08_first_steps.ipynb": "first-steps.md"}
    if path in homes:
        return homes[path]
    if path == "examples" or path.startswith("examples/"):
        return "examples.md"
    if SOURCE.fullmatch(path):
        return _code_page(path)
    if PICTURE.fullmatch(path):
        return _picture(path)
    return path.removeprefix("docs/") if path.startswith("docs/") else None


def _code_page(source: str) -> str:
    return source.removeprefix("src/swingup/").removesuffix(".py") + ".md"


def _picture(path: str) -> str:
    return path.removeprefix("docs/")


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
