"""The scenarios of a comparison, and which of them the same metric ranks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trackbench.base.errors import InputError
from trackbench.compare.entries import Entry, ResultSet
from trackbench.compare.metrics import compared_metrics
from trackbench.metrics import Metric


@dataclass(frozen=True)
class ScenarioResults:
    """One scenario, with the result of each set that has it."""

    scenario: str
    entries: dict[int, Entry]

    @property
    def ranked_by(self) -> str | None:
        """The metric that ranks its trackers; None without a truth.

        Raises:
            InputError: another metric ranks those of another result.
        """
        first, *others = self.entries.values()
        ours = first.result.summary
        for entry in others:
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
        """Their names."""
        return ", ".join(cell.scenario for cell in self.cells)

    def metrics(self) -> dict[str, Metric]:
        """Those that its results have a value of in each run, by path.

        Raises:
            InputError: the one that ranks is none of them.
        """
        summaries = [entry.result.summary for cell in self.cells for entry in cell.entries.values()]
        own = [metric for summary in summaries for metric in summary.score.metrics]
        found = compared_metrics(own, built_in=summaries[0].identities == "known")
        if self.ranked_by not in found:
            problem = f"not the result of a run: {self.ranked_by} is none of its metrics"
            raise InputError(problem, file=self.cells[0].entries[0].label)
        return found


def cells_of(sets: Sequence[ResultSet]) -> tuple[list[ScenarioResults], list[str]]:
    """The scenarios that are compared, and which are not."""
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
    """The scenarios by the metric that ranks, and the names of those without a truth.

    Raises:
        InputError: none can.
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
