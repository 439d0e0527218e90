"""The report of one run as a page."""

from __future__ import annotations

import io
from html.parser import HTMLParser

import pyarrow as pa
import pytest
from rich.console import Console
from tests.support.example_result import (
    RMSE,
    failed_tracker,
    make_differences,
    make_result,
    make_summary,
    make_tables,
)
from tests.support.results import with_differences

from trackbench.document.html import to_html
from trackbench.report.console import print_summary
from trackbench.report.pairs import Pairs
from trackbench.report.result import result_document
from trackbench.results import Result


class Page(HTMLParser):
    """What the tests look at in a page: elements with their attributes, nesting, and text."""

    VOID = ("meta", "link", "input", "br")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None], tuple[str, ...]]] = []
        self.rows: list[list[str]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        assert self._open == [], "every element is closed"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs), tuple(self._open)))
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs), tuple(self._open)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "script"} & {*self._open}:
            # Between a number and its unit there is no break.
            self.text += data.replace("\N{NO-BREAK SPACE}", " ")
        if self._open and {"td", "th"} & {*self._open} and "small" not in self._open and "svg" not in self._open:
            self.rows[-1][-1] += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes, _ in self.elements if name == tag]


def render(result: Result) -> str:
    return to_html(result_document(result))


@pytest.fixture(scope="module")
def text() -> str:
    return render(make_result())


@pytest.fixture(scope="module")
def page(text: str) -> Page:
    return Page(text)


def ranked_rows(page: Page) -> dict[str, list[str]]:
    return {row[0]: row for row in page.rows if len(row) > 8 and row[0] in RMSE}


def test_the_page_loads_nothing(text: str, page: Page) -> None:
    links = [value for _, attributes, _ in page.elements for key, value in attributes.items() if key in ("href", "src")]
    assert all(str(link).startswith(("#", "data:")) for link in links)
    assert not {"iframe", "img"} & {tag for tag, _, _ in page.elements}
    assert page.all("script") == [{"type": "text/plain"}, {}, {}]
    assert "http://" not in text
    assert "https://" not in text
    assert "@import" not in text


def test_ranked_values_are_those_of_the_result(page: Page) -> None:
    rows = ranked_rows(page)
    assert list(rows) == list(RMSE)
    assert {name: float(row[1]) for name, row in rows.items()} == RMSE
    assert rows["ekf_tight"][6] == "96.00"
    assert {row[8] for row in rows.values()} == {"99.0"}
    assert rows["ekf_tight"][9:11] == ["3", "7"]
    assert [row[2] for row in rows.values()] == ["a", "a", "b", "c", "d", "e"]
    assert "±0.008" in page.text


def test_missing_values_are_na_with_their_reason(page: Page) -> None:
    assert ranked_rows(page)["raw"][4].startswith("n/a")
    assert ranked_rows(page)["alpha_beta"][6].startswith("n/a")
    reasons = [abbreviation["title"] for abbreviation in page.all("abbr")]
    assert "raw gives no velocity" in reasons
    assert page.text.count("raw gives no velocity") == 1
    assert "None" not in page.text
    assert "nan" not in page.text


def test_verdicts_in_words(page: Page) -> None:
    assert "ukf_ctrv has the smallest position error, 0.382 m; not shown better than ekf_ctrv in" in page.text
    assert any([row[0], row[-1]] == ["ekf_cv", "too large"] for row in page.rows)
    assert any([row[0], row[-1]] == ["ekf_ctrv", "turning 39.7, straight 2.9"] for row in page.rows)
    assert "the tracker gives no covariance" in page.text
    assert "1 of 2 expectations of the scenario failed" in page.text
    rows = [[text.replace("\N{NO-BREAK SPACE}", " ") for text in row] for row in page.rows]
    assert any(row[:3] == ["stated velocity", "off by 5.3 m/s", "v2 at 4.50 s"] for row in rows)
    assert ["position jump", "1.4 m", "v3 at 15.00 s", "left out from then on"] in rows


def test_a_failed_tracker_is_shown_with_its_cause(page: Page) -> None:
    assert "ValueError: matrix <3> is singular (step 12, 0.60 s, sensor roof_lidar, run 0, object v1)" in page.text
    assert "mine" not in ranked_rows(page)


def test_text_is_escaped() -> None:
    summary = make_summary()
    attack = "<script>alert('x')</script>"
    summary["scenario"] |= {"name": attack, "description": attack, "text": attack}
    summary["truth"]["objects"][0] = attack
    tables = make_tables()
    for name in ("truth", "estimates", "measurements"):
        at = tables[name].column_names.index("object")
        objects = [attack if value == "v1" else value for value in tables[name]["object"].to_pylist()]
        tables[name] = tables[name].set_column(at, "object", pa.array(objects))
    page = Page(render(Result.from_json(summary, tables)))
    assert all("alert" not in str(script) for script in page.all("script"))
    assert len(page.all("script")) == 3
    assert page.text.count(attack) >= 3


def test_every_tracker_failed() -> None:
    summary = make_summary()
    summary |= {"trackers": [failed_tracker()], "ranking": ["mine"]}
    empty = pa.table({})
    page = Page(
        render(
            Result.from_json(
                summary,
                {
                    **make_tables(),
                    **dict.fromkeys(("steps", "nis", "estimates", "autocorrelation", "differences"), empty),
                },
            )
        )
    )
    assert "mine failed; no tracker is ranked" in page.text
    assert "is singular" in page.text
    assert [figure["id"] for figure in page.all("figure")] == ["map"]


def test_what_is_charged_for_missing_estimates_is_told() -> None:
    summary = make_summary()
    pairs = make_differences()
    for place, item in enumerate(pairs):
        if item.b == "ekf_cv" and item.a in ("ukf_ctrv", "ekf_ctrv"):
            update = {"better": None, "verdict": "smaller", "without_charged": -item.value}
            pairs[place] = item.model_copy(update=update)
    for entry in summary["trackers"]:
        if entry["name"] == "ekf_cv":
            entry["metrics"]["position_rmse"] |= {"charged_share": 0.42, "without_charged": 0.1234}
    result = with_differences(Result.from_json(summary, make_tables()), pairs)
    page, console = Page(render(result)), Console(file=io.StringIO(), width=80)
    print_summary(result, console)
    terminal = console.file.getvalue()
    assert max(map(len, terminal.splitlines())) <= 80
    for text in (page.text, terminal):
        flat = " ".join(text.split())
        charge = "42 % of its squared position error is the charge for missing estimates (0.123 m without it)"
        assert f"ekf_cv: {charge}" in flat
        for name in ("ukf_ctrv", "ekf_ctrv"):
            assert f"{name} is not called better than ekf_cv: its errors are smaller only with that charge" in flat
    assert "given 0.123" in page.text
    assert {name: row[2] for name, row in ranked_rows(page).items()}["ekf_cv"] == "a"
    for a, b, verdict in (("ukf_ctrv", "ekf_cv", "smaller"), ("ekf_cv", "ukf_ctrv", "larger")):
        pair = Pairs(result).get(a, b)
        assert pair is not None
        assert pair.verdict == verdict
