"""What a recorded run shows at a time, and when each tracker was worst: as values, and for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from trackbench.document import Column
from trackbench.document.terminal import print_table
from trackbench.metrics.function_events import FunctionEvent, TrackEvent, drawn_instants
from trackbench.metrics.recorded_run import EstimateMoment, estimates_at, latest_rows, table_frame
from trackbench.report.console import print_summary
from trackbench.report.numbers import rounded
from trackbench.report.tables import TRACKER, text_table
from trackbench.results import Result
from trackbench.results.columns import split
from trackbench.subjects.recording.data import Recorded, read
from trackbench.subjects.recording.focus import WHOLE, Moment, Opening, require_name, require_time, worst_moments

#: Probability of each mode, by tracker that has several motion models, by vehicle and by mode.
Modes = dict[str, dict[str, dict[str, float]]]
#: Words for the numbers in the table ``due``.
STATUS = ("absent", "optional", "due")


@dataclass(frozen=True)
class Inspection:
    """A recorded run with the moments that were asked for."""

    recorded: Recorded
    at: dict[str, Any] | None = None
    """The latest of everything up to a time, as a viewer shows it: ``time_s``, ``vehicles`` that are there, with their
    ``measurements`` and ``estimates``. With hidden identities ``tracks`` in their place, and of a vehicle the
    ``status`` and by tracker in ``states`` whether it is waiting, tracked, switched, lost, or not due."""
    worst: Sequence[Moment] | None = None
    """Moments by tracker, contenders first; with hidden identities or of a function events, the worst first."""
    modes: Modes = field(default_factory=dict)
    """Probability of each mode at the time that was asked for."""
    function: str | None = None
    """Function whose events the moments are."""

    def json(self) -> dict[str, Any]:
        """Return everything as JSON values; moments that were not asked for are left out."""
        summary = self.recorded.result.summary
        values: dict[str, Any] = {
            "file": str(self.recorded.path),
            "scenario": summary.scenario.name,
            "description": summary.scenario.description,
            "command": summary.command,
            "seed": summary.seed,
            "runs": summary.runs,
            "recorded_run": summary.recorded_run,
            "objects": summary.truth.objects,
            "duration_s": summary.truth.duration_s,
            "fingerprint": summary.fingerprint,
            "versions": summary.versions,
            "trackers": [tracker.model_dump(mode="json") for tracker in summary.trackers],
        }
        if self.at is not None:
            values |= {"at": self.at, "modes": self.modes}
        if self.worst is None:
            return values
        if summary.identities == "hidden" or self.function is not None:
            return values | {"worst": [_values(event) for event in self.worst]}
        groups = groupby(self.worst, key=lambda moment: moment.tracker)
        return values | {"worst": {tracker: [_values(moment) for moment in group] for tracker, group in groups}}


def _values(moment: Moment) -> dict[str, Any]:
    if isinstance(moment, EstimateMoment):
        return asdict(moment)
    if isinstance(moment, FunctionEvent):
        return {**moment._asdict(), "word": moment.word, "wrong_s": moment.wrong_s}
    return {**moment._asdict(), "reason": moment.reason}


def inspect(path: Path | Recorded, opening: Opening = WHOLE) -> Inspection:
    """Read the folder of a run or a recording.

    Args:
        path: the folder or recording, or what was read of it.
        opening: also the scene at its time; also as many worst moments of each tracker as it says, with hidden
            identities or of a function as many events.

    Raises:
        InputError: it cannot be read, or has no such time, tracker, vehicle or function.
    """
    recorded = path if isinstance(path, Recorded) else read(path)
    result = recorded.result
    if opening.tracker is not None:
        require_name(opening.tracker, list(result), "tracker")
    moments = worst_moments(result, opening, each=True)
    at, modes = None, Modes()
    if opening.at_s is not None:
        hidden = result.summary.identities == "hidden"
        at = _tracks_at(result, opening.at_s, opening.tracker) if hidden else _scene_at(result, opening.at_s)
        modes = _modes(result, opening.at_s)
    return Inspection(recorded, at, None if opening.worst is None else moments, modes, opening.function)


def _scene_at(result: Result, time: float) -> dict[str, Any]:
    truth, measured = table_frame(result.tables.truth), ["sensor", "object", "time_s", "x_m", "y_m"]
    require_time(truth["time_s"].min(), truth["time_s"].max(), time)
    present = latest_rows(truth, time, "role", "object").query("alive > 0").rename(columns={"object": "name"})
    measurements = latest_rows(table_frame(result.tables.measurements, "valid", *measured), time, "sensor", "object")
    return {
        "time_s": float(truth["time_s"][truth["time_s"] <= time + 1e-9].max()),
        "vehicles": present[VEHICLE].to_dict("records"),
        "measurements": measurements.query("valid > 0")[measured].to_dict("records"),
        "estimates": [asdict(item) for item in estimates_at(result, time) if item.object in set(present["name"])],
    }


def _tracks_at(result: Result, time: float, only: str | None) -> dict[str, Any]:
    """Return the scene at the latest instant up to a time, with the tracks of all trackers or of one."""
    require_time(0.0, result.summary.truth.duration_s, time)
    tables, instants = result.tables, drawn_instants(result.tables)
    now = float(instants[max(0, int(np.searchsorted(instants, time + 1e-9)) - 1)]) if len(instants) else 0.0
    states: dict[str, dict[str, str]] = {}
    for (tracker, name), rows in split(tables.objects, "tracker", "object").items():
        inside = (rows["time_s"] <= now + 1e-9) & (now + 1e-9 < rows["until_s"])
        states.setdefault(name, {})[tracker] = str(rows["state"][inside][0]) if inside.any() else "not due"
    due = latest_rows(table_frame(tables.due, "object", "status", "time_s"), now, "object")
    status = {name: STATUS[int(number)] for name, number in zip(due["object"], due["status"], strict=True)}
    vehicles = latest_rows(table_frame(tables.truth), now, "role", "object").query("alive > 0")
    vehicles = vehicles[vehicles["object"].isin(status)].rename(columns={"object": "name"})
    tracks = table_frame(tables.tracks, "time_s", *TRACK)
    near = tracks[((tracks["time_s"] - now).abs() < 1e-9) & (tracks["tracker"].eq(only) | (only is None))]
    known = near[list(TRACK)].astype({"track": int, "existence": object})
    return {
        "time_s": now,
        "vehicles": [
            {**vehicle, "status": status[vehicle["name"]], "states": states.get(vehicle["name"], {})}
            for vehicle in vehicles[list(MOTION)].to_dict("records")
        ],
        "tracks": known.where(known.notna(), None).to_dict("records"),
    }


def _modes(result: Result, time: float) -> Modes:
    """Return the probabilities at the latest instant up to the time."""
    modes: Modes = {}
    rows_of = split(result.tables.if_there("recorded_modes"), "tracker", "mode", "object")
    for (tracker, mode, name), rows in rows_of.items():
        step = int(np.searchsorted(rows["time_s"], time + 1e-9, side="right")) - 1
        if step >= 0 and np.isfinite(rows["probability"][step]):
            modes.setdefault(tracker, {}).setdefault(name, {})[mode] = float(rows["probability"][step])
    return modes


#: What is printed of a vehicle, an estimate, a track, and each kind of moment.
MOTION = ("name", "px_m", "py_m", "speed_mps")
VEHICLE = [
    *("name", "role", "px_m", "py_m", "vx_mps", "vy_mps"),
    *("speed_mps", "course_rad", "acceleration_mps2", "yaw_rate_radps"),
]
ERRORS = ("position_error_m", "velocity_error_mps", "nees")
ESTIMATE = ("object", "tracker", "px_m", "py_m", *ERRORS)
TRACK = ("tracker", "track", "px_m", "py_m", "existence")
MOMENTS: dict[type, tuple[str, ...]] = {
    EstimateMoment: ("tracker", "time_s", "object", *ERRORS),
    TrackEvent: ("tracker", "time_s", "kind", "object", "track", "cost_m2", "reason"),
    FunctionEvent: ("tracker", "run", "time_s", "object", "word", "wrong_s"),
}
HEADINGS = {
    "name": "vehicle", "object": "vehicle", "px_m": "x, m", "py_m": "y, m", "speed_mps": "speed, m/s",
    "position_error_m": "error, m", "velocity_error_mps": "error, m/s", "nees": "NEES", "time_s": "time, s",
    "kind": "event", "cost_m2": "cost, m²", "reason": "why", "word": "what", "wrong_s": "by, s",
    "missed_by": "not tracked by",
}  # fmt: skip


def print_inspection(inspection: Inspection, console: Console) -> None:
    """Print the moments that were asked for, or the scores of all runs."""
    result, at, moments = inspection.recorded.result, inspection.at, inspection.worst
    summary = result.summary
    if at is None and moments is None:
        print_summary(result, console)
        return
    console.print(f"{result.name}: run {summary.recorded_run} of {summary.runs}, seed {summary.seed}")
    if at is not None:
        caption = f"At {rounded(at['time_s'], 3)} s"
        if "tracks" in at:
            vehicles = [{**vehicle, "missed_by": _missed_by(vehicle["states"])} for vehicle in at["vehicles"]]
            _print(console, (*MOTION, "status", "missed_by"), vehicles, caption)
            _print(console, TRACK, at["tracks"])
        else:
            _print(console, MOTION, at["vehicles"], caption)
            _print(console, ESTIMATE, sorted(at["estimates"], key=lambda estimate: str(estimate["object"])))
        for tracker, vehicles_of in inspection.modes.items():
            for name, modes in vehicles_of.items():
                shares = ", ".join(f"{mode} {rounded(share, 2)}" for mode, share in modes.items())
                console.print(f"modes of {tracker}, {name}: {shares}")
    if moments:
        caption = "The worst first"
        if isinstance(moments[0], EstimateMoment):
            caption = "Of each tracker the worst first; a moment is the top of a peak"
        _print(console, MOMENTS[type(moments[0])], [_values(moment) for moment in moments], caption)
    elif moments is not None:
        reason = "Nothing that counts went wrong" if summary.truth.known else "Without truth no event has a cost"
        console.print(f"{reason}.")
    for failed in (tracker for tracker in summary.trackers if tracker.failed is not None):
        console.print(f"{failed.name} failed: {failed.failed}")
    if moments and inspection.function is None:
        # Events are in order already.
        first = max(moments, key=lambda moment: getattr(moment, "position_error_m", 0.0))
        command = f"trackbench view {inspection.recorded.path} --worst --tracker {first.tracker}"
        console.print(f"\n{command}", style="dim", soft_wrap=True)


def _missed_by(states: dict[str, str]) -> str:
    """Return the names of the trackers that should have a track of a vehicle and have none."""
    return ", ".join(name for name, state in states.items() if state in ("waiting", "lost"))


def _print(console: Console, names: Sequence[str], rows: Sequence[dict[str, Any]], caption: str = "") -> None:
    """Print a table with a row for each item, and the values of these names as columns."""
    texts = {name for name in names for row in rows[:1] if isinstance(row[name], str)}
    columns = {
        TRACKER if name == "tracker" else Column(HEADINGS.get(name, name), left=name in texts): partial(_text, name)
        for name in names
    }
    console.print()
    print_table(text_table("moments", rows, columns, caption), console)


def _text(name: str, row: dict[str, Any]) -> str:
    value = row[name]
    return rounded(value, 2) if isinstance(value, float | None) else str(value)
