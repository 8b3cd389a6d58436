"""The site that `make docs` builds: strictly, and with nothing to fetch from elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from browser import show

pytestmark = pytest.mark.repository

pytest.importorskip("mkdocs", reason="no mkdocs; `pip install -e '.[docs]'` installs it")
pytest.importorskip(
    "mkdocstrings", reason="no mkdocstrings; `pip install -e '.[docs]'` installs it"
)

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--quiet",
        "--site-dir",
        str(folder),
    ]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, env=environment, timeout=600
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_no_page_fetches_anything_from_elsewhere(site):
    """Links that a reader follows, and the page's own address, are not fetched as it is shown."""
    elsewhere = re.compile(
        r"""<(?!a |base )[^>]*\b(?:src|href|srcset|data)\s*=\s*["']?(?:http|//)[^>]*>"""
    )
    for file in site.rglob("*.html"):
        tags = elsewhere.findall(file.read_text(encoding="utf-8"))
        assert [tag for tag in tags if not re.search('rel="(canonical|alternate)"', tag)] == [], (
            file.name
        )
    for file in (file for file in site.rglob("*.css") if "assets" not in file.parts):
        assert "http" not in file.read_text(encoding="utf-8"), file.name


def test_every_equation_is_drawn_and_numbered(site):
    page = (site / "method.html").read_text(encoding="utf-8")
    source = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")
    assert page.count('<div class="equation"') == source.count("```math")
    numbers = re.findall(r"\\tag\{(\d+)\}", source)
    assert re.findall(r'class="equation-number">\((\d+)\)', page) == numbers
    for file in site.glob("*.html"):
        text = file.read_text(encoding="utf-8")
        plain = re.sub(r"<(script|style|code).*?</\1>", "", text, flags=re.DOTALL)
        assert not re.search(r"EquationNumber|\$[^\s$][^$\n<]*\$", plain), file.name


def test_the_search_works_in_a_page_opened_as_a_file_with_no_network(site, tmp_path):
    """There the browser starts no workers; docs/iframe-worker.js does what the search's would."""
    (site / "asks.html").write_text(
        '<meta http-equiv="refresh" content="0; url=method.html?q=pressure">'
    )
    shown = show(site / "asks.html", tmp_path)
    (site / "asks.html").unlink()
    assert shown.errors == []
    assert re.search(r'class="md-search-result__meta">\s*\d+ matching documents?', shown.document)
