"""Estimates of known objects that another program wrote, placed at the instants at which they are scored."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Gaussian
from trackbench.runner.external_tracks import clock_shift, rows_of_run, why_other_scans
from trackbench.runner.work import BlockRuns, Work
from trackbench.sensing.scans import Measurements, fingerprint_of
from trackbench.truth.config.traffic import TracksConfig, files_in
from trackbench.truth.tracks import SAME_STAMP_S, TrackRows


def external_estimates(work: Work, piece: BlockRuns, name: str, measurements: Measurements) -> Gaussian:
    """Return another program's estimates in some runs: mean ``(4, instants, objects, runs)`` and covariance.

    Args:
        work: data shared by all blocks.
        piece: block of runs.
        name: name of the tracker.
        measurements: measurements of the runs, whose fingerprints the file may state.

    Raises:
        InputError: a row has another fingerprint, an unknown object, no scan at its time, no velocity or no covariance.
    """
    config, files = work.trackers[name], work.external_tracks[name]
    assert isinstance(config, TracksConfig)
    place = piece.scene if len(files) > 1 else 0
    rows, file = files[place], Path(files_in(config.path)[place])
    scene = work.scenes[piece.scene]
    time, ids = scene.truth.time[scene.instants()], scene.truth.ids
    shift = clock_shift(rows, scene.truth, config.time_offset_s)
    shape = len(time), len(ids), len(piece.runs)
    placed = Gaussian(np.full((4, *shape), np.nan), np.full((4, 4, *shape), np.nan))
    for column, run in enumerate(piece.runs):
        run_rows = rows_of_run(rows, piece.scene, run)
        where = f"scene {piece.scene}, run {run}"
        fingerprint = fingerprint_of(measurements.digests[column])
        problem = why_other_scans(run_rows, fingerprint) or _why_not_placed(run_rows, ids)
        if problem is not None:
            raise InputError(f"{where}: {problem}", file=file, key=f"trackers.{name}")
        stamp = run_rows.time + shift
        instant = np.clip(np.searchsorted(time, stamp - SAME_STAMP_S), 0, len(time) - 1)
        away = np.abs(time[instant] - stamp) > SAME_STAMP_S
        if away.any():
            at = f"there is no scan at {stamp[away][0]:.9g} s, where an estimate is given"
            raise InputError(f"{where}: {at}", file=file, key=f"trackers.{name}")
        number = {name: index for index, name in enumerate(ids)}
        item = np.array([number[each] for each in run_rows.id], dtype=np.intp)
        states = np.stack([run_rows.px, run_rows.py, *run_rows.velocity])  # type: ignore[list-item]
        placed.mean[:, instant, item, column] = states
        placed.covariance[:, :, instant, item, column] = run_rows.covariance
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
