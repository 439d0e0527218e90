"""The thinning of a long run's recording: which instants of the scene and points of the plots it keeps."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.results import Result, Tables
from trackbench.subjects.recording.focus import Opening, moment_of, worst_moments

#: Number of instants of a run, and points of a line, above which about this number is kept.
MOST = 4000
#: Number of worst moments of each tracker and each vehicle whose instants are kept.
WORST = 20
#: Time to either side of the moment worth seeing first in which every instant is kept, s.
AROUND_S = 3.0
#: Tables that are thinned by instant; measurements are thinned by scan.
BY_INSTANT = ("truth", "estimates", "tracks", "taken", "gates", "due")


def instants(tables: Tables) -> Array:
    """Return the instants at which the recorded run has estimates, tracks or measurements, ``(instants,)`` s."""
    sources = [tables.if_there(name) for name in ("estimates", "due", "tracks", "measurements")]
    return np.unique(np.concatenate([table["time_s"] for table in sources if table.num_rows] or [np.empty(0)]))


def thin_tables(result: Result) -> Tables:
    """Return the tables of a run; a long run's tables keep the rows of some instants only.

    These instants are kept: evenly spaced ones, all near the moment worth seeing first, and the worst moments of each
    tracker and vehicle. The latest scan of every sensor before each kept instant is kept as well.
    """
    tables, time = result.tables, instants(result.tables)
    if len(time) <= MOST:
        return tables
    evenly, opening = time[np.linspace(0, len(time) - 1, MOST).astype(int)], moment_of(result).time_s
    around = time[:0] if opening is None else time[np.abs(time - opening) <= AROUND_S]
    kept_times = np.unique(np.concatenate([evenly, around, _worst_times(result)]))
    thinned = {name: tables[name] for name in BY_INSTANT if tables.if_there(name).num_rows}
    rows = {name: _are_among(table["time_s"].to_numpy(), kept_times) for name, table in thinned.items()}
    if tables.measurements.num_rows:
        sensors, when = (tables.measurements[name].to_numpy() for name in ("sensor", "time_s"))
        rows["measurements"] = np.zeros(len(when), dtype=bool)
        for sensor in np.unique(sensors):
            scans = np.unique(when[sensors == sensor])
            latest = scans[np.maximum(np.searchsorted(scans, kept_times + 1e-9) - 1, 0)]
            rows["measurements"] |= (sensors == sensor) & _are_among(when, latest)
    return Tables({name: table.filter(rows[name]) if name in rows else table for name, table in tables.items()})


def extremes(values: Array) -> Indices:
    """Return the indices of the points of a line that are drawn: all points, or about ``MOST`` of a long line.

    Kept are both ends and, in each of ``MOST / 2`` stretches, the lowest, the highest and a missing value.
    """
    if len(values) <= MOST:
        return np.arange(len(values))
    size = -(-len(values) // (MOST // 2))
    stretches = np.append(values, np.full(-len(values) % size, np.nan)).reshape(-1, size)
    missing = ~np.isfinite(stretches)
    lowest = np.where(missing, np.inf, stretches).argmin(axis=1)
    highest = np.where(missing, -np.inf, stretches).argmax(axis=1)
    gap = np.where(missing.any(axis=1), missing.argmax(axis=1), lowest)
    places = np.arange(len(stretches)) * size + [lowest, highest, gap]
    return np.unique(np.append(places, [0, len(values) - 1]).clip(max=len(values) - 1))


def _worst_times(result: Result) -> Array:
    """Return the instants of the worst moments of each tracker and of each vehicle, s."""
    tables = [result.tables.if_there(name) for name in ("estimates", "tracks")]
    trackers = {name for table in tables if table.num_rows for name in table["tracker"].unique().to_pylist()}
    openings = [Opening(worst=WORST, tracker=name) for name in trackers]
    openings += [Opening(worst=WORST, vehicle=name) for name in result.summary.truth.objects if trackers]
    return np.array([moment.time_s for opening in openings for moment in worst_moments(result, opening)])


def _are_among(when: Array, time: Array) -> Mask:
    """Return a mask of the rows whose time, s, is among ``time`` up to rounding."""
    nearest = time[np.minimum(np.searchsorted(time, when - 1e-9), len(time) - 1)]
    return np.abs(nearest - when) < 1e-9
