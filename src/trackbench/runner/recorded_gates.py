"""The gates of the recorded run: where each track lets the next detection be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa

from trackbench.distributions import chi_square_quantile
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.multi import build_multi
from trackbench.runner.columns import Columns, stacked
from trackbench.stepping.tracks import NO_TRACK, BatchedTracks, tracks_of_run, unread
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.types import Array, Indices, Scan

#: Points of an outline, of which the last is the first.
CORNERS = 17


def gates_table(
    trackers: Mapping[str, FilterConfig | PluginConfig],
    scans: Sequence[Scan],
    origins: Sequence[Indices],
) -> pa.Table:
    """The outlines of the gates of built-in trackers, each point a row.

    The recorded run is taken through each tracker once more, on its own: to ask all runs of a block costs more.
    """
    parts: list[Columns] = []
    for name, config in trackers.items():
        if isinstance(config, FilterConfig) and config.associate is not None and config.associate.method != "oracle":
            parts += _gates(name, config, scans, origins)
    return stacked(parts)


def _gates(name: str, config: FilterConfig, scans: Sequence[Scan], origins: Sequence[Indices]) -> list[Columns]:
    assert config.associate is not None
    tracker, found = BatchedTracks(build_multi(config)), list[Columns]()
    for number, (scan, origin) in enumerate(zip(scans, origins, strict=True)):
        one = scan._replace(measurement=scan.measurement[..., None], valid=scan.valid[..., None])
        if config.sensors_used is not None and scan.sensor not in config.sensors_used:
            tracker.step(unread(one), origin[:0, None])
            continue
        predicted = tracks_of_run(tracker.predict(one), 0)
        tracker.step(one, origin[:, None])
        there = predicted.ids != NO_TRACK
        if not there.any():
            continue
        threshold = float(chi_square_quantile(config.associate.gate, float(len(scan.measurement))))
        x, y = outlines(scan, predicted.mean[:, there], predicted.covariance[..., there], threshold)
        rows = x.size
        found.append(
            {
                "tracker": [name] * rows,
                "time_s": np.full(rows, scan.time),
                "scan": np.full(rows, float(number)),
                "track": np.repeat(predicted.ids[there].astype(float), CORNERS),
                "x_m": x.ravel(),
                "y_m": y.ravel(),
            }
        )
    return found


def outlines(scan: Scan, mean: Array, covariance: Array, threshold: float) -> tuple[Array, Array]:
    """``(K, CORNERS)`` x and y, m: the edge of each gate over the first two components of a measurement.

    The sensor's equation is linearised at the track. A gate is an ellipsoid, and its shadow on two components is the
    ellipse of their covariance with the same threshold.

    Args:
        scan: of the sensor.
        mean: ``(4, K)`` of the predicted tracks.
        covariance: ``(4, 4, K)``.
        threshold: of the squared Mahalanobis distance.
    """
    model = SENSOR_MODELS[scan.kind]
    pose, velocity = scan.sensor_pose[:, None], scan.sensor_velocity[:, None]
    slope = model.jacobian(mean, pose, velocity)
    spread = np.einsum("iak,abk,jbk->ijk", slope, covariance, slope) + scan.noise_covariance[..., None]
    expected = model.measure(mean, pose, velocity)
    angle = np.linspace(0, 2 * np.pi, CORNERS)
    circle = np.sqrt(threshold) * np.stack([np.cos(angle), np.sin(angle)])
    factor = np.linalg.cholesky(np.moveaxis(spread[:2, :2], 2, 0))
    edge = expected[:, :, None] * np.ones(CORNERS)
    edge[:2] += np.einsum("kij,jc->ikc", factor, circle)
    flat = edge.reshape(len(edge), -1)
    found = model.position(scan._replace(measurement=flat, valid=np.ones(flat.shape[1], dtype=bool))).mean
    return found[0].reshape(-1, CORNERS), found[1].reshape(-1, CORNERS)
