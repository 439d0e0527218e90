"""The state of a recorded run at a time, and its worst moments, for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Console

from trackbench.base.errors import InputError
from trackbench.document import Table
from trackbench.document.terminal import print_table
from trackbench.metrics.function_events import drawn_instants
from trackbench.metrics.recorded_run import estimates_at, table_frame
from trackbench.report.console import print_summary
from trackbench.report.numbers import rounded
from trackbench.results import Result
from trackbench.subjects.recording.data import read
from trackbench.subjects.recording.focus import Opening, require_time, worst_moments
from trackbench.subjects.recording.moments import ESTIMATE, MISSED, TRACK, moments_table, rows_table


def inspect(path: Path, opening: Opening, console: Console) -> None:
    """Print the scores of a recorded run, its errors or tracks at a time, or its worst moments.

    Args:
        path: folder of the run, or its recording.
        opening: time to print, or number of worst moments; neither prints the scores.
        console: receives the text.

    Raises:
        InputError: the run cannot be read, or lacks the time, tracker, vehicle or function.
    """
    if opening.vehicle is not None and opening.worst is None:
        raise InputError("chooses whose worst moments are shown: give --worst with it", key="--vehicle")
    result = read(path).result
    moments = worst_moments(result, opening)
    summary = result.summary
    if opening.at_s is None and opening.worst is None:
        print_summary(result, console)
        return
    console.print(f"{result.name}: run {summary.recorded_run} of {summary.runs}, seed {summary.seed}")
    tables: list[Table] = []
    if opening.at_s is not None:
        require_time(result, opening.at_s)
        hidden = summary.identities == "hidden"
        tables += tracks_at(result, opening.at_s, opening.tracker) if hidden else errors_at(result, opening.at_s)
    elif moments:
        tables.append(moments_table(moments, "The worst first"))
    else:
        reason = "Nothing that counts went wrong" if summary.truth.known else "Without truth no event has a cost"
        console.print(f"{reason}.")
    for table in tables:
        console.print()
        print_table(table, console)
    for failed in (tracker for tracker in summary.trackers if tracker.failed is not None):
        console.print(f"{failed.name} failed: {failed.failed}")
    if moments and summary.has_recording:
        chosen = {name: getattr(opening, name) for name in ("tracker", "vehicle", "function")}
        options = "".join(f" --{name} {value}" for name, value in chosen.items() if value is not None)
        console.print(f"\ntrackbench view {path} --worst{options}", style="dim", soft_wrap=True)


def errors_at(result: Result, time: float) -> Iterator[Table]:
    """Yield the table of each tracker's and vehicle's latest errors up to a time, s."""
    instants = result.tables.truth["time_s"].to_numpy()
    estimates = [asdict(estimate) for estimate in estimates_at(result, time)]
    caption = f"At {rounded(float(instants[instants <= time + 1e-9].max()), 3)} s"
    yield rows_table(ESTIMATE, sorted(estimates, key=lambda estimate: str(estimate["object"])), caption)


def tracks_at(result: Result, time: float, only: str | None) -> Iterator[Table]:
    """Yield tables of vehicles that lack a track, and of all tracks, at the latest instant up to a time, s.

    ``only`` is the name of one tracker; None for all trackers.
    """
    tables, instants = result.tables, drawn_instants(result.tables)
    now = float(instants[max(0, int(np.searchsorted(instants, time + 1e-9)) - 1)]) if len(instants) else 0.0
    names = [only] if only is not None else list(result)
    states = table_frame(tables.objects, "tracker", "object", "state", "time_s", "until_s")
    inside = (states["time_s"] <= now + 1e-9) & (now + 1e-9 < states["until_s"])
    missed = states[inside & states["state"].isin(["waiting", "lost"]) & states["tracker"].isin(names)]
    tracks = table_frame(tables.tracks, "time_s", *TRACK)
    current = tracks[((tracks["time_s"] - now).abs() < 1e-9) & tracks["tracker"].isin(names)]
    rows = current.astype({"track": int, "existence": object})
    yield rows_table(MISSED, missed.to_dict("records"), f"At {rounded(now, 3)} s, due vehicles without a track")
    yield rows_table(TRACK, rows.where(rows.notna(), None).to_dict("records"), "Tracks")
