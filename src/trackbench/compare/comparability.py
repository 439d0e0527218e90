"""Scenarios of a comparison: whether two results can be compared, and over which runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import new_class
from typing import Any, NoReturn

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from trackbench.base.errors import InputError, counted
from trackbench.compare.entries import Entry, ResultSet
from trackbench.metrics import BUILT_IN, Metric
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.results.checks import differing
from trackbench.results.scenario_summary import MetricSummary
from trackbench.scenario.config import ScenarioConfig


@dataclass(frozen=True)
class ScenarioResults:
    """One scenario, with the result of each set of results that contains it."""

    scenario: str
    entries: dict[int, Entry]

    @property
    def ranked_by(self) -> str | None:
        """Dotted path of the metric that ranks the trackers in the scenario; None without a truth.

        Raises:
            InputError: different metrics rank the trackers of different results.
        """
        first, *later = self.entries.values()
        ours = first.result.summary
        for entry in later:
            theirs = entry.result.summary
            if theirs.headline != ours.headline:
                reason = f"identities are {theirs.identities} here and {ours.identities} there"
                if theirs.identities == ours.identities:
                    reason = f"{theirs.truth.vehicles} here and {ours.truth.vehicles} there"
                raise InputError(f"cannot be compared with {first.label}: {reason}", file=entry.label)
        return ours.headline if ours.truth.known else None


@dataclass(frozen=True)
class Group:
    """Scenarios whose trackers are ranked by the same metric."""

    ranked_by: str
    cells: list[ScenarioResults]

    @property
    def scenarios(self) -> str:
        return ", ".join(cell.scenario for cell in self.cells)

    def metrics(self) -> dict[str, Metric]:
        """Return the metrics that have a value in each run, and so can be compared, by dotted path.

        Raises:
            InputError: the metric that ranks trackers has no value in each run.
        """
        summaries = [entry.result.summary for cell in self.cells for entry in cell.entries.values()]
        of_results = [metric for summary in summaries for metric in summary.score.metrics]
        metrics = compared_metrics(of_results, built_in=summaries[0].identities == "known")
        if self.ranked_by not in metrics:
            problem = f"not a result: {self.ranked_by} is none of its metrics"
            raise InputError(problem, file=self.cells[0].entries[0].label)
        return metrics


def cells_of(sets: Sequence[ResultSet]) -> tuple[list[ScenarioResults], list[str]]:
    """Return the scenarios that the baseline and a later set share, or all of a single set; and notes on the others."""
    if all(len(item.entries) == 1 for item in sets):
        first = sets[0].entries[0].result.name
        return [ScenarioResults(first, {number: item.entries[0] for number, item in enumerate(sets)})], []
    by_name: dict[str, dict[int, Entry]] = {}
    for number, item in enumerate(sets):
        for entry in item.entries:
            by_name.setdefault(entry.result.name, {})[number] = entry
    cells, notes = [], []
    for name, entries in by_name.items():
        if len(sets) == 1 or (0 in entries and len(entries) > 1):
            cells.append(ScenarioResults(name, entries))
        else:
            labels = ", ".join(sets[number].label for number in entries)
            notes.append(f"in {labels} alone, so not compared: scenario {name}")
    if not cells:
        raise InputError("nothing to compare: no scenario is in the first folder and a later one", file=sets[-1].label)
    return cells, notes


def groups_of_cells(cells: Sequence[ScenarioResults]) -> tuple[list[Group], list[str]]:
    """Group the scenarios by the metric that ranks trackers; also return the names of scenarios without a truth.

    Raises:
        InputError: no scenario has a truth.
    """
    ranked: dict[str, list[ScenarioResults]] = {}
    without: list[ScenarioResults] = []
    for cell in cells:
        metric = cell.ranked_by
        (without if metric is None else ranked.setdefault(metric, [])).append(cell)
    if not ranked:
        problem = "a recording without a truth: there are no errors to compare"
        raise InputError(problem, file=without[0].entries[0].label)
    return [Group(metric, members) for metric, members in ranked.items()], [cell.scenario for cell in without]


class StoredMetric(Metric):
    """Metric of a stored result whose class is not loaded: the mean of its column in the table of runs."""

    def finish(self, sums: Any) -> NoReturn:
        raise NotImplementedError


def compared_metrics(of_results: Sequence[MetricSummary], *, built_in: bool) -> dict[str, Metric]:
    """Return the metrics computed run by run, by path: those of results, and with ``built_in`` built-in ones."""
    metrics: list[Metric] = [metric for metric in BUILT_IN if metric.columns] if built_in else []
    for item in of_results:
        if not item.per_sensor:
            of_tracks = None if built_in else TRACK_METRICS.get(item.name)
            metrics.append(of_tracks or stored_metric(item))
    return {metric.path: metric for metric in metrics}


def stored_metric(summary: MetricSummary) -> StoredMetric:
    """Make a metric from the description of it that a result holds."""
    members = {name: getattr(summary, name) for name in ("name", "unit", "meaning", "better", "compared")}
    members["__module__"] = __name__
    metric: StoredMetric = new_class(summary.name, (StoredMetric,), {}, lambda body: body.update(members))()
    return metric


IntArray = NDArray[np.intp]

#: Columns of the table of the truth that hold the motion of the targets.
MOTION = ("object", "time_s", "px_m", "py_m", "vx_mps", "vy_mps")
#: Least number of shared runs for a paired comparison.
FEWEST = 2


@dataclass(frozen=True)
class Comparability:
    """Runs over which two results are compared: shared runs, paired, or two independent samples."""

    shared: tuple[IntArray, IntArray] | None
    """Numbers of the paired runs in the baseline, and in the later result: runs with the same measurements in both.
    None for two independent samples."""
    reason: str
    """Reason why the runs are paired, or not."""

    @classmethod
    def of_all(cls, runs: int, reason: str) -> Comparability:
        """Return a pairing of all ``runs`` runs of both results by their numbers, with its reason."""
        return cls((np.arange(runs), np.arange(runs)), reason)


def comparability(baseline: Entry, later: Entry) -> Comparability:
    """Return over which runs two results are compared: pairs of equal runs, or two independent samples.

    The trackers, the number of runs, the seed and the scenario's name are allowed to differ. The objects, the sensors
    and the scoring must be the same. Equal fingerprints of a run show that all its measurements were the same.

    Raises:
        InputError: the results are not comparable; with the reason.
    """
    for reason in _obstacles(baseline, later):
        raise InputError(f"cannot be compared with {baseline.label}: {reason}", file=later.label)
    ours, theirs = baseline.result.summary.fingerprints, later.result.summary.fingerprints
    if ours == theirs:
        return Comparability.of_all(len(ours), "the fingerprints of all measurements are equal")
    for entry, fingerprints in ((baseline, ours), (later, theirs)):
        if len(fingerprints) != entry.result.summary.runs:
            raise InputError("fingerprints: not one of each run", file=entry.label)
    places = {place: number for number, place in enumerate(_places(later))}
    both = [(number, places[place]) for number, place in enumerate(_places(baseline)) if place in places]
    equal = [(first, second) for first, second in both if ours[first] == theirs[second]]
    if len(equal) < FEWEST:
        return Comparability(None, _reason_for_other_noise(baseline, later))
    which = f"{counted(len(equal), 'run')} of {len(theirs)} here and {len(ours)} there"
    first, second = np.array(equal).T
    return Comparability((first, second), f"over the {which} with equal fingerprints")


def require_same_metric(baseline: Entry, later: Entry, path: str) -> None:
    """Make sure that a user's metric has the same unit, better direction and options in both results.

    Raises:
        InputError: the unit, the better direction or an option of the metric differs.
    """
    ours, theirs = _own_metric(baseline, path), _own_metric(later, path)
    for key, before, now in differing(ours, theirs) if ours and theirs else ():
        reason = f"another metric {path}: {key} is {_shown(now)} here and {_shown(before)} there"
        raise InputError(f"cannot be compared with {baseline.label}: {reason}", file=later.label)


def engine_notes(sets: Sequence[ResultSet], cells: Sequence[ScenarioResults]) -> Iterator[str]:
    """Yield a note on each later set of results that another engine (such as numpy) computed than the baseline."""
    for number, later in enumerate(sets[1:], 1):
        both = [(cell.entries[0], cell.entries[number]) for cell in cells if number in cell.entries]
        engines = [[entry.result.summary.engine_in_words for entry in pair] for pair in both]
        for ours, theirs in sorted({(ours, theirs) for ours, theirs in engines if ours != theirs}):
            by = f"{later.label} was computed by the {theirs}, {sets[0].label} by the {ours}"
            yield f"{by}: equal values may differ in their last digits"


def _places(entry: Entry) -> list[tuple[int, int]]:
    """Return for each run the index of its scene, and the index of the run within the scene, both from 0."""
    summary = entry.result.summary
    in_scene = summary.runs // max(1, len(summary.truth.scenes))
    return [divmod(number, in_scene) for number in range(summary.runs)]


def _obstacles(baseline: Entry, later: Entry) -> Iterator[str]:
    moved_alike = baseline.result.summary.truth.motion == later.result.summary.truth.motion != []
    for key, ours, theirs in differing(_stated(baseline.scenario), _stated(later.scenario)):
        # A recording may lie in another folder.
        if not (moved_alike and key.endswith("path")):
            yield f"another scenario: {key} is {_shown(theirs)} here and {_shown(ours)} there"
    ours, theirs = baseline.result.summary.truth.objects, later.result.summary.truth.objects
    if ours != theirs:
        yield f"other objects: {_few(theirs)} here and {_few(ours)} there"
    runs = [(s.seed, s.scenario.name, s.recorded_run) for s in (baseline.result.summary, later.result.summary)]
    # In the recorded runs the targets must have moved in the same way.
    due = not baseline.scenario.truth.random or runs[0] == runs[1]
    # The table has the recorded scene, the fingerprints have every scene.
    alike = moved_alike or len(baseline.result.summary.truth.motion) < 2
    if due and not (alike and _same(_motion(baseline.table("truth")), _motion(later.table("truth")))):
        versions = _changed(baseline.result.summary.versions, later.result.summary.versions)
        yield "the same scenario moved differently" + (f" ({versions})" if versions else "")


def _stated(scenario: ScenarioConfig) -> dict[str, Any]:
    """Return the options in which two compared scenarios must agree: truth, sensors and scoring."""
    options = scenario.model_dump(mode="json", include={"truth", "sensors", "sensing"})
    score = {key: getattr(scenario.score, key) for key in ("settle_s", "point", "cutoff_m", "switch_costs_s")}
    return {**options, "score": score}


def _own_metric(entry: Entry, path: str) -> dict[str, Any] | None:
    """Return the unit, direction and options of a user's metric; None where the result does not have the metric."""
    for metric in entry.result.summary.score.metrics:
        if metric.name == path:
            return {"unit": metric.unit, "better": metric.better, **metric.options}
    return None


def _motion(table: pa.Table) -> pa.Table | None:
    if not {"role", *MOTION} <= set(table.column_names):
        return None
    return table.filter(pc.equal(table["role"], "target")).select(list(MOTION))


def _same(ours: pa.Table | None, theirs: pa.Table | None) -> bool:
    """Return whether two tables of true motion are equal up to rounding: positions to a micrometre."""
    if ours is None or theirs is None or len(ours) != len(theirs):
        return False
    if ours["object"].to_pylist() != theirs["object"].to_pylist():
        return False
    pairs = ([np.asarray(table[name], dtype=float) for table in (ours, theirs)] for name in MOTION[1:])
    return all(np.allclose(a, b, rtol=0.0, atol=1e-6, equal_nan=True) for a, b in pairs)


def _reason_for_other_noise(baseline: Entry, later: Entry) -> str:
    a, b = baseline.result.summary, later.result.summary
    pairs = {"seed": (a.seed, b.seed), "name": (a.scenario.name, b.scenario.name)}
    reasons = [f"{what} {theirs} here and {ours} there" for what, (ours, theirs) in pairs.items() if ours != theirs]
    if a.fingerprints[:1] == b.fingerprints[:1]:
        reasons.append("fewer than two runs in common")
    unknown = "the measurements differ for no reason that the results state"
    return "; ".join(reasons) or _changed(a.versions, b.versions) or unknown


def _changed(ours: Mapping[str, str], theirs: Mapping[str, str]) -> str:
    names = [name for name in ours if name in theirs and ours[name] != theirs[name]]
    return ", ".join(f"{name} {theirs[name]} here and {ours[name]} there" for name in names)


def _shown(value: Any) -> str:
    text = "not given" if value is None else str(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _few(names: list[str]) -> str:
    shown = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
    return f"{counted(len(names), 'object')} ({shown})"
