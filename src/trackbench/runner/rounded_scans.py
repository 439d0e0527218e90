"""Fingerprints of measurements that agree on any kind of processor: hashes of values rounded to 0.001."""

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

#: Decimals that are hashed. The last digits of values differ between processors, but rarely across an edge of rounding.
DECIMALS = 3


def rounded_fingerprints(loaded: Scenario, truths: Sequence[LoadedTruth]) -> list[str]:
    """Return a fingerprint of each run of each scene: a hash of its measurements, rounded to 0.001.

    The scenario's trackers are not run.

    Args:
        loaded: the scenario.
        truths: truth of each scene.
    """
    work = work_of(replace(loaded, config=loaded.config.model_copy(update={"trackers": {}})), truths)
    sense = sense_hidden if work.hidden else sense_known
    fingerprints = []
    for number, scene in enumerate(work.scenes):
        scans = sense(scene.sensors, work.seed, work.noise_of(number), range(work.runs)).scans
        for run in range(work.runs):
            digest = hashlib.sha256()
            for scan in scans:
                # Members are numbered by object, then run; with hidden identities the runs have an axis of their own.
                valid = scan.valid.reshape(-1, work.runs)[:, run]
                measured = scan.measurement.reshape(len(scan.measurement), -1, work.runs)[:, valid, run]
                # Adding 0.0 turns -0.0 into 0.0.
                digest.update(f"{scan.sensor} {scan.time:.6f} {np.flatnonzero(valid).tolist()}".encode())
                digest.update((np.round(measured, DECIMALS) + 0.0).tobytes())
            fingerprints.append(digest.hexdigest()[:16])
    return fingerprints
