"""What has to be the same wherever a result was made."""

from __future__ import annotations

from typing import Any

from trackbench.results import Result


def without_times(result: Result) -> dict[str, Any]:
    """The summary and the tables, but for the time of a step."""
    summary = result.json()
    for tracker in summary["trackers"]:
        tracker["metrics"].pop("step_time", None)
    tables = {name: [str(column) for column in table.to_pydict().items()] for name, table in result.tables.items()}
    return {**summary, "tables": tables}
