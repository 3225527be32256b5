"""Equations and symbols of the site as a book sets them: MathML for display equations, subscripts for symbols."""

import re
from xml.etree import ElementTree

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMESPACE = "http://www.w3.org/1998/Math/MathML"
LIMITED = {"∑", "∏", "lim"}
"""Operators whose limits stand below and above them in a display equation."""
STACKED = {"msub": "munder", "msup": "mover", "msubsup": "munderover"}

NOT_PROSE = re.compile(r"<(pre|code|math|script|style)\b.*?</\1>|<[^>]*>", re.DOTALL)
SUBSCRIPT = re.compile(r"(?<!\w)(Δ?[^\W\d_]'?)_(?:\{([^{}]+)\}|([A-Za-z0-9Α-Ωα-ω]{1,3})(?![A-Za-z0-9_]))")
"""A symbol of one letter with its subscript, as docstrings have them: γ_H, A_t, x_ij, A_{t+1}."""


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Write display equations as MathML."""
    return BLOCK.sub(lambda block: equation(block.group(1).strip()), markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Write symbols of the prose, such as ρ_H, with their subscripts."""
    parts, end = [], 0
    for markup in NOT_PROSE.finditer(html):
        parts += [_subscripts(html[end : markup.start()]), markup.group(0)]
        end = markup.end()
    return "".join([*parts, _subscripts(html[end:])])


def _subscripts(prose: str) -> str:
    return SUBSCRIPT.sub(lambda symbol: f"{symbol[1]}<sub>{symbol[2] or symbol[3]}</sub>", prose)


def equation(latex: str) -> str:
    """A display equation as MathML, with the limits of sums above and below them, in a box that can scroll."""
    ElementTree.register_namespace("", NAMESPACE)
    root = ElementTree.fromstring(convert(latex, display="block"))
    for element in root.iter():
        kind = element.tag.removeprefix(f"{{{NAMESPACE}}}")
        # The converter stacks limits in some places only: inside brackets it writes plain subscripts.
        if kind in STACKED and element[0].text in LIMITED:
            element.tag = f"{{{NAMESPACE}}}{STACKED[kind]}"
    return f'<div class="equation">{ElementTree.tostring(root, encoding="unicode")}</div>'
