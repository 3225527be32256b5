"""The documentation site: it builds without a warning, fits a phone, and its search needs no server."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

import swingup

ROOT = Path(swingup.__file__).parents[2]
CHROMIUM = shutil.which("chromium")
OPTIONS = ["--no-sandbox", "--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
PHONE = 400
"""Pixels."""
VOID = {"area", "base", "br", "col", "hr", "img", "input", "link", "meta", "source", "wbr"}

pytestmark = pytest.mark.skipif(not (ROOT / "mkdocs.yml").is_file(), reason="the site is only in a checkout")


def load_hook(name):
    """One of the hooks in docs/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Prose(HTMLParser):
    """The text of a page outside of code and equations, and the number of each element."""

    def __init__(self, html):
        super().__init__()
        self.text, self.counts, self._hidden = [], {}, []
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.counts[tag] = self.counts.get(tag, 0) + 1
        if tag in ("code", "pre", "math", "script", "style") or (self._hidden and tag not in VOID):
            self._hidden.append(tag)

    def handle_endtag(self, tag):
        if self._hidden and self._hidden[-1] == tag:
            self._hidden.pop()

    def handle_data(self, text):
        if not self._hidden:
            self.text.append(text)


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    pytest.importorskip("mkdocs", reason="mkdocs is not installed")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    paths = os.pathsep.join([str(ROOT / "src"), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": paths}
    built = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    assert (built.returncode, built.stdout + built.stderr) == (0, "")
    return folder


@pytest.fixture(scope="session")
def pages(site):
    found = {path.relative_to(site).as_posix(): path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    assert len(found) > 30
    return found


@pytest.fixture(scope="session")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    with playwright.sync_playwright() as tool:
        chromium = tool.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield chromium
        chromium.close()


@pytest.mark.parametrize(
    ("prose", "html"),
    [
        ("<p>the gain ρ_H (γ_H)</p>", "<p>the gain ρ<sub>H</sub> (γ<sub>H</sub>)</p>"),
        ("u_k and u_kᵀ, Δq_k", "u<sub>k</sub> and u<sub>k</sub>ᵀ, Δq<sub>k</sub>"),
        ("s'_t, A_{t+1}, x_ij, π_θ", "s'<sub>t</sub>, A<sub>t+1</sub>, x<sub>ij</sub>, π<sub>θ</sub>"),
        ("<code>ρ_H</code> <pre><code>ρ_H</code> ρ_H</pre>", None),
        ('<a href="#x_H" title="ρ_H">t_final, num_envs, __init__</a>', None),
    ],
)
def test_symbols_of_the_prose_get_subscripts(prose, html):
    pytest.importorskip("latex2mathml", reason="the site's packages are not installed")
    hook = load_hook("mathematics")
    assert hook.on_page_content(prose, None, None, None) == (html or prose)


@pytest.mark.parametrize(
    ("latex", "stacked"),
    [
        (r"\left[ \sum_{t=0}^{T-1} r_t \right]", "munderover"),
        (r"\left( \sum_i x_i \right)", "munder"),
        (r"\lim_{T \to \infty} x_T", "munder"),
    ],
)
def test_limits_stand_above_and_below(latex, stacked):
    pytest.importorskip("latex2mathml", reason="the site's packages are not installed")
    mathml = load_hook("mathematics").equation(latex)
    assert f"<{stacked}>" in mathml
    assert mathml.count("<msub>") == 1  # of the variable


def test_a_notebook_shows_text_and_figures():
    pytest.importorskip("mkdocs", reason="mkdocs is not installed")
    png = "iVBORw0KGgoAAAANSUhEUgAAAAQAAAACCAAAAAB1u+cKAAAADElEQVR4nGNgYGAAAAAEAAH2FzhVAAAAAElFTkSuQmCC"  # 4 x 2
    cells = [
        {"cell_type": "markdown", "source": ["# A title\n", "text"]},
        {
            "cell_type": "code",
            "source": ["print('<')"],
            "outputs": [{"text": ["\x1b[1m<\x1b[0m\n"]}, {"data": {"image/png": png, "text/plain": ["<Figure>"]}}],
        },
    ]
    markdown, figures = load_hook("notebook_page").render(cells)
    assert markdown == (
        "# A title\ntext\n\n```python\nprint('<')\n```\n\n<pre class='output'>&lt;</pre>\n\n"
        "![A title](first-steps-1.png){ width=2 }"
    )
    assert figures["first-steps-1.png"].startswith(b"\x89PNG")


@pytest.mark.slow
def test_prose_shows_no_raw_subscript(pages):
    raw = {}
    for name, html in pages.items():
        found = re.findall(r"\S*[α-ωΑ-Ω]_\w*", " ".join(Prose(html).text))
        raw |= {name: found} if found else {}
    assert raw == {}
    assert "λ<sub>e</sub> of the entropy advantages" in pages["api.html"]  # of a docstring


@pytest.mark.slow
def test_every_sum_of_an_equation_has_its_limits_above_and_below(pages):
    equations = re.findall(r"<math\b.*?</math>", pages["ar-eapo.html"], re.DOTALL)
    sums = sum(equation.count("∑") for equation in equations)
    assert sums >= 5
    assert sum(len(re.findall(r"<munder(?:over)?><mo[^>]*>∑", each)) for each in equations) == sums
    assert "<munderover>" in pages["ar-eapo.html"]


@pytest.mark.slow
def test_pages_show_their_pictures_and_the_notebook_its_outputs(site, pages):
    shown = {
        (Path(name).parent / source).as_posix()
        for name, html in pages.items()
        for source in re.findall(r'<img [^>]*src="([^":]+)"', html)
    }
    assert {f"benchmarks/{name}.png" for name in ("ablations", "curves", "mujoco")} <= shown
    assert {"swing-up.gif", "robustness.png", "first-steps-1.png", "first-steps-2.png"} <= shown
    assert [name for name in sorted(shown) if not (site / name).is_file()] == []
    assert "shipped: score 0.695" in pages["first-steps.html"]


@pytest.mark.slow
def test_nothing_is_fetched_from_elsewhere(pages):
    for name, html in pages.items():
        assert re.findall(r'<(?:script|img|iframe)\b[^>]*src="(?:https?:)?//[^"]*"', html) == [], name
        assert re.findall(r'<link [^>]*rel="stylesheet"[^>]*href="(?:https?:)?//[^"]*"', html) == [], name


@pytest.mark.slow
def test_every_page_fits_a_phone(site, pages, browser):
    page = browser.new_page(viewport={"width": PHONE, "height": 800})
    widths = {}
    for name in sorted(pages):
        page.goto((site / name).as_uri())
        widths[name] = page.evaluate("document.scrollingElement.scrollWidth")
    page.close()
    assert {name: width for name, width in widths.items() if width > PHONE} == {}


@pytest.mark.slow
@pytest.mark.parametrize("start", ["index.html", "learner/presets.html"])
def test_the_search_needs_no_server(site, browser, start):
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto((site / start).as_uri())
    page.click("input[name=query]")
    page.keyboard.type("pendubot")
    page.wait_for_selector(".md-search-result__item a", state="attached", timeout=20_000)
    page.locator(".md-search-result__link").first.click()
    page.wait_for_function(f"!location.href.includes({start!r})")
    assert page.title() != "Not found - swingup"
    assert "pendubot" in page.inner_text("article").lower()
    page.close()
    assert complaints == []


@pytest.mark.slow
@pytest.mark.parametrize(("system", "scheme"), [("dark", "slate"), ("light", "default")])
def test_colours_follow_the_system(site, browser, system, scheme):
    page = browser.new_page(color_scheme=system)
    page.goto((site / "index.html").as_uri())
    page.wait_for_function("document.body.getAttribute('data-md-color-media') !== null")
    shown = page.evaluate("document.body.getAttribute('data-md-color-scheme')")
    page.emulate_media(color_scheme="light" if system == "dark" else "dark")
    page.wait_for_function(f"document.body.getAttribute('data-md-color-scheme') !== '{scheme}'")
    page.close()
    assert shown == scheme
