"""Tracks that another program wrote: read, placed at the instants of a run, with the truth at their time stamps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import InputError, shortened_text
from trackbench.base.types import Array, Indices, Mask, Truth
from trackbench.metrics.traffic import TrackHistory, TruthHistory
from trackbench.scenario.keys import TrackerEntry
from trackbench.trackers.answers import NO_TRACK
from trackbench.truth.config.traffic import TracksConfig, files_in, read_tracks
from trackbench.truth.row_times import nearest_rows, row_period
from trackbench.truth.tracks import SAME_STAMP_S, TrackRows

#: Longest period of a track's rows at which the track also exists between its rows, s.
LONGEST_PERIOD_S = 0.5
_NONE = np.zeros(0, dtype=np.intp)
#: Largest number of instants times tracks: their covariances take half a gigabyte.
MOST_CELLS = 4_000_000
#: Largest number of objects times tracks times instants, where tracks of one instant have different time stamps.
LARGEST = 20_000_000


class PlacedTracks(NamedTuple):
    """Tracks of one run at its T instants, in K columns; a track may change its column."""

    history: TrackHistory
    stamp: Array
    """``(T, K)`` time stamp of each track, s after the start of the truth; NaN in an empty column."""


def rows_of_files(
    trackers: Mapping[str, TrackerEntry], truths: Sequence[Truth], runs: int, folder: Path
) -> dict[str, list[TrackRows]]:
    """Return the rows of each file with external tracks, by name of the tracker.

    Args:
        trackers: trackers of the scenario, by name.
        truths: truth of each scene.
        runs: number of runs of each scene.
        folder: folder that relative paths start from.

    Raises:
        InputError: a file is damaged, lacks the column ``run`` where there are several runs, or has no row within the
            time of a truth.
    """
    rows_of: dict[str, list[TrackRows]] = {}
    spans = [(float(truth.start) + truth.time[0], float(truth.start) + truth.time[-1]) for truth in truths]
    # A time stamp then belongs to one scene only.
    apart_in_time = all(end <= later for (_, end), (later, _) in pairwise(sorted(spans)))
    for name, config in trackers.items():
        if not isinstance(config, TracksConfig):
            continue
        rows_of[name] = read_tracks(config, name, folder)
        for number, (file, rows) in enumerate(zip(files_in(config.path), rows_of[name], strict=True)):
            several = len(rows_of[name]) > 1
            if rows.run is None and (runs > 1 or not (several or apart_in_time)):
                message = "there is no column run, and the scenario has several runs or scenes; use --runs 1, one scene"
                raise InputError(f"{message}, or a list of files, one for each scene", file=file)
            expected = spans[number : number + 1] if several else spans
            if rows.run is not None:
                expected = [(float(truth.time[0]), float(truth.time[-1])) for truth in truths]
            problem = why_no_overlap(rows, config.time_offset_s, expected)
            if problem is not None:
                raise InputError(problem, file=file, key=f"trackers.{name}")
    return rows_of


def clock_shift(rows: TrackRows, truth: Truth, offset: float) -> float:
    """Return the time to add to the rows' times, s, so that they count from the start of a truth.

    Rows have the truth's clock; but rows with a column ``run``, from exported scans, count from the start already.
    """
    return float(rows.start - (0 if rows.run is not None else truth.start)) + offset


def rows_of_run(rows: TrackRows, scene: int, run: int) -> TrackRows:
    """Return the rows of one scene and run, by number; a file without a column of scenes or runs gives all its rows."""
    matches = np.ones(len(rows), dtype=bool)
    for column, number in ((rows.scene, scene), (rows.run, run)):
        if column is not None:
            matches &= np.array([text in (str(number), f"{number}.0") for text in column], dtype=bool)
    return rows if matches.all() else rows.rows(np.flatnonzero(matches))


def why_other_scans(rows: TrackRows, fingerprint: str) -> str | None:
    """Say why the tracks of a run were made from other scans; None if fingerprints agree or are not stated.

    Args:
        rows: rows of the run.
        fingerprint: fingerprint of the run's measurements.
    """
    stated = sorted({*(rows.fingerprint or ())} - {fingerprint})
    if not stated:
        return None
    if stated == [""]:
        return "some rows have no fingerprint, and others have one"
    remedy = "they were made of other scans (name, seed, sensors or truth of the scenario differ): export them anew"
    theirs = shortened_text(stated[-1], 40)
    return f"the tracks have the fingerprint {theirs!r}, the measurements {fingerprint!r}; {remedy}"


def inside(rows: TrackRows, shift: float, first: float, last: float) -> Mask:
    """Return a mask of the rows from ``first`` to ``last``, s, plus half of ``LONGEST_PERIOD_S`` at either end."""
    stamp, margin = rows.time + shift, LONGEST_PERIOD_S / 2
    return np.asarray((stamp >= first - margin) & (stamp <= last + margin))


def why_no_overlap(rows: TrackRows, offset: float, spans: Sequence[tuple[float, float]]) -> str | None:
    """Say why no row of a file is within the time of any truth; None where a row is.

    Args:
        rows: rows of the file.
        offset: time to add to the time stamps, s.
        spans: first and last time of each truth, s of the clock.
    """
    shift = float(rows.start) + offset
    if any(inside(rows, shift, *span).any() for span in spans):
        return None
    first, last = rows.time.min() + shift, rows.time.max() + shift
    begin, end = min(span[0] for span in spans), max(span[1] for span in spans)
    if first > end:
        what = f"the tracks begin {first - end:.4g} s after the end of the truth"
    elif last < begin:
        what = f"the tracks end {begin - last:.4g} s before the truth begins"
    else:
        what = "no row is within the time of a scene"
    return f"{what}: check the clocks and the units of time, or give the offset: time_offset_s (--time-offset)"


def tracks_at_instants(rows: TrackRows, time: Array, shift: float) -> PlacedTracks:
    """Place each track at each instant: by its row nearest in time, unless rows are missing there.

    Between two successive rows without a gap (see ``row_period``) a track exists at every instant. Elsewhere it exists
    within half a period of a row: the median period of the instants, or the period of the rows if it is longer. An
    instant is exact if the time of any track's row equals it. A track with rows at more than two thirds of the exact
    instants of its lifetime exists at exact instants only where it has a row itself.

    Args:
        rows: rows in the order of time.
        time: ``(T,)`` times of the instants, s after the start of the truth.
        shift: time to add to the time stamps of the rows, s.

    Raises:
        InputError: there are too many tracks at too many instants.
    """
    number = _numbers(rows.id)
    order = np.lexsort((rows.time, number))
    track, stamp = number[order], rows.time[order] + shift
    instant = np.clip(np.searchsorted(time, stamp), 0, len(time) - 1)
    instant -= (instant > 0) & (np.abs(stamp - time[instant - 1]) <= np.abs(stamp - time[instant]))
    exact = np.abs(stamp - time[instant]) <= SAME_STAMP_S
    stamp = np.where(exact, time[instant], stamp)
    first = np.flatnonzero(np.diff(track, prepend=track[0] - 1)) if len(track) else np.zeros(0, dtype=np.intp)
    instant_period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    is_exact = np.isin(np.arange(len(time)), instant[exact])
    exact_before = np.concatenate([[0], np.cumsum(is_exact)])
    instants, members = [], []
    for start, end in pairwise([*first.tolist(), len(track)]):
        times = stamp[start:end]
        period, whole = row_period(times)
        reach = max(instant_period, min(period, LONGEST_PERIOD_S)) / 2 * (1 + 1e-9)
        low, high = np.searchsorted(time, [times[0] - reach, times[-1] + reach])
        at = np.arange(low, high)
        nearest, away, before_at = nearest_rows(times, time[at])
        near = away <= reach
        if period <= LONGEST_PERIOD_S:
            near |= (time[at] > times[0]) & (time[at] < times[-1]) & np.append(whole, False)[before_at]
        lifetime = np.searchsorted(time, times[[0, -1]] + (-SAME_STAMP_S, SAME_STAMP_S))
        if 3 * exact[start:end].sum() > 2 * (exact_before[lifetime[1]] - exact_before[lifetime[0]]):
            near &= ~is_exact[at] | (exact[start + nearest] & (instant[start + nearest] == at))
        instants.append(at[near])
        members.append(order[start + nearest[near]])
    at, row = np.concatenate([*instants, _NONE]), np.concatenate([*members, _NONE])
    by_instant = np.lexsort((row, at))
    at, row = at[by_instant], row[by_instant]
    column = np.arange(len(at)) - np.searchsorted(at, at)
    shape = (len(time), int(column.max(initial=-1)) + 1)
    if shape[0] * shape[1] > MOST_CELLS:
        raise InputError(f"{shape[1]} tracks at one of {shape[0]} instants are too many; drop rows that are none")
    stamp = stamp[np.argsort(order)]

    def placed(values: Array, fill: float = np.nan) -> Array:
        result = np.full((*values.shape[:-1], *shape), fill)
        result[..., at, column] = values[..., row]
        return result

    missing = np.full(len(rows), np.nan)
    vx, vy = (missing if value is None else value for value in rows.velocity)
    ids = np.full(shape, NO_TRACK)
    ids[at, column] = number[row]
    nothing = np.full((4, 4, 1), np.nan)
    covariance = np.broadcast_to(nothing, (4, 4, len(rows))) if rows.covariance is None else rows.covariance
    existence = None if rows.existence is None else placed(rows.existence)
    mean = placed(np.stack([rows.px, rows.py, vx, vy]))
    return PlacedTracks(TrackHistory(ids, mean, placed(covariance), existence), placed(stamp))


def _numbers(ids: object) -> Indices:
    """Return a whole number for each id: the id itself where all are numbers, else its rank of first appearance."""
    names, first, number = np.unique(np.asarray(ids, dtype=str), return_index=True, return_inverse=True)
    whole = [name.removesuffix(".0") for name in names.tolist()]
    if all(name.isdecimal() and len(name) < 16 for name in whole) and len({*whole}) == len(whole):
        return np.array([int(name) for name in whole])[number]
    rank = np.empty(len(names), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(names))
    return rank[number]


def truth_at(truth: Truth, run: int, instants: TruthHistory, stamp: Array) -> TruthHistory:
    """Return the truth at the time stamps of tracks, interpolated linearly between instants of the truth.

    Args:
        truth: truth of the scene.
        run: number of the run, which selects the truth's motion.
        instants: truth at the T instants of the run.
        stamp: ``(T, K)`` time stamp of each track, NaN where there is none.

    Raises:
        InputError: the tracks have too many different time stamps.
    """
    away = np.nan_to_num(stamp - instants.time[:, None], nan=0.0)
    if not away.any():
        return instants
    has_track = np.isfinite(stamp)
    common = np.where(has_track.any(axis=1), np.nanmax(np.where(has_track, stamp, -np.inf), axis=1), instants.time)
    if (~has_track | (np.abs(stamp - common[:, None]) <= SAME_STAMP_S)).all():
        return instants._replace(state=_states(truth, run, common, instants.state))
    if stamp.size * len(truth.ids) > LARGEST:
        message = "the tracks of one instant have different time stamps, and are too many; cut the recording"
        raise InputError(message)
    times = np.where(has_track, stamp, instants.time[:, None])
    nominal = np.broadcast_to(instants.state[..., None], (*instants.state.shape, stamp.shape[1]))
    return instants._replace(at_tracks=_states(truth, run, times, nominal))


def _states(truth: Truth, run: int, time: Array, nominal: Array) -> Array:
    """Return true states at times ``(T,)`` or ``(T, K)``; objects that never exist keep their states in ``nominal``.

    Before its first and after its last instant an object keeps its velocity.
    """
    result = np.array(nominal)
    motion = truth.state_of_run(run)
    for item in range(len(truth.ids)):
        alive = truth.alive[:, item] if truth.beside is None else truth.alive[:, item] & ~truth.beside[:, item]
        if not alive.any():
            continue
        alive_time = truth.time[alive]
        inside = np.clip(time, alive_time[0], alive_time[-1])
        state = np.stack([np.interp(inside, alive_time, values) for values in motion[:, alive, item]])
        state[:2] += state[2:] * (time - inside)
        result[:, :, item] = state
    return result
