"""The observation: a row for the ego vehicle and one for each track, in the layout of highway-env's Kinematics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium import spaces

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array, Observer, Tracks

COORDINATES = ("x", "y", "vx", "vy")
DEVIATIONS = tuple(f"std_{name}" for name in COORDINATES)
#: By feature, the two coordinates whose correlation it is.
CORRELATIONS = {
    f"corr_{COORDINATES[i]}_{COORDINATES[j]}": (i, j) for i in range(4) for j in range(i + 1, 4)
}  # fmt: skip
FEATURES = ("presence", *COORDINATES, *DEVIATIONS, *CORRELATIONS, "existence")
#: Those of an observation unless others are named.
DEFAULT = ("presence", *COORDINATES, *DEVIATIONS, "existence")
#: Standard deviations are clipped at it, m and m/s.
MOST_DEVIATION = 10.0
#: In place of a probability of existence that a tracker does not state.
NOT_STATED = -1.0
#: highway-env's y points down its screen, to the right of the cars; that of tracks points to the left.
DOWN = np.array([1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True)
class ObservationLayout:
    """How the ego vehicle and tracks become an array ``(rows, features)``, in highway-env's axes.

    The first row is the ego vehicle; the others are tracks relative to it, the nearest first. Rows that are not needed
    are zero. Coordinates are clipped to their range.
    """

    rows: int
    features: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    """By coordinate, m and m/s."""
    normalised: bool = True
    """Whether coordinates go from -1 to 1 over their range and standard deviations from 0 to 1; else m and m/s."""
    _low: Array = field(init=False)
    _high: Array = field(init=False)

    def __post_init__(self) -> None:
        if not isinstance(self.rows, int) or isinstance(self.rows, bool) or not 2 <= self.rows <= 1000:
            raise InputError(f"must be a whole number from 2 to 1000, not {self.rows!r}", key="rows")
        for name in self.features:
            if name not in FEATURES:
                raise InputError(f"unknown feature {name!r}; {nearest_choices(str(name), FEATURES)}", key="features")
        if not self.features or len(set(self.features)) < len(self.features):
            raise InputError("name each feature once, and at least one", key="features")
        limits = [self._limits(name) for name in self.features]
        object.__setattr__(self, "_low", np.array([low for low, _ in limits]))
        object.__setattr__(self, "_high", np.array([high for _, high in limits]))

    def _limits(self, name: str) -> tuple[float, float]:
        """The least and the largest value of a feature, m, m/s or 1."""
        if name in COORDINATES:
            return self.ranges[name]
        if name in DEVIATIONS:
            return 0.0, MOST_DEVIATION
        return (0.0, 1.0) if name == "presence" else (-1.0, 1.0)

    def space(self) -> spaces.Box:
        """All observations."""
        low = self.to_array(np.broadcast_to(self._low, (self.rows, len(self.features))))
        high = self.to_array(np.broadcast_to(self._high, (self.rows, len(self.features))))
        # A row that is not needed is zero.
        return spaces.Box(np.minimum(low, 0.0), np.maximum(high, 0.0), dtype=np.float32)

    def to_array(self, values: Array) -> Array:
        """Values ``(..., features)`` in m and m/s as they are observed."""
        values = np.clip(values, self._low, self._high)
        if self.normalised:
            for i, name in enumerate(self.features):
                if name in COORDINATES:
                    low, high = self.ranges[name]
                    values[..., i] = 2.0 * (values[..., i] - low) / (high - low) - 1.0
                elif name in DEVIATIONS:
                    values[..., i] /= MOST_DEVIATION
        return values.astype(np.float32)

    def from_array(self, observation: Array) -> dict[str, Array]:
        """By feature ``(rows,)``, in m and m/s."""
        columns = {name: np.asarray(observation[:, i], dtype=float) for i, name in enumerate(self.features)}
        if self.normalised:
            for name in columns:
                if name in COORDINATES:
                    low, high = self.ranges[name]
                    columns[name] = low + (columns[name] + 1.0) * (high - low) / 2.0
                elif name in DEVIATIONS:
                    columns[name] = columns[name] * MOST_DEVIATION
        return columns

    def observe(self, ego: Observer, tracks: Tracks) -> Any:
        """The observation ``(rows, features)`` of now, the last step of the ego's motion."""
        own = np.array([ego.px[-1], ego.py[-1], ego.vx[-1], ego.vy[-1]])
        relative = tracks.mean - own[:, None]
        chosen = np.argsort(np.hypot(relative[0], relative[1]), kind="stable")[: self.rows - 1]
        result = np.zeros((self.rows, len(self.features)), dtype=np.float32)
        existence = None if tracks.existence is None else tracks.existence[chosen]
        columns = self._columns(relative[:, chosen], tracks.covariance[..., chosen], existence)
        of_ego = self._columns(own[:, None], np.zeros((4, 4, 1)), np.ones(1))
        result[0] = self.to_array(of_ego)[0]
        result[1 : 1 + len(chosen)] = self.to_array(columns)
        return result

    def _columns(self, mean: Array, covariance: Array, existence: Array | None) -> Array:
        """``(K, features)`` in m and m/s."""
        count = mean.shape[1]
        mean = mean * DOWN[:, None]
        deviation = np.sqrt(np.maximum(covariance[range(4), range(4)], 0.0))
        values: dict[str, Array] = {"presence": np.ones(count), **dict(zip(COORDINATES, mean, strict=True))}
        values |= dict(zip(DEVIATIONS, deviation, strict=True))
        for name, (i, j) in CORRELATIONS.items():
            if name in self.features:
                scale = np.maximum(deviation[i] * deviation[j], np.finfo(float).tiny)
                values[name] = DOWN[i] * DOWN[j] * covariance[i, j] / scale
        values["existence"] = np.full(count, NOT_STATED) if existence is None else existence
        return np.nan_to_num(np.stack([values[name] for name in self.features], axis=-1))


def layout_of(env: Any, rows: int | None, features: Sequence[str] | None, normalised: bool) -> ObservationLayout:
    """The layout of an environment: rows and ranges are those of its own Kinematics observation unless stated.

    Source: ``KinematicObservation`` of highway-env, for the ranges where an environment states none.
    """
    own = env.default_config().get("observation", {})
    own = own if own.get("type") == "Kinematics" else {}
    lanes = len(env.road.network.all_side_lanes(env.vehicle.lane_index))
    ranges = {"x": (-200.0, 200.0), "y": (-4.0 * lanes, 4.0 * lanes), "vx": (-80.0, 80.0), "vy": (-80.0, 80.0)}
    stated = own.get("features_range") or {}
    ranges |= {name: (float(low), float(high)) for name, (low, high) in stated.items() if name in ranges}
    if isinstance(features, str):
        raise InputError(f"must be a list of names, not {features!r}", key="features")
    return ObservationLayout(
        own.get("vehicles_count", 5) if rows is None else rows, tuple(features or DEFAULT), ranges, normalised
    )
