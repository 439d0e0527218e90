"""Every metric of tracking in traffic: its unit, its meaning and how its values combine over runs."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple


class TrafficMetric(NamedTuple):
    """What a pair of sums (total, count) of each run means."""

    unit: str
    meaning: str
    better: Literal["smaller", "larger", "none"]
    combine: Literal["ratio", "root", "mean"] = "ratio"
    """Over runs: the ratio of the sums; its root; the mean of the runs' own values (their count is 1)."""
    at_least: float = 0.0
    """What it cannot be below."""
    at_most: float = math.inf
    """What it cannot be above."""


def share(
    meaning: str, better: Literal["smaller", "larger", "none"], combine: Literal["ratio", "mean"] = "ratio"
) -> TrafficMetric:
    """A metric from 0 to 1."""
    return TrafficMetric("", meaning, better, combine, at_most=1.0)


METRICS: dict[str, TrafficMetric] = {
    "gospa": TrafficMetric("m", "error in position, missed objects and false tracks in one number", "smaller", "root"),
    "gospa_localisation": TrafficMetric("m", "part of GOSPA from the positions of matched tracks", "smaller", "root"),
    "gospa_missed": TrafficMetric("m", "part of GOSPA from objects without a track", "smaller", "root"),
    "gospa_false": TrafficMetric("m", "part of GOSPA from tracks without an object", "smaller", "root"),
    "gospa_switch": TrafficMetric("m", "part of T-GOSPA from switches of tracks", "smaller", "root"),
    "tgospa": TrafficMetric("m", "GOSPA of whole trajectories: switches of tracks cost too", "smaller", "root"),
    "ospa": TrafficMetric("m", "error per object in position and number", "smaller", "root"),
    "ospa2": TrafficMetric("m", "error per trajectory in position, number and identity", "smaller", "root"),
    "hota": share("detection and association in one number", "larger", "mean"),
    "deta": share("detection part of HOTA", "larger", "mean"),
    "assa": share("association part of HOTA", "larger", "mean"),
    "idf1": share("share of time that one track each covers of the objects", "larger"),
    "mota": TrafficMetric(
        "", "one minus misses, false tracks and switches per due instant", "larger", at_least=-math.inf, at_most=1.0
    ),
    "motp": TrafficMetric("m", "mean distance of matched tracks", "smaller"),
    "id_switches": TrafficMetric("1/min", "changes of an object's track, per minute of an object", "smaller"),
    "fragmentations": TrafficMetric(
        "1/min", "times a lost object is tracked again, per minute of an object", "smaller"
    ),
    "false_tracks": TrafficMetric("1/min", "tracks that never are on an object, per minute", "smaller"),
    "confirm_latency": TrafficMetric(
        "s", "time that objects wait for their first track, per object that gets one", "smaller"
    ),
    "never_confirmed": share("share of the due objects that are never tracked", "smaller"),
    "lost_time_share": share("share of the time after its first track that an object has none", "smaller"),
    "track_purity": share("share of a track's time that it spends on its main object", "larger"),
    "siap_completeness": share("share of the due instants with any track", "larger"),
    "siap_ambiguity": TrafficMetric("", "tracks on an object that has any", "smaller", at_least=1.0),
    "siap_spuriousness": share("share of the tracks on no object", "smaller"),
    "siap_position": TrafficMetric("m", "mean distance of tracks to the nearest object", "smaller"),
    "siap_velocity": TrafficMetric("m/s", "mean difference of their velocities", "smaller"),
    "position_rmse": TrafficMetric("m", "root mean square error of the position of matched tracks", "smaller", "root"),
    "velocity_rmse": TrafficMetric(
        "m/s", "root mean square error of the velocity of matched tracks", "smaller", "root"
    ),
    "nees": TrafficMetric("", "normalised estimation error squared of matched tracks, 4 when consistent", "none"),
    "nees_inside": share("share of them within the 95 % bound of chi-square, 0.95 when consistent", "none"),
    "matched_share": share("share of the due instants with a matched track", "larger"),
    "association_right": share("share of associations with the track's own object", "larger"),
    "association_wrong_object": share("share of associations with another object", "smaller"),
    "association_clutter": share("share of associations with a false alarm", "smaller"),
    "association_missed": share("share of associations left out although the object was detected", "smaller"),
}
