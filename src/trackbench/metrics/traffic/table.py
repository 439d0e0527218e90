"""All metrics of tracks: units, meanings and how the values combine over runs."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from types import new_class
from typing import Any, ClassVar, Literal

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.built_in.basic import Nees, PositionRmse, VelocityRmse
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.metrics.protocol import Accumulator, Direction, Metric, Outcome

Combine = Literal["ratio", "root", "mean"]


class TrackSums:
    """Accumulator of the built-in metrics of tracks: total and number of terms of each metric in each run."""

    name = "built-in tracks"

    def init(self, scope: Any) -> list[Array]:
        return []

    def update(self, sums: list[Array], run: Any) -> list[Array]:
        """Add the totals and counts of one run of tracks."""
        sums.append(np.array([run.scores.values.get(path, (0.0, 0.0)) for path in PATHS]).T)
        return sums

    def close(self, sums: list[Array]) -> Array:
        """Return the sums and numbers of terms in each run, by metric path, ``(runs, 2, paths)``."""
        return np.array(sums)

    def merge(self, blocks: Sequence[Array]) -> Array:
        return np.concatenate(blocks)


TRACKS = TrackSums()


class RunRatio(Metric):
    """Metric of tracks that is a ratio of two sums over each run: a quantity's total, and its number of terms."""

    needs: ClassVar[Set[str]] = frozenset({"tracks", "truth"})
    shared: ClassVar[Accumulator | None] = TRACKS
    combine: ClassVar[Combine] = "ratio"
    """How runs combine. ratio: of the sums over all runs; root: square root of this ratio; mean: of the values of the
    runs, each with count 1."""
    at_least: ClassVar[float] = 0.0
    fewest: ClassVar[float] = 50
    """Least number of runs of one scene with which the interval has its stated coverage
    (``benchmarks/calibration/traffic.py``)."""
    localises: ClassVar[bool] = False
    """Whether the metric's total contains the squared distance of each matched track."""
    missing: ClassVar[str] = "no run tells it"
    """Reason for a missing value where no run has a term."""

    def __reduce__(self) -> tuple[Any, ...]:
        # The class is made at run time and has no name in this module.
        return _of_name, (self.name,)

    @property
    def columns(self) -> tuple[str, ...]:
        return f"{self.name}_total", f"{self.name}_count"

    def reference_axes(self, path: str, sums: Array) -> float:
        """Return twice the mean number of matched tracks per instant if the metric sums their squared distances.

        The result is the number of axes whose squared errors of the truth add to the squared metric.
        """
        if not self.localises:
            return super().reference_axes(path, sums)
        matched, instants = run_sums(sums, "matched_share")[0].sum(), run_sums(sums, path)[1].sum()
        return 2.0 * float(matched / instants) if instants else 0.0

    def of_runs(self, *columns: Array) -> Interval | None:
        total, count = columns
        if not count.any():
            return None
        quotient = ratio(total, count, at_least=self.at_least, at_most=self.at_most)
        quotient = quotient._replace(skewed=True, fewest=self.fewest)
        return root(quotient) if self.combine == "root" else quotient

    def finish(self, sums: Array) -> Outcome:
        return self.of_runs(*run_sums(sums, self.name)) or self.no_value(self.missing)


def run_sums(sums: Array, path: str) -> Array:
    """Return sum and number of terms of a metric in each run, ``(2, runs)``, from the sums ``(runs, 2, paths)``."""
    return np.asarray(sums[:, :, PATHS.index(path)].T)


def run_ratio(name: str, unit: str, meaning: str, better: Direction | None, **options: Any) -> RunRatio:
    """Make a metric of tracks that is a ratio of sums; ``options`` are class variables of :class:`RunRatio`."""
    members = {"name": name, "unit": unit, "meaning": meaning, "better": better, "__module__": __name__, **options}
    metric: RunRatio = new_class(name, (RunRatio,), {}, lambda body: body.update(members))()
    return metric


def share(name: str, meaning: str, better: Direction | None, **options: Any) -> RunRatio:
    """Make a metric of tracks that is a share from 0 to 1."""
    return run_ratio(name, "1", meaning, better, at_most=1.0, **options)


def root_of(name: str, unit: str, meaning: str, **options: Any) -> RunRatio:
    """Make a metric of tracks, the root of the mean of the squares that the scorer sums under ``name``."""
    return run_ratio(name, unit, meaning, "smaller", combine="root", **options)


def over_tracks(metric: type[Metric], **options: Any) -> RunRatio:
    """Make a metric of tracks from a metric of estimates, summed over the matched tracks."""
    options["value_name"] = metric.value_name
    return run_ratio(metric.name, metric.unit, metric.meaning, metric.better, **options)


def of_detections(name: str, unit: str, meaning: str, **options: Any) -> RunRatio:
    """Make a metric of a recording without truth: no direction is better, and the interval is not calibrated."""
    return run_ratio(name, unit, meaning, None, needs={"tracks", "no truth"}, fewest=2, **options)


def by_name(*metrics: RunRatio) -> dict[str, RunRatio]:
    return {metric.name: metric for metric in metrics}


#: Reasons for a missing value.
NOT_SAID = {"missing": "the tracker does not say which detections it used"}
#: Options of shares of associations, which few runs decide.
OF_ASSOCIATIONS = {**NOT_SAID, "fewest": 400}
NOT_ASKED = {"missing": "only built-in trackers tell what they predict"}
#: Metrics of runs with a truth, by name.
TRACK_METRICS = by_name(
    root_of("tgospa", "m", "GOSPA of whole trajectories: switches of tracks cost too", ranks=True, localises=True),
    root_of("gospa", "m", "error in position, missed objects and false tracks in one number", localises=True),
    root_of(
        "gospa_localisation", "m", "part of GOSPA from the positions of matched tracks", fewest=400, localises=True
    ),
    root_of("gospa_missed", "m", "part of GOSPA from objects without a track"),
    root_of("gospa_false", "m", "part of GOSPA from tracks without an object", fewest=10),
    root_of("gospa_switch", "m", "part of T-GOSPA from identity switches, which GOSPA lacks"),
    share("hota", "detection and association in one number", "larger", combine="mean", fewest=100),
    share("deta", "detection part of HOTA", "larger", combine="mean"),
    share("assa", "association part of HOTA", "larger", combine="mean", fewest=100),
    share("idf1", "F1 score of the time that each object is on its one track", "larger", fewest=400),
    share("mota", "one minus misses, false tracks and switches per due instant", "larger", at_least=-math.inf),
    run_ratio("id_switches", "1/min", "changes of an object's track, per minute of an object", "smaller", fewest=10),
    run_ratio("false_tracks", "1/min", "tracks that never are on an object, per minute", "smaller", fewest=10),
    run_ratio(
        "confirm_latency",
        "s",
        "time that objects wait for their first track, per object that gets one",
        "smaller",
        missing="no object was ever tracked",
        fewest=100,
    ),
    share("never_confirmed", "share of the due objects that are never tracked", "smaller"),
    share("lost_time_share", "time without a track, as a share since an object's first track", "smaller", fewest=100),
    over_tracks(PositionRmse, combine="root", fewest=400),
    over_tracks(VelocityRmse, combine="root", fewest=math.inf),
    over_tracks(Nees, fewest=math.inf),
    share("nees_inside", "share of NEES below the 95 % point of chi-square, 0.95 when consistent", None, fewest=400),
    share("matched_share", "share of the due instants with a matched track", "larger"),
    share("association_right", "share of associations with the track's own object", "larger", **OF_ASSOCIATIONS),
    share("association_wrong_object", "share of associations with another object", "smaller", **OF_ASSOCIATIONS),
    share("association_clutter", "share of associations with a false alarm", "smaller", **OF_ASSOCIATIONS),
    share(
        "association_missed",
        "share of associations left out although the object was detected",
        "smaller",
        **OF_ASSOCIATIONS,
    ),
)
#: Metrics of runs with a truth that need the object of each detection.
ASSOCIATION_METRICS = [metric for path, metric in TRACK_METRICS.items() if path.startswith("association_")]
#: Metrics of runs with a truth that count tracks on no object.
OF_FALSE_TRACKS = ("gospa_false", "hota", "deta", "assa", "idf1", "mota", "false_tracks")
#: Metrics of runs without a truth, by name.
DETECTION_METRICS = by_name(
    of_detections("track_count", "1", "mean number of tracks after a scan"),
    of_detections("new_tracks", "1/min", "tracks that begin, per minute"),
    of_detections("used_share", "1", "share of the detections that a track used", at_most=1.0, **NOT_SAID),
    of_detections(
        "nis",
        "1",
        "normalised innovation squared over its degrees of freedom, of used detections, 1 when consistent",
        **NOT_ASKED,
    ),
    of_detections(
        "prediction_score",
        "1",
        "logarithm of the predicted density of detections, per detection (nats)",
        at_least=-math.inf,
        **NOT_ASKED,
    ),
)


def _of_name(name: str) -> RunRatio:
    return (TRACK_METRICS | DETECTION_METRICS)[name]


#: Paths of all metrics that a run may have.
PATHS = (*TRACK_METRICS, *DETECTION_METRICS)
