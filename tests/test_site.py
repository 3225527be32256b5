"""The documentation site: it builds without a warning, fits a phone, and its search needs no server."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import swingup

ROOT = Path(swingup.__file__).parents[2]
PHONE = 400
"""Pixels."""
pytestmark = pytest.mark.skipif(not (ROOT / "mkdocs.yml").is_file(), reason="the site is only in a checkout")


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


@pytest.mark.slow
def test_pages_show_their_equations_pictures_and_the_notebooks_outputs(site, pages):
    foreign = r'<(?:(?:script|img|iframe)\b[^>]*src|link [^>]*rel="stylesheet"[^>]*href)="(?:https?:)?//[^"]*"'
    for name, html in pages.items():
        prose = re.sub(r"<(code|pre|math|script|style)\b.*?</\1>", "", html, flags=re.DOTALL)
        assert re.findall(r">[^<]*[α-ωΑ-Ω]_\w[^<]*", prose) == [], name
        assert re.findall(foreign, html) == [], name
    assert "λ<sub>e</sub> of the entropy advantages" in pages["api.html"]  # of a docstring
    equations = re.findall(r"<math\b.*?</math>", pages["ar-eapo.html"], re.DOTALL)
    sums = sum(equation.count("∑") for equation in equations)
    assert sums >= 5
    assert sum(len(re.findall(r"<munder(?:over)?><mo[^>]*>∑", each)) for each in equations) == sums
    shown = {
        (Path(name).parent / source).as_posix()
        for name, html in pages.items()
        for source in re.findall(r'<img [^>]*src="([^":]+)"', html)
    }
    assert {"benchmarks/curves.png", "swing-up.gif", "first-steps-1.png", "first-steps-2.png"} <= shown
    assert [name for name in sorted(shown) if not (site / name).is_file()] == []
    assert "shipped: score 0.698" in pages["first-steps.html"]


@pytest.mark.slow
def test_pages_fit_a_phone(site, pages, chromium):
    page, widths = chromium.new_page(viewport={"width": PHONE, "height": 800}), {}
    for name in sorted(pages):
        page.goto((site / name).as_uri())
        widths[name] = page.evaluate("document.scrollingElement.scrollWidth")
    assert {name: width for name, width in widths.items() if width > PHONE} == {}
    page.close()
