"""The tables of a run's report, and the cells of the values that a result holds."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import pairwise

from trackbench.document import Cell, Column, Table, Tone
from trackbench.metrics.differences import SILENCE
from trackbench.metrics.verdict_words import mean_text
from trackbench.metrics.verdicts import WHITENESS_TOLERANCE
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, interval, margin_words, percent, signed
from trackbench.report.run.pairs import Pair, Pairs, letters
from trackbench.results import ConditionVerdict, MetricValue, Result, TrackerResult, sensor_words

INTERVAL = "95 % interval"
VERDICT = "verdict, 95 % interval"
NO_METRIC = MetricValue(unit="1", reason="the tracker does not give what this needs")

#: A verdict's colour.
TONE: dict[str, Tone] = {
    "consistent": "good",
    "white": "good",
    "optimistic": "bad",
    "pessimistic": "warn",
    "mixed": "warn",
    "coloured": "warn",
    "undecided": "",
    "": "",
}

TRACKER = Column("tracker", left=True)


def names(trackers: Sequence[TrackerResult]) -> list[Cell]:
    """Each tracker's name, and whether it is no competitor."""
    return [Cell(t.name, (t.reference_kind,) if t.reference_kind else (), tracker=t.name) for t in trackers]


def metric_of(tracker: TrackerResult, path: str) -> MetricValue:
    """A metric, which the tracker may lack."""
    return tracker.metrics.get(path, NO_METRIC)


def values(trackers: Sequence[TrackerResult], path: str, significant: int = 3, scale: float = 1.0) -> list[Cell]:
    """One metric down a column, with the same decimals for all; its verdict and interval are the small print."""
    found = [metric_of(tracker, path) for tracker in trackers]
    places = decimals([None if m.value is None else scale * m.value for m in found], significant)
    return [_value(metric, places, scale) for metric in found]


def missing(metric: MetricValue) -> Cell:
    """Without a value, with its reason."""
    return Cell(NOT_AVAILABLE, reason=metric.reason or str(NO_METRIC.reason))


def count(number: int | None) -> Cell:
    """How often something happened that should not."""
    return Cell(str(number or 0), tone="bad" if number else "")


def _value(metric: MetricValue, places: int, scale: float) -> Cell:
    if metric.value is None:
        return missing(metric)
    bounds = None if metric.ci95 is None else [scale * end for end in metric.ci95]
    details = tuple(text for text in (metric.verdict, interval(bounds, places)) if text)
    return Cell(fixed(scale * metric.value, places), details, TONE.get(metric.verdict or "", ""))


#: Metrics with a column of their own in some table, and the groups of which all have one.
_SHOWN = (
    "position_rmse", "velocity_rmse", "course_rmse", "nees", "position_over_reference", "velocity_over_reference",
    "position_reference", "velocity_reference", "coverage", "step_time",
)  # fmt: skip
_SHOWN_GROUPS = ("rmse.", "nis.", "whiteness.")
_TAKEN_IN = Column(
    "taken in, %",
    "share of the measurements of a known object with an innovation; a late scan that is dropped has none",
)


def ranking(result: Result) -> Table:
    """Every scored tracker, best first, with intervals and verdicts."""
    trackers, runs, label = result.scored, result.summary.runs, result.summary.held_against.label
    margin = margin_words(result.summary.score.margin, "m")
    columns = [
        (Column("#", "rank by position RMSE"), _ranks(result)),
        (TRACKER, names(trackers)),
        (
            Column(
                "group", f"of two that share a letter neither was shown to be better by more than {margin}", left=True
            ),
            list(map(Cell, letters(result))),
        ),
        (Column("position RMSE, m", details=INTERVAL), values(trackers, "position_rmse")),
        (Column("velocity RMSE, m/s", details=INTERVAL), values(trackers, "velocity_rmse")),
        (Column("course RMSE, deg", details=INTERVAL), values(trackers, "course_rmse")),
        (
            Column("NEES, 4 expected", "mean, verdict under all conditions, 95 % interval", details=VERDICT),
            values(trackers, "nees"),
        ),
        (
            Column(f"over {label}", f"position RMSE over that of the {label}", details=INTERVAL),
            values(trackers, "position_over_reference"),
        ),
        (
            Column("coverage, %", "steps with a vehicle present at which there is an estimate"),
            values(trackers, "coverage", scale=100),
        ),
        (Column("diverged", f"of {runs} runs"), [count(tracker.health.diverged_runs) for tracker in trackers]),
        (
            Column("repaired", "covariances made positive definite again"),
            [count(tracker.health.repaired_covariances) for tracker in trackers],
        ),
        (Column("µs per step", "one predict and update of one run"), values(trackers, "step_time", significant=2)),
    ]
    return Table.of_columns("ranking", columns)


def _ranks(result: Result) -> list[Cell]:
    """None for one that is no competitor."""
    order = [tracker.name for tracker in result.contenders]
    return [Cell(str(order.index(t.name) + 1) if t.name in order else "") for t in result.scored]


def axes_and_reference(result: Result) -> Table:
    """RMSE along each axis, and of the reference."""
    trackers, label = result.scored, result.summary.held_against.label
    paths = {
        "rmse.px": "x, m",
        "rmse.py": "y, m",
        "rmse.vx": "vx, m/s",
        "rmse.vy": "vy, m/s",
        "position_reference": f"{label}, position, m",
        "velocity_reference": f"{label}, velocity, m/s",
        "velocity_over_reference": f"velocity RMSE over {label}",
    }
    columns = [(Column(heading, details=INTERVAL), values(trackers, path)) for path, heading in paths.items()]
    return Table.of_columns("axes-and-reference", [(TRACKER, names(trackers)), *columns])


def other_metrics(result: Result, shown: Collection[str] = _SHOWN) -> Table | None:
    """The metrics that no other table has, a column each; None if there are none."""
    trackers = result.scored
    found: dict[str, str] = {}
    for tracker in trackers:
        for path, metric in tracker.metrics.items():
            if path not in shown and not path.startswith(_SHOWN_GROUPS):
                found.setdefault(path, path if metric.unit == "1" else f"{path}, {metric.unit}")
    if not found:
        return None
    columns = [(Column(heading, details=VERDICT), values(trackers, path)) for path, heading in found.items()]
    return Table.of_columns("other-metrics", [(TRACKER, names(trackers)), *columns])


def innovations(result: Result) -> list[Table]:
    """NIS and whiteness of the innovations of each sensor, for each tracker that gives them."""
    tables = []
    for number, sensor in enumerate(result.summary.sensors):
        trackers = [tracker for tracker in result.scored if metric_of(tracker, f"nis.{sensor}").value is not None]
        given = [metric_of(tracker, f"nis.{sensor}").coverage for tracker in trackers]
        columns = [
            (TRACKER, names(trackers)),
            (
                Column(
                    f"NIS, {_expected(trackers, sensor)} expected", "mean, verdict and 95 % interval", details=VERDICT
                ),
                values(trackers, f"nis.{sensor}"),
            ),
            *([(_TAKEN_IN, list(map(Cell, map(_percents, given))))] if any(map(_misses, given)) else []),
            (
                Column("below the 95 % point, %", "share of the single innovations; 95 expected"),
                [_inside(tracker, sensor) for tracker in trackers],
            ),
            (
                Column(
                    "lag-1 autocorrelation",
                    f"of the normalised innovations; white within {WHITENESS_TOLERANCE} of 0",
                    details=VERDICT,
                ),
                values(trackers, f"whiteness.{sensor}"),
            ),
        ]
        if trackers:
            tables.append(Table.of_columns(f"innovations-{number}", columns, f"Innovations of {sensor}"))
    return tables


def nees_by_condition(result: Result) -> Table | None:
    """Mean NEES of each tracker under each condition that any was judged by; None where none was."""
    trackers = result.scored
    found = [{item.name: item for item in metric_of(tracker, "nees").conditions or ()} for tracker in trackers]
    conditions = list(dict.fromkeys(name for items in found for name in items))
    if not conditions:
        return None
    columns = [(Column(name, details=VERDICT), [_condition(items.get(name)) for items in found]) for name in conditions]
    caption = "Mean NEES under each condition, 4 expected"
    return Table.of_columns("nees-by-condition", [(TRACKER, names(trackers)), *columns], caption)


def _condition(found: ConditionVerdict | None) -> Cell:
    if found is None:
        return Cell(NOT_AVAILABLE, reason="too few estimates of the tracker to judge it")
    return Cell(mean_text(found.mean), (found.verdict, interval(found.ci95, 1)), TONE[found.verdict])


def _expected(trackers: Sequence[TrackerResult], sensor: str) -> str:
    """The degrees of freedom of the innovations, which a filter of positions has fewer of."""
    known = sorted({tracker.metrics[f"nis.{sensor}"].dof or 0 for tracker in trackers}, reverse=True)
    return " or ".join(str(dof) for dof in known)


def key_differences(result: Result) -> Table:
    """Each tracker against the best and against the one ranked just above it; a reference against the best alone."""
    order = [tracker.name for tracker in result.contenders]
    beside = [tracker for tracker in result.scored if tracker.name not in order]
    pairs = Pairs(result.summary)
    found = [(pairs.get(name, order[0]), pairs.get(name, above)) for above, name in pairwise(order)]
    of_references = [pairs.get(tracker.name, order[0]) for tracker in beside]
    places = _places([*(pair for both in found for pair in both), *of_references])
    rows = [
        (Cell(name, tracker=name), _difference(best, places), _difference(above, places))
        for name, (best, above) in zip(order[1:], found, strict=True)
    ]
    rows += [
        (name, _difference(best, places), Cell("")) for name, best in zip(names(beside), of_references, strict=True)
    ]
    headings = (f"minus {order[0]}, m", "minus the next better, m")
    columns = (TRACKER, *(Column(heading, details=VERDICT) for heading in headings))
    return Table("differences", columns, tuple(rows))


def all_differences(result: Result, trackers: Sequence[TrackerResult]) -> Table:
    """Every pair of some trackers: row minus column."""
    order = [tracker.name for tracker in trackers]
    pairs = Pairs(result.summary)
    places = _places(pairs.get(a, b) for a in order for b in order)
    rows = [
        (Cell(a, tracker=a), *(Cell("") if a == b else _in_matrix(pairs.get(a, b), places) for b in order))
        for a in order
    ]
    columns = (Column("row minus column, m", left=True), *(Column(name, details="verdict") for name in order))
    return Table("all-differences", columns, tuple(rows), matrix=True)


def expectations(result: Result) -> Table:
    """What the scenario states should hold, and what was found."""
    rows = [
        (
            Cell("passed", tone="good") if item.passed else Cell("failed", tone="bad"),
            Cell(item.text),
            Cell(found(item.value)),
        )
        for item in result.summary.expectations
    ]
    columns = (Column("result", left=True), Column("expected", left=True), Column("found"))
    return Table("expectations", columns, tuple(rows))


def sensors(result: Result) -> Table:
    """The sensors, and how often each detected."""
    late = any(about.latency_s[1] > 0 for about in result.summary.sensors.values())
    columns = (
        Column("sensor", left=True, details="preset"),
        Column("kind", left=True),
        Column("rate, Hz"),
        *([Column("latency, s", "from a measurement to its arrival at the trackers")] if late else []),
        Column("noise", "standard deviation of each component of a measurement", left=True),
        Column("field of view, deg", "horizontal, centred on the boresight"),
        Column("range", "beyond it nothing is detected"),
        Column("mount", "pose on the observer: forward, to the left, counter-clockwise", left=True),
        Column("detections, %", "scans with a vehicle in the field of view that gave a measurement of it"),
    )
    rows = [
        (
            Cell(name, (about.preset,) if about.preset else ()),
            Cell(about.kind),
            Cell(NOT_AVAILABLE, reason="a single scan") if about.rate_hz is None else Cell(f"{about.rate_hz:.4g}"),
            *([Cell(sensor_words.latency(about))] if late else []),
            Cell(sensor_words.noise(about)),
            Cell(f"{about.fov_deg:g}"),
            Cell(sensor_words.reach(about)),
            Cell(sensor_words.mount(about)),
            Cell(_percents(about.detection_rate)),
        )
        for name, about in result.summary.sensors.items()
    ]
    return Table("sensors", columns, tuple(rows))


def found(value: float | str | None) -> str:
    """What was found where something was expected."""
    if value is None:
        return NOT_AVAILABLE
    return fixed(value, decimals([value])) if isinstance(value, float) else str(value)


def _inside(tracker: TrackerResult, sensor: str) -> Cell:
    nis = metric_of(tracker, f"nis.{sensor}")
    return missing(nis) if nis.inside95 is None else Cell(_percents(nis.inside95, 1))


def _misses(share: float | None) -> bool:
    return share is not None and share < 1 - SILENCE


def _percents(share: float | None, places: int = 0) -> str:
    return percent(share, places).removesuffix("\N{NO-BREAK SPACE}%")


def _places(pairs: Iterable[Pair | None]) -> int:
    """Decimals that the uncertainty of the differences leaves a meaning."""
    known = [pair for pair in pairs if pair]
    widths = [(pair.ci95[1] - pair.ci95[0]) / 2 for pair in known if pair.ci95]
    return decimals(widths, 1) if widths else decimals([pair.value for pair in known], 2)


def _difference(pair: Pair | None, places: int) -> Cell:
    if pair is None:
        return Cell(NOT_AVAILABLE, reason="the pair was not compared")
    bounds = interval(pair.ci95, places)
    return Cell(signed(pair.value, places), (pair.verdict, *([bounds] if bounds else [])))


def _in_matrix(pair: Pair | None, places: int) -> Cell:
    """Its colour says whether the first of the pair is better or worse."""
    if pair is None:
        return Cell(NOT_AVAILABLE, reason="the pair was not compared")
    tone: Tone = "good" if pair.verdict == "better" else "bad" if pair.verdict == "worse" else ""
    return Cell(signed(pair.value, places), (pair.verdict,), tone)
