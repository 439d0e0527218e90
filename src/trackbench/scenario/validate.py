"""Checks between the sections of a scenario, after each section has been checked by itself."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from trackbench.base.config import KeyPath, Problem
from trackbench.base.errors import counted, nearest_choices
from trackbench.base.subjects import collected
from trackbench.metrics import Field
from trackbench.metrics.registry import by_path
from trackbench.models.sensors import SENSOR_MODELS, sensor_type
from trackbench.models.sensors.presets import presets
from trackbench.scenario.keys import Expectation, ScenarioKeys
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.trackers.published import TRACKERS
from trackbench.truth import SteppedTruth
from trackbench.truth.config.traffic import TracksConfig, files_in
from trackbench.truth.sources import RecordingTruth, ScriptedTruth

#: Times that differ by less are equal, s: a difference of times has rounding errors.
ROUNDING = 1e-9
#: Keys of a sensor that are only used with hidden identities.
SENSOR_HIDDEN = ("clutter", "resolution", "states")
#: Keys of the scores that are only used with hidden identities, and with known ones.
SCORE_HIDDEN = ("cutoff_m", "switch_costs_s")
SCORE_KNOWN = ("settle_s", "each", "divergence_m", "lost_after_s", "min_coverage", "reference")
#: Value of ``sensing.identities`` that gives what a metric needs.
IDENTITIES = {"labels": "known", "tracks": "hidden"}
#: Keys of a sensor that only simulated measurements obey; recorded ones are taken as they are.
SYNTHETIC = (
    "rate_hz",
    "phase_s",
    "detection_probability",
    "detection",
    "occlusion",
    "clutter",
    "resolution",
    "effects",
)


def validate(scenario: ScenarioKeys) -> Iterator[Problem]:
    """Yield every contradiction between the sections of a scenario."""
    if isinstance(scenario.truth, RecordingTruth):
        yield from _recording(scenario, scenario.truth)
    if isinstance(scenario.truth, SteppedTruth):
        yield from _times(scenario, scenario.truth)
    fed = scenario.truth.feeds(scenario.sensor_kinds)
    for name, sensor in scenario.sensors.items():
        if sensor.rate_hz is None and name not in fed:
            yield Problem(("sensors", name, "rate_hz"), "missing; measurements per second, Hz")
    is_hidden = scenario.sensing.identities == "hidden"
    other = "known" if is_hidden else "hidden"
    for path in _of_other_identities(scenario, is_hidden):
        yield Problem(path, f"only used with sensing: {{identities: {other}}}; write that, or remove this")
    yield from _single_object_trackers(scenario) if is_hidden else ()
    yield from _external_tracks(scenario)
    yield from _scored_point(scenario)
    yield from collected("checks", scenario)
    for name, tracker in scenario.trackers.items():
        for problem in _tracker(scenario, tracker):
            yield Problem(("trackers", name, *problem.at), problem.message)
    for key, limit in (("scene", len(scenario.truth.scenes())), ("run", scenario.monte_carlo.runs)):
        if getattr(scenario.recording, key) >= limit:
            yield Problem(("recording", key), f"must be from 0 to {limit - 1}, of {counted(limit, key)}")
    if scenario.score.baseline is not None:
        yield from _unknown(("score", "baseline"), "tracker", scenario.score.baseline, scenario.trackers)
    metrics = by_path(scenario.sensors, scenario.own_metrics, scenario.properties) if scenario.expect else {}
    for index, expectation in enumerate(scenario.expect):
        for problem in _expectation(scenario, expectation, metrics):
            yield Problem(("expect", index, *problem.at), problem.message)


def same_every_run(scenario: ScenarioKeys) -> bool:
    """Return whether all runs are equal, because no motion, start of a track or measurement is random."""
    trackers = scenario.trackers.values()
    from_truth = any(isinstance(item, FilterConfig) and item.initial.source == "truth" for item in trackers)
    all_fed = len(scenario.truth.feeds(scenario.sensor_kinds)) == len(scenario.sensors)
    return all_fed and not scenario.truth.random and not from_truth


def _unknown(path: KeyPath, kind: str, name: str, names: Iterable[str]) -> Iterator[Problem]:
    if name not in [*names]:
        yield Problem(path, f"the scenario has no {kind} {name!r}; {nearest_choices(name, names)}")


def _times(scenario: ScenarioKeys, truth: SteppedTruth) -> Iterator[Problem]:
    settle = scenario.score.settle_s
    if scenario.sensing.identities == "known" and settle >= truth.duration_s:
        message = f"is {settle:g} and must be shorter than truth.duration_s, which is {truth.duration_s:g}"
        yield Problem(("score", "settle_s"), message)
    for name, sensor in scenario.sensors.items():
        if sensor.rate_hz is None:
            continue
        if not _is_whole(truth.rate_hz / sensor.rate_hz):
            rates = [rate for rate in range(1, truth.rate_hz + 1) if truth.rate_hz % rate == 0]
            below = sum(rate < sensor.rate_hz for rate in rates)
            use = " or ".join(map(str, rates[max(below - 1, 0) : below + 1]))
            message = f"{sensor.rate_hz:g} Hz does not divide truth.rate_hz, which is {truth.rate_hz}; use {use}"
            yield Problem(("sensors", name, "rate_hz"), message)
            continue
        step_s, period_s = 1 / truth.rate_hz, 1 / sensor.rate_hz
        most = min(round(period_s / step_s) - 1, math.floor(truth.duration_s / step_s + ROUNDING))
        near_s = min(round(sensor.phase_s / step_s), most) * step_s
        if abs(sensor.phase_s - near_s) > 1e-6 * step_s:
            limits = f"below the sensor's period, which is {period_s:g} s, and not after the end"
            message = f"must be a multiple of the truth step, which is {step_s:g} s, {limits}; use {near_s:g}"
            yield Problem(("sensors", name, "phase_s"), message)


def _is_whole(value: float) -> bool:
    return math.isfinite(value) and abs(value - round(value)) < 1e-6


def _of_other_identities(scenario: ScenarioKeys, is_hidden: bool) -> Iterator[KeyPath]:
    """Yield the path of each key that is only used with the other value of ``sensing.identities``."""
    if any(("labels" if is_hidden else "tracks") in metric.needs for metric in scenario.score.metrics):
        yield "score", "metrics"
    score_keys = SCORE_KNOWN if is_hidden else SCORE_HIDDEN
    yield from (("score", key) for key in score_keys if key in scenario.score.model_fields_set)
    if is_hidden:
        return
    for name, sensor in scenario.sensors.items():
        yield from (("sensors", name, key) for key in SENSOR_HIDDEN if key in sensor.model_fields_set)
    for name, tracker in scenario.trackers.items():
        if isinstance(tracker, FilterConfig) and tracker.associate is not None:
            yield "trackers", name, "associate"
    truth = scenario.truth
    for name, body in truth.objects.items() if isinstance(truth, ScriptedTruth) else ():
        if not body.target:
            yield "truth", "objects", name, "target"
    if isinstance(truth, RecordingTruth):
        yield from (("truth", "reference", key) for key in sorted(truth.reference.model_fields_set))
        if truth.stretches is not None:
            yield "truth", "stretches"


def _single_object_trackers(scenario: ScenarioKeys) -> Iterator[Problem]:
    """Yield a problem for each tracker that follows one object, in a scenario with hidden identities."""
    alone = "follows one object, but hidden identities need a tracker of several"
    for name, tracker in scenario.trackers.items():
        if isinstance(tracker, FilterConfig) and tracker.associate is None:
            yield Problem(("trackers", name, "filter"), f"{alone}; add associate: {{method: gnn}}")
        elif isinstance(tracker, PluginConfig) and TRACKERS.home_of(tracker.reference).startswith("trackbench."):
            yield Problem(("trackers", name, "use"), f"{tracker.use} {alone}; use a filter with associate")


def _external_tracks(scenario: ScenarioKeys) -> Iterator[Problem]:
    """Yield problems of tracks from files, and of other trackers in a scenario without sensors."""
    for name, tracker in scenario.trackers.items():
        use = ("trackers", name, "use")
        if not isinstance(tracker, TracksConfig):
            if not scenario.sensors:
                yield Problem(("sensors",), f"missing: {name} reads them; only tracks made elsewhere need none")
                return
        elif scenario.sensing.identities == "known" and not scenario.sensors:
            message = "without sensors tracks are scored without identities; write sensing: {identities: hidden}"
            yield Problem(use, message)
        elif isinstance(scenario.truth, RecordingTruth) and scenario.truth.without_truth:
            yield Problem(use, "there is no truth to score its tracks against")
        elif len(files := files_in(tracker.path)) > 1 and len(files) != (scenes := len(scenario.truth.scenes())):
            message = f"{len(files)} files for {counted(scenes, 'scene')}; name one for each, in the same order"
            yield Problem(("trackers", name, "path"), message)


def _scored_point(scenario: ScenarioKeys) -> Iterator[Problem]:
    """Yield a problem if the scored point is not the centre and the size of the objects is not known."""
    truth = scenario.truth
    if scenario.score.point == "centre" or not isinstance(truth, RecordingTruth):
        return
    if truth.without_truth:
        yield Problem(("score", "point"), "there is no truth, of which a point could be scored")
    else:
        sizes = [name for name in ("length_m", "width_m") if name not in truth.model_fields_set]
        missing = [name for name in sizes if getattr(truth.columns, name.removesuffix("_m"), None) is None]
        if missing:
            keys = " and ".join(f"truth.{name}" for name in missing)
            message = f"the size of the objects is not known: write {keys}, or name their columns"
            yield Problem(("score", "point"), message)


def _tracker(scenario: ScenarioKeys, tracker: FilterConfig | PluginConfig | TracksConfig) -> Iterator[Problem]:
    """Yield contradictions between a tracker and the sensors."""
    lists: dict[KeyPath, Iterable[str]] = {("sensors",): tracker.sensors or []}
    if isinstance(tracker, FilterConfig):
        lists["initial", "sensors"] = tracker.initial.sensors or []
    for at, names in lists.items():
        for index, sensor in enumerate(names):
            yield from _unknown((*at, index), "sensor", sensor, scenario.sensors)
    if isinstance(tracker, FilterConfig):
        yield from _assumed(scenario, tracker)
        yield from _start(scenario, tracker)
        yield from _lag(scenario, tracker)
        for sensor in tracker.associate.detection_probability if tracker.associate is not None else ():
            yield from _unknown(("associate", "detection_probability", sensor), "sensor", sensor, scenario.sensors)


def _assumed(scenario: ScenarioKeys, tracker: FilterConfig) -> Iterator[Problem]:
    """Yield a problem for each sensor model, noise or effect that a tracker assumes and the sensors contradict."""
    for key in ("assume", "sensor_models", "measurement_noise"):
        for sensor, assumed in getattr(tracker, key).items():
            if sensor not in scenario.sensors:
                yield from _unknown((key, sensor), "sensor", sensor, scenario.sensors)
                continue
            if tracker.sensors_used is not None and sensor not in tracker.sensors_used:
                reads = ", ".join(tracker.sensors_used)
                yield Problem((key, sensor), f"the tracker does not read {sensor}; it reads {reads}")
                continue
            kind = tracker.sensor_models.get(sensor, scenario.sensors[sensor].type)
            if key == "assume":
                for problem in assumed.problems_on(kind, tracker.filter == "kf"):
                    yield Problem((key, sensor, *problem.at), problem.message)
            elif key == "sensor_models":
                true, other = (SENSOR_MODELS[each].components for each in (scenario.sensors[sensor].type, assumed))
                if len(true) != len(other):
                    what = f"the {', '.join(other)} of a {kind}"
                    yield Problem((key, sensor), f"{sensor} reads {', '.join(true)}, which cannot be taken for {what}")
            else:
                options = list(dict.fromkeys(SENSOR_MODELS[kind].sigma_options))
                for name in (name for name in assumed if name not in options):
                    hint = nearest_choices(name, options)
                    yield Problem((key, sensor, name), f"a {kind} has no such standard deviation; {hint}")


def _start(scenario: ScenarioKeys, tracker: FilterConfig) -> Iterator[Problem]:
    """Yield a problem for each quantity that a tracker's filter or start needs and no sensor measures."""
    initial = tracker.initial
    read = tracker.sensors or list(scenario.sensors)
    starting = initial.sensors or read
    if not starting or not {*read, *starting} <= {*scenario.sensors}:
        return
    kinds = {name: tracker.sensor_models.get(name, sensor.type) for name, sensor in scenario.sensors.items()}
    placed = {sensor for sensor, kind in kinds.items() if SENSOR_MODELS[kind].measures_position()}
    sensors = " and ".join(f"{sensor} ({kinds[sensor]})" for sensor in starting)
    for sensor in read:
        if tracker.filter == "kf" and sensor not in placed:
            message = f"kf converts measurements to positions, and {sensor} ({kinds[sensor]}) measures none; use ekf"
            yield Problem(("filter",), message)
    if initial.source != "truth" and not placed & {*starting}:
        remedy = "start from a sensor that does" + (", or from: truth" if tracker.associate is None else "")
        yield Problem(("initial",), f"no track can start: none of {sensors} measures a position; {remedy}")
    if initial.velocity == "zero" or "velocity" not in initial.model_fields_set or tracker.associate is not None:
        return
    if not any(SENSOR_MODELS[kinds[sensor]].measures_velocity() for sensor in starting):
        message = f"{sensors} measures no range rate; remove it, or start from a sensor that does"
        yield Problem(("initial", "velocity"), message)


def _lag(scenario: ScenarioKeys, tracker: FilterConfig) -> Iterator[Problem]:
    if tracker.smoother is not None or tracker.late != "replay":
        return
    read = scenario.sensors if tracker.sensors_used is None else tracker.sensors_used
    latency = {sensor: scenario.sensors[sensor].latency for sensor in read if sensor in scenario.sensors}
    least = min((low for low, _ in latency.values()), default=0.0)
    for sensor, (_, most) in latency.items():
        # The largest time by which a later scan, of any sensor, may arrive before a scan of this sensor.
        behind = most - least
        if behind > tracker.lag_s + ROUNDING:
            dropped = f"scans of {sensor} may be {behind:g} s older than the state and would be dropped"
            yield Problem(("lag_s",), f"replay goes back {tracker.lag_s:g} s, but {dropped}; use {behind:g} or more")
            return


def _expectation(scenario: ScenarioKeys, expectation: Expectation, metrics: Mapping[str, Field]) -> Iterator[Problem]:
    yield from _unknown(("tracker",), "tracker", expectation.tracker, scenario.trackers)
    metric = metrics.get(expectation.metric)
    if metric is None:
        other = by_path(scenario.sensors, scenario.own_metrics).get(expectation.metric)
        kinds = [IDENTITIES[kind] for kind in IDENTITIES if other is not None and kind in other.needs]
        hint = nearest_choices(expectation.metric, metrics)
        if kinds:
            hint = f"it is one of {kinds[0]} identities, and sensing.identities is {scenario.sensing.identities}"
        yield Problem(("metric",), f"there is no metric {expectation.metric!r}; {hint}")
        return
    tracker = scenario.trackers.get(expectation.tracker)
    sensor = expectation.metric.split(".")[1] if metric.per_sensor else None
    read = tracker.sensors if tracker is not None else None
    if read is not None and sensor is not None and sensor not in read:
        message = f"tracker {expectation.tracker} does not read {sensor}; it reads {', '.join(read)}"
        yield Problem(("metric",), message)
    yield from _limit(scenario, expectation, metric, metrics)


def _limit(
    scenario: ScenarioKeys, expectation: Expectation, metric: Field, metrics: Mapping[str, Field]
) -> Iterator[Problem]:
    path, word, rival = expectation.metric, expectation.equals, expectation.better_than
    for operator in ("below", "above"):
        if metric.words and getattr(expectation, operator) is not None:
            yield Problem((operator,), f"{path} is a word, not a number; use is: {' | '.join(metric.words)}")
    if word is not None and not metric.words:
        yield Problem(("is",), f"{path} is a number, not a word; use below or above")
    elif word is not None and word not in metric.words:
        yield Problem(("is",), f"{path} is never {word!r}; {nearest_choices(word, metric.words)}")
    if rival is None:
        return
    yield from _unknown(("better_than",), "other tracker", rival, {*scenario.trackers} - {expectation.tracker})
    if not metric.compared:
        compared = ", ".join(name for name, entry in metrics.items() if entry.compared)
        yield Problem(("better_than",), f"trackers are not compared by {path}; only by {compared}")


def _recording(scenario: ScenarioKeys, truth: RecordingTruth) -> Iterator[Problem]:
    """Yield contradictions between a recording and the other sections."""
    kinds = scenario.sensor_kinds
    fed = truth.feeds(kinds)
    yield from _columns(truth, kinds)
    yield from _recorded_identities(scenario, truth)
    for name in scenario.sensors if truth.without_truth else ():
        if name not in fed:
            yield Problem(("truth", "readings"), f"{name} is missing: nothing can be synthesised without a truth")
    first: dict[str, str] = {}
    for name, kind in fed.items() if truth.format == "udacity" else ():
        other = first.setdefault(sensor_type(kind), name)
        if other != name:
            yield Problem(("sensors", name), f"the recording has one {kind}, and it feeds {other}; remove one of them")
    # With hidden identities the key occlusion decides which objects of a truth are due.
    is_due = scenario.sensing.identities == "hidden" and not truth.without_truth
    for name in fed:
        sensor = scenario.sensors[name]
        of_preset = presets()[sensor.preset].values if sensor.preset is not None else {}
        for key in SYNTHETIC:
            if key in sensor.model_fields_set and key not in of_preset and not (key == "occlusion" and is_due):
                message = f"the measurements of {name} are recorded and taken as they are; remove"
                yield Problem(("sensors", name, key), message)
    runs = scenario.monte_carlo.runs
    if runs > 1 and same_every_run(scenario):
        message = f"must be 1, not {runs}: all measurements are recorded, so every run would be the same"
        yield Problem(("monte_carlo", "runs"), message)


def _columns(truth: RecordingTruth, kinds: Mapping[str, str]) -> Iterator[Problem]:
    for name, columns in truth.measurements.items():
        at = ("truth", "readings", name)
        if name not in kinds:
            yield from _unknown(at, "sensor", name, kinds)
            continue
        model = SENSOR_MODELS[kinds[name]]
        needed = columns.of_sensor(model.components)
        for component in needed:
            if component not in columns.components:
                yield Problem((*at, component), f"missing: a {kinds[name]} reads {', '.join(needed)}")
        for component in (*columns.components, *columns.bias):
            if component not in needed:
                yield Problem((*at, component), f"sensor {name} is a {kinds[name]}, which reads {', '.join(needed)}")
        if columns.copies_within_m is not None and not model.measures_position():
            yield Problem((*at, "copies_within_m"), f"a {kinds[name]} measures no position to compare; remove it")


def _recorded_identities(scenario: ScenarioKeys, truth: RecordingTruth) -> Iterator[Problem]:
    """Yield contradictions between a recording and ``sensing.identities``."""
    is_known = scenario.sensing.identities == "known"
    if truth.stretches is not None and scenario.monte_carlo.runs > 1:
        message = "only used with monte_carlo: {runs: 1}, since several runs already give intervals; remove"
        yield Problem(("truth", "stretches"), message)
    if is_known and truth.without_truth:
        message = "missing: the file with the truth; without one, write sensing: {identities: hidden}"
        yield Problem(("truth", "path"), message)
    if is_known and truth.columns is not None and truth.columns.without_velocity:
        yield Problem(("truth", "columns"), "the velocity is missing: write vx and vy, or speed and course")
    source = truth if is_known else truth.with_hidden_identities()
    unlabelled = [name for name in truth.measurements if source.unlabelled(name)]
    for name, columns in truth.measurements.items():
        for key in ("slot", "copies_within_m") if name not in unlabelled else ():
            if getattr(columns, key) is not None:
                message = "only used with unlabelled detections, and these have the names of their objects; remove"
                yield Problem(("truth", "readings", name, key), message)
    for name, tracker in scenario.trackers.items() if unlabelled and not is_known else ():
        if isinstance(tracker, FilterConfig) and tracker.associate is not None and tracker.associate.method == "oracle":
            message = f"oracle needs the object of each detection, which is not recorded for {', '.join(unlabelled)}"
            yield Problem(("trackers", name, "associate", "method"), message)
