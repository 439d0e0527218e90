"""The documentation as a site: built strictly, complete, and read without a network."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from tests.support.browser import shown_by_browser

#: What a browser loads by itself, by tag.
from tests.support.places import DOCS, ROOT

from trackbench.cli.docs import command_line_markdown
from trackbench.cli.explain import glossary
from trackbench.subjects.doctor.docs import doctor_reference

LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "object": "data"}


class Page(HTMLParser):
    """The elements of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))


def build(source: Path, site: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sphinx", "--quiet", *options, str(source), str(site)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


STRICT = ("--fail-on-warning", "--keep-going")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    done = build(DOCS, folder, *STRICT)
    assert done.returncode == 0, done.stderr
    return folder


def pages(site: Path) -> Iterator[tuple[str, Page]]:
    for file in sorted(site.rglob("*.html")):
        yield file.relative_to(site).as_posix(), Page(file)


def test_every_page_is_built_and_in_the_menu(site: Path) -> None:
    written = {file.relative_to(DOCS).with_suffix(".html").as_posix() for file in DOCS.rglob("*.md")}
    found = {name for name, _ in pages(site)} - {"search.html"}
    assert found == written
    linked = {attributes.get("href") for tag, attributes in Page(site / "index.html").elements if tag == "a"}
    assert written <= linked | {"index.html"}


@pytest.mark.parametrize("tex", [r"\nosuchcommand{x}", r"\begin{nosuch} a &= b \end{nosuch}"])
def test_an_equation_that_is_not_understood_is_refused(monkeypatch: pytest.MonkeyPatch, tex: str) -> None:
    monkeypatch.syspath_prepend(str(DOCS / "site"))
    import mathml

    assert "<msup>" in mathml.mathml("x^2", "inline")
    with pytest.raises(ValueError, match="not understood"):
        mathml.mathml(tex, "block")


def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    for name, page in pages(site):
        for tag, attributes in page.elements:
            address = attributes.get(LOADED.get(tag, ""))
            assert not re.match(r"(\w+:)?//", address or ""), f"{name}: {address}"
    for style in site.rglob("*.css"):
        addresses = re.findall(r"url\(['\"]?([^)'\"]+)|@import\s+['\"]([^'\"]+)", style.read_text(encoding="utf-8"))
        for address in (one or other for one, other in addresses):
            assert not re.match(r"(https?:)?//", address), f"{style.name}: {address}"


@pytest.mark.browser
@pytest.mark.parametrize(("query", "page"), [("Cholesky", "filters"), ("sensor_pose", "api"), ("zzzz", None)])
def test_a_search_finds_from_a_disk(site: Path, tmp_path: Path, query: str, page: str | None) -> None:
    """As the field asks, see above."""
    dom, console = shown_by_browser(tmp_path, site / "search.html", query=f"?q={query}")
    listed = re.search(r'<ul role="list" class="search">(.*?)</ul>', dom, re.DOTALL)
    assert listed
    found = set(re.findall(r'<a href="([\w/-]+)\.html', listed[1]))
    assert page in found if page else found == set()
    excerpts = [re.sub("<.*?>", "", text) for text in re.findall(r'<p class="context">(.*?)</p>', listed[1], re.DOTALL)]
    assert bool(excerpts) == bool(page)
    assert [text for text in excerpts if query.lower() not in text.lower()] == []
    assert console == []


@pytest.mark.parametrize(
    ("page", "made", "module"),
    [
        ("command-line", command_line_markdown, "cli.docs"),
        ("glossary", glossary, "cli.explain"),
        ("doctor-reference", doctor_reference, "subjects.doctor.docs"),
    ],
)
def test_the_generated_pages_are_up_to_date(page: str, made: Callable[[], str], module: str) -> None:
    shown = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    assert shown == made(), f"run: python -m trackbench.{module} > docs/{page}.md"


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "results" / "README.md", *sorted(DOCS.rglob("*.md"))])
def test_links_lead_somewhere_on_disk_too(page: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    targets: list[Any] = [target for target in re.findall(r"\]\(([^)#\s]+)", text) if not target.startswith("http")]
    assert [target for target in targets if not (page.parent / target).exists()] == []
