"""What must fit together between the sections of a scenario."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping

from trackbench.base.config import Problem
from trackbench.base.errors import counted, nearest_choices
from trackbench.base.subjects import collected
from trackbench.metrics import Field
from trackbench.metrics.registry import by_path
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.models.sensors.presets import presets
from trackbench.scenario import recorded_checks
from trackbench.scenario.keys import Expectation, ScenarioKeys
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.published import TRACKERS
from trackbench.truth import SteppedTruth
from trackbench.truth.config import HighwayOptions, RecordingOptions, ScriptedOptions
from trackbench.truth.config.traffic import TracksConfig, files_in
from trackbench.truth.sources import RecordingTruth

#: Two times that differ by less are the same, s: a difference of times is not exact.
ROUNDING = 1e-9


def scenario_problems(scenario: ScenarioKeys) -> Iterator[Problem]:
    """Everything that is wrong between the sections of ``scenario``, each of which is valid by itself."""
    if isinstance(scenario.truth, RecordingTruth):
        yield from recorded_checks.recording_problems(scenario, scenario.truth)
    if isinstance(scenario.truth, SteppedTruth):
        yield from _times(scenario, scenario.truth)
    fed = scenario.truth.feeds(scenario.sensor_kinds)
    for name, sensor in scenario.sensors.items():
        if sensor.rate_hz is None and name not in fed:
            yield Problem(("sensors", name, "rate_hz"), "missing; measurements per second, Hz")
    yield from _identities(scenario)
    yield from _made_elsewhere(scenario)
    yield from _scored_point(scenario)
    yield from collected("checks", scenario)
    yield from _tracker_sensors(scenario)
    runs = scenario.monte_carlo.runs
    scenes = len(scenario.truth.scenes())
    if scenario.recording.scene >= scenes:
        there = f"from 0 to {scenes - 1}" if scenes > 1 else "0, since there is one scene"
        yield Problem(("recording", "scene"), f"must be {there}")
    if scenario.recording.run >= runs:
        yield Problem(("recording", "run"), f"must be from 0 to {runs - 1}, because monte_carlo.runs is {runs}")
    baseline = scenario.score.baseline
    if baseline is not None and baseline not in scenario.trackers:
        message = f"the scenario has no tracker {baseline!r}; {nearest_choices(baseline, scenario.trackers)}"
        yield Problem(("score", "baseline"), message)
    metrics = by_path(scenario.sensors, scenario.own_metrics, scenario.properties) if scenario.expect else {}
    for index, expectation in enumerate(scenario.expect):
        for problem in _expectation(scenario, expectation, metrics):
            yield Problem(("expect", index, *problem.at), problem.message)


def _times(scenario: ScenarioKeys, truth: SteppedTruth) -> Iterator[Problem]:
    settle = scenario.score.settle_s
    if scenario.sensing.identities == "known" and settle >= truth.duration_s:
        default = "" if "settle_s" in scenario.score.model_fields_set else f"is {settle:g} where it is not stated, and "
        message = f"{default}must be shorter than truth.duration_s, which is {truth.duration_s:g}"
        yield Problem(("score", "settle_s"), message)
    truth_rate = truth.rate_hz
    for name, sensor in scenario.sensors.items():
        if sensor.rate_hz is None:
            continue
        steps = truth_rate / sensor.rate_hz
        if not _whole(steps):
            near = " or ".join(f"{rate:g}" for rate in _nearest_rates(truth_rate, steps))
            message = f"{sensor.rate_hz:g} Hz does not divide truth.rate_hz, which is {truth_rate}; use {near}"
            if sensor.preset is not None and sensor.rate_hz == presets()[sensor.preset].values.get("rate_hz"):
                message += f" (the rate is that of preset {sensor.preset})"
            yield Problem(("sensors", name, "rate_hz"), message)
        elif sensor.phase_s * sensor.rate_hz >= 1:
            message = f"must be below the sensor's period, which is {1 / sensor.rate_hz:g} s"
            yield Problem(("sensors", name, "phase_s"), message)
        elif sensor.phase_s > truth.duration_s:
            message = f"the first measurement is after the end, which is at {truth.duration_s:g} s"
            yield Problem(("sensors", name, "phase_s"), message)
        elif not _whole(sensor.phase_s * truth_rate):
            near = f"{round(sensor.phase_s * truth_rate) / truth_rate:g}"
            message = f"must be a multiple of the truth step, which is {1 / truth_rate:g} s; use {near}"
            yield Problem(("sensors", name, "phase_s"), message)


def _nearest_rates(truth_rate: int, steps: float) -> list[float]:
    """The rates below and above ``truth_rate / steps`` that divide and have at most three decimals."""
    # The slowest of these.
    steps = min(steps, 1000 * truth_rate)
    slower = itertools.chain(range(math.ceil(steps), truth_rate), [truth_rate])
    faster = range(math.floor(steps), 0, -1)
    rates = [
        next((truth_rate / count for count in counts if _whole(1000 * truth_rate / count)), None)
        for counts in (slower, faster)
    ]
    return [rate for rate in rates if rate is not None]


def _made_elsewhere(scenario: ScenarioKeys) -> Iterator[Problem]:
    """What goes with tracks that another program wrote, and that there are sensors for all other trackers."""
    for name, tracker in scenario.trackers.items():
        if not isinstance(tracker, TracksConfig):
            if not scenario.sensors:
                yield Problem(("sensors",), f"missing: {name} reads them; only tracks made elsewhere need none")
                return
        elif scenario.sensing.identities == "known":
            message = "tracks are scored without identities; write sensing: {identities: hidden}, and export scans anew"
            yield Problem(("trackers", name, "use"), message)
        elif isinstance(scenario.truth, RecordingTruth) and scenario.truth.without_truth:
            yield Problem(("trackers", name, "use"), "there is no truth to score its tracks against")
        elif len(files := files_in(tracker.path)) > 1 and len(files) != (scenes := len(scenario.truth.scenes())):
            message = f"{len(files)} files for {counted(scenes, 'scene')}; name one for each, in the same order"
            yield Problem(("trackers", name, "path"), message)


def _scored_point(scenario: ScenarioKeys) -> Iterator[Problem]:
    """Say where a point beside the centre is not known."""
    truth, point = scenario.truth, scenario.score.point
    if point == "centre":
        return
    if isinstance(truth, RecordingTruth) and truth.without_truth:
        yield Problem(("score", "point"), "there is no truth, of which a point could be scored")
    columns, assumed = getattr(truth, "columns", None), {"length_m", "width_m"} - truth.model_fields_set
    if isinstance(truth, RecordingOptions) and not truth.without_truth:
        missing = [name for name in sorted(assumed) if getattr(columns, name.removesuffix("_m"), None) is None]
        if missing:
            keys = " and ".join(f"truth.{name}" for name in missing)
            message = f"the size of the objects is not known: write {keys}, or name their columns"
            yield Problem(("score", "point"), message)


def _tracker_sensors(scenario: ScenarioKeys) -> Iterator[Problem]:
    for name, tracker in scenario.trackers.items():
        for index, sensor in enumerate(tracker.sensors or []):
            if sensor not in scenario.sensors:
                yield Problem(("trackers", name, "sensors", index), _no_sensor(scenario, sensor))
        starting = tracker.initial.sensors if isinstance(tracker, FilterConfig) else None
        for index, sensor in enumerate(starting or []):
            if sensor not in scenario.sensors:
                yield Problem(("trackers", name, "initial", "sensors", index), _no_sensor(scenario, sensor))
        if isinstance(tracker, FilterConfig):
            yield from _assumed(scenario, name, tracker)
            yield from _start(scenario, name, tracker)
            yield from _lag(scenario, name, tracker)
        for sensor in getattr(getattr(tracker, "associate", None), "detection_probability", {}):
            if sensor not in scenario.sensors:
                at = ("trackers", name, "associate", "detection_probability", sensor)
                yield Problem(at, _no_sensor(scenario, sensor))


def _assumed(scenario: ScenarioKeys, name: str, tracker: FilterConfig) -> Iterator[Problem]:
    """Sensor models, noise and effects that a tracker assumes."""
    for sensor, effects in tracker.assume.items():
        if unread := _not_read(scenario, tracker, sensor):
            yield Problem(("trackers", name, "assume", sensor), unread)
            continue
        kind = tracker.sensor_models.get(sensor, scenario.sensors[sensor].type)
        for problem in effects.problems_on(kind, tracker.filter == "kf"):
            yield Problem(("trackers", name, "assume", sensor, *problem.at), problem.message)
    for sensor, kind in tracker.sensor_models.items():
        at = ("trackers", name, "sensor_models", sensor)
        if unread := _not_read(scenario, tracker, sensor):
            yield Problem(at, unread)
            continue
        own = SENSOR_MODELS[scenario.sensors[sensor].type].components
        other = SENSOR_MODELS[kind].components
        if len(own) != len(other):
            reads = f"{sensor} reads {', '.join(own)}"
            yield Problem(at, f"{reads}, which cannot be taken for the {', '.join(other)} of a {kind}")
    for sensor, sigmas in tracker.measurement_noise.items():
        at = ("trackers", name, "measurement_noise", sensor)
        if unread := _not_read(scenario, tracker, sensor):
            yield Problem(at, unread)
            continue
        kind = tracker.sensor_models.get(sensor, scenario.sensors[sensor].type)
        options = list(dict.fromkeys(SENSOR_MODELS[kind].sigma_options))
        for key in sigmas:
            if key not in options:
                yield Problem((*at, key), f"a {kind} has no such standard deviation; {nearest_choices(key, options)}")


def _start(scenario: ScenarioKeys, name: str, tracker: FilterConfig) -> Iterator[Problem]:
    """What a tracker needs of its sensors and none of them measures: positions, and a velocity where it is stated."""
    initial = tracker.initial
    read = tracker.sensors or list(scenario.sensors)
    starting = initial.sensors or read
    if not starting or not {*read, *starting} <= {*scenario.sensors}:
        return
    kind_of = {name: tracker.sensor_models.get(name, sensor.type) for name, sensor in scenario.sensors.items()}
    placed = {sensor: SENSOR_MODELS[kind].measures_position() for sensor, kind in kind_of.items()}
    sensors = " and ".join(f"{sensor} ({kind_of[sensor]})" for sensor in starting)
    for sensor in read:
        if tracker.filter == "kf" and not placed[sensor]:
            message = f"kf converts measurements to positions, and {sensor} ({kind_of[sensor]}) measures none; use ekf"
            yield Problem(("trackers", name, "filter"), message)
    if initial.source != "truth" and not any(placed[sensor] for sensor in starting):
        remedy = "start from a sensor that does" + (", or from: truth" if tracker.associate is None else "")
        yield Problem(
            ("trackers", name, "initial"), f"no track can start: none of {sensors} measures a position; {remedy}"
        )
    if initial.velocity == "zero" or "velocity" not in initial.model_fields_set or tracker.associate is not None:
        return
    if not any(SENSOR_MODELS[kind_of[sensor]].measures_velocity() for sensor in starting):
        message = f"{sensors} measures no range rate; remove it, or start from a sensor that does"
        yield Problem(("trackers", name, "initial", "velocity"), message)


def _lag(scenario: ScenarioKeys, name: str, tracker: FilterConfig) -> Iterator[Problem]:
    if tracker.smoother is not None or tracker.late != "replay":
        return
    read = scenario.sensors if tracker.sensors_used is None else tracker.sensors_used
    latency = {sensor: scenario.sensors[sensor].latency for sensor in read if sensor in scenario.sensors}
    least = min((low for low, _ in latency.values()), default=0.0)
    for sensor, (_, most) in latency.items():
        # Of its own scans and of the other sensors', those that were taken later arrive before it by up to this.
        behind = most - least
        if behind > tracker.lag_s + ROUNDING:
            reach = f"{tracker.late} goes back {tracker.lag_s:g} s"
            dropped = f"scans of {sensor} may be {behind:g} s older than the state and would be dropped"
            yield Problem(("trackers", name, "lag_s"), f"{reach}, but {dropped}; use {behind:g} or more")
            return


def _not_read(scenario: ScenarioKeys, tracker: FilterConfig, sensor: str) -> str | None:
    """Why what a tracker assumes of a sensor changes nothing; None where it reads it."""
    if sensor not in scenario.sensors:
        return _no_sensor(scenario, sensor)
    if tracker.sensors_used is None or sensor in tracker.sensors_used:
        return None
    return f"the tracker does not read {sensor}; it reads {', '.join(tracker.sensors_used)}"


def _no_sensor(scenario: ScenarioKeys, sensor: str) -> str:
    return f"the scenario has no sensor {sensor!r}; {nearest_choices(sensor, scenario.sensors)}"


def _expectation(scenario: ScenarioKeys, expectation: Expectation, metrics: Mapping[str, Field]) -> Iterator[Problem]:
    tracker = scenario.trackers.get(expectation.tracker)
    if tracker is None:
        message = f"the scenario has no tracker {expectation.tracker!r}"
        yield Problem(("tracker",), f"{message}; {nearest_choices(expectation.tracker, scenario.trackers)}")
    metric = metrics.get(expectation.metric)
    if metric is None:
        identities = scenario.sensing.identities
        other = by_path(scenario.sensors, scenario.own_metrics).get(expectation.metric)
        if other is not None and other.needs & IDENTITIES.keys():
            (kind,) = other.needs & IDENTITIES.keys()
            hint = f"it is one of {IDENTITIES[kind]} identities, and sensing.identities is {identities}"
        else:
            hint = nearest_choices(expectation.metric, metrics)
        yield Problem(("metric",), f"there is no metric {expectation.metric!r}; {hint}")
        return
    sensor = expectation.metric.split(".")[1] if metric.per_sensor else None
    read = tracker.sensors if tracker is not None else None
    if read is not None and sensor is not None and sensor not in read:
        message = f"tracker {expectation.tracker} does not read {sensor}; it reads {', '.join(read)}"
        yield Problem(("metric",), message)
    yield from _limit(scenario, expectation, metric, metrics)


def _limit(
    scenario: ScenarioKeys, expectation: Expectation, metric: Field, metrics: Mapping[str, Field]
) -> Iterator[Problem]:
    word, rival = expectation.equals, expectation.better_than
    for operator in ("below", "above"):
        if metric.words and getattr(expectation, operator) is not None:
            message = f"{expectation.metric} is a word, not a number; use is: {' | '.join(metric.words)}"
            yield Problem((operator,), message)
    if word is not None and not metric.words:
        yield Problem(("is",), f"{expectation.metric} is a number, not a word; use below or above")
    elif word is not None and word not in metric.words:
        yield Problem(("is",), f"{expectation.metric} is never {word!r}; {nearest_choices(word, metric.words)}")
    if rival is None:
        return
    if rival not in scenario.trackers:
        message = f"the scenario has no tracker {rival!r}; {nearest_choices(rival, scenario.trackers)}"
        yield Problem(("better_than",), message)
    elif rival == expectation.tracker:
        yield Problem(("better_than",), "a tracker cannot be better than itself; name another one")
    if not metric.compared:
        compared = ", ".join(path for path, entry in metrics.items() if entry.compared)
        yield Problem(("better_than",), f"trackers are not compared by {expectation.metric}; only by {compared}")


def _whole(value: float) -> bool:
    """Whether ``value`` is a whole number but for rounding."""
    return math.isfinite(value) and abs(value - round(value)) < 1e-6


REASONS = {
    "clutter": "a false alarm has no identity",
    "resolution": "a detection of two vehicles has no single identity",
    "states": "trackers are told of this only without identities",
}
#: What of the scores is not used where tracks are scored.
OF_SINGLE_OBJECTS = ("settle_s", "each", "divergence_m", "lost_after_s", "min_coverage", "reference")
#: By what a metric needs, the identities that give it.
IDENTITIES = {"labels": "known", "tracks": "hidden"}
REMEDY = "write sensing: {identities: hidden}, or remove this"


def _identities(scenario: ScenarioKeys) -> Iterator[Problem]:
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
    if any("tracks" in metric.needs for metric in scenario.score.metrics):
        yield Problem(("score", "metrics"), f"are of tracks; {REMEDY}")
    for key in ("cutoff_m", "switch_costs_s"):
        if key in scenario.score.model_fields_set:
            yield Problem(("score", key), f"is of tracks; {REMEDY}")
    truth = scenario.truth
    if isinstance(truth, HighwayOptions) and truth.others_within_m is not None:
        yield Problem(("truth", "others_within_m"), f"with known identities only targets are measured; {REMEDY}")
    if isinstance(truth, ScriptedOptions):
        for name, body in truth.objects.items():
            if not body.target:
                message = f"with known identities every object is a target; {REMEDY}"
                yield Problem(("truth", "objects", name, "target"), message)


def _of_hidden(scenario: ScenarioKeys) -> Iterator[Problem]:
    for name, tracker in scenario.trackers.items():
        alone = "follows one object each, of which the detections do not say"
        if isinstance(tracker, FilterConfig) and tracker.associate is None:
            yield Problem(("trackers", name, "filter"), f"{alone}; add associate: {{method: gnn}}")
        elif isinstance(tracker, PluginConfig) and TRACKERS.home_of(tracker.reference).startswith("trackbench."):
            yield Problem(("trackers", name, "use"), f"{tracker.use} {alone}; use a filter with associate")
    if any("labels" in metric.needs for metric in scenario.score.metrics):
        yield Problem(("score", "metrics"), "are of single objects; with hidden identities remove them")
    for key in OF_SINGLE_OBJECTS:
        if key in scenario.score.model_fields_set:
            yield Problem(("score", key), "not used with identities: hidden; remove it")
