"""A document in every format: LaTeX, CSV, SVG, PDF, Markdown, terminal and HTML say the same."""

from __future__ import annotations

import csv
import io
import re
from functools import cache

import pytest
from matplotlib.figure import Figure as Canvas
from tests.support.example_result import make_result

from trackbench.document import (
    Cell,
    Code,
    Column,
    Document,
    Figure,
    Item,
    Items,
    LegendEntry,
    Paragraph,
    Row,
    Section,
    Status,
    Table,
    TrackerStyle,
)
from trackbench.document.drawing import INK, MUTED
from trackbench.document.files import FORMATS, Format, document_text, files, to_csv
from trackbench.document.html import to_html
from trackbench.report.result import result_document
from trackbench.results import Result

#: What any of the formats could take for its own.
HOSTILE = r"50 % of $x_1$ & {y} # ~^\end{document} <b> `*[a]* | --"
STYLE = TrackerStyle("t0", "ekf_cv", "#123456")


class Painter:
    """Draws a line, and counts how often."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, canvas: Canvas) -> None:
        self.count += 1
        axes = canvas.add_subplot(xlabel="time, s")
        axes.plot([0, 1], [2, 3], color=STYLE.colour, gid=STYLE.key)
        axes.axhline(2.5, color=INK)
        axes.axhspan(2.1, 2.2, color=MUTED)


TABLE = Table(
    "ranking",
    (Column("tracker", left=True), Column("RMSE, m", details="95 % interval"), Column("note, %", left=True)),
    (
        (Cell("ekf_cv", tracker="ekf_cv"), Cell("\N{MINUS SIGN}0.12", ("0.11 to 0.13",), strong=True), Cell(HOSTILE)),
        (Cell("raw"), Cell("n/a", reason="it gives no velocity"), Cell("95\N{NO-BREAK SPACE}%", link="raw.html")),
        (Cell("mine"), Cell("n/a", reason="it gives no velocity"), Cell("")),
    ),
    caption="The ranking",
)


def document(painter: Painter) -> Document:
    figure = Figure(
        "error",
        "Error over time",
        "A caption that says what is drawn.",
        "The error grows from 2 to 3.",
        painter,
        200,
        legend=(LegendEntry("ekf_cv", STYLE.colour, key=STYLE.key), LegendEntry("the noise", MUTED, "band")),
        tooltips={STYLE.key: STYLE.name},
    )
    verdict = Section(
        "Verdict",
        (
            Paragraph("ekf_cv is the best.", strong=True),
            Status("1 of 2 failed", "bad"),
            Items((Item(HOSTILE, "ekf_cv", "small print"), Item("it failed", "mine", tone="bad"))),
            TABLE,
        ),
    )
    more = Section("More", (Code("key: 1\n  deep: '```'  # 5 %\n", "yaml"),), folded=True)
    return Document(
        "report", f"Title {HOSTILE}", (verdict, Section("Figures", (Row((figure,)), more))), "A lead.", ("1 run",),
        (STYLE,),
    )  # fmt: skip


@cache
def made(format: Format) -> tuple[dict[str, bytes], int]:
    painter = Painter()
    found = {name: content() for name, content in files(document(painter), format)}
    return found, painter.count


@pytest.mark.parametrize("format", FORMATS)
def test_the_same_document_gives_the_same_bytes(format: Format) -> None:
    assert made.__wrapped__(format) == made(format)


def test_csv_read_back_is_the_table() -> None:
    assert list(csv.reader(io.StringIO(to_csv(TABLE)))) == [
        ["tracker", "RMSE, m", "RMSE, m: 95 % interval", "note, %"],
        ["ekf_cv", "-0.12", "0.11 to 0.13", HOSTILE],
        ["raw", "n/a", "", "95 %"],
        ["mine", "n/a", "", ""],
    ]


@pytest.fixture(scope="module", params=["example", "tiny"])
def of_run(request: pytest.FixtureRequest, tiny_result: Result) -> Document:
    """The report of a result with one of everything, and of a run."""
    return result_document(make_result() if request.param == "example" else tiny_result)


def test_every_table_of_a_run_reads_back_from_csv(of_run: Document) -> None:
    assert len(of_run.tables) > 5
    names = [name for name, _ in files(of_run, "csv")]
    assert names == [f"tables/{table.name}.csv" for table in of_run.tables]
    assert len(set(names)) == len(names)
    for table in of_run.tables:
        heading, *rows = csv.reader(io.StringIO(to_csv(table)))
        assert len(rows) == len(table.rows)
        assert len(set(heading)) == len(heading), "a heading says what its column is"
        assert all(len(row) == len(heading) for row in rows)
        assert [row[0] for row in rows] == [row[0].text for row in table.rows]


def balanced(source: str) -> bool:
    """Whether every environment and every brace that is not escaped is closed, in order."""
    bare = re.sub(r"\\[\\{}%]", "", source)
    depth = 0
    for letter in bare:
        depth += (letter == "{") - (letter == "}")
        if depth < 0:
            return False
    opened: list[str] = []
    for what, name in re.findall(r"\\(begin|end)\{(\w+)\}", source):
        if what == "begin":
            opened.append(name)
        elif not opened or opened.pop() != name:
            return False
    return depth == 0 and not opened


def test_latex_is_balanced_and_escaped() -> None:
    source = made("latex")[0]["tables/ranking.tex"].decode()
    assert balanced(source)
    assert not balanced(source.replace(r"\end{tabular}", "", 1))
    assert source.startswith("% The ranking\n% n/a: it gives no velocity\n\\begin{tabular}{@{}")
    # Outside of a comment, nothing special is left bare.
    assert not re.search(r"(?<!\\)[%#]", re.sub(r"(?m)^% .*", "", source))
    assert r"\textbf{ekf\_cv} & \textbf{$-$0.12 (0.11 to 0.13)}" in source
    assert "95~\\%" in source


@pytest.mark.parametrize("width", [80, 50])
def test_a_terminal_shows_every_cell_in_its_width(of_run: Document, width: int) -> None:
    shown = document_text(of_run, width)
    assert max(map(len, shown.splitlines())) <= max(width, max(len(c.text) for c in codes(of_run)))
    words = {word.rstrip(";") for word in shown.split()}
    for table in of_run.tables:
        for row in table.rows:
            assert {word for cell in row for word in cell.text.split()} <= words
    assert "Over time" not in shown.splitlines(), "it holds figures alone"


def codes(found: Document) -> list[Code]:
    from trackbench.document import all_blocks

    return [
        Code(line) for block in all_blocks(found.blocks) if isinstance(block, Code) for line in block.text.splitlines()
    ]


def test_a_page_escapes_what_is_hostile() -> None:
    page = to_html(document(Painter()))
    assert "<b>" not in page
    assert page.count("&lt;b&gt;") >= 3
    assert '<a href="raw.html">' in page
    assert 'aria-label="The error grows from 2 to 3."' in page
