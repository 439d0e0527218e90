"""Merging of results with equal measurements, each with other trackers, to one result."""

from __future__ import annotations

import math
from collections.abc import Mapping

from trackbench.base.errors import InputError
from trackbench.results.result import Result
from trackbench.results.stored_tables import Tables
from trackbench.results.tracker_result import TrackerResult


def merged_result(results: Mapping[str, Result]) -> Result:
    """Merge results with the same measurements to one result with the trackers of all.

    The trackers stand in the order of the results. Tables without a column ``tracker`` come from the first result.

    Args:
        results: results, by a name for each that error messages mention.

    Raises:
        InputError: the measurements or the motion differ, or two trackers have the same name.
    """
    import pyarrow as pa

    (first_label, first), *others = results.items()
    for label, result in others:
        ours, theirs = first.summary, result.summary
        if (ours.fingerprints, ours.truth.motion) != (theirs.fingerprints, theirs.truth.motion):
            key = "truth.motion" if ours.fingerprints == theirs.fingerprints else "fingerprints"
            raise InputError(f"{result.name}: {key} differs from {first_label}, so nothing is paired", file=label)
    trackers, label_of = list[TrackerResult](), dict[str, str]()
    for label, result in results.items():
        for tracker in result.summary.trackers:
            if tracker.name in label_of:
                raise InputError(f"there is a tracker {tracker.name!r} in {label_of[tracker.name]} too", file=label)
            label_of[tracker.name] = label
            trackers.append(tracker.model_copy(update={"place": len(trackers)}))
    summaries, errors = [result.summary for result in results.values()], dict[str, float]()
    for tracker in trackers:
        metric = tracker.metrics.get(first.summary.headline)
        errors[tracker.name] = math.inf if metric is None or metric.value is None else metric.value
    scenes = [
        same[0].model_copy(update={"error": {name: error for scene in same for name, error in scene.error.items()}})
        for same in zip(*(summary.truth.scenes for summary in summaries), strict=True)
    ]
    update = {
        "trackers": trackers,
        "ranking": sorted(label_of, key=errors.__getitem__),
        "truth": first.summary.truth.model_copy(update={"scenes": scenes}),
        "passed": all(summary.passed for summary in summaries),
    }
    tables = {name: first.tables[name] for name in first.tables}
    for name in [name for name, table in tables.items() if "tracker" in table.column_names]:
        every = [result.tables[name] for result in results.values()]
        tables[name] = pa.concat_tables(every, promote_options="default").unify_dictionaries()
    return Result(first.summary.model_copy(update=update), Tables(tables))
