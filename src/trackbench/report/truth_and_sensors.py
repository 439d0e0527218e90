"""The truth and the sensors of a run: whether the truth is consistent, the findings of its audit, and the sensors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from trackbench.base.errors import counted
from trackbench.document import Cell, Column, Table
from trackbench.report.numbers import NOT_AVAILABLE, decimals, joined_names, percent_number, rounded
from trackbench.report.tables import text_table
from trackbench.report.verdicts import TRUTH
from trackbench.results import Result, TruthAudit, TruthSummary

#: Velocity errors below this limit are not reported, m/s.
_NEGLIGIBLE = 0.001
#: Audits by scene; a single scene has an empty name.
Audits = Mapping[str, TruthAudit]


def truth_verdict(truth: TruthSummary) -> str:
    """Return in words whether the truth is consistent, was repaired, or was not audited."""
    audits = _audits(truth)
    repaired = sum(audit.verdict == "repaired" for audit in audits.values())
    if not audits:
        return TRUTH["not audited"]
    if not repaired:
        return TRUTH["consistent"]
    where = "" if len(audits) == 1 else f" of {repaired} of {len(audits)} {truth.kind_of_scenes}"
    return TRUTH["repaired"].format(where=where)


def audit_table(truth: TruthSummary) -> Table | None:
    """Return a table of the faults that the audit found in all scenes: size, place, remedy; None without faults."""
    audits = _audits(truth)
    rows = [*_recording(truth), *_velocity(audits), *_jumps(audits)]
    columns: dict[Column, Callable[[_Finding], str]] = {
        Column("of the truth", left=True): lambda row: row[0],
        Column("found"): lambda row: row[1],
        Column("where", left=True): lambda row: row[2],
        Column("what was done", left=True): lambda row: row[3],
    }
    return text_table("audit", rows, columns) if rows else None


_Finding = tuple[str, str, str, str]


def _audits(truth: TruthSummary) -> Audits:
    of_scenes = {scene.name: scene.audit for scene in truth.scenes} or {"": truth.audit}
    return {name: audit for name, audit in of_scenes.items() if audit is not None}


def _recording(truth: TruthSummary) -> Iterator[_Finding]:
    """Yield faults of recorded traffic: largest acceleration, error of stated speeds, jumps, noise smoothed away."""
    options = truth.model_extra or {}
    if truth.source != "recorded-traffic":
        return
    motion, noise = options["recorded_motion"], options["recorded_noise"]
    smoothed = f"smoothed over {options['smoothing']['window_s']:g} s" if options["smoothing"] else ""
    after = f"{smoothed}: {_two_digits(motion['acceleration_mps2'])} m/s²" if smoothed else ""
    at_most = f"{_two_digits(motion['recorded_acceleration_mps2'])} m/s²"
    apart = f"{_two_digits(motion['recorded_speed_error_mps'])} m/s (RMS)"
    yield "acceleration as recorded", at_most, f"vehicle {motion['recorded_vehicle']}", after
    yield "stated speed", f"off by {apart}", "as recorded", ""
    yield "position jumps", str(motion["recorded_jumps"]), "as recorded", ""
    if smoothed:
        rms = f"{_two_digits(noise['position_m'])} m per axis, {_two_digits(noise['velocity_mps'])} m/s (RMS)"
        yield "noise of the recording", rms, "", f"{smoothed}; intervals carry it"


def _velocity(audits: Audits) -> Iterator[_Finding]:
    if not audits:
        return
    scene, audit = max(audits.items(), key=lambda item: item[1].velocity_error_before.max_mps or 0.0)
    before, repaired = audit.velocity_error_before, audit.repaired
    after = [item.velocity_error_after.max_mps for item in audits.values()]
    largest_after = max((error for error in after if error is not None), default=None)
    largest = before.max_mps or 0.0
    if largest < _NEGLIGIBLE or audit.velocity_error_after.max_mps is None or largest_after is None:
        return
    names = repaired.velocity_from_displacement
    how = f"from displacement for {joined_names(names)}" if names else ""
    is_small = largest_after < _NEGLIGIBLE
    remaining = f"less than {_NEGLIGIBLE:g}" if is_small else f"at most {_two_digits(largest_after)}"
    remedy = f"computed {how}: {remaining} m/s left" if how else ""
    place = _place(before.object, before.time_s, scene)
    yield "stated velocity", f"off by {_two_digits(largest)} m/s", place, remedy


def _jumps(audits: Audits) -> Iterator[_Finding]:
    """Yield findings on jumps of velocity and position, and a truth that ends early."""
    jumps = {name: audit.velocity_jumps for name, audit in audits.items()}
    largest = [(worst.largest_mps, scene, worst) for scene, worst in jumps.items() if worst.largest_mps is not None]
    if largest:
        size, scene, worst = max(largest, key=lambda item: item[0])
        count = counted(sum(item.count for item in jumps.values()), "velocity jump")
        limit = f"none: a car changes by {worst.limit_mps2:g} m/s² at most"
        yield count, f"the largest {_two_digits(size)} m/s", _place(worst.object, worst.time_s, scene), limit
    for scene, audit in audits.items():
        for jump in audit.jumps:
            if jump.object != "observer":
                place = _place(jump.object, jump.time_s, scene)
                yield "position jump", f"{_two_digits(jump.distance_m)} m", place, "left out from then on"
        if audit.ended_early is not None:
            yield "early end", f"{rounded(audit.ended_early.time_s, 2)} s", scene, audit.ended_early.reason


def _place(name: str | None, time_s: float | None, scene: str) -> str:
    return f"{name} at {rounded(time_s, 2)} s" + (f" of {scene}" if scene else "")


def _two_digits(value: float) -> str:
    return rounded(value, decimals([value], 2))


def sensor_table(result: Result) -> Table:
    """Return a table of each sensor's properties, and its rate of detecting a vehicle in its field of view."""
    table = result.summary.sensors
    sensors = list(table.values())
    single = Cell(NOT_AVAILABLE, reason="a single scan")
    noise = "standard deviation of each component of a measurement"
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
