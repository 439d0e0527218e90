"""A history as a call, and its files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from trackbench.api.result import Report
from trackbench.api.scenario import listed
from trackbench.compare.limits import Limit
from trackbench.document.files import files
from trackbench.results import json_text
from trackbench.results.metric_value import data_frame, value_columns
from trackbench.subjects.history.changes import OPTION
from trackbench.subjects.history.history import WINDOW, History, history_of
from trackbench.subjects.history.report import history_document


class ReportableHistory(History):
    """The results of a scenario over time. A notebook shows it as a page, ``print`` as text."""

    def report(self) -> Report:
        """The page that ``trackbench history`` writes."""
        return Report(history_document(self))

    def to_pandas(self) -> Any:
        """A data frame: a row for each result, tracker and metric."""
        return data_frame(
            {
                "result": entry.number,
                "made_at": entry.made_at and datetime.fromisoformat(entry.made_at),
                "commit": entry.commit,
                "tracker": tracker,
                "metric": metric,
                **value_columns(value),
            }
            for entry in self.results
            for tracker, values in entry.values.items()
            for metric, value in values.items()
        )

    def __repr__(self) -> str:
        return f"<history of {self.scenario}: {len(self.results)} results, {len(self.changes)} changes>"

    def __str__(self) -> str:
        return str(self.report())

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def history(
    folders: Path | str | Sequence[Path | str],
    *,
    metrics: Sequence[str] = (),
    trackers: Sequence[str] | None = None,
    scenario: str | None = None,
    limits: Mapping[str, float] | None = None,
    window: int = WINDOW,
) -> ReportableHistory:
    """Lay the results of a scenario in time, and find where a metric is shown to have changed.

    Args:
        folders: of runs, or of folders of runs, however deep.
        metrics: what to look at; unless given ``position_rmse``, or ``tgospa`` where identities are hidden.
        trackers: names of those to look at; all unless given.
        scenario: its name; that of most of the results unless given.
        limits: by metric, by how many percent the last result may be worse than those of the window.
        window: number of results before the last one.

    Raises:
        InputError: there are no results, one cannot be read, or a name is not there.
    """
    places = [folders] if isinstance(folders, Path | str) else folders
    past = history_of(
        [Path(place) for place in places],
        metrics=listed(metrics),
        trackers=None if trackers is None else listed(trackers),
        scenario=scenario,
        limits=[Limit.parse(f"{metric}:{percent}", OPTION) for metric, percent in (limits or {}).items()],
        window=window,
    )
    return ReportableHistory.model_validate(dict(past))


def history_files(past: History, folder: Path) -> Iterator[tuple[Path, bytes]]:
    """The page, the same as Markdown with its figures, and the data."""
    document = history_document(past)
    for format in ("html", "markdown"):
        for name, content in files(document, format, "history"):
            yield folder / name, content()
    yield folder / "history.json", json_text(past.json()).encode()
