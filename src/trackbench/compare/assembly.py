"""Assembly of a comparison from stored results: checks, scores, differences, ranking and limits."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.execution import one_blas_thread
from trackbench.compare.comparability import (
    Group,
    ScenarioResults,
    cells_of,
    comparability,
    engine_notes,
    groups_of_cells,
    require_same_metric,
)
from trackbench.compare.comparison import (
    ComparedResult,
    ComparedScenario,
    Comparison,
    Entrant,
    EntrantScore,
    OrderInWorlds,
    RankedTracker,
)
from trackbench.compare.differences import (
    Match,
    coverage_notes,
    differences_to,
    judged_differences,
    match_within,
    same_tracker,
)
from trackbench.compare.entries import Entry, ResultSet
from trackbench.compare.limits import OPTION, Limit, gate_results
from trackbench.compare.origins import order_notes, origins_of_sets
from trackbench.compare.pooled import overall
from trackbench.compare.ranking import Pairings, entrant_scores, ranked_trackers, sets_of_scenes
from trackbench.metrics import Metric
from trackbench.results import Result, merged_places


def orders(
    cells: Iterable[ScenarioResults], ranked_by: str, scores: Sequence[EntrantScore], pairings: Pairings
) -> list[OrderInWorlds]:
    """Return the better tracker of each pair in each world (drivers and sensors); ``a`` leads in the first world."""
    by_base: dict[str, dict[str, str]] = {}
    for cell in cells:
        scenario = cell.entries[0].result.summary.scenario
        if scenario.world is not None:
            by_base.setdefault(scenario.base, {})[scenario.world] = cell.scenario
    result = []
    for base, worlds in by_base.items():
        first, *later = (_contender_errors(scores, name, ranked_by) for name in worlds.values())
        names = [name for name in sorted(first, key=first.__getitem__) if all(name in errors for errors in later)]
        for a, b in combinations(names, 2) if later else ():
            if all(pairings.compared(name, a, b) for name in worlds.values()):
                ahead = {world: pairings.better(name, a, b) for world, name in worlds.items()}
                result.append(OrderInWorlds(scenario=base, a=a, b=b, ahead=ahead))
    return result


def _contender_errors(scores: Sequence[EntrantScore], scenario: str, metric: str) -> dict[str, float]:
    ranked = [item for item in scores if item.scenario == scenario and not item.reference]
    return {score.entrant.tracker: value for score in ranked if (value := score.value(metric)) is not None}


def commands(
    sets: Sequence[ResultSet],
    metrics: Sequence[str],
    trackers: Sequence[str] | None,
    baseline: str | None,
    limits: Sequence[Limit],
) -> list[str]:
    """Return the commands that repeat each run and the comparison; empty if a result does not state its command."""
    if not all(entry.result.summary.command for item in sets for entry in item.entries):
        return []
    places = [_places(item) for item in sets]
    runs = [
        f"{entry.result.summary.command} {shlex.join(['--out', str(out)])}"
        for item, (out, _) in zip(sets, places, strict=True)
        for entry in item.entries
    ]
    options = [word for metric in metrics for word in ("--metric", metric)]
    options += [] if trackers is None else ["--trackers", ",".join(trackers)]
    options += [] if baseline is None else ["--baseline", baseline]
    options += [word for limit in limits for word in (OPTION, f"{limit.metric}:{limit.percent:g}")]
    compared = shlex.join(["trackbench", "compare", *(str(path) for _, path in places), *options])
    return [*dict.fromkeys(runs), compared]


def _places(item: ResultSet) -> tuple[Path, Path]:
    """Return two folders for commands: to write a set's runs to, and to name in ``trackbench compare``."""
    path = Path(item.label)
    path = path.parent if path.suffix == ".json" else path
    if len(item.entries) > 1 or item.entries[0].label != item.label:
        return path, path
    name = item.entries[0].result.name
    return (path.parent, path) if path.name == name else (path, path / name)


@one_blas_thread()
def compare_results(
    results: Sequence[ResultSet | Result | Sequence[Result]],
    *,
    metrics: Sequence[str] = (),
    trackers: Sequence[str] | None = None,
    baseline: str | None = None,
    limits: Sequence[Limit] = (),
) -> Comparison:
    """Compare the trackers of one set of results with each other, or the trackers of several sets with the first set's.

    A set holds the results of different scenarios; a single result is also a set. Results of the same scenario are
    compared over the runs with the same measurements, if there are any. If two results have a single tracker each,
    these two are compared even if their names differ. Scenarios that different metrics rank are compared separately;
    scenarios without a truth are not compared.

    Args:
        results: sets of results; the first set is the baseline.
        metrics: metrics to compare by, beside those of the limits; scenarios without any of them, and by default all
            scenarios, are compared by ``position_rmse``, or ``tgospa`` with hidden identities.
        trackers: names of the trackers to compare; None for all.
        baseline: name of the tracker of a single set that the others are compared with; None for the baseline that the
            scenarios state, else the best.
        limits: how much worse the trackers of the later sets are allowed to be.

    Raises:
        InputError: results cannot be compared, a name is unknown, or nothing is left to compare.
    """
    sets = [_set_of(number, item) for number, item in enumerate(results)]
    cells, left_out = cells_of(sets)
    groups, without_truth = groups_of_cells(cells)
    wanted = list(dict.fromkeys([*metrics, *(limit.metric for limit in limits)]))
    by_path = [group.metrics() for group in groups]
    _require_metrics(wanted, limits, by_path)
    names = {name for item in sets for entry in item.entries for name in entry.trackers}
    for name in trackers or ():
        if name not in names:
            raise InputError(f"no tracker {name!r} in these results; {nearest_choices(name, names)}", key="--trackers")
    kept = names if trackers is None else set(trackers)
    if baseline is not None:
        _require_baseline(baseline, sets, kept)
    compared = [cell for group in groups for cell in group.cells]
    chosen = {
        (cell.scenario, number): [name for name in entry.trackers if trackers is None or name in trackers]
        for cell in compared
        for number, entry in cell.entries.items()
    }
    if limits:
        limited = [metric_of[limit.metric] for metric_of in by_path for limit in limits if limit.metric in metric_of]
        _require_judgeable(sets, cells, compared, chosen, limited)
    comparisons, notes = [], [*left_out, *engine_notes(sets, compared)]
    if len(kept) < len(names):
        may = "would" if len(sets) == 1 else "may"
        among = f"Judged among {len(kept)} of the {len(names)} trackers"
        # Trackers that are the same in every run of two sets are not counted by the correction.
        notes.append(f"{among}: with all {len(names)} the corrected p-values {may} be larger.")
    what = "only one tracker" if len(sets) == 1 else "no tracker is in the first result and in a later one"
    for group, metric_of in zip(groups, by_path, strict=True):
        comparison = _comparison([item.label for item in sets], group, metric_of, wanted, limits, chosen, baseline)
        if comparison is not None:
            comparisons.append(comparison)
        else:
            notes.append(f"{group.scenarios} not compared: {what}")
        absent = [limit.metric for limit in limits if limit.metric not in metric_of]
        notes += [f"no {metric} in {group.scenarios}, so its limit says nothing of it" for metric in absent]
    if not comparisons:
        raise InputError(f"nothing to compare: {what}", file=sets[-1].label)
    first, *other_groups = comparisons
    shown = {name for members in chosen.values() for name in members}
    places = merged_places(entry.result for item in sets for entry in item.entries)
    origins = origins_of_sets(len(sets), cells, trackers)
    update = {
        "other_groups": other_groups,
        "origins": origins,
        "places": {name: place for name, place in places.items() if name in shown},
        "without_truth": without_truth,
        "notes": [*notes, *order_notes(origins, sets), *first.notes],
        "commands": commands(sets, metrics, trackers, baseline, limits),
    }
    return first.model_copy(update=update)


def _comparison(
    sets: list[str],
    group: Group,
    metrics: Mapping[str, Metric],
    wanted: Sequence[str],
    limits: Sequence[Limit],
    chosen: Mapping[tuple[str, int], list[str]],
    named_baseline: str | None,
) -> Comparison | None:
    cells, ranked_by, single = group.cells, group.ranked_by, len(sets) == 1
    wanted = [path for path in wanted if path in metrics] or [ranked_by]
    limits = [limit for limit in limits if limit.metric in metrics]
    for cell in cells:
        for entry in cell.entries.values():
            for path in (ranked_by, *wanted):
                require_same_metric(cell.entries[0], entry, path)
    matches = [match for cell in cells for match in _matches(cell, chosen, single, named_baseline)]
    if single and len(cells) > 1:
        wanted = list(dict.fromkeys([ranked_by, *wanted]))
    elif not any(match.pairs for match in matches):
        return None
    allowed = {limit.metric: limit.percent for limit in limits}
    compared = [metrics[path] for path in wanted]
    differing, missing = judged_differences(matches, compared, over_scenarios=not single, limits=allowed)
    pairings = None
    if single:
        # Trackers are paired by the metric that ranks, whatever metrics are compared.
        by_rank = differing
        if wanted != [ranked_by]:
            by_rank, _ = judged_differences(matches, [metrics[ranked_by]], over_scenarios=False)
        pairings = Pairings(by_rank, ranked_by)
    scored = [
        score
        for cell in cells
        for number, entry in cell.entries.items()
        for score in entrant_scores(number, entry, cell.scenario, chosen[cell.scenario, number], pairings, wanted)
    ]
    scenes = sets_of_scenes({cell.scenario: cell.entries[0].result.summary.truth.motion for cell in cells})
    order = ranked_trackers(scored, ranked_by) if single else []
    baseline = _baseline(cells, chosen, order, named_baseline) if single else None
    places = {item.tracker: place for place, item in enumerate(order)}
    to_baseline = (
        sorted(differences_to(baseline, differing), key=lambda item: places[item.entrant.tracker])
        if baseline
        else differing
    )
    return Comparison(
        sets=sets,
        ranked_by=ranked_by,
        scenarios=[_compared(cell, matches) for cell in cells],
        scores=scored,
        differences=differing,
        overall=overall(to_baseline, scenes, scored) if len(cells) > 1 else [],
        baseline=baseline,
        sets_of_scenes=scenes,
        ranking=order,
        worlds=orders(cells, ranked_by, scored, pairings) if pairings else [],
        gates=gate_results(limits, metrics, differing, missing),
        not_compared=missing,
        notes=[*_notes(cells, matches, chosen, single), *coverage_notes(matches, differing, compared)],
    )


def _baseline(
    cells: Sequence[ScenarioResults],
    chosen: Mapping[tuple[str, int], list[str]],
    order: Sequence[RankedTracker],
    named: str | None,
) -> str | None:
    """Return the tracker that the others are compared with; None for a single scenario without a baseline.

    The baseline is the tracker that the user named, else the ``score.baseline`` of all scenarios, else the best.
    """
    if any(named in chosen[cell.scenario, 0] for cell in cells):
        return named
    stated = {cell.entries[0].result.summary.score.baseline for cell in cells}
    name = stated.pop() if len(stated) == 1 else None
    if name is not None and all(name in chosen[cell.scenario, 0] for cell in cells):
        return name
    return order[0].tracker if order and len(cells) > 1 else None


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


def _require_metrics(wanted: Sequence[str], limits: Sequence[Limit], by_path: Sequence[Mapping[str, Metric]]) -> None:
    """Make sure that each named metric has a value in each run, and a better direction if a limit is on it."""
    for path in wanted:
        limited = any(limit.metric == path for limit in limits)
        metrics = [metric_of[path] for metric_of in by_path if path in metric_of]
        if not metrics:
            hint = nearest_choices(path, {name for metric_of in by_path for name in metric_of})
            raise InputError(f"{path!r} has no values by run to compare; {hint}", key=OPTION if limited else "--metric")
        if limited and any(metric.better is None for metric in metrics):
            raise InputError(f"{path} has no better direction, so it cannot regress; state an expectation", key=OPTION)


def _require_baseline(name: str, sets: Sequence[ResultSet], trackers: Collection[str]) -> None:
    """Make sure that there is a single set of results, and that tracker ``name`` is among its compared trackers."""
    if len(sets) > 1:
        message = f"of several results the first is the baseline: {sets[0].label}; name a tracker for one result only"
        raise InputError(message, key="--baseline")
    if name not in trackers:
        message = f"no tracker {name!r} among the compared ones; {nearest_choices(name, trackers)}"
        raise InputError(message, key="--baseline")


def _matches(
    cell: ScenarioResults, chosen: Mapping[tuple[str, int], list[str]], single: bool, named_baseline: str | None
) -> Iterator[Match]:
    baseline = cell.entries[0]
    if single:
        yield match_within(baseline, chosen[cell.scenario, 0], named_baseline)
        return
    for number, entry in cell.entries.items():
        if number > 0:
            pairs = same_tracker(chosen[cell.scenario, 0], chosen[cell.scenario, number])
            yield Match(cell.scenario, entry, baseline, number, comparability(baseline, entry), pairs)


def _require_judgeable(
    sets: Sequence[ResultSet],
    cells: Sequence[ScenarioResults],
    compared: Sequence[ScenarioResults],
    chosen: Mapping[tuple[str, int], list[str]],
    limited: Sequence[Metric],
) -> None:
    """Make sure that each limit can be judged for each tracker, so that no regression passes unseen.

    Raises:
        InputError: there is no later set, a result gives no interval, or a later set lacks a scenario or tracker.
    """
    if len(sets) < 2:
        raise InputError("needs two results: the baseline, and a later one", key=OPTION)
    by_name = {cell.scenario: cell for cell in cells}
    for number, later in enumerate(sets[1:], 1):
        for entry in sets[0].entries:
            name = entry.result.name
            if name not in by_name or number not in by_name[name].entries:
                message = f"no result of the scenario {name!r}, which the baseline has"
                raise InputError(message, file=later.label, key=OPTION)
    for cell in compared:
        for number, entry in cell.entries.items():
            lacking = [why for metric in limited if (why := entry.without_interval(metric))]
            if lacking:
                message = f"no regression can be shown: {lacking[0]}, or state expectations with below: instead"
                raise InputError(message, file=entry.label, key=OPTION)
            ours, theirs = chosen[cell.scenario, 0], chosen[cell.scenario, number]
            lost = [name for name in ours if name not in theirs]
            if lost and not len(ours) == len(theirs) == 1:
                message = f"no tracker {lost[0]!r}, which the baseline has; name those to compare with --trackers"
                raise InputError(message, file=entry.label, key=OPTION)


def _compared(cell: ScenarioResults, matches: Sequence[Match]) -> ComparedScenario:
    ways = {match.number: match.how for match in matches if match.scenario == cell.scenario and match.number > 0}
    compared = []
    for number, entry in cell.entries.items():
        summary, how = entry.result.summary, ways.get(number)
        result = ComparedResult(
            set=number,
            label=entry.label,
            runs=summary.runs,
            seed=summary.seed,
            expectations=len(summary.expectations),
            expectations_met=sum(item.passed for item in summary.expectations),
            shared_runs=None if how is None or how.shared is None else len(how.shared[0]),
            reason="" if how is None else how.reason,
        )
        compared.append(result)
    description = cell.entries[0].result.summary.scenario.description
    return ComparedScenario(name=cell.scenario, description=description, results=compared)


def _notes(
    cells: Sequence[ScenarioResults],
    matches: Sequence[Match],
    chosen: Mapping[tuple[str, int], list[str]],
    single: bool,
) -> Iterator[str]:
    if any(entry.result.summary.runs == 1 and entry.stretches < 2 for cell in cells for entry in cell.entries.values()):
        yield "a single run has no interval, so only its values are compared"
    compared = {
        (match.scenario, entrant) for match in matches for pair in match.pairs for entrant in match.entrants(pair)
    }
    for cell in cells if not single else ():
        for number, entry in cell.entries.items():
            names = chosen[cell.scenario, number]
            alone = [name for name in names if (cell.scenario, Entrant(tracker=name, set=number)) not in compared]
            if alone:
                yield f"in {entry.label} alone, so not compared: {', '.join(alone)}"
