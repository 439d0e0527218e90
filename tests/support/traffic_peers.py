"""Stone Soup's trackers of several objects on the scans of one run, as its documentation uses them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDA, JPDAwithLBP
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToBearingRangeRate2D
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.types.angle import Bearing
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.numeric import Probability
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater.kalman import ExtendedKalmanUpdater
from tests.support.peers import cv_matrices

from trackbench.base.types import Array, Indices, Scan
from trackbench.models.sensors import Radar

BEGIN = datetime(2000, 1, 1)
#: By belief propagation: the enumeration of all vehicles' associations takes minutes for a scan.
ASSOCIATORS = {"gnn": GNNWith2DAssignment, "jpda": JPDA, "jpda by belief propagation": JPDAwithLBP}
#: Stone Soup's order of a radar's components is bearing, range, range rate.
ORDER = {"radar": [1, 0, 2], "lidar": [0, 1]}


def stonesoup_tracks(
    mean: Array, covariance: Array, time: float, scans: Sequence[Scan], method: str, gate: float
) -> Iterator[tuple[Array, Array, Indices]]:
    """After each scan, mean ``(4, K)`` and covariance of given tracks, and the column each took; -1 for none.

    With JPDA the column is that of the largest association probability.
    """
    tracks = [
        Track([GaussianState(mean[:, k, None], covariance[..., k], timestamp=at(time))]) for k in range(mean.shape[1])
    ]
    for scan in scans:
        f, q = cv_matrices(scan.time - time)
        model = LinearGaussianTimeInvariantTransitionModel(transition_matrix=f, covariance_matrix=q)
        updater = ExtendedKalmanUpdater(measurement_model=None, force_symmetric_covariance=True)
        hypothesiser = PDAHypothesiser(
            ExtendedKalmanPredictor(model),
            updater,
            clutter_spatial_density=scan.clutter_density,
            prob_detect=Probability(scan.detection_probability),
            prob_gate=Probability(gate),
        )
        associator = ASSOCIATORS[method](hypothesiser)
        detections = detected(scan)
        found = associator.associate(set(tracks), detections, at(scan.time))
        used = []
        for track in tracks:
            hypotheses = [found[track]] if method == "gnn" else list(found[track])
            best = max(hypotheses, key=lambda each: float(each.probability))
            used.append(detections.index(best.measurement) if best else -1)
            track.append(_updated(hypotheses, updater))
        time = scan.time
        yield (
            np.concatenate([np.asarray(track.state_vector, dtype=float) for track in tracks], axis=1),
            np.stack([np.asarray(track.covar) for track in tracks], axis=-1),
            np.array(used),
        )


class ExactRadar(CartesianToBearingRangeRate2D):
    """Stone Soup takes the derivative by finite differences, whose error adds up to a few 1e-6 in the estimates."""

    def jacobian(self, state, **kwargs):
        x = np.asarray(state.state_vector, dtype=float)[:, 0]
        return Radar.jacobian(x, np.zeros(3), np.zeros(2))[ORDER["radar"]]


def at(time: float) -> datetime:
    return BEGIN + timedelta(seconds=time)


def detected(scan: Scan) -> list[Detection]:
    """The detections of a scan in its order."""
    order = ORDER[scan.kind]
    noise = scan.noise_covariance[np.ix_(order, order)]
    if scan.kind == "radar":
        model: Any = ExactRadar(4, (0, 1), noise, velocity_mapping=(2, 3))
    else:
        model = LinearGaussian(4, (0, 1), noise)
    found = []
    for values in scan.measurement.T:
        vector = values[order].astype(object)
        if scan.kind == "radar":
            vector[0] = Bearing(vector[0])
        found.append(Detection(vector[:, None], timestamp=at(scan.time), measurement_model=model))
    return found


def _updated(hypotheses: Sequence[Any], updater: ExtendedKalmanUpdater) -> GaussianState:
    states = [updater.update(each) if each else each.prediction for each in hypotheses]
    if len(states) == 1:
        return states[0]
    means = StateVectors([state.state_vector for state in states])
    covariances = np.stack([state.covar for state in states], axis=2)
    weights = np.array([float(each.probability) for each in hypotheses])
    mean, covariance = gm_reduce_single(means, covariances, weights)
    return GaussianState(mean, covariance, timestamp=states[0].timestamp)
