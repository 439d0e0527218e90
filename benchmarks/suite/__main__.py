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
from trackbench.subjects.suite.page import bibtex, entries_in, overview_table, scenario_letters
from trackbench.subjects.suite.suite import KINDS, Kind, find_suite

ROOT = Path(__file__).parents[2]
OUT, SUITE = ROOT / "results" / "suite", "trackbench-road-1"
TRACKBENCH = Path(sys.executable).parent / "trackbench"
#: Seconds of processor time of each tracker in all its scenarios.
TIMES = OUT / "times.json"
#: Stone Soup's JPDA would take an hour for all, most of it for tentative tracks of clutter.
ONLY = {"stonesoup_jpda": "traffic-typical,traffic-recorded"}
INTRODUCTION = (
    "Made by make suite (docs/suite.md). Each entry.json has the sha256 of estimates and scores; its command makes "
    "them anew, PYTHONPATH=benchmarks/suite trackbench suite verify results/suite/NAME checks them."
)
BUILT_IN = (
    "Built-in trackers have the values of the suite's file, those in benchmarks/suite the same motion and process "
    "noise, Stone Soup's in continuous time and equal at the sensor's rate. Both libraries' KFs read the lidar alone, "
    "kf_cv also the radar's positions. stonesoup_jpda is in two scenarios: all would take an hour."
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
    overview = overview_table(merged)
    # Without the scores, which stand in the tables below.
    rows = [(*row[:2], *row[3:]) for row in overview.rows]
    blocks: list[Block] = [
        Paragraph(INTRODUCTION),
        Table("best", (*overview.columns[:2], *overview.columns[3:]), tuple(rows)),
    ]
    blocks += [
        Section(title, tuple(_scores(merged, kind)))
        for title, kind in (("Position RMSE, m", "single"), ("T-GOSPA, m", "traffic"))
    ]
    blocks.append(Section("Who the trackers are", (Paragraph(BUILT_IN), *_trackers(merged, times))))
    blocks.append(Section("Cite the suite", (Code(bibtex(merged.suite), "bibtex"),)))
    lead = (
        "Trackers that share a letter are the same, or not shown to be better by more than the margin. In brackets: "
        "95 % intervals; where missing estimates are charged, the error of the given ones. Not ranked: too many "
        "missing."
    )
    return Document("suite", f"First entries of {SUITE}", tuple(blocks), lead=lead)


def _scores(merged: MergedEntries, kind: Kind) -> Iterator[Table]:
    """Yield tables of a few scenarios each, with the error and the groups of every tracker."""
    results = {name: result for name, result in merged.results.items() if merged.suite.scenarios[name].kind == kind}
    trackers = list(dict.fromkeys(name for result in results.values() for name in result.summary.ranking))
    width = ceil(len(results) / ceil(len(results) / 5))
    for first in range(0, len(results), width):
        columns = [(TRACKER, [Cell(name, tracker=name) for name in trackers])]
        for name, result in [*results.items()][first : first + width]:
            cells = metric_cells(own := [result[each] for each in result.summary.ranking], result.summary.headline)
            letters = scenario_letters(merged, name)
            texts = {
                each.name: f"{cell.text} ({'; '.join(cell.details)}) {letters.get(each.name, 'not ranked')}"
                for each, cell in zip(own, cells, strict=True)
            }
            columns.append((Column(name, left=True), [Cell(texts.get(each, "-")) for each in trackers]))
        yield Table.of_columns(f"{kind}-{first}", columns)


def _trackers(merged: MergedEntries, times: dict[str, int]) -> Iterator[Block]:
    """Yield who the trackers of others are, and the processor time of each tracker."""
    who = [stored.entry.tracker for stored in merged.entries if stored.entry.tracker.source != "trackbench"]
    rows = [(Cell(item.name, tracker=item.name), *map(Cell, (item.version, item.licence, item.source))) for item in who]
    headings = (TRACKER, *(Column(each, left=True) for each in ("version", "licence", "source")))
    yield Table("trackers", headings, tuple(rows))
    seconds = ", ".join(f"{name} {time}" for name, time in times.items())
    yield Paragraph(f"Processor time with scores and reports, s: {seconds}.")


if __name__ == "__main__":
    main()
