"""Enter the built-in trackers and those of FilterPy and Stone Soup in trackbench-road-1: results/suite.

python -m benchmarks.suite [NAME...]
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Iterator
from math import ceil
from pathlib import Path

from trackbench.document import Block, Cell, Code, Column, Document, Paragraph, Section, Table
from trackbench.document.markdown import to_markdown
from trackbench.report.tables import TRACKER, metric_cells
from trackbench.subjects.suite.merge import MergedEntries, merged_entries
from trackbench.subjects.suite.page import bibtex, entries_in, group_letters, overview_table
from trackbench.subjects.suite.suite import KINDS, Kind, find_suite

ROOT = Path(__file__).parents[2]
OUT, SUITE = ROOT / "results" / "suite", "trackbench-road-1"
TRACKBENCH = Path(sys.executable).parent / "trackbench"
#: Seconds of processor time of each tracker in all its scenarios.
TIMES = OUT / "times.json"
#: Stone Soup's JPDA would take an hour for all, most of it for tentative tracks of clutter.
ONLY = {"stonesoup_jpda": "traffic-typical,traffic-recorded"}
INTRODUCTION = (
    "Made by make suite. docs/suite.md says how a suite works and how to enter your own tracker. Of each entry its "
    "entry.json is committed, with the sha256 of its estimates and scores. The command in it makes these files anew, "
    "PYTHONPATH=benchmarks/suite trackbench suite verify results/suite/NAME checks them, and trackbench suite page "
    "shows velocity, covariance and identities too."
)
BUILT_IN = (
    "The built-in trackers have the values of the suite's file. Those of other people's libraries are in "
    "benchmarks/suite, with the motion and process noise of the built-in ones; Stone Soup's noise is in continuous "
    "time, and equal at the rate of the sensor. The KFs of both libraries read the lidar alone, kf_cv also the "
    "positions of the radar. stonesoup_jpda is in two scenarios alone: all would take it an hour. The processor "
    "time is that of all scenarios with scores and reports, the motion having been simulated before."
)


def main() -> None:
    suite, files = find_suite(SUITE), sorted(Path(__file__).parent.glob("*.yaml"))
    named = {name: name for kind in KINDS for name in suite.stated.trackers[kind]}
    named |= {file.stem: str(file.relative_to(ROOT)) for file in files}
    times = json.loads(TIMES.read_text(encoding="utf-8")) if TIMES.exists() else {}
    for name in sys.argv[1:] or named:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        only = ["--only", ONLY[name]] if name in ONLY else []
        options = [*only, "--out", OUT, "--workers", "1", "--no-recording", "--quiet"]
        subprocess.run([TRACKBENCH, "suite", "run", SUITE, named[name], *options], check=True, cwd=ROOT)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times[name] = round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        TIMES.write_text(json.dumps(times, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    subprocess.run([TRACKBENCH, "suite", "page", OUT], check=True)
    (OUT / "README.md").write_text(to_markdown(readme(merged_entries([*entries_in(OUT)]), times)), encoding="utf-8")


def readme(merged: MergedEntries, times: dict[str, int]) -> Document:
    """Return the summary of the page that is committed."""
    letters = {name: group_letters(merged, name, result) for name, result in merged.results.items()}
    blocks: list[Block] = [Paragraph(INTRODUCTION), overview_table(merged, letters)]
    blocks += [
        Section(title, tuple(_scores(merged, kind, letters)))
        for title, kind in (("Position RMSE, m", "single"), ("T-GOSPA, m", "traffic"))
    ]
    blocks.append(Section("Who the trackers are", (Paragraph(BUILT_IN), _trackers(merged, times))))
    blocks.append(Section("Cite the suite", (Code(bibtex(merged.suite), "bibtex"),)))
    lead = (
        "Trackers that share a letter are not shown to differ by more than the margin. In brackets: 95 % intervals; "
        "where a tracker is charged for missing estimates, the error of the given ones. Not ranked: too many missing."
    )
    return Document("suite", f"First entries of {SUITE}", tuple(blocks), lead=lead)


def _scores(merged: MergedEntries, kind: Kind, letters: dict[str, dict[str, str]]) -> Iterator[Table]:
    """Yield tables of a few scenarios each, with the error and the groups of every tracker."""
    results = {name: result for name, result in merged.results.items() if merged.suite.scenarios[name].kind == kind}
    trackers = list(dict.fromkeys(name for result in results.values() for name in result.summary.ranking))
    width = ceil(len(results) / ceil(len(results) / 5))
    for first in range(0, len(results), width):
        columns = [(TRACKER, [Cell(name, tracker=name) for name in trackers])]
        for name, result in [*results.items()][first : first + width]:
            cells = metric_cells(own := [result[each] for each in result.summary.ranking], result.summary.headline)
            texts = {
                each.name: f"{cell.text} ({'; '.join(cell.details)}) {letters[name].get(each.name, 'not ranked')}"
                for each, cell in zip(own, cells, strict=True)
            }
            columns.append((Column(name, left=True), [Cell(texts.get(each, "-")) for each in trackers]))
        yield Table.of_columns(f"{kind}-{first}", columns)


def _trackers(merged: MergedEntries, times: dict[str, int]) -> Table:
    rows = [(stored.entry.tracker, times.get(stored.entry.tracker.name, 0)) for stored in merged.entries]
    cells = [
        (Cell(who.name, tracker=who.name), *map(Cell, (who.version, who.licence, who.source, f"{seconds}")))
        for who, seconds in rows
    ]
    headings = (
        TRACKER,
        *(Column(each, left=True) for each in ("version", "licence", "source")),
        Column("processor time, s"),
    )
    return Table("trackers", headings, tuple(cells))


if __name__ == "__main__":
    main()
