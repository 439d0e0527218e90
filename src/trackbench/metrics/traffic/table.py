"""Every metric of tracking in traffic: its unit, its meaning and how its values combine over runs."""

from __future__ import annotations

import math
from types import new_class
from typing import Any, ClassVar, Literal

from trackbench.base.types import Array
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.metrics.protocol import Direction, Metric

Combine = Literal["ratio", "root", "mean"]


class RunRatio(Metric):
    """A metric of tracks that is the ratio of two sums of each run: of a total and the number of its terms."""

    scores = "tracks"
    combine: ClassVar[Combine] = "ratio"
    """Over runs: the ratio of the sums; its root; the mean of the runs' own values (their count is 1)."""
    at_least: ClassVar[float] = 0.0

    @property
    def columns(self) -> tuple[str, ...]:
        return f"{self.name}_total", f"{self.name}_count"

    def of_runs(self, *columns: Array) -> Interval | None:
        total, count = columns
        if not count.any():
            return None
        quotient = ratio(total, count, at_least=self.at_least, at_most=self.at_most)
        return root(quotient) if self.combine == "root" else quotient

    def finish(self, sums: Array) -> Interval | None:
        """``sums``: ``(2, runs)`` total and count of each run."""
        return self.of_runs(*sums)


def run_ratio(
    name: str,
    unit: str,
    meaning: str,
    better: Direction | None,
    combine: Combine = "ratio",
    at_least: float = 0.0,
    at_most: float = math.inf,
) -> RunRatio:
    """A metric of the class that these make."""
    members: dict[str, Any] = {
        "name": name,
        "unit": unit,
        "meaning": meaning,
        "better": better,
        "combine": combine,
        "at_least": at_least,
        "at_most": at_most,
        "__module__": __name__,
    }
    metric: RunRatio = new_class(name, (RunRatio,), {}, lambda body: body.update(members))()
    return metric


def share(name: str, meaning: str, better: Direction | None, combine: Combine = "ratio") -> RunRatio:
    """A metric from 0 to 1."""
    return run_ratio(name, "1", meaning, better, combine, at_most=1.0)


def by_name(*metrics: RunRatio) -> dict[str, RunRatio]:
    return {metric.name: metric for metric in metrics}


TRACK_METRICS = by_name(
    run_ratio("gospa", "m", "error in position, missed objects and false tracks in one number", "smaller", "root"),
    run_ratio("gospa_localisation", "m", "part of GOSPA from the positions of matched tracks", "smaller", "root"),
    run_ratio("gospa_missed", "m", "part of GOSPA from objects without a track", "smaller", "root"),
    run_ratio("gospa_false", "m", "part of GOSPA from tracks without an object", "smaller", "root"),
    run_ratio("gospa_switch", "m", "part of T-GOSPA from switches of tracks", "smaller", "root"),
    run_ratio("tgospa", "m", "GOSPA of whole trajectories: switches of tracks cost too", "smaller", "root"),
    run_ratio("ospa", "m", "error per object in position and number", "smaller", "root"),
    run_ratio("ospa2", "m", "error per trajectory in position, number and identity", "smaller", "root"),
    share("hota", "detection and association in one number", "larger", "mean"),
    share("deta", "detection part of HOTA", "larger", "mean"),
    share("assa", "association part of HOTA", "larger", "mean"),
    share("idf1", "share of time that one track each covers of the objects", "larger"),
    run_ratio(
        "mota",
        "1",
        "one minus misses, false tracks and switches per due instant",
        "larger",
        at_least=-math.inf,
        at_most=1.0,
    ),
    run_ratio("motp", "m", "mean distance of matched tracks", "smaller"),
    run_ratio("id_switches", "1/min", "changes of an object's track, per minute of an object", "smaller"),
    run_ratio("fragmentations", "1/min", "times a lost object is tracked again, per minute of an object", "smaller"),
    run_ratio("false_tracks", "1/min", "tracks that never are on an object, per minute", "smaller"),
    run_ratio(
        "confirm_latency", "s", "time that objects wait for their first track, per object that gets one", "smaller"
    ),
    share("never_confirmed", "share of the due objects that are never tracked", "smaller"),
    share("lost_time_share", "share of the time after its first track that an object has none", "smaller"),
    share("track_purity", "share of a track's time that it spends on its main object", "larger"),
    share("siap_completeness", "share of the due instants with any track", "larger"),
    run_ratio("siap_ambiguity", "1", "tracks on an object that has any", "smaller", at_least=1.0),
    share("siap_spuriousness", "share of the tracks on no object", "smaller"),
    run_ratio("siap_position", "m", "mean distance of tracks to the nearest object", "smaller"),
    run_ratio("siap_velocity", "m/s", "mean difference of their velocities", "smaller"),
    run_ratio("position_rmse", "m", "root mean square error of the position of matched tracks", "smaller", "root"),
    run_ratio("velocity_rmse", "m/s", "root mean square error of the velocity of matched tracks", "smaller", "root"),
    run_ratio("nees", "1", "normalised estimation error squared of matched tracks, 4 when consistent", None),
    share("nees_inside", "share of them within the 95 % bound of chi-square, 0.95 when consistent", None),
    share("matched_share", "share of the due instants with a matched track", "larger"),
    share("association_right", "share of associations with the track's own object", "larger"),
    share("association_wrong_object", "share of associations with another object", "smaller"),
    share("association_clutter", "share of associations with a false alarm", "smaller"),
    share("association_missed", "share of associations left out although the object was detected", "smaller"),
)
