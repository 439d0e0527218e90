"""Estimates of known objects that another program wrote, placed at the instants at which they are scored."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Gaussian
from trackbench.runner.filed_tracks import clock_shift, rows_of_run, why_other_scans
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.scans import Measurements
from trackbench.truth.config.traffic import TracksConfig, files_in
from trackbench.truth.tracks import SAME_STAMP_S, TrackRows


def filed_estimates(work: Work, piece: BlockRuns, name: str, measurements: Measurements) -> Gaussian:
    """Return the estimates of a file in some runs: mean ``(4, instants, objects, runs)`` and its covariance.

    Args:
        work: what all blocks share.
        piece: the runs.
        name: of the tracker.
        measurements: of the runs, whose fingerprints the file may name.

    Raises:
        InputError: a row is of other scans, of no object or at no instant, or has no velocity or no covariance.
    """
    config, files = work.trackers[name], work.filed[name]
    assert isinstance(config, TracksConfig)
    place = piece.scene if len(files) > 1 else 0
    rows, file = files[place], Path(files_in(config.path)[place])
    scene = work.scenes[piece.scene]
    time, ids = scene.truth.time[scene.instants()], scene.truth.ids
    shift = clock_shift(rows, scene.truth, config.time_offset_s)
    shape = len(time), len(ids), len(piece.runs)
    placed = Gaussian(np.full((4, *shape), np.nan), np.full((4, 4, *shape), np.nan))
    for column, run in enumerate(piece.runs):
        own = rows_of_run(rows, piece.scene, run)
        where = f"scene {piece.scene}, run {run}"
        problem = why_other_scans(own, measurements.digests[column].hex()[:16]) or _why_not_placed(own, ids)
        if problem is not None:
            raise InputError(f"{where}: {problem}", file=file, key=f"trackers.{name}")
        stamp = own.time + shift
        instant = np.clip(np.searchsorted(time, stamp - SAME_STAMP_S), 0, len(time) - 1)
        away = np.abs(time[instant] - stamp) > SAME_STAMP_S
        if away.any():
            at = f"there is no scan at {stamp[away][0]:.9g} s, where an estimate is given"
            raise InputError(f"{where}: {at}", file=file, key=f"trackers.{name}")
        number = {name: index for index, name in enumerate(ids)}
        item = np.array([number[each] for each in own.id], dtype=np.intp)
        placed.mean[:, instant, item, column] = np.stack([own.px, own.py, *own.velocity])  # type: ignore[list-item]
        placed.covariance[:, :, instant, item, column] = own.covariance
    return placed


def _why_not_placed(rows: TrackRows, ids: tuple[str, ...]) -> str | None:
    """Say why rows are no estimates of known objects; None where they are."""
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
