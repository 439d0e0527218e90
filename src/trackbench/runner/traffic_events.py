"""What happened to objects and tracks, and how well the tracks say what they know, as tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from trackbench.base.types import Array
from trackbench.metrics.traffic.existence import BINS
from trackbench.metrics.traffic.strips import STATES
from trackbench.results.table_check import NO_OBJECT
from trackbench.runner.columns import Columns, stacked
from trackbench.runner.traffic_sums import dearest, summed
from trackbench.runner.work import Work

if TYPE_CHECKING:
    from trackbench.runner.traffic_results import TrafficEvaluation

ASSOCIATIONS = ("right", "wrong_object", "clutter", "missed")


def events_table(work: Work, found: Mapping[str, TrafficEvaluation]) -> pa.Table:
    """All events of the recorded run, and those of the others: of more than ``MOST_EVENTS`` the dearest."""
    return stacked([_events(work, name, item) for name, item in found.items()])


def _events(work: Work, name: str, evaluation: TrafficEvaluation) -> Columns:
    recorded = work.number(work.recorded_scene, work.recorded_run)
    rows = dearest([event for block in evaluation.blocks for event in block.events], recorded)
    ids = [work.scenes[scene].truth.ids for scene in work.scene_of_run]

    def number(field: str) -> Array:
        return np.array([getattr(event, field) for _, event in rows], dtype=float)

    def objects(field: str) -> list[str]:
        numbers = ((run, getattr(event, field)) for run, event in rows)
        return [ids[run][item] if item >= 0 else NO_OBJECT for run, item in numbers]

    return {
        "tracker": [name] * len(rows),
        "kind": [event.kind for _, event in rows],
        "object": objects("object"),
        "other_object": objects("other_object"),
        "why": [event.why for _, event in rows],
        "run": np.array([run for run, _ in rows], dtype=float),
        "time_s": number("time"),
        "track": _known(number("track")),
        "other_track": _known(number("other_track")),
        "x_m": number("x"),
        "y_m": number("y"),
        "cost_m2": number("cost"),
    }


def objects_table(work: Work, found: Mapping[str, TrafficEvaluation], time: Array) -> pa.Table:
    """What each object's time was spent on in the recorded run, stretch by stretch."""
    ids = work.scenes[work.recorded_scene].truth.ids
    until = np.append(time[1:], 2 * time[-1] - time[-2] if len(time) > 1 else time[-1])
    parts: list[Columns] = []
    for name, evaluation in found.items():
        strips = next(block.strips for block in evaluation.blocks if block.strips is not None)
        for item, strip in enumerate(strips.T):
            starts = np.flatnonzero(np.diff(strip, prepend=-1))
            ends = np.append(starts[1:], len(strip)) - 1
            parts.append(
                {
                    "tracker": [name] * len(starts),
                    "object": [ids[item]] * len(starts),
                    "state": [STATES[code] for code in strip[starts]],
                    "time_s": time[starts],
                    "until_s": until[ends],
                }
            )
    return stacked(parts)


def association_table(found: Mapping[str, TrafficEvaluation]) -> pa.Table:
    """How often each tracker's tracks took a detection of their own object, another's, a false alarm or none."""
    parts: list[Columns] = []
    for name, evaluation in found.items():
        totals = {outcome: float(evaluation.sums(f"association_{outcome}")[0].sum()) for outcome in ASSOCIATIONS}
        if any(totals.values()):
            parts.append({"tracker": [name], **{outcome: np.array([total]) for outcome, total in totals.items()}})
    return stacked(parts)


def existence_table(found: Mapping[str, TrafficEvaluation]) -> pa.Table:
    """Tracks by the existence probability that they state, and how many of them are on an object."""
    parts: list[Columns] = []
    for name, evaluation in found.items():
        bins = summed([block.existence for block in evaluation.blocks])
        if bins is None:
            continue
        stated, real, number = (np.asarray(each, dtype=float) for each in bins)
        parts.append(
            {
                "tracker": [name] * BINS,
                "from": np.arange(BINS) / BINS,
                "to": np.arange(1, BINS + 1) / BINS,
                "count": number,
                "stated": stated / np.where(number > 0, number, np.nan),
                "real": real / np.where(number > 0, number, np.nan),
            }
        )
    return stacked(parts)


def _known(ids: Array) -> Array:
    """NaN where there is none."""
    return np.where(ids >= 0, ids, np.nan)
