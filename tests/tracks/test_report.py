"""The report of a run of hidden identities, also in a browser, and the page that describes it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.browser import look
from tests.support.places import DOCS

from trackbench.base.errors import InputError
from trackbench.document import Document, Section, all_blocks
from trackbench.document.drawing import figure_file
from trackbench.document.files import document_text
from trackbench.document.html import to_html
from trackbench.metrics.function_events import events_of
from trackbench.report.numbers import percent
from trackbench.report.result import result_document
from trackbench.report.tables import ranking_table
from trackbench.results import Result


@pytest.fixture(scope="module")
def document(traffic_result: Result) -> Document:
    return result_document(traffic_result)


def titles(document: Document) -> list[str]:
    return [block.title for block in all_blocks(document.blocks) if isinstance(block, Section)]


def test_every_figure_is_drawn(document: Document) -> None:
    assert {figure.name for figure in document.figures} == {"gospa", "map"}
    for figure in document.figures:
        assert figure_file(figure, "svg").startswith(b"<svg"), figure.name
        assert len(figure.caption) > 30
        assert len(figure.alternative) > 30


def test_the_time_line_of_the_replay_has_the_gospa_of_the_recorded_run(
    document: Document, traffic_result: Result
) -> None:
    (scene,) = (figure.replay for figure in document.figures if figure.replay)
    runs = traffic_result.to_pandas("runs")
    recorded = runs[runs["run"] == traffic_result.summary.recorded_run].set_index("tracker")
    (chart,) = scene.beside
    assert {line.name for line in chart.lines} == {tracker.name for tracker in traffic_result.drawn}
    for line in chart.lines:
        assert (line.value**2).sum() == pytest.approx(recorded["gospa_total"][line.name]), line.name
    # The best has no event here, so it opens at its largest GOSPA.
    (best,) = (line for line in chart.lines if line.name == scene.shown[0])
    assert scene.shown[0] not in {event.tracker for event in scene.events}
    assert scene.start is not None
    assert scene.start.time_s == best.time[best.value.argmax()]


def test_the_best_is_not_the_one_that_knows_the_origins(document: Document, traffic_result: Result) -> None:
    best = traffic_result.contenders[0].name
    assert best != "oracle"
    assert f"{best} has the smallest T-GOSPA" in document_text(document)


def test_a_metric_of_another_name_has_the_nearest(traffic_result: Result) -> None:
    with pytest.raises(InputError, match="no metric 'gopsa' of this tracker; did you mean 'gospa'"):
        traffic_result["gnn"].metrics["gopsa"]
    assert "gopsa" not in traffic_result["gnn"].metrics
    assert traffic_result["gnn"].metrics.get("gopsa") is None


def test_the_costliest_causes_have_their_share_of_the_cost(document: Document, traffic_result: Result) -> None:
    (table,) = (table for table in document.tables if table.name == "causes")
    events = [event for event in events_of(traffic_result, "naive") if event.cost_m2 > 0]
    _, kind, why, times, share = next([cell.text for cell in row] for row in table.rows if row[0].text == "naive")
    of_cause = [event.cost_m2 for event in events if (event.kind, event.cause) == (kind, why)]
    assert int(times) == len(of_cause)
    assert share == percent(sum(of_cause) / sum(event.cost_m2 for event in events))


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
    assert run_page(PAGE, tmp_path) == 9
    names = {file.name for file in (tmp_path / "exported").rglob("*") if file.is_file()}
    assert names == {"gt.txt", "seqinfo.ini", "truck_hides_car.txt"}
