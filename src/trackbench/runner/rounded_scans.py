"""Fingerprints of measurements on any kind of processor: hashes to a thousandth of m, rad and m/s."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trackbench.runner.work import work_of
from trackbench.scenario import Scenario
from trackbench.sensing.detections import sense_hidden
from trackbench.sensing.scans import sense_known
from trackbench.truth import LoadedTruth

#: Last digits differ from one kind of processor to another; a value next to an edge of rounding is rare.
DECIMALS = 3


def rounded_fingerprints(loaded: Scenario, truths: Sequence[LoadedTruth]) -> list[str]:
    """Return a fingerprint of the measurements of each run of each scene, whatever the scenario's trackers.

    Args:
        loaded: the scenario.
        truths: those of its scenes.
    """
    work = work_of(replace(loaded, config=loaded.config.model_copy(update={"trackers": {}})), truths)
    sense = sense_hidden if work.hidden else sense_known
    fingerprints = []
    for number, scene in enumerate(work.scenes):
        scans = sense(scene.sensors, work.seed, work.noise_of(number), range(work.runs)).scans
        for run in range(work.runs):
            digest = hashlib.sha256()
            for scan in scans:
                # Members are numbered by object, then run; a run of hidden identities has an axis of its own.
                valid = scan.valid.reshape(-1, work.runs)[:, run]
                measured = scan.measurement.reshape(len(scan.measurement), -1, work.runs)[:, valid, run]
                # 0.0 makes -0.0 into 0.0.
                digest.update(f"{scan.sensor} {scan.time:.6f} {np.flatnonzero(valid).tolist()}".encode())
                digest.update((np.round(measured, DECIMALS) + 0.0).tobytes())
            fingerprints.append(digest.hexdigest()[:16])
    return fingerprints
