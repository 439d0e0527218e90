"""One comparison, of whatever results are given."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from trackbench.compare.comparability import Comparability, comparability, require_same_metric
from trackbench.compare.comparison import ComparedResult, ComparedScenario, Comparison, Entrant, PairDifference
from trackbench.compare.differences import Match, coverage_notes, differences, overall, same_tracker, within
from trackbench.compare.entries import Entry, ResultSet
from trackbench.compare.limits import OPTION, Limit, held, require_directed
from trackbench.compare.metrics import ComparedMetric, compared_metric
from trackbench.compare.ranking import Pairings, ranking, scores
from trackbench.errors import InputError, nearest
from trackbench.execution import one_blas_thread
from trackbench.results import Result


@dataclass(frozen=True)
class _Cell:
    """One scenario, with the result of each set that has it."""

    scenario: str
    entries: dict[int, Entry]


@one_blas_thread()
def compare(
    results: Sequence[ResultSet | Result | Sequence[Result]],
    *,
    metrics: Sequence[str] = (),
    trackers: Sequence[str] | None = None,
    limits: Sequence[Limit] = (),
) -> Comparison:
    """Compare the trackers of one set of results with each other, or of several, each with that of the first.

    A set holds the results of different scenarios; one result is a set too. Results of the same scenario are compared
    over the runs with the same measurements, if there are any. Where each of two results has a single tracker, those
    are compared whatever their names.

    Args:
        results: the sets; the first is the baseline.
        metrics: what to compare by, beside those of the limits; unless given ``position_rmse``, or ``gospa`` where
            identities are hidden.
        trackers: names of those to compare; all unless given.
        limits: how much worse the trackers of the later sets may be.

    Raises:
        InputError: results that cannot be compared, a name that is not there, nothing to compare.
    """
    sets = [_set_of(number, item) for number, item in enumerate(results)]
    ranked_by = _ranked_by(sets)
    wanted = list(dict.fromkeys([*metrics, *(limit.metric for limit in limits)])) or [ranked_by]
    for limit in limits:
        require_directed(_metric(limit.metric, OPTION, sets))
    known = {path: _metric(path, "--metric", sets) for path in (ranked_by, *wanted)}
    _require_known(sets, trackers)
    cells, notes = _cells(sets)
    for cell in cells:
        for entry in cell.entries.values():
            for path in known:
                require_same_metric(cell.entries[0], entry, path)
    chosen = {
        (cell.scenario, number): [name for name in entry.trackers if trackers is None or name in trackers]
        for cell in cells
        for number, entry in cell.entries.items()
    }
    if limits:
        _require_judgeable(sets, cells, chosen)
    single = len(sets) == 1
    matches = [match for cell in cells for match in _matches(cell, chosen, single)]
    if single and len(cells) > 1:
        wanted = list(dict.fromkeys([ranked_by, *wanted]))
    elif not any(match.pairs for match in matches):
        what = "only one tracker" if single else "no tracker of the same name in the first result and a later one"
        raise InputError(f"nothing to compare: {what}", file=sets[-1].label)
    allowed = {limit.metric: limit.percent for limit in limits}
    compared = [known[path] for path in wanted]
    found, missing = differences(matches, compared, over_scenarios=not single, limits=allowed)
    pairings = _pairings(found, matches, known[ranked_by]) if single else None
    scored = [
        score
        for cell in cells
        for number, entry in cell.entries.items()
        for score in scores(number, entry, cell.scenario, chosen[cell.scenario, number], pairings)
    ]
    ranked, rank_differences = ranking(scored, pairings) if pairings else ([], [])
    return Comparison(
        sets=[item.label for item in sets],
        ranked_by=ranked_by,
        scenarios=[_compared(cell, matches) for cell in cells],
        scores=scored,
        differences=found,
        overall=overall(found) if not single and len(cells) > 1 else [],
        ranking=ranked,
        rank_differences=rank_differences,
        gates=held(limits, known, found, missing),
        not_compared=missing,
        notes=[*notes, *_notes(cells, matches, chosen, single)],
    )


def _pairings(found: Sequence[PairDifference], matches: Sequence[Match], metric: ComparedMetric) -> Pairings:
    """Which tracker is better where, whatever metrics are compared."""
    known = any(item.metric == metric.path for item in found)
    return Pairings(found if known else differences(matches, [metric], over_scenarios=False)[0], metric.path)


def _ranked_by(sets: Sequence[ResultSet]) -> str:
    """The metric that trackers are ranked by.

    Raises:
        InputError: identities are hidden in some results and known in others, or there is no truth.
    """
    every = [entry for item in sets for entry in item.entries]
    for entry in every:
        if not entry.result.summary.truth.known:
            raise InputError("a recording without a truth: there are no errors to compare", file=entry.label)
    first, *others = every
    ours = first.result.summary
    for entry in others:
        theirs = entry.result.summary
        if theirs.identities != ours.identities:
            reason = f"identities are {theirs.identities} here and {ours.identities} there"
            raise InputError(f"cannot be compared with {first.label}: {reason}", file=entry.label)
    return ours.headline


def _set_of(number: int, item: ResultSet | Result | Sequence[Result]) -> ResultSet:
    if isinstance(item, ResultSet):
        return item
    label = f"results {number + 1}"
    if isinstance(item, Result):
        return ResultSet(label, (Entry(label, item),))
    names = [result.name for result in item]
    for name in names:
        if names.count(name) > 1:
            message = f"two results of the scenario {name!r} in one list; give each result as an argument of its own"
            raise InputError(message, file=label)
    return ResultSet(label, tuple(Entry(f"{label}: {result.name}", result) for result in item))


def _metric(path: str, key: str, sets: Sequence[ResultSet]) -> ComparedMetric:
    """A metric by its path, which may be one that is not built in."""
    hidden = sets[0].entries[0].result.summary.identities == "hidden"
    own = [metric for item in sets for entry in item.entries for metric in entry.result.summary.score.metrics]
    return compared_metric(path, key, own, built_in=not hidden)


def _require_known(sets: Sequence[ResultSet], trackers: Sequence[str] | None) -> None:
    known = {name for item in sets for entry in item.entries for name in entry.trackers}
    for name in trackers or ():
        if name not in known:
            raise InputError(f"no tracker {name!r} in these results; {nearest(name, known)}", key="--trackers")


def _cells(sets: Sequence[ResultSet]) -> tuple[list[_Cell], list[str]]:
    """The scenarios that are compared, and which are not."""
    if all(len(item.entries) == 1 for item in sets):
        first = sets[0].entries[0].result.name
        return [_Cell(first, {number: item.entries[0] for number, item in enumerate(sets)})], []
    by_name: dict[str, dict[int, Entry]] = {}
    for number, item in enumerate(sets):
        for entry in item.entries:
            by_name.setdefault(entry.result.name, {})[number] = entry
    cells, notes = [], []
    for name, entries in by_name.items():
        if len(sets) == 1 or (0 in entries and len(entries) > 1):
            cells.append(_Cell(name, entries))
        else:
            labels = ", ".join(sets[number].label for number in entries)
            notes.append(f"in {labels} alone, so not compared: scenario {name}")
    if not cells:
        raise InputError("nothing to compare: no scenario is in the first folder and a later one", file=sets[-1].label)
    return cells, notes


def _matches(cell: _Cell, chosen: dict[tuple[str, int], list[str]], single: bool) -> Iterator[Match]:
    baseline = cell.entries[0]
    if single:
        yield within(baseline, chosen[cell.scenario, 0])
        return
    for number, entry in cell.entries.items():
        if number > 0:
            pairs = same_tracker(chosen[cell.scenario, 0], chosen[cell.scenario, number])
            yield Match(cell.scenario, entry, baseline, number, comparability(baseline, entry), pairs)


def _require_judgeable(
    sets: Sequence[ResultSet], cells: Sequence[_Cell], chosen: dict[tuple[str, int], list[str]]
) -> None:
    """Make sure that no regression could pass unseen.

    Raises:
        InputError: there is no later set, a result without an interval, or a scenario or tracker that a later set
            lacks.
    """
    if len(sets) < 2:
        raise InputError("needs two results: the baseline, and a later one", key=OPTION)
    compared = {cell.scenario: cell for cell in cells}
    for number, later in enumerate(sets[1:], 1):
        for entry in sets[0].entries:
            name = entry.result.name
            if name not in compared or number not in compared[name].entries:
                message = f"no result of the scenario {name!r}, which the baseline has"
                raise InputError(message, file=later.label, key=OPTION)
    for cell in cells:
        for number, entry in cell.entries.items():
            if entry.result.summary.runs == 1:
                message = (
                    "a single run gives no interval, so no regression can be shown; "
                    "state expectations with below: instead"
                )
                raise InputError(message, file=entry.label, key=OPTION)
            ours, theirs = chosen[cell.scenario, 0], chosen[cell.scenario, number]
            lost = [name for name in ours if name not in theirs]
            if lost and not len(ours) == len(theirs) == 1:
                message = f"no tracker {lost[0]!r}, which the baseline has; name those to compare with --trackers"
                raise InputError(message, file=entry.label, key=OPTION)


def _compared(cell: _Cell, matches: Sequence[Match]) -> ComparedScenario:
    scenario = cell.entries[0].result.summary.scenario
    how = {match.number: match.how for match in matches if match.scenario == cell.scenario and match.number > 0}
    return ComparedScenario(
        name=cell.scenario,
        description=scenario.description,
        results=[_result(number, entry, how.get(number)) for number, entry in cell.entries.items()],
    )


def _result(number: int, entry: Entry, how: Comparability | None) -> ComparedResult:
    summary = entry.result.summary
    return ComparedResult(
        set=number,
        label=entry.label,
        runs=summary.runs,
        seed=summary.seed,
        expectations=len(summary.expectations),
        expectations_met=sum(item.passed for item in summary.expectations),
        shared_runs=None if how is None or how.shared is None else len(how.shared[0]),
        reason="" if how is None else how.reason,
    )


def _notes(
    cells: Sequence[_Cell], matches: Sequence[Match], chosen: dict[tuple[str, int], list[str]], single: bool
) -> Iterator[str]:
    """What a reader must know beside the differences."""
    if any(entry.result.summary.runs == 1 for cell in cells for entry in cell.entries.values()):
        yield "one run is compared by nothing but its values"
    compared = {
        (match.scenario, entrant) for match in matches for pair in match.pairs for entrant in match.entrants(pair)
    }
    for cell in cells if not single else ():
        for number, entry in cell.entries.items():
            names = chosen[cell.scenario, number]
            alone = [name for name in names if (cell.scenario, Entrant(tracker=name, set=number)) not in compared]
            if alone:
                yield f"in {entry.label} alone, so not compared: {', '.join(alone)}"
    yield from coverage_notes(matches)
