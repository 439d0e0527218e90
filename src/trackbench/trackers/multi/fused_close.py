"""Pairs of a track and a detection that are close in every component, by a kernel."""

from __future__ import annotations

from functools import cache

import numpy as np

from trackbench.base.types import Indices
from trackbench.base.units import wrap_angle
from trackbench.engine.equations import Equations, Values
from trackbench.engine.filters import kernels
from trackbench.engine.pairs import PairSearch
from trackbench.filters import Measured, PredictedMeasurement
from trackbench.trackers.multi.detections import RunDetections

#: By how much the box about a gate is larger in variance, so that rounding leaves out no pair.
MARGIN = 1e-6


def close_in_all(
    predicted: PredictedMeasurement, measured: Measured, detections: RunDetections, run: Indices, threshold: float
) -> tuple[Indices, Indices]:
    """Pairs that are in the box about the gate."""
    values = {
        "value": measured.value,
        "noise": measured.noise,
        "expected": predicted.mean,
        "spread": predicted.covariance,
        "threshold": threshold,
    }
    return _box(len(measured.value), measured.angular, measured.noise.ndim > 2)(values, run, detections.first)


@cache
def _box(components: int, angular: tuple[int, ...], noise_of_each: bool) -> PairSearch:
    def function(values: Values) -> Values:
        close = np.ones((), dtype=bool)
        for i in range(components):
            apart = values["value"][i] - values["expected"][i]
            apart = wrap_angle(apart) if i in angular else apart
            variance = values["spread"][i, i] + values["noise"][i, i]
            close = close & (apart * apart <= values["threshold"] * variance * (1.0 + MARGIN))
        return {"close": close}

    one, two = (components,), (components, components)
    shapes = {"value": one, "noise": two, "expected": one, "spread": two, "threshold": ()}
    equations = Equations("detection in a box", function, {name: len(shape) for name, shape in shapes.items()})
    own = {"value", "noise"} if noise_of_each else {"value"}
    return PairSearch(kernels(), equations, shapes, {"expected", "spread"}, own)
