"""Tracks that another program wrote: those of a run at its instants, and the truth at their time stamps."""

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

#: Longest period of rows between which a track is given, s.
LONGEST_PERIOD_S = 0.5
_NONE = np.zeros(0, dtype=np.intp)
#: Instants times tracks whose covariances take half a gigabyte.
MOST_CELLS = 4_000_000
#: Objects times tracks times instants whose truth is kept where the tracks of an instant have several time stamps.
LARGEST = 20_000_000


class FiledTracks(NamedTuple):
    """The tracks of one run at its T instants, in K columns of no meaning."""

    history: TrackHistory
    stamp: Array
    """``(T, K)`` s after the start of the truth; NaN where there is no track."""


def rows_of_files(
    trackers: Mapping[str, TrackerEntry], truths: Sequence[Truth], runs: int, folder: Path
) -> dict[str, list[TrackRows]]:
    """Return the rows of tracks made elsewhere, by tracker.

    Args:
        trackers: of the scenario, by name.
        truths: one for each scene.
        runs: of each scene.
        folder: where relative paths start.

    Raises:
        InputError: a file is damaged, does not say of which of several runs its tracks are, or has none in the time of
            a truth.
    """
    filed: dict[str, list[TrackRows]] = {}
    spans = [(float(truth.start) + truth.time[0], float(truth.start) + truth.time[-1]) for truth in truths]
    # Then a time stamp tells of which scene it is.
    apart_in_time = all(end <= later for (_, end), (later, _) in pairwise(sorted(spans)))
    for name, config in trackers.items():
        if not isinstance(config, TracksConfig):
            continue
        filed[name] = read_tracks(config, name, folder)
        for number, (file, rows) in enumerate(zip(files_in(config.path), filed[name], strict=True)):
            several = len(filed[name]) > 1
            if rows.run is None and (runs > 1 or not (several or apart_in_time)):
                message = "there is no column run, and the scenario has several runs or scenes; use --runs 1, one scene"
                raise InputError(f"{message}, or a list of files, one for each scene", file=file)
            own = spans[number : number + 1] if several else spans
            if rows.run is not None:
                own = [(float(truth.time[0]), float(truth.time[-1])) for truth in truths]
            problem = why_no_overlap(rows, config.time_offset_s, own)
            if problem is not None:
                raise InputError(problem, file=file, key=f"trackers.{name}")
    return filed


def clock_shift(rows: TrackRows, truth: Truth, offset: float) -> float:
    """Return what is added to the times of rows, s, so that they count from the start of a truth.

    The rows are of the truth's clock; those of exported scans, with a column ``run``, count from the start already.
    """
    return float(rows.start - (0 if rows.run is not None else truth.start)) + offset


def rows_of_run(rows: TrackRows, scene: int, run: int) -> TrackRows:
    """The rows of a run of a scene, by their numbers; all of a file that does not say of which they are."""
    chosen = np.ones(len(rows), dtype=bool)
    for column, number in ((rows.scene, scene), (rows.run, run)):
        if column is not None:
            chosen &= np.array([text in (str(number), f"{number}.0") for text in column], dtype=bool)
    return rows if chosen.all() else rows.rows(np.flatnonzero(chosen))


def why_other_scans(own: TrackRows, fingerprint: str) -> str | None:
    """Why the tracks of a run were not made of its scans; None where nothing speaks against it.

    Args:
        own: the rows of the run.
        fingerprint: of the run's measurements.
    """
    stated = sorted({*(own.fingerprint or ())} - {fingerprint})
    if not stated:
        return None
    if stated == [""]:
        return "some rows have no fingerprint, and others have one"
    remedy = "they were made of other scans (name, seed, sensors or truth of the scenario differ): export them anew"
    theirs = shortened_text(stated[-1], 40)
    return f"the tracks have the fingerprint {theirs!r}, the measurements {fingerprint!r}; {remedy}"


def inside(rows: TrackRows, shift: float, first: float, last: float) -> Mask:
    """Which rows are within the time of a truth, or so near to it that they may be of its first or last instant."""
    stamp, margin = rows.time + shift, LONGEST_PERIOD_S / 2
    return np.asarray((stamp >= first - margin) & (stamp <= last + margin))


def why_no_overlap(rows: TrackRows, offset: float, spans: Sequence[tuple[float, float]]) -> str | None:
    """Why no row is within the time of any truth; None where one is.

    Args:
        rows: of the file.
        offset: added to the time stamps, s.
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


def tracks_at_instants(rows: TrackRows, time: Array, shift: float) -> FiledTracks:
    """Return the row of each track at each instant: the nearest in time, unless rows are missing there.

    Between two rows of which none is missing between, see ``row_period``, a track is given at every instant. Elsewhere
    it is given within half a period of a row: the median time between instants, or the period of the rows where it is
    longer. A track that has a row at more than two of three instants at which any has one, between its first and its
    last, was given then and not between: at such instants it is where it has a row.

    Args:
        rows: in the order of time.
        time: ``(T,)`` of the instants, s after the start of the truth.
        shift: added to the rows' times, s.

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
    usual = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    taken = np.isin(np.arange(len(time)), instant[exact])
    before = np.concatenate([[0], np.cumsum(taken)])
    instants, members = [], []
    for start, end in pairwise([*first.tolist(), len(track)]):
        own = stamp[start:end]
        period, whole = row_period(own)
        reach = max(usual, min(period, LONGEST_PERIOD_S)) / 2 * (1 + 1e-9)
        low, high = np.searchsorted(time, [own[0] - reach, own[-1] + reach])
        at = np.arange(low, high)
        nearest, away, before_at = nearest_rows(own, time[at])
        near = away <= reach
        if period <= LONGEST_PERIOD_S:
            near |= (time[at] > own[0]) & (time[at] < own[-1]) & np.append(whole, False)[before_at]
        inside = np.searchsorted(time, own[[0, -1]] + (-SAME_STAMP_S, SAME_STAMP_S))
        if 3 * exact[start:end].sum() > 2 * (before[inside[1]] - before[inside[0]]):
            near &= ~taken[at] | (exact[start + nearest] & (instant[start + nearest] == at))
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
    return FiledTracks(TrackHistory(ids, mean, placed(covariance), existence), placed(stamp))


def _numbers(ids: object) -> Indices:
    """Whole numbers for ids: those that they are, or in the order in which they come."""
    names, first, number = np.unique(np.asarray(ids, dtype=str), return_index=True, return_inverse=True)
    whole = [name.removesuffix(".0") for name in names.tolist()]
    if all(name.isdecimal() and len(name) < 16 for name in whole) and len({*whole}) == len(whole):
        return np.array([int(name) for name in whole])[number]
    rank = np.empty(len(names), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(names))
    return rank[number]


def truth_at(truth: Truth, run: int, instants: TruthHistory, stamp: Array) -> TruthHistory:
    """The truth at the time stamps of tracks, between its own instants by linear interpolation.

    Args:
        truth: of the scene.
        run: whose motion it is.
        instants: the truth at the instants.
        stamp: ``(T, K)`` as of :class:`FiledTracks`.

    Raises:
        InputError: the tracks have too many different time stamps.
    """
    away = np.nan_to_num(stamp - instants.time[:, None], nan=0.0)
    if not away.any():
        return instants
    there = np.isfinite(stamp)
    common = np.where(there.any(axis=1), np.nanmax(np.where(there, stamp, -np.inf), axis=1), instants.time)
    if (~there | (np.abs(stamp - common[:, None]) <= SAME_STAMP_S)).all():
        return instants._replace(state=_states(truth, run, common, instants.state))
    if stamp.size * len(truth.ids) > LARGEST:
        message = "the tracks of one instant have different time stamps, and are too many; cut the recording"
        raise InputError(message)
    own = np.where(there, stamp, instants.time[:, None])
    nominal = np.broadcast_to(instants.state[..., None], (*instants.state.shape, stamp.shape[1]))
    return instants._replace(at_tracks=_states(truth, run, own, nominal))


def _states(truth: Truth, run: int, time: Array, nominal: Array) -> Array:
    """``(4, T, N)``, or ``(4, T, N, K)`` where ``time`` is ``(T, K)``; as at the instant where an object is not there.

    Before its first and after its last instant an object keeps its velocity.
    """
    result = np.array(nominal)
    motion = truth.state_of_run(run)
    for item in range(len(truth.ids)):
        alive = truth.alive[:, item] if truth.beside is None else truth.alive[:, item] & ~truth.beside[:, item]
        if not alive.any():
            continue
        own = truth.time[alive]
        inside = np.clip(time, own[0], own[-1])
        state = np.stack([np.interp(inside, own, values) for values in motion[:, alive, item]])
        state[:2] += state[2:] * (time - inside)
        result[:, :, item] = state
    return result
