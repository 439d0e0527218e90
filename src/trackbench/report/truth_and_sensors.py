"""The truth and the sensors of a run: the findings of ``trackbench.truth.audit`` as sentences, and a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from trackbench.base.errors import counted
from trackbench.document import Cell, Column, Table
from trackbench.report.numbers import NOT_AVAILABLE, decimals, joined_names, percent_number, rounded
from trackbench.results import Result, TruthAudit, TruthSummary

#: m/s or m; what is smaller is not worth its digits.
_NEGLIGIBLE = 0.001
#: By scene; a single one has no name.
Audits = Mapping[str, TruthAudit]


def audit_sentences(truth: TruthSummary) -> list[str]:
    """What the audit of all scenes says, the conclusion first."""
    of_scenes = {scene.name: scene.audit for scene in truth.scenes} or {"": truth.audit}
    audits = {name: audit for name, audit in of_scenes.items() if audit is not None}
    if not audits:
        return ["The truth was not audited."]
    return [
        _conclusion(audits, truth.kind_of_scenes),
        *_recording(truth),
        *_velocity(audits),
        *_velocity_jumps(audits),
        *_cuts(audits),
        *_clock(audits),
    ]


def _conclusion(audits: Audits, kind: str) -> str:
    repaired = sum(audit.verdict == "repaired" for audit in audits.values())
    if repaired:
        where = "" if len(audits) == 1 else f" of {repaired} of {len(audits)} {kind}"
        return f"The truth{where} had faults, which were repaired before anything was scored."
    if all(audit.verdict == "exact" for audit in audits.values()):
        return "The truth is exact: its velocities come from the same formulas as its positions."
    return "The truth is consistent: velocity agrees with displacement, no position jumps."


def _recording(truth: TruthSummary) -> Iterator[str]:
    """What recorded traffic implies, before and after it is smoothed."""
    options = truth.model_extra or {}
    if truth.source != "recorded-traffic":
        return
    raw, used, noise = options["as_recorded"], options["as_used"], options["recorded_noise"]
    if options["format"] == "i80":
        yield "The traffic is NGSIM I-80, which comes with trackbench."
    yield (
        f"As recorded, at {options['rate_hz']:g} Hz, vehicles accelerate by up to "
        f"{_two_digits(raw['acceleration_max_mps2'])} m/s² (vehicle {raw['vehicle']}; 99 %: "
        f"{_two_digits(raw['acceleration_p99_mps2'])}); speed and displacement differ by "
        f"{_two_digits(raw['displacement_rms_mps'])} m/s (RMS), "
        f"at most {_two_digits(raw['displacement_max_mps'])}; {counted(raw['jumps'], 'position jump')}."
    )
    if options["smoothing"]:
        yield (
            f"Smoothed over {options['smoothing']['window_s']:g} s, they accelerate by up to "
            f"{_two_digits(used['acceleration_max_mps2'])} m/s². Smoothing took "
            f"{_two_digits(noise['position_m'])} m per axis and {_two_digits(noise['velocity_mps'])} m/s (RMS): the "
            f"recording's own noise, which the intervals of position and velocity errors carry."
        )


def _velocity(audits: Audits) -> Iterator[str]:
    scene, audit = max(audits.items(), key=lambda item: item[1].velocity_error_before.max_mps or 0.0)
    before, after, repaired = audit.velocity_error_before, audit.velocity_error_after, audit.repaired
    left = [item.velocity_error_after.max_mps for item in audits.values()]
    most = max((error for error in left if error is not None), default=None)
    if not before.max_mps or after.max_mps is None or most is None:
        return
    remaining = f"less than {_NEGLIGIBLE:g}" if most < _NEGLIGIBLE else f"at most {_two_digits(most)}"
    sources = {
        "course and slip angle": repaired.velocity_from_course_and_slip,
        "displacement": repaired.velocity_from_displacement,
    }
    if not any(sources.values()):
        yield f"The stated velocity differs from the displacement by {remaining} m/s."
        return
    how = joined_names([f"from {source} for {joined_names(names)}" for source, names in sources.items() if names])
    yield (
        f"The stated velocity contradicted the motion by up to {_two_digits(before.max_mps)} m/s "
        f"({_place(before.object, before.time_s, scene)}); it was computed {how}, which leaves {remaining} m/s."
    )


def _velocity_jumps(audits: Audits) -> Iterator[str]:
    jumps = {name: audit.velocity_jumps for name, audit in audits.items()}
    peak = max(item.peak_acceleration_mps2 or 0.0 for item in jumps.values())
    scene, worst = max(jumps.items(), key=lambda item: item[1].largest_mps or 0.0)
    if worst.largest_mps is None:
        if peak > 0:
            yield f"No velocity jumps: the largest acceleration is {_two_digits(peak)} m/s\N{SUPERSCRIPT TWO}."
        return
    yield (
        f"{counted(sum(item.count for item in jumps.values()), 'velocity jump')}: in one step the velocity changes by "
        f"more than a car can do, which is put at {worst.limit_mps2:g} m/s\N{SUPERSCRIPT TWO}, twice the grip of a "
        f"tyre. The largest is {_two_digits(worst.largest_mps)} m/s ({_place(worst.object, worst.time_s, scene)}), the "
        f"peak acceleration {rounded(peak, 0)} m/s\N{SUPERSCRIPT TWO}."
    )


def _cuts(audits: Audits) -> Iterator[str]:
    for scene, audit in audits.items():
        for jump in audit.jumps:
            if jump.object != "observer":
                when = f"at {rounded(jump.time_s, 2)} s{_of(scene)}"
                yield f"{jump.object} jumps by {_two_digits(jump.distance_m)} m {when}, and is left out from then on."
        if audit.ended_early is not None:
            end = rounded(audit.ended_early.time_s, 2)
            yield f"The truth{_of(scene)} ends at {end} s: {audit.ended_early.reason}."


def _clock(audits: Audits) -> Iterator[str]:
    drifts = [audit.clock_drift_s or 0.0 for audit in audits.values() if audit.repaired.own_clock]
    if drifts:
        drift = rounded(max(drifts), 3)
        yield f"The simulator's clock was off by up to {drift} s; time is counted from its steps instead."


def _place(name: str | None, time_s: float | None, scene: str) -> str:
    return f"{name} at {rounded(time_s, 2)} s{_of(scene)}"


def _of(scene: str) -> str:
    return f" of {scene}" if scene else ""


def _two_digits(value: float) -> str:
    return rounded(value, decimals([value], 2))


def sensor_table(result: Result) -> Table:
    """The sensors, and how often each detected."""
    table = result.summary.sensors
    sensors = list(table.values())
    single = Cell(NOT_AVAILABLE, reason="a single scan")
    noise = "standard deviation of each component of a measurement"
    pose = "pose on the observer: forward, to the left, counter-clockwise"
    rates = "scans with a vehicle in the field of view that gave a measurement of it"
    columns = [
        (
            Column("sensor", left=True, details="preset"),
            [Cell(name, (sensor.preset,) if sensor.preset else ()) for name, sensor in table.items()],
        ),
        (Column("kind", left=True), [Cell(sensor.kind) for sensor in sensors]),
        (Column("rate, Hz"), [Cell(f"{s.rate_hz:.4g}") if s.rate_hz is not None else single for s in sensors]),
        (Column("noise", noise, left=True), [Cell(sensor.noise_in_words) for sensor in sensors]),
        (
            Column("field of view, deg", "horizontal, centred on the boresight"),
            [Cell(f"{sensor.fov_deg:g}") for sensor in sensors],
        ),
        (
            Column("range", "beyond it nothing is detected"),
            [Cell(sensor.range_in_words) for sensor in sensors],
        ),
        (Column("mount", pose, left=True), [Cell(sensor.mount_in_words) for sensor in sensors]),
    ]
    if result.summary.truth.known:
        columns.append((Column("detections, %", rates), [Cell(percent_number(s.detection_rate)) for s in sensors]))
    if any(sensor.effects for sensor in sensors):
        differs = Column("effects", "how it differs from an ideal sensor with white noise", left=True)
        columns.insert(4, (differs, [Cell(sensor.effects_in_words) for sensor in sensors]))
    if any(sensor.latency_s[1] > 0 for sensor in sensors):
        late = Column("latency, s", "from a measurement to its arrival at the trackers")
        columns.insert(3, (late, [Cell(sensor.latency_in_words) for sensor in sensors]))
    return Table.of_columns("sensors", columns)
