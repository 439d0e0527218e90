"""Origin of each set of results: time, commit of the code, and other changes since the previous set."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from trackbench.compare.comparability import ScenarioResults
from trackbench.compare.comparison import SetOrigin
from trackbench.compare.entries import Entry, ResultSet
from trackbench.results import Summary
from trackbench.results.checks import differing


def origins_of_sets(count: int, cells: Sequence[ScenarioResults], trackers: Sequence[str] | None) -> list[SetOrigin]:
    """Return when and with which code each of several sets of results was made, in order; empty for a single set.

    Args:
        count: number of sets that are compared, the baseline first.
        cells: scenarios, each with its result in each set.
        trackers: names of the trackers that are compared; None for all.
    """
    origins = []
    for number in range(count if count > 1 else 0):
        of_scenarios = [cell.entries for cell in cells if number in cell.entries]
        known = [made for entries in of_scenarios if (made := entries[number].result.summary.provenance)]
        last = max(known, key=lambda made: made.made_at, default=None)
        commits = dict.fromkeys(made.commit_in_words for made in known if made.commit)
        pairs = [(entries[number - 1], entries[number]) for entries in of_scenarios if number - 1 in entries]
        changes = dict.fromkeys(change for pair in pairs for change in _changes(*pair, trackers))
        made_at = last and last.made_at.isoformat(timespec="milliseconds")
        commit = ", ".join(commits) or None
        origins.append(SetOrigin(set=number, made_at=made_at, commit=commit, changes=[*changes]))
    return origins


def order_notes(origins: Sequence[SetOrigin], sets: Sequence[ResultSet]) -> Iterator[str]:
    """Yield a note on each set of results that is listed after a set that was made later."""
    for before, after in pairwise(origins):
        if before.made_at and after.made_at and after.made_at < before.made_at:
            yield f"{sets[after.set].label} was made before {sets[before.set].label}, which is listed before it"


def _changes(before: Entry, after: Entry, trackers: Sequence[str] | None) -> Iterator[str]:
    ours, theirs = before.result.summary, after.result.summary
    yield from (f"{name} {old} to {new}" for name, old, new in differing(ours.versions, theirs.versions))
    described = [*differing(_described(ours, trackers), _described(theirs, trackers))]
    yield from (f"{name}: {old} to {new}" for name, old, new in described)
    a, b = ours.scenario, theirs.scenario
    if not described and (a.text, a.overrides) != (b.text, b.overrides):
        yield f"the scenario {b.name}"
    if ours.provenance and theirs.provenance:
        code = differing(ours.provenance.code, theirs.provenance.code)
        yield from (f"the code of {name}" for name, _, _ in code)
        old, new = ours.provenance.commit_in_words, theirs.provenance.commit_in_words
        if old != new:
            yield f"commit {old} to {new}"


def _described(summary: Summary, trackers: Sequence[str] | None) -> dict[str, str]:
    return {item.name: item.describe for item in summary.trackers if trackers is None or item.name in trackers}
