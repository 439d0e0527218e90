"""The report: one HTML file that needs nothing else, to be read on a screen, a phone or paper."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.report import breakdown_tables, tables
from trackbench.report.audit_words import audit_sentences
from trackbench.report.autocorrelation import autocorrelation
from trackbench.report.breakdown_figures import errors_by_class
from trackbench.report.claims import NOTABLE, QUANTITIES
from trackbench.report.cost import cost_against_accuracy
from trackbench.report.figures import Look, Picture, looks
from trackbench.report.map import map_of_run
from trackbench.report.page import page
from trackbench.report.series import error_over_time, nees_over_time, nis_over_time, spread
from trackbench.report.wording import Tracker, expectations_met, facts, failure, headline, scored, unscored, verdict
from trackbench.results import Result


def render(result: Result) -> str:
    """The report of a run as the text of an HTML file, the same for the same result.

    It loads nothing from anywhere: styles and figures are in the file.
    """
    summary = result.json()
    look, order = looks(summary), scored(summary)
    shown = [look[tracker["name"]] for tracker in order]
    return page(
        "report.html.j2",
        title=summary["scenario"]["name"],
        summary=summary,
        facts=facts(summary),
        headline=headline(summary),
        expectations_met=expectations_met(summary["expectations"]),
        looks=look,
        shown=shown,
        verdicts=[(tracker["name"], verdict(tracker, summary["runs"]), tracker["describe"]) for tracker in order],
        failures=[(tracker["name"], failure(tracker)) for tracker in unscored(summary)],
        tables={
            "ranked": tables.ranked(summary),
            "per_axis": tables.per_axis(summary),
            "innovations": tables.innovations(summary),
            "key_differences": tables.key_differences(summary),
            "all_differences": tables.all_differences(summary),
            "errors": [breakdown_tables.errors(summary, by) for by in breakdown_tables.BY],
            "confidence": [
                [breakdown_tables.confidence(summary, by, quantity) for quantity in QUANTITIES]
                for by in breakdown_tables.BY
            ],
            "expectations": tables.expectations(summary),
            "sensors": tables.sensors(summary),
        },
        cost=cost_against_accuracy(order, look),
        accuracy=list(_accuracy(result, shown)),
        by_class=list(_by_class(order, look)),
        notable=NOTABLE,
        honesty=list(_honesty(result, shown)),
        audit=audit_sentences(summary["truth"].get("audit") or {}),
    )


def _accuracy(result: Result, shown: list[Look]) -> Iterator[Picture]:
    steps = result.tables["steps"]
    acceleration = result.summary.bound.acceleration_sigma_mps2
    pictures = (
        error_over_time(steps, shown, "position", "m", acceleration),
        error_over_time(steps, shown, "velocity", "m/s", acceleration),
        spread(steps, shown),
        map_of_run(result.tables, result.json()["recorded_run"], shown),
    )
    return (picture for picture in pictures if picture)


def _by_class(order: list[Tracker], look: dict[str, Look]) -> Iterator[Picture]:
    quantities = zip(QUANTITIES, ("m", "m/s"), strict=True)
    pictures = (errors_by_class(order, look, by, *quantity) for quantity in quantities for by in breakdown_tables.BY)
    return (picture for picture in pictures if picture)


def _honesty(result: Result, shown: list[Look]) -> Iterator[Picture]:
    nees = nees_over_time(result.tables["steps"], shown)
    sensors = list(enumerate(result.json()["sensors"]))
    nis = (nis_over_time(result.tables["nis"], sensor, shown, number) for number, sensor in sensors)
    correlation = result.tables["autocorrelation"]
    white = (autocorrelation(correlation, sensor, shown, number) for number, sensor in sensors)
    return (picture for picture in (nees, *nis, *white) if picture)
