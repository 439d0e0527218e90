"""The report of a run of hidden identities, also in a browser, and the page that describes it."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Annotation
from rich.console import Console
from tests.support.browser import look
from tests.support.places import DOCS

from trackbench.base.errors import InputError
from trackbench.document import Document, Figure, Section, every
from trackbench.document.drawing import svg_file
from trackbench.document.files import document_text
from trackbench.document.html import to_html
from trackbench.metrics.function_events import events_of
from trackbench.report.console import print_summary
from trackbench.report.figures.map import draw_surroundings
from trackbench.report.result import result_document
from trackbench.report.tables import ranking_table
from trackbench.results import Result, TrackerResult


@pytest.fixture(scope="module")
def document(traffic_result: Result) -> Document:
    return result_document(traffic_result)


def titles(document: Document) -> list[str]:
    return [block.title for block in every(document.blocks) if isinstance(block, Section)]


def test_every_figure_is_drawn(document: Document) -> None:
    assert {figure.name for figure in document.figures} == {"gospa", "map"}
    for figure in document.figures:
        assert svg_file(figure).startswith("<svg"), figure.name
        assert len(figure.caption) > 30
        assert len(figure.alternative) > 30


def test_the_best_is_not_the_one_that_knows_the_origins(document: Document, traffic_result: Result) -> None:
    best = traffic_result.contenders[0].name
    assert best != "oracle"
    assert f"{best} has the smallest T-GOSPA" in document_text(document)


def test_a_metric_of_another_name_has_the_nearest(traffic_result: Result) -> None:
    with pytest.raises(InputError, match="no metric 'gopsa' of this tracker; did you mean 'gospa'"):
        traffic_result["gnn"].metrics["gopsa"]
    assert "gopsa" not in traffic_result["gnn"].metrics
    assert traffic_result["gnn"].metrics.get("gopsa") is None


def test_a_reference_is_marked_and_next_to_nobody(document: Document, traffic_result: Result) -> None:
    (table,) = (table for table in document.tables if table.name == "differences")
    *others, last = table.rows
    assert [row[0].text for row in others] == [tracker.name for tracker in traffic_result.contenders[1:]]
    assert (last[0].text, last[0].details) == ("oracle", ("reference",))
    (table,) = (table for table in document.tables if table.name == "ranking")
    marked = {row[0].text for row in table.rows if row[0].details == ("reference",)}
    assert marked == {"oracle"}
    assert "between those that share a letter" in " ".join(document_text(document).split())


@pytest.mark.parametrize("nees", [3.0, 12345.6])
def test_the_terminal_has_room(traffic_result: Result, nees: float, capsys: pytest.CaptureFixture[str]) -> None:
    def with_nees(tracker: TrackerResult) -> TrackerResult:
        found = tracker.metrics["nees"].model_copy(update={"value": nees})
        return tracker.model_copy(update={"metrics": {**tracker.metrics, "nees": found}})

    changed = traffic_result.updated(trackers=[with_nees(tracker) for tracker in traffic_result.summary.trackers])
    print_summary(changed, Console(width=80))
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 and line == line.rstrip() and line for line in lines)
    first = next(i for i, line in enumerate(lines) if line.startswith("tracker")) + 1
    rows = lines[first : first + 4]
    names = [line.split()[0] for line in rows]
    assert sorted(names) == ["gnn", "naive", "oracle*", "pmb"]
    # An oracle is in no group.
    assert [len(line.split()) for line in rows] == [10 if name == "oracle*" else 11 for name in names]
    assert lines[first + 4] == "group: no difference over 5.6 to 13 mm shown between those that share a letter"


@pytest.mark.parametrize("width", [40, 60, 80])
def test_columns_that_do_not_fit_go_on_below(traffic_result: Result, width: int) -> None:
    def printed(columns: int) -> list[str]:
        output = io.StringIO()
        print_summary(traffic_result, Console(file=output, width=columns))
        return output.getvalue().splitlines()

    lines = printed(width)
    assert all(len(line) <= width for line in lines)
    headings = [line.split()[1:] for line in lines if line.startswith("tracker")]
    (wide,) = [line.split()[1:] for line in printed(200) if line.startswith("tracker")]
    assert [word for part in headings for word in part] == wide


def test_marks_of_the_figures_are_those_of_their_legends(document: Document) -> None:
    marks = {figure.name: {entry.label: entry.mark for entry in figure.legend} for figure in document.figures}
    assert marks["map"]["false track begins"] == "triangle"
    (found,) = (figure for figure in document.figures if figure.name == "map")
    assert "the recording has all" in found.caption


def test_names_on_a_map_do_not_cover_each_other(traffic_result: Result) -> None:
    paths = {name: (np.array([0.0, end]), np.zeros(2)) for name, end in (("lorry", 300.0), ("second", 310.0))}
    found: list[float] = []

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        draw_surroundings(axes, traffic_result.tables.roads, [], paths, (1.0, 10.0))
        found.extend(note.xyann[1] for note in axes.texts if isinstance(note, Annotation))

    svg_file(Figure("map", "Map", "", "", paint, 100))
    assert abs(found[0] - found[1]) >= 10


def test_the_costliest_events_are_listed_with_the_commands_that_show_them(
    document: Document, traffic_result: Result
) -> None:
    (table,) = (table for table in document.tables if table.name == "costliest-events")
    (cost,) = (float(row[5].text) for row in table.rows if row[0].text == "naive")
    assert cost == pytest.approx(max(event.cost_m2 for event in events_of(traffic_result, "naive", 0)), abs=0.06)
    assert f"trackbench view . --worst --tracker {traffic_result.scored[0].name}" in document_text(document)


def test_headings_are_the_terms_of_the_field(document: Document) -> None:
    headings = {column.heading for table in document.tables for column in table.columns}
    assert {"GOSPA, m", "HOTA", "IDF1", "T-GOSPA, m", "DetA", "AssA", "position RMSE, m", "NEES"} <= headings


def test_a_failed_tracker_and_one_alone(failing_result: Result) -> None:
    document = result_document(failing_result)
    assert "Not ranked" in titles(document)
    assert "Differences between trackers" not in titles(document)
    assert "ValueError: out of order" in document_text(document)
    assert "gnn has a T-GOSPA of" in document_text(document)
    assert "failing" in to_html(document)
    assert [row[0].text for row in ranking_table(failing_result).rows] == ["gnn"]


def test_all_trackers_failed(failing_result: Result) -> None:
    only = failing_result.updated(trackers=[failing_result["failing"]], ranking=["failing"], differences=[])
    empty = {
        name: table.slice(0, 0) if "tracker" in table.column_names else table for name, table in only.tables.items()
    }
    document = result_document(Result(only.summary, type(only.tables)(empty)))
    assert "no tracker is ranked" in document_text(document)
    assert document.figures == []


def test_long_names_and_many_trackers_are_drawn(traffic_result: Result) -> None:
    names = {name: f"a_tracker_with_a_rather_long_name_{name}" for name in traffic_result}
    summary = traffic_result.summary.model_dump_json()
    tables = {}
    for name, longer in names.items():
        summary = summary.replace(f'"{name}"', f'"{longer}"')
    for name, table in traffic_result.tables.items():
        if "tracker" in table.column_names:
            column = [names[str(value)] for value in table["tracker"].to_pylist()]
            table = table.set_column(table.column_names.index("tracker"), "tracker", [column])
        tables[name] = table
    renamed = Result(type(traffic_result.summary).model_validate_json(summary), type(traffic_result.tables)(tables))
    document = result_document(renamed)
    assert len(document.figures) == 2
    for figure in document.figures:
        assert "a_tracker" in svg_file(figure)


def test_errors_of_matched_tracks_say_from_where_on_a_track_is_matched(document: Document) -> None:
    assert "Errors and NEES are of tracks within 2.5 m of their object" in document_text(document)
    (table,) = (table for table in document.tables if table.name == "errors-of-matched-tracks")
    assert "NEES inside" in [column.heading for column in table.columns]


@pytest.mark.browser
@pytest.mark.slow
def test_the_page_fits_its_screen(
    tmp_path_factory: pytest.TempPathFactory, traffic_result: Result, failing_result: Result
) -> None:
    results = {"traffic": traffic_result, "failing": failing_result}
    pages = {name: to_html(result_document(result)) for name, result in results.items()}
    seen = look(tmp_path_factory.mktemp("browser"), pages, (390, 1280))
    assert seen.console == []
    for (page, width), frame in seen.frames.items():
        assert frame["scrollWidth"] <= width, page
        assert frame["overflowing"] == [], page
        assert frame["smallest"] >= 12
        assert len(frame["figures"]) == 2


PAGE = DOCS / "traffic.md"


@pytest.mark.docs_pages
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 10
    names = {file.name for file in (tmp_path / "exported").rglob("*") if file.is_file()}
    assert names == {"gt.txt", "seqinfo.ini", "motorway.txt", "events.csv"}
