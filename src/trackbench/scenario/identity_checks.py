"""What has a meaning only where the measurements do not say of which object they are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from trackbench.base.config import Problem
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.published import TRACKERS
from trackbench.truth.config import HighwayOptions, ScriptedOptions

if TYPE_CHECKING:
    from trackbench.scenario.config import ScenarioConfig

REASONS = {
    "clutter": "a false alarm has no identity",
    "resolution": "a detection of two vehicles has no single identity",
    "states": "trackers are told of this only without identities",
}
#: What of the scores is not used where tracks are scored.
OF_SINGLE_OBJECTS = ("settle_s", "divergence_m", "lost_after_s", "min_coverage", "reference")
REMEDY = "write sensing: {identities: hidden}, or remove this"


def problems(scenario: ScenarioConfig) -> Iterator[Problem]:
    """What is stated of hidden identities in a scenario whose identities are known, and the other way round."""
    if scenario.sensing.identities == "hidden":
        yield from _of_hidden(scenario)
        return
    for name, sensor in scenario.sensors.items():
        for key, reason in REASONS.items():
            if key in sensor.model_fields_set:
                yield Problem(("sensors", name, key), f"{reason}; {REMEDY}")
    for name, tracker in scenario.trackers.items():
        if isinstance(tracker, FilterConfig) and tracker.associate is not None:
            yield Problem(("trackers", name, "associate"), f"the measurements say of which object they are; {REMEDY}")
    if any(metric.scores == "tracks" for metric in scenario.score.metrics):
        yield Problem(("score", "metrics"), f"are of tracks; {REMEDY}")
    if "cutoff_m" in scenario.score.model_fields_set:
        yield Problem(("score", "cutoff_m"), f"is of tracks; {REMEDY}")
    truth = scenario.truth
    if isinstance(truth, HighwayOptions) and truth.others_within_m is not None:
        yield Problem(("truth", "others_within_m"), f"with known identities only targets are measured; {REMEDY}")
    if isinstance(truth, ScriptedOptions):
        for name, body in truth.objects.items():
            if not body.target:
                message = f"with known identities every object is a target; {REMEDY}"
                yield Problem(("truth", "objects", name, "target"), message)


def _of_hidden(scenario: ScenarioConfig) -> Iterator[Problem]:
    for name, tracker in scenario.trackers.items():
        alone = "follows one object each, of which the detections do not say"
        if isinstance(tracker, FilterConfig) and tracker.associate is None:
            yield Problem(("trackers", name, "filter"), f"{alone}; add associate: {{method: gnn}}")
        elif isinstance(tracker, PluginConfig) and TRACKERS.home_of(tracker.use).startswith("trackbench."):
            yield Problem(("trackers", name, "use"), f"{tracker.use} {alone}; use a filter with associate")
    if any(metric.scores != "tracks" for metric in scenario.score.metrics):
        yield Problem(("score", "metrics"), "are of single objects; with hidden identities remove them")
    for key in OF_SINGLE_OBJECTS:
        if key in scenario.score.model_fields_set:
            yield Problem(("score", key), "not used with identities: hidden; remove it")
