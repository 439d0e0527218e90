"""The tables of a report, free of any markup: what each cell says, and why where it has nothing to say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from trackbench.report.numbers import NOT_AVAILABLE, Metric, decimals, fixed, interval, percent
from trackbench.report.significance import NO_DIFFERENCE, Difference, Differences, letters
from trackbench.report.wording import scored

Summary = Mapping[str, Any]

#: A verdict's colour in a report.
TONE = {
    "consistent": "good",
    "white": "good",
    "optimistic": "bad",
    "pessimistic": "warn",
    "coloured": "warn",
    "undecided": "",
}


@dataclass(frozen=True)
class Cell:
    """A cell: its text, the lines of small print under it, and its tone ("", "good", "warn", "bad")."""

    text: str
    details: tuple[str, ...] = ()
    tone: str = ""
    reason: str = ""
    """Why there is no value."""
    tracker: str = ""
    """The tracker that the cell names, if it does."""
    strong: bool = False
    """Whether it stands out, as the best do."""


@dataclass(frozen=True)
class Table:
    """Headings (each with an explanation, possibly empty) and rows of cells."""

    headings: list[tuple[str, str]]
    rows: list[list[Cell]]
    reasons: list[str] = field(init=False)
    """Every reason for a missing value, once, for the footnotes."""

    def __post_init__(self) -> None:
        found = [cell.reason for row in self.rows for cell in row if cell.reason]
        object.__setattr__(self, "reasons", list(dict.fromkeys(found)))

    def mark(self, cell: Cell) -> str:
        """The number of the footnote that explains a cell, or nothing."""
        return str(self.reasons.index(cell.reason) + 1) if cell.reason else ""


def ranked(summary: Summary) -> Table:
    """Every scored tracker, best first, with intervals and verdicts."""
    trackers = scored(summary)
    group = letters([t["name"] for t in trackers], Differences(summary["differences"]))
    every = [t["metrics"] for t in trackers]
    sensors = list(summary["sensors"])
    columns: list[tuple[tuple[str, str], list[Cell]]] = [
        (("#", "rank by position RMSE"), [Cell(str(i + 1)) for i in range(len(trackers))]),
        (("tracker", ""), _names(trackers)),
        (
            ("alike", "no difference was shown between trackers that share a letter"),
            [Cell(group[t["name"]]) for t in trackers],
        ),
        (("position RMSE, m", "with its 95 % interval"), _values(every, "position_rmse")),
        (("velocity RMSE, m/s", "with its 95 % interval"), _values(every, "velocity_rmse")),
        (("course RMSE, deg", "with its 95 % interval"), _values(every, "course_rmse")),
        (("NEES", "mean (4 is right), verdict, and its 95 % interval"), [_consistency(m["nees"]) for m in every]),
        *(
            (
                (f"NIS {name}", "mean, verdict, and the share of innovations under the 95 % point"),
                [_nis(_entry(t, "nis", name)) for t in trackers],
            )
            for name in sensors
        ),
        (
            ("efficiency", "position RMSE over the Cramér-Rao bound; 1 is the best possible"),
            _values(every, "position_efficiency"),
        ),
        (("diverged", f"of {summary['runs']} runs"), [_count(t["health"]["diverged_runs"]) for t in trackers]),
        (
            ("repaired", "covariances made positive definite again"),
            [_count(t["health"]["repaired_covariances"]) for t in trackers],
        ),
        (("µs per step", "one predict and update of one run"), _values(every, "step_time", significant=2)),
    ]
    return _by_columns(columns)


def per_axis(summary: Summary) -> Table:
    """RMSE along each axis."""
    trackers = scored(summary)
    axes = [t["metrics"]["rmse"] for t in trackers]
    units = {"px": "m", "py": "m", "vx": "m/s", "vy": "m/s"}
    return _by_columns(
        [
            (("tracker", ""), _names(trackers)),
            *(((f"{axis}, {unit}", ""), _values(axes, axis)) for axis, unit in units.items()),
        ]
    )


def innovations(summary: Summary) -> Table:
    """NIS and whiteness of each sensor's innovations, for each tracker that gives innovations."""
    trackers = [
        t for t in scored(summary) if any(_entry(t, "nis", name).get("mean") is not None for name in summary["sensors"])
    ]
    columns: list[tuple[tuple[str, str], list[Cell]]] = [(("tracker", ""), _names(trackers))]
    for sensor in summary["sensors"]:
        nis = [_entry(t, "nis", sensor) for t in trackers]
        white = [_entry(t, "whiteness", sensor) for t in trackers]
        columns += [
            ((f"NIS {sensor}", "mean, verdict, and its 95 % interval"), [_consistency(n) for n in nis]),
            (("under the 95 % point", "should be 95 %"), [_share(n) for n in nis]),
            (("lag-one correlation", "of successive normalised innovations; should be 0"), [_white(w) for w in white]),
        ]
    return _by_columns(columns)


def key_differences(summary: Summary) -> Table:
    """Each tracker against the best and against the one ranked just above it."""
    names = [tracker["name"] for tracker in scored(summary)]
    differences = Differences(summary["differences"])
    pairs = [(differences.get(name, names[0]), differences.get(name, above)) for above, name in pairwise(names)]
    places = _decimals_of(d for pair in pairs for d in pair)
    rows = [
        [Cell(name, tracker=name), _difference(best, places), _difference(above, places)]
        for name, (best, above) in zip(names[1:], pairs, strict=True)
    ]
    first = names[0] if names else "the best"
    return Table(
        [("tracker", ""), (f"against the best, {first}, m", ""), ("against the one ranked above, m", "")], rows
    )


def all_differences(summary: Summary) -> Table:
    """The whole matrix: row minus column."""
    names = [tracker["name"] for tracker in scored(summary)]
    differences = Differences(summary["differences"])
    places = _decimals_of(differences.get(a, b) for a in names for b in names)
    rows = [
        [
            Cell(a, tracker=a),
            *(Cell("\N{EM DASH}") if a == b else _in_matrix(differences.get(a, b), places) for b in names),
        ]
        for a in names
    ]
    return Table([("row minus column, m", ""), *((name, "") for name in names)], rows)


def expectations(summary: Summary) -> Table:
    """What the scenario states should hold, and what was found."""
    rows = [
        [
            Cell("passed", tone="good") if e["passed"] else Cell("failed", tone="bad"),
            Cell(e["text"]),
            Cell(_found(e["value"])),
        ]
        for e in summary["expectations"]
    ]
    return Table([("", ""), ("expected", ""), ("found", "")], rows)


def sensors(summary: Summary) -> Table:
    """The sensors, and how often each detected."""
    rows = [
        [
            Cell(name, _line(s.get("preset"))),
            Cell(s["kind"]),
            Cell(f"{s['rate_hz']:g}\N{NO-BREAK SPACE}Hz"),
            Cell(str(s["dof"])),
            Cell(percent(s.get("detection_rate"))),
        ]
        for name, s in summary["sensors"].items()
    ]
    headings = [
        ("sensor", ""),
        ("kind", ""),
        ("rate", ""),
        ("components", "of one measurement"),
        ("detections", "share of the instants with a vehicle present that gave a measurement of it"),
    ]
    return Table(headings, rows)


def _by_columns(columns: Sequence[tuple[tuple[str, str], list[Cell]]]) -> Table:
    return Table([heading for heading, _ in columns], [list(row) for row in zip(*(c for _, c in columns), strict=True)])


def _names(trackers: Iterable[Mapping[str, Any]]) -> list[Cell]:
    return [Cell(t["name"], tracker=t["name"]) for t in trackers]


def _reason(metric: Metric) -> str:
    return str(metric.get("reason") or "the tracker does not give what this needs")


def _entry(tracker: Mapping[str, Any], metric: str, sensor: str) -> Metric:
    """A metric of one sensor, which a tracker may lack."""
    return (tracker["metrics"].get(metric) or {}).get(sensor) or {}


def _line(text: str | None) -> tuple[str, ...]:
    return (text,) if text else ()


def _values(metrics: Sequence[Metric], key: str, significant: int = 3) -> list[Cell]:
    """One metric down a column, with the same decimals for all."""
    found: list[Metric] = [m.get(key) or {"value": None} for m in metrics]
    places = decimals([m["value"] for m in found], significant)
    return [
        Cell(NOT_AVAILABLE, reason=_reason(m))
        if m["value"] is None
        else Cell(fixed(m["value"], places), _line(interval(m.get("ci95"), places)))
        for m in found
    ]


def _count(number: int) -> Cell:
    return Cell(str(number), tone="bad" if number else "")


def _consistency(metric: Metric) -> Cell:
    if metric.get("mean") is None:
        return Cell(NOT_AVAILABLE, reason=_reason(metric))
    details = (metric["verdict"], *_line(interval(metric["ci95"], 2)))
    return Cell(fixed(metric["mean"], 2), details, TONE[metric["verdict"]])


def _nis(metric: Metric) -> Cell:
    if metric.get("mean") is None:
        return Cell(NOT_AVAILABLE, reason=_reason(metric))
    details = (metric["verdict"], f"{percent(metric['inside95'])} inside")
    return Cell(f"{fixed(metric['mean'], 2)} of {metric['dof']}", details, TONE[metric["verdict"]])


def _share(metric: Metric) -> Cell:
    share = metric.get("inside95")
    return Cell(percent(share, 1), reason=_reason(metric) if share is None else "")


def _white(metric: Metric) -> Cell:
    if metric.get("value") is None:
        return Cell(NOT_AVAILABLE, reason=_reason(metric))
    return Cell(fixed(metric["value"], 3), (metric["verdict"],), TONE[metric["verdict"]])


def _decimals_of(differences: Iterable[Difference | None]) -> int:
    """Decimals that the uncertainty of the differences leaves a meaning."""
    known = [d for d in differences if d]
    widths = [(d.ci95[1] - d.ci95[0]) / 2 for d in known if d.ci95]
    return decimals(widths, 1) if widths else decimals([d.value for d in known], 2)


def _difference(found: Difference | None, places: int) -> Cell:
    """A paired difference with its verdict and interval."""
    if found is None:
        return Cell(NOT_AVAILABLE, reason="the pair was not compared")
    verdict = NO_DIFFERENCE if found.better is None else "better" if found.better == found.a else "worse"
    return Cell(_signed(found.value, places), (verdict, *_line(interval(found.ci95, places))))


def _in_matrix(found: Difference | None, places: int) -> Cell:
    """A paired difference whose colour says whether the first of the pair is better or worse."""
    if found is None:
        return Cell(NOT_AVAILABLE, reason="the pair was not compared")
    if found.better is None:
        return Cell(_signed(found.value, places), (NO_DIFFERENCE,))
    won = found.better == found.a
    return Cell(_signed(found.value, places), ("better" if won else "worse",), "good" if won else "bad")


def _signed(value: float, places: int) -> str:
    return ("+" if value > 0 else "") + fixed(value, places)


def _found(value: Any) -> str:
    if value is None:
        return NOT_AVAILABLE
    return fixed(value, decimals([value])) if isinstance(value, float) else str(value)
