"""The gates of the recorded run: where each track lets the next detection be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa

from trackbench.base.distributions import chi_square_quantile
from trackbench.base.types import Array, Scan, Tracks
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.runner.columns import Columns, stacked
from trackbench.trackers.config import FilterConfig, PluginConfig

#: Points of an outline, of which the last is the first.
CORNERS = 17


def gates_table(
    trackers: Mapping[str, FilterConfig | PluginConfig],
    predicted: Mapping[str, Mapping[int, Tracks]],
    scans: Sequence[Scan],
) -> pa.Table:
    """The outlines of the gates of built-in trackers, each point a row.

    Args:
        trackers: by name.
        predicted: by name and number of a scan, the tracks before it.
        scans: of the recorded run.
    """
    parts: list[Columns] = []
    for name, expected in predicted.items():
        config = trackers[name]
        if isinstance(config, FilterConfig) and config.associate is not None and config.associate.method != "oracle":
            gate = config.associate.gate
            parts += [_gates(name, number, scans[number], tracks, gate) for number, tracks in expected.items()]
    return stacked(parts)


def _gates(name: str, number: int, scan: Scan, predicted: Tracks, gate: float) -> Columns:
    threshold = float(chi_square_quantile(gate, float(len(scan.measurement))))
    x, y = outlines(scan, predicted.mean, predicted.covariance, threshold)
    return {
        "tracker": [name] * x.size,
        "time_s": np.full(x.size, scan.time),
        "scan": np.full(x.size, float(number)),
        "track": np.repeat(predicted.ids.astype(float), CORNERS),
        "x_m": x.ravel(),
        "y_m": y.ravel(),
    }


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
