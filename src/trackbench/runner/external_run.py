"""Tracks that another program wrote: taken for scoring, the offset of their clock, and the frame that they are in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array, Gaussian, Truth
from trackbench.metrics.blocks import FEWEST, LONGER, OBJECTS, Blocks, blocks_of, correlation_time
from trackbench.metrics.traffic import TrackHistory, TruthHistory
from trackbench.metrics.traffic.scorer import SceneRuns
from trackbench.results import MetricValue
from trackbench.runner.external_tracks import (
    clock_shift,
    inside,
    rows_of_run,
    tracks_at_instants,
    truth_at,
    why_other_scans,
)
from trackbench.runner.work import BlockRuns, Scene, Work
from trackbench.sensing.scans import Measurements, fingerprint_of
from trackbench.truth.config.traffic import TracksConfig, files_in
from trackbench.truth.tracks import SAME_STAMP_S, TrackRows

#: The first search for the offset goes from -FARTHEST_S to FARTHEST_S, s.
FARTHEST_S = 2.0
#: Largest number of rows of a run that the search uses.
MOST_ROWS = 4000
#: An object has no direction of motion below this speed, m/s, or below this share of its largest speed.
SLOW_MPS, SLOW_SHARE = 0.5, 0.25
#: An object counts as moving if its positions spread by this many standard deviations of their noise.
FAR = 20.0
#: Largest number of Gauss-Newton steps.
STEPS = 30
#: An offset whose interval is wider is reported as unknown, s.
USELESS_S = 0.5
#: A smaller offset is not mentioned, s, nor one that moves a track by a smaller share of its error.
LEAST_S, LEAST_SHARE = 1e-3, 0.1
#: Share of rows near objects: below FEW other frames are tried; one with MANY is named to the user.
FEW, MANY = 0.1, 0.5
#: Other frames: the matrix (row by row) that turns x and y of the file into the truth's frame.
FRAMES = {
    "x and y exchanged": (0, 1, 1, 0),
    "x = -y, y = x (turned by 90 degrees)": (0, -1, 1, 0),
    "x = y, y = -x (turned by -90 degrees)": (0, 1, -1, 0),
    "x = -x, y = -y (turned by 180 degrees)": (-1, 0, 0, -1),
    "y = -y (y to the other side)": (1, 0, 0, -1),
    "x = -x (x to the other side)": (-1, 0, 0, 1),
    "x = -y, y = -x": (0, -1, -1, 0),
}

#: The matrix that leaves positions as they are.
_AS_STATED = np.eye(2)
NOTHING_MOVES = "no track is on an object that moves"


class TrackOffset(NamedTuple):
    """Offset between another program's clock and the truth's, estimated from position errors along the paths."""

    time: MetricValue
    """Time to add to the time stamps of the tracks, s, besides a shift that is known."""
    shown: bool
    """Whether the offset is large and certain enough to be reported."""


def offset_pairs(rows: TrackRows, truth: Truth, run: int, shift: float, cutoff: float) -> Array:
    """Return, for P rows near an object, ``(4, P)``: time, number of the object, y (m) and speed of the object.

    Time stamps are moved by a time t, found by a search and then by Gauss-Newton. y is the error along the path after
    that move, plus t times the speed: to first order a shift along the path plus the clock offset times the speed.

    Args:
        rows: rows of the run, in the order of time.
        truth: truth of the scene.
        run: number of the run, which selects the truth's motion.
        shift: time to add to the time stamps of the rows, s.
        cutoff: distance from which a row is on no object, m.
    """
    near = NearestObject(rows, truth, run, shift)
    if not len(near.stamp) or not truth.ids:
        return np.zeros((4, 0))
    fast = float(np.percentile(np.hypot(truth.vx, truth.vy)[truth.alive], 95))
    tried = np.linspace(-FARTHEST_S, FARTHEST_S, 2 * int(np.clip(FARTHEST_S * 2 * fast / cutoff, 1, 100)) + 1)
    costs = [np.minimum(near.at(each)[1], cutoff**2).mean() for each in tried.tolist()]
    best = int(np.argmin(costs))
    moved = float(tried[best]) if costs[best] < 0.5 * costs[len(tried) // 2] else 0.0
    pairs = np.zeros((4, 0))
    for _ in range(STEPS):
        number, square, error, velocity = near.at(moved)
        speed = np.hypot(*velocity)
        on = (square < cutoff**2) & (speed > near.slow[number])
        if not on.any():
            return np.zeros((4, 0))
        along = (error * velocity).sum(axis=0)[on] / speed[on]
        pairs = np.stack([near.stamp[on], number[on], along + moved * speed[on], speed[on]])
        step = float((along @ speed[on]) / (speed[on] @ speed[on]))
        moved = float(np.clip(moved + step, -FARTHEST_S, FARTHEST_S))
        if abs(step) < 1e-5:
            break
    return pairs


class NearestObject:
    """Search for the object nearest to each track row of a run, at most ``MOST_ROWS`` rows in the truth's time.

    Args:
        rows: rows of the run, in the order of time.
        truth: truth of the scene.
        run: number of the run, which selects the truth's motion.
        shift: time to add to the time stamps of the rows, s.
    """

    def __init__(self, rows: TrackRows, truth: Truth, run: int, shift: float) -> None:
        stamp = rows.time + shift
        numbers = np.flatnonzero((stamp >= truth.time[0]) & (stamp <= truth.time[-1]))
        numbers = numbers[:: -(-len(numbers) // MOST_ROWS) or 1]
        self.stamp = stamp[numbers]
        """``(rows,)`` times of the rows in use, s after the start of the truth."""
        self._truth, self._place = truth, np.stack([rows.px[numbers], rows.py[numbers]])
        self._motion = truth.state_of_run(run)
        self.slow = np.full(len(truth.ids), np.inf)
        """``(objects,)`` speed below which each object has no direction of motion, m/s."""
        for item, alive in enumerate(truth.alive.T):
            place, velocity = self._motion[:2, alive, item], self._motion[2:, alive, item]
            if alive.any() and np.hypot(*np.ptp(place, axis=1)) > FAR * truth.recorded_noise.position_m:
                fastest = float(np.percentile(np.hypot(*velocity), 95))
                self.slow[item] = min(SLOW_MPS, SLOW_SHARE * fastest)

    def at(self, moved: float, frame: Array = _AS_STATED) -> tuple[Array, Array, Array, Array]:
        """Return ``(rows,)`` nearest object and squared distance, ``(2, rows)`` position error and object's velocity.

        Args:
            moved: time to add to the time stamps, s.
            frame: ``(2, 2)`` matrix that turns or mirrors the rows' positions.
        """
        when = self.stamp + moved
        states = np.empty((4, len(self._truth.ids), len(when)))
        step = np.clip(np.searchsorted(self._truth.time, when), 0, len(self._truth.time) - 1)
        for item in range(states.shape[1]):
            for row in range(4):
                states[row, item] = np.interp(when, self._truth.time, self._motion[row, :, item])
        away = (frame @ self._place)[:, None] - states[:2]
        is_present = self._truth.alive[step].T & (when >= self._truth.time[0]) & (when <= self._truth.time[-1])
        square = np.where(is_present, (away**2).sum(axis=0), np.inf)
        number = np.argmin(square, axis=0)
        columns = np.arange(len(when))
        return number, square[number, columns], away[:, number, columns], states[2:, number, columns]


def offset_of(pairs: Array) -> TrackOffset:
    """Estimate the clock offset and the shift along the path by least squares; the offset gets a 95 % interval.

    All objects share one shift with ``OBJECTS`` objects or more, or with ``FEWEST`` runs or more. Otherwise each object
    has a shift of its own, and only changes of speed tell the offset. With ``FEWEST`` runs or more the interval is over
    runs, else over blocks of time; with ``OBJECTS`` objects or more also over whole objects, if that is wider.

    Args:
        pairs: ``(5, P)`` number of the run, then time, number of the object, y and speed (:func:`offset_pairs`).
    """
    run, time, number, y, speed = pairs
    if not len(y):
        return TrackOffset(MetricValue(unit="s", reason=NOTHING_MOVES), shown=False)
    owner = np.unique(number, return_inverse=True)[1]
    runs = np.unique(run, return_inverse=True)[1]
    one_shift = owner.max() + 1 >= OBJECTS or runs.max() + 1 >= FEWEST
    group = np.zeros_like(owner) if one_shift else owner
    centred = [each - (np.bincount(group, each) / np.bincount(group))[group] for each in (speed, y)]

    def unknown(reason: str) -> TrackOffset:
        return TrackOffset(MetricValue(unit="s", reason=reason), shown=False)

    if centred[0] @ centred[0] <= 1e-6 * len(y):
        return unknown("speeds are too alike to tell a time offset from a shift along the path")
    value = float(centred[0] @ centred[1] / (centred[0] @ centred[0]))
    residual = centred[1] - value * centred[0]
    # The runs are laid one after the other on a common time axis.
    length = float(np.ptp(time)) + 1.0
    following = time + length * (LONGER + 1) * runs
    order = np.argsort(following, kind="stable")
    if runs.max() + 1 >= FEWEST:
        blocks = Blocks((runs,))
    else:
        correlated = correlation_time(following[order], owner[order], residual[order])
        if (runs.max() + 1) * length < FEWEST * LONGER / 2 * correlated:
            return unknown(f"no interval: errors stay correlated for {correlated:.2g} s of {length - 1:.3g} s")
        back = np.argsort(order)
        cuts = blocks_of(following[order], owner[order], residual[order][None]).cuts
        blocks = Blocks(tuple(cut[back] for cut in cuts))
    terms = np.stack([np.ones(len(y)), centred[0], centred[1], centred[0] ** 2, centred[0] * centred[1]])
    (interval,) = blocks.intervals(terms, _slope)
    low, high = interval.bounds()
    if not high - low < USELESS_S:
        return unknown("speeds are too alike to tell a time offset from a shift along the path")
    error = float(np.sqrt(np.mean((y - y.mean()) ** 2)))
    moves = abs(value) * float(np.sqrt(np.mean(speed**2)))
    shown = low * high > 0 and abs(value) >= LEAST_S and moves >= LEAST_SHARE * error
    return TrackOffset(MetricValue(value=value, unit="s", ci95=(low, high)), shown=shown)


def _slope(sums: Array) -> Array:
    count, x, y, xx, xy = sums
    return np.asarray((xy - x * y / count) / (xx - x * x / count))[None]


class ExternalRows:
    """Rows that another program wrote for a block of runs.

    Args:
        work: data shared by all blocks.
        piece: block of runs.
        name: name of the tracker.
        measurements: measurements of the runs, whose fingerprints the file may state.
    """

    def __init__(self, work: Work, piece: BlockRuns, name: str, measurements: Measurements) -> None:
        config, files = work.trackers[name], work.external_tracks[name]
        assert isinstance(config, TracksConfig)
        place = piece.scene if len(files) > 1 else 0
        self._rows, self._file, self._key = files[place], files_in(config.path)[place], f"trackers.{name}"
        self._piece, self._measurements = piece, measurements
        self.shift = clock_shift(self._rows, work.scenes[piece.scene].truth, config.time_offset_s)
        """Time to add to the time stamps of the rows, s."""

    def of_run(self, run: int) -> TrackRows:
        """Return the rows of one run; ``run`` counts from the first run of the block.

        Raises:
            InputError: the tracks were made from other scans than those of the run.
        """
        rows = rows_of_run(self._rows, self._piece.scene, self._piece.runs[run])
        # Without sensors there are no scans with which the fingerprint could agree.
        if self._measurements.scans:
            self.refuse(run, why_other_scans(rows, fingerprint_of(self._measurements.digests[run])))
        return rows

    def refuse(self, run: int, problem: str | None) -> None:
        """Raise an error with file, scene and run, unless ``problem`` is None; ``run`` counts within the block."""
        if problem is not None:
            where = f"scene {self._piece.scene}, run {self._piece.runs[run]}"
            raise InputError(f"{where}: {problem}", file=self._file, key=self._key)


class ExternalHistories:
    """Tracks that another program wrote, at the instants of a scene's runs, with the truth at their time stamps.

    Args:
        rows: rows of the runs.
        cutoff: distance from which a row is on no object, m.
    """

    def __init__(self, rows: ExternalRows, cutoff: float) -> None:
        self._rows, self._cutoff = rows, cutoff
        self._pairs: list[Array] = []
        self.counts = np.zeros(3, dtype=np.intp)
        """Number of rows, of rows within the time of the truth, and of runs without a row in that time."""

    @property
    def offsets(self) -> Array:
        """``(5, P)`` rows near an object in all runs so far: run, time, object, error along the path, m, speed, m/s."""
        return np.concatenate(self._pairs, axis=1)

    def of_run(self, scene: SceneRuns, run: int) -> tuple[TruthHistory, TrackHistory]:
        """Return the truth and the tracks in one run; ``run`` counts from the first run of the block.

        Raises:
            InputError: the tracks were made from other scans than those of the run.
        """
        number, truth, shift = scene.runs.start + run, scene.truth, self._rows.shift
        rows = self._rows.of_run(run)
        is_inside = inside(rows, shift, truth.time[0], truth.time[-1])
        self.counts += len(rows), is_inside.sum(), not is_inside.any()
        time = truth.time[scene.due.steps]
        history, stamp = tracks_at_instants(rows, time, shift)
        pairs = offset_pairs(rows, truth, number, shift, self._cutoff)
        self._pairs.append(np.concatenate([np.full((1, pairs.shape[1]), scene.number + run), pairs]))
        return truth_at(truth, number, scene.truth_at(time, run), stamp), history


def external_estimates(source: ExternalRows, scene: Scene, runs: int) -> Gaussian:
    """Return another program's estimates in some runs: mean ``(4, instants, objects, runs)`` and covariance.

    Raises:
        InputError: a row has another fingerprint, an unknown object, no scan at its time, no velocity or no covariance.
    """
    time, ids = scene.truth.time[scene.instants()], scene.truth.ids
    shape = len(time), len(ids), runs
    placed = Gaussian(np.full((4, *shape), np.nan), np.full((4, 4, *shape), np.nan))
    number = {name: index for index, name in enumerate(ids)}
    for column in range(runs):
        rows = source.of_run(column)
        source.refuse(column, _why_not_placed(rows, ids))
        stamp = rows.time + source.shift
        instant = np.clip(np.searchsorted(time, stamp - SAME_STAMP_S), 0, len(time) - 1)
        away = stamp[np.abs(time[instant] - stamp) > SAME_STAMP_S]
        if len(away):
            source.refuse(column, f"there is no scan at {away[0]:.9g} s, where an estimate is given")
        item = np.array([number[each] for each in rows.id], dtype=np.intp)
        placed.mean[:, instant, item, column] = np.stack([rows.px, rows.py, *rows.velocity])  # type: ignore[list-item]
        placed.covariance[:, :, instant, item, column] = rows.covariance
    return placed


def _why_not_placed(rows: TrackRows, ids: tuple[str, ...]) -> str | None:
    if not len(rows):
        return None
    unknown = sorted({*rows.id} - {*ids})
    if unknown:
        return f"there is no object {unknown[0][:40]!r}; {nearest_choices(unknown[0], ids)}"
    vx, vy = rows.velocity
    if vx is None or vy is None or np.isnan(vx + vy).any():
        return "with known identities each row needs a velocity: vx and vy"
    if rows.covariance is None or np.isnan(rows.covariance).any():
        return "with known identities each row needs a covariance: p_00 to p_33"
    return None


def remarks_on_files(work: Work, name: str, matched_share: float) -> tuple[str, ...]:
    """Say where the files of a tracker contradict the truth, and what to do about it.

    Args:
        work: data shared by all blocks; only the first run of each scene is checked.
        name: name of the tracker.
        matched_share: share of the objects' time in which a track is on them. A single file with a high share is not
            checked: its other tracks may follow traffic without a truth.
    """
    config, files = work.trackers[name], work.external_tracks[name]
    assert isinstance(config, TracksConfig)
    assert work.track_score is not None
    remarks = []
    for number, file_rows in enumerate(files):
        rows, truth = rows_of_run(file_rows, number, 0), work.scenes[number].truth
        shift = clock_shift(file_rows, truth, config.time_offset_s)
        doubtful = len(files) > 1 or matched_share < FEW
        why = why_nothing_matches(rows, truth, shift, work.track_score.cutoff) if doubtful else None
        where = f"{PurePath(files_in(config.path)[number]).name}: " if len(files) > 1 else ""
        remarks += [] if why is None else [where + why]
    return tuple(remarks)


def why_nothing_matches(rows: TrackRows, truth: Truth, shift: float, cutoff: float) -> str | None:
    """Say why almost no row of a file is near an object, and what to do; None where enough rows are.

    Args:
        rows: rows of one run in the file of tracks, in the order of time.
        truth: truth of the run's scene.
        shift: time to add to the time stamps of the rows, s.
        cutoff: distance from which a row is on no object, m.
    """
    nearest = NearestObject(rows, truth, 0, shift)
    if not len(nearest.stamp):
        return None

    def share(frame: Sequence[float]) -> float:
        return float((nearest.at(0.0, np.reshape(frame, (2, 2)))[1] < cutoff**2).mean())

    near = share((1, 0, 0, 1))
    if near >= FEW:
        return None
    shares = {name: share(frame) for name, frame in FRAMES.items()}
    best = max(shares, key=lambda name: shares[name])
    what = f"{100 * near:.1f} % of its rows are within {cutoff:g} m of an object"
    if shares[best] < MANY:
        return f"{what}: are the tracks of this recording, in its frame and in metres?"
    remedy = "; exchange their columns (--map)" if best == "x and y exchanged" else "; convert the file"
    return f"{what}; with {best} {100 * shares[best]:.0f} % would be{remedy}"
