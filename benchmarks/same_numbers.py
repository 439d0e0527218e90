"""Show that two commits give the same numbers, to the last bit: of every shipped scenario by both engines, and of the
other commands. Prints a line for each, and the first values that differ; exits with 1 if any do.

python -m benchmarks.same_numbers OLD [NEW]                  folders of a checkout, or commits; NEW is this one
python -m benchmarks.same_numbers OLD --save DIR             only keeps the results of OLD, but those that are there
python -m benchmarks.same_numbers --old-results DIR [NEW] --only highway --only 'traffic/*' --only 'commands/tune*'
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from benchmarks.same_numbers_runs import (
    NOTES,
    REPOSITORY,
    Checkout,
    Task,
    checked_out,
    read_notes,
    removed,
    tasks,
    write_notes,
)
from benchmarks.same_numbers_values import ORDER, Values, describe_difference, numerals, read, same_bits

# A path is FILE:KEY.KEY[ENTRY].KEY of a JSON file and FILE:COLUMN of a table, FILE being relative to the folder of the
# result. An entry of a list is named by its name, metric and the like where these tell the entries apart, else by its
# number. In the patterns below * stands for anything, and a pattern also holds for all that is inside what it names.

#: Old path: new path, where only the name has changed; each * of the new path is what the same * of the old one was.
#: The order matters: all that match are applied, one after the other.
RENAMED: dict[str, str] = {}
#: Path of a column of words or of a word: old word: new word.
RENAMED_VALUES: dict[str, dict[str, str]] = {}
#: New path that the old commit does not have: why.
ADDED: dict[str, str] = {
    "*truth.recorded_motion*": "of recorded traffic: what as_recorded and as_used had",
    "*truth.targets.ids": "null beside nearest",
    "*truth.targets.nearest": "null beside ids",
    "*result.json:tables*": "digests of the files of the tables",
    "*trackers[*].offline": "whether a tracker's results were made elsewhere",
    "*trackers[*].paired": "whether its tracks are of the measurements of the others",
    "*trackers[*].time_offset": "of tracks that were made elsewhere",
    "*trackers[*].conditions*": "the scores by condition, in one level",
    "*trackers[*].use*": "a tracker that is not built in, as the scenario names it",
    "*sensors.*.sigmas*": "noise by component, in place of a text",
    "*steps.parquet:recorded_gospa_m": "GOSPA of the recorded run, which the report computed again",
}
#: Old path that the new commit does not have: why.
REMOVED: dict[str, str] = {
    "*truth.others_within_m": "an option that is gone",
    "*audit.clock_drift_s": "time is counted in the simulator's steps whatever its clock",
    "*audit.repaired.own_clock": "the same",
    "*audit.repaired.velocity_from_course_and_slip": "what the simulator states and no truth uses is not judged",
    "*truth.as_recorded*": "of recorded traffic: recorded_motion has it",
    "*truth.as_used*": "the same",
    "*components.*.mean*": "the errors that an audit of a log estimates together tell it",
    "*components.*.exponent*": "the noise by range is in its bands",
    "*components.*.spread": "the same",
    "*detections.seen_*": "fields that no page showed",
    "*truth_velocity[*].jumps": "a finding that is gone",
    "*truth_velocity[*].noise": "a field that no page showed",
    "*trackers[*].first_velocity*": "the warning about a stated first velocity is gone",
    "*trackers[*].run_spread": "trackers that use no measurement are not looked for",
    "*:precision*": "a run has the number of runs that it is given",
    "*trackers[*].breakdown*": "trackers[*].conditions has the scores by condition, in one level",
    "*trackers[*].scene_share": "a share that no page showed",
    "*trackers[*].along_path_m": "a shift that no page showed",
    "*trackers[*].offset_alone_s": "an offset that no page showed",
    "*.bounds95*": "bounds that no page showed: the interval tells of whiteness",
    "*tolerance_mps": "a constant of the audit",
    "*result.json:reference.motion": "always the same one",
    "*result.json:reference.acceleration_changes": "the kind of the reference tells it",
    "*result.json:reference.velocity_sigma_mps": "scenario.text has it",
    "*result.json:score.each": "scenario.text has it",
    "*result.json:score.divergence_m": "scenario.text has it",
    "*result.json:score.lost_after_s": "scenario.text has it",
    "*result.json:score.switch_costs_s": "scenario.text has it",
    "*result.json:sensors*.mount*": "scenario.text has it",
    "*result.json:sensors*.dof": "the kind of the sensor tells it",
    "*result.json:sensors*.noise*": "noise has all components as one text",
    "breakdown.parquet*": "result.json has the scores by manoeuvre and by range",
    "*autocorrelation.parquet*": "only the correlation at a lag of one measurement is judged",
    "*existence.parquet*": "a table that no page showed",
    "*association.parquet*": "runs.parquet has the same numbers for each run",
    "*steps.parquet:position_p10_m": "a column that no page showed",
    "*steps.parquet:position_p90_m": "a column that no page showed",
    "*siap_*": "metrics that stood beside GOSPA, HOTA and MOTA and said the same",
    "*:position_p95*": "a metric that no page showed: the points of chi-square tell of large errors",
    "*:velocity_p95*": "the same",
    "*position_p95*": "the same",
    "*velocity_p95*": "the same",
    "*course_*": "a metric that no page showed: the errors of the velocity tell it",
    "*trackers[*].metrics.position_reference": "that of the errors over its ratio to the reference",
    "*trackers[*].metrics.velocity_reference": "the same",
    "*.motp*": "the position RMSE of matched tracks says it",
    "*ospa*": "metrics that stood beside GOSPA and T-GOSPA and said the same",
    "*fragmentations*": "the share of lost time and the events say it",
    "*track_purity*": "IDF1 and AssA say it",
    "*track_length*": "the tracks per minute that begin say it",
    "*ospa2*": "a metric that stood beside T-GOSPA and said the same",
    "*start_delay*": "a run with score.settle_s of 0 tells how tracks begin",
    "*start_position_rmse*": "a run with score.settle_s of 0 tells how tracks begin",
    "*tgospa_half*": "T-GOSPA at another cost of a switch: set score.switch_costs_s",
    "*tgospa_twice*": "T-GOSPA at another cost of a switch: set score.switch_costs_s",
    "*track_breaks*": "a count against the sensor's own tracks, which are no truth",
    "*track_swaps*": "a count against the sensor's own tracks, which are no truth",
}
#: Path that is not compared: why.
LEFT_OUT: dict[str, str] = {
    "*audit.velocity_error_before*": "of the truth's own velocity, before of the one that the simulator states",
    "*audit.verdict": "the same",
    "*.step_time": "measured with a clock",
    "*step_time|*": "measured with a clock",
    "*|step_time*": "measured with a clock",
    "*:versions": "of packages, and of trackbench itself",
    "*:rerun": "a version",
    "*:schema_version": "a version",
    "*:command": "holds paths",
    "*:provenance*": "when and of which commit it was made",
    "*:file": "a path",
    "*:sets": "paths",
    "*.label": "a path",
    "*result.json:scenario.text": "the text of the file of the scenario, with its comments",
    "*result.json:scenario.file": "a path",
    "*result.json:artifacts": "names of files, which are compared themselves",
    "*result.json:truth.cached": "whether an earlier run has left it in the cache",
}
#: Sentences for people: the numbers in them are compared, other words are told and are no difference.
SENTENCES = (
    "*.describe",
    "*description",
    "*.meaning",
    "*.reason",
    "*.text",
    "*.question",
    "*.result",
    "*.evidence",
    "*.advice",
    "*.remarks",
    "*:note",
    "*.held_out",
    "*commands/tune*.verdict",
    "*:why",
)
SHOWN = 5


@dataclass
class Outcome:
    """What the comparison of two results has shown."""

    values: int = 0
    differences: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", nargs="*", metavar="OLD [NEW]")
    parser.add_argument("--old-results", type=Path, metavar="DIR", help="in place of OLD: what --save has kept")
    parser.add_argument(
        "--save", type=Path, metavar="DIR", help="keep the results of OLD here, and go on with what is there"
    )
    parser.add_argument("--runs", type=int, metavar="N", help="runs of a scenario, at most [3]")
    parser.add_argument("--only", action="append", metavar="GLOB", help="scenario, or commands/NAME; again")
    parser.add_argument("--engines", default="numpy,fused")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="so many at once [1]")
    parser.add_argument("--all", action="store_true", help=f"show every difference, not the first {SHOWN}")
    options = parser.parse_args()
    places = list(options.places) if options.old_results is None else [None, *options.places]
    if not 1 <= len(places) <= 2 or (options.old_results is not None and options.save is not None):
        parser.error("give OLD and perhaps NEW, or --old-results DIR and perhaps NEW")
    with tempfile.TemporaryDirectory(prefix="same_numbers-") as folder:
        new = places[1] if len(places) == 2 else None if options.save else str(REPOSITORY)
        sys.exit(0 if _compare(places[0], new, options, Path(folder)) else 1)


def _compare(old: str | None, new: str | None, options: argparse.Namespace, work: Path) -> bool:
    """Compare the commits, or only keep the results of the old one; whether there was no difference and no failure."""
    results = options.old_results or options.save or work / "old-results"
    fresh = {"runs": options.runs or 3, "tasks": [], "failed": {}}
    notes = read_notes(results) if old is None or (results / NOTES).exists() else fresh
    if options.runs not in (None, notes["runs"]):
        sys.exit(f"the old results are of {notes['runs']} runs")
    trees = {"old": work / "old-tree", "new": work / "new-tree"}
    began = time.monotonic()
    failed, values, count = 0, 0, 0
    try:
        sides = [
            None if place is None else Checkout(checked_out(place, trees[side]), work / side)
            for side, place in (("old", old), ("new", new))
        ]
        for side in filter(None, sides):
            side.prepare()
        engines = options.engines.split(",")
        listed = [task for side in filter(None, sides) for task in tasks(side.source, engines)]
        listed += [Task(*names) for names in notes["tasks"] if old is None and names[1] in engines]
        chosen = [task for task in dict.fromkeys(listed) if _named(task, options.only or ["*"])]

        def try_one(task: Task) -> tuple[Task, Outcome, float]:
            start = time.monotonic()
            outcome = _tried(task, *sides, results, work / "new-results" / task.folder, notes)
            return task, outcome, time.monotonic() - start

        with ThreadPoolExecutor(options.jobs) as pool:
            for task, outcome, seconds in pool.map(try_one, chosen):
                _show(task, outcome, seconds, options.all)
                failed += bool(outcome.differences)
                values += outcome.values
                count += 1
                if options.save is not None:
                    write_notes(results, {key: copy(value) for key, value in notes.items()})
    finally:
        for tree in trees.values():
            removed(tree)
    verdict = (
        f"{failed} of {count} differ or failed" if failed else f"all {count} are the same" if new else f"{count} kept"
    )
    print(f"{verdict}: {values} values in {time.monotonic() - began:.0f} s")
    return not failed and bool(count)


def _named(task: Task, patterns: list[str]) -> bool:
    return any(fnmatch(task.name, pattern) for pattern in patterns)


def _tried(
    task: Task, old: Checkout | None, new: Checkout | None, results: Path, new_out: Path, notes: dict[str, Any]
) -> Outcome:
    """Run a task with both commits, with the old one only where its results are not there, and compare."""
    names = [task.name, task.engine]
    if old is not None and names not in notes["tasks"]:
        if why := old.compute(task, notes["runs"], results / task.folder):
            notes["failed"][task.folder] = why
        notes["tasks"].append(names)
    if names not in notes["tasks"]:
        return Outcome(differences=["there are no old results of it"])
    if task.folder in notes["failed"]:
        return Outcome(differences=[f"the old commit failed: {notes['failed'][task.folder]}"])
    if new is None:
        return Outcome()
    try:
        if why := new.compute(task, notes["runs"], new_out):
            return Outcome(differences=[f"the new commit failed: {why}"])
        outcome = compared(read(results / task.folder, task.name), read(new_out, task.name))
        return outcome if outcome.values else Outcome(differences=["there are no values", *outcome.differences])
    finally:
        shutil.rmtree(new_out, ignore_errors=True)


def _show(task: Task, outcome: Outcome, seconds: float, everything: bool) -> None:
    same = "same" if outcome.values else "kept"
    verdict = f"{len(outcome.differences)} DIFFERENCES" if outcome.differences else same
    print(f"{task.name:32} {task.engine:6} {verdict}, {outcome.values} values, {seconds:.0f} s", flush=True)
    for lines in (outcome.differences, outcome.notes):
        for line in lines if everything else lines[:SHOWN]:
            print(f"    {line}")
        if len(lines) > SHOWN and not everything:
            print(f"    and {len(lines) - SHOWN} more (--all)")
    sys.stdout.flush()


def compared(old: Values, new: Values) -> Outcome:
    """Hold the values of one result against those of another."""
    outcome = Outcome()
    kept = [path for path in old if not matching(path, LEFT_OUT)]
    names = Counter(map(renamed, kept))
    outcome.differences += [f"several of the old are renamed: {path}" for path, count in names.items() if count > 1]
    old = {renamed(path): old[path] for path in kept}
    new = {path: value for path, value in new.items() if not matching(path, LEFT_OUT)}
    only_old = [path for path in old if path not in new and not path.endswith(ORDER)]
    only_new = [path for path in new if path not in old and not path.endswith(ORDER)]
    for path in old.keys() & new.keys():
        outcome.values += _compare_value(path, old[path], new[path], outcome)
    outcome.differences.sort()
    removed_, added = _told(only_old, REMOVED), _told(only_new, ADDED)
    outcome.notes += [f"removed {len(removed_)} values, added {len(added)}"] if removed_ or added else []
    unmatched = [path for path in only_new if path not in added]
    for path in (path for path in only_old if path not in removed_):
        alike = [other for other in unmatched if same_bits(old[path], new[other])] if ".parquet:" in path else []
        hint = f"; the same values are in the new {', '.join(alike)}" if alike else ""
        outcome.differences.append(f"only in the old: {path}{hint}")
    outcome.differences += [f"only in the new: {path}" for path in unmatched]
    return outcome


def _compare_value(path: str, old: Any, new: Any, outcome: Outcome) -> int:
    """How many values were compared; what differs goes to ``outcome``."""
    for pattern, words in RENAMED_VALUES.items():
        if matching(path, [pattern]):
            old = [words.get(word, word) for word in old] if isinstance(old, list) else words.get(old, old)
    if path.endswith(ORDER):
        # Entries that one side lacks are told of themselves.
        old, new = ([name for name in side if name in other] for side, other in ((old, new), (new, old)))
        if old != new:
            outcome.differences.append(f"{path}: {' '.join(old)} -> {' '.join(new)}")
        return 0
    if not same_bits(old, new):
        if matching(path, SENTENCES) and numerals(old) == numerals(new):
            outcome.notes.append(f"other words: {path}: {old!r} -> {new!r}"[:300])
        else:
            outcome.differences.append(f"{path}{describe_difference(old, new)}"[:400])
    return len(old) if hasattr(old, "__len__") and not isinstance(old, str) else 1


def renamed(path: str) -> str:
    """The path that a value of the old commit has in the new one."""
    for old, new in RENAMED.items():
        match = re.match(_expression(old), path)
        if match:
            parts = iter(match.groups())
            path = re.sub(r"\*", lambda _: next(parts), new) + path[match.end() :]  # noqa: B023
    return path


def matching(path: str, patterns: Iterable[str]) -> bool:
    """Whether a path is what a pattern names, or inside it."""
    return any(re.match(_expression(pattern), path) for pattern in patterns)


def _expression(pattern: str) -> str:
    return re.escape(pattern).replace(r"\*", "(.*?)") + r"(?=$|[.:\[])"


def _told(paths: list[str], reasons: Mapping[str, str]) -> set[str]:
    return {path for path in paths if matching(path, reasons)}


if __name__ == "__main__":
    main()
