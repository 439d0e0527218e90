"""The tables of a recorded run's moments, estimates and tracks, for the terminal and for recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from trackbench.document import Column, Table
from trackbench.metrics.function_events import FunctionEvent, TrackEvent
from trackbench.metrics.recorded_run import EstimateMoment
from trackbench.report.numbers import rounded
from trackbench.report.tables import TRACKER, text_table
from trackbench.subjects.recording.focus import Moment

#: Columns of a missed vehicle, an estimate, a track, and each kind of moment.
MISSED = ("object", "tracker", "state")
ERRORS = ("position_error_m", "velocity_error_mps", "nees")
ESTIMATE = ("object", "tracker", *ERRORS)
TRACK = ("tracker", "track", "px_m", "py_m", "existence")
MOMENTS: dict[type, tuple[str, ...]] = {
    EstimateMoment: ("tracker", "time_s", "object", *ERRORS),
    TrackEvent: ("tracker", "time_s", "kind", "object", "track", "cost_m2", "reason"),
    FunctionEvent: ("tracker", "time_s", "object", "word", "wrong_s"),
}
HEADINGS = {
    "object": "vehicle", "px_m": "x, m", "py_m": "y, m",
    "position_error_m": "error, m", "velocity_error_mps": "error, m/s", "nees": "NEES", "time_s": "time, s",
    "kind": "event", "cost_m2": "cost, m²", "reason": "why", "word": "what", "wrong_s": "by, s",
}  # fmt: skip


def _values(moment: Moment) -> dict[str, Any]:
    if isinstance(moment, EstimateMoment):
        return asdict(moment)
    if isinstance(moment, FunctionEvent):
        return {**moment._asdict(), "word": moment.word, "wrong_s": moment.wrong_s}
    return {**moment._asdict(), "reason": moment.reason}


def moments_table(moments: Sequence[Moment], caption: str = "") -> Table:
    """Return a table with a row for each moment; there must be at least one, and all must have the same class."""
    return rows_table(MOMENTS[type(moments[0])], [_values(moment) for moment in moments], caption)


def rows_table(names: Sequence[str], rows: Sequence[dict[str, Any]], caption: str = "") -> Table:
    """Return a table of rows, with the columns ``names``."""
    texts = {name for name in names for row in rows[:1] if isinstance(row[name], str)}
    columns = {
        TRACKER if name == "tracker" else Column(HEADINGS.get(name, name), left=name in texts): partial(_cell, name)
        for name in names
    }
    return text_table("moments", rows, columns, caption)


def _cell(name: str, row: dict[str, Any]) -> str:
    value = row[name]
    return rounded(value, 2) if isinstance(value, float | None) else str(value)
