"""What is kept of a trial: of each run the sums of its errors and of the likelihood of its innovations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.intervals import Interval, clustered, ratio, root
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.results import MetricValue

#: Of labelled objects: the unit of each measure.
UNITS = {"position_rmse": "m", "velocity_rmse": "m/s", "nees": "", "log_likelihood": ""}
#: Of detections that nobody labelled, and which value of each is better.
TRAFFIC_UNITS = {
    path: TRACK_METRICS[path].unit for path in ("gospa", "gospa_localisation", "gospa_missed", "gospa_false")
}
#: Each measure as a sentence names it.
WORDS = {
    "position_rmse": "position RMSE",
    "velocity_rmse": "velocity RMSE",
    "nees": "mean NEES",
    "log_likelihood": "log-likelihood of a measurement",
    "gospa": "GOSPA",
    "gospa_localisation": "GOSPA, localisation",
    "gospa_missed": "GOSPA, missed",
    "gospa_false": "GOSPA, false",
}
#: Components of the state whose NEES is taken.
NEES_DOF = 4


@dataclass(frozen=True)
class Sums:
    """Of each run and measure, the total of its terms and their number."""

    values: dict[str, Array]
    """By measure ``(2, runs)``."""

    @classmethod
    def joined(cls, parts: Sequence[Sums]) -> Sums:
        """Those of consecutive runs as one."""
        return cls({name: np.concatenate([part.values[name] for part in parts], axis=1) for name in parts[0].values})

    def interval(self, name: str, scene: Indices) -> Interval | None:
        """A measure with what each run, or scene, adds to it; None where no run tells it.

        Args:
            name: of the measure.
            scene: ``(runs,)`` number of the scene of each run.
        """
        if name not in self.values:
            return None
        total, count = self.values[name]
        if not count.any():
            return None
        if name in TRACK_METRICS:
            found = TRACK_METRICS[name].of_runs(total, count)
            return None if found is None else clustered(found, scene)
        if name == "log_likelihood":
            return clustered(ratio(total, count), scene)
        mean = ratio(total, count, at_least=0.0)
        return clustered(root(mean) if name.endswith("_rmse") else mean, scene)

    def value(self, name: str) -> float:
        """A measure over all runs; NaN where no run tells it."""
        found = (
            self.interval(name, np.zeros(self.values[name].shape[1], dtype=np.intp)) if name in self.values else None
        )
        return np.nan if found is None else found.value

    def lacking(self, start: Sums, measures: Sequence[str] = ("position_rmse", "log_likelihood")) -> str | None:
        """What there is less of than with the start's values, or is not finite, so that the two cannot be compared.

        Args:
            start: of the tracker as it is; of labelled objects nothing else was summed than what it gives.
            measures: by which the two are to be compared.
        """
        for name in measures:
            if name not in self.values or name not in start.values:
                continue
            own, other = self.values[name][1], start.values[name][1]
            word = "innovations" if name == "log_likelihood" else "estimates"
            if (own < other).any():
                given = np.minimum(own, other).sum()
                return f"it gives {given:.0f} of the {other.sum():.0f} {word} that the start gives"
            if not np.isfinite(self.values[name][0]).all():
                return f"its {word} are not finite"
        return None


def as_value(interval: Interval | None, unit: str) -> MetricValue:
    """As it stands in a result."""
    return MetricValue(unit=unit, reason="no run tells it") if interval is None else interval.as_value(unit)
