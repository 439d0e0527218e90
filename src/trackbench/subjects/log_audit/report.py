"""The report of a log's audit, and its tables."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trackbench.base.errors import counted
from trackbench.document import Block, Cell, Code, Column, Document, Item, Items, Paragraph, Row, Section, Status, Table
from trackbench.metrics.blocks import BlockInterval
from trackbench.report.figures.map import map_of_scene
from trackbench.report.numbers import NOT_AVAILABLE
from trackbench.subjects.log_audit.audit import LogAudit, corrected, yaml_to_paste
from trackbench.subjects.log_audit.figures import band_figures
from trackbench.subjects.log_audit.findings import SensorAudit, bounds_text, error_words, quantity_text
from trackbench.subjects.log_audit.noise import GATE_M
from trackbench.subjects.log_audit.replay import replay_of_log

_METHOD = (
    "The errors of time, mount and bias of a sensor are estimated together, by least squares of measurement minus "
    "truth, weighted by the noise, without outliers beyond four sigma. Intervals are 95 % and come from a block "
    "bootstrap over time, and over objects where there are eight. A finding moves a measurement by at least a tenth of "
    "a sigma, and a log without errors has one in at most 5 % of cases."
)


def log_audit_document(audit: LogAudit) -> Document:
    """Return the report of an audit: its summary, a replay, and what was found on each sensor and clock."""
    blocks: list[Block] = [
        *log_audit_summary(audit).blocks,
        *_replay(audit),
        *(Section(f"Sensor {name}", tuple(_sensor(item))) for name, item in audit.sensors.items()),
        Section("Clocks", (clocks_table(audit),)),
        Section("How it is estimated", (Paragraph(_METHOD),), folded=True),
    ]
    if not audit.unexplained:
        text = corrected(audit.scenario, audit.findings)
        blocks.append(Section("The scenario with the findings put in", (Code(text, "yaml"),)))
    facts = (
        f"{audit.duration_s:.1f} s",
        counted(len(audit.sensors), "recorded sensor"),
        counted(sum(len(item.log.log.time) for item in audit.sensors.values()), "measurement"),
    )
    return Document("audit", f"Audit of {audit.name}", tuple(blocks), facts=facts)


def _replay(audit: LogAudit) -> Iterator[Section]:
    if scene := replay_of_log(item.log for item in audit.sensors.values()):
        caption = "Measured positions in the sensor's colour, with the unit that fits and before any other finding."
        yield Section("Around the largest error", (map_of_scene(scene, caption),))


def log_audit_summary(audit: LogAudit) -> Document:
    """Return the summary for the terminal: the verdict, the findings, and the noise of the sensors."""
    items = tuple(Item(f"{finding.evidence} {finding.fix}", finding.title) for finding in audit.findings)
    blocks: list[Block] = [*_verdict(audit)]
    if items:
        blocks.append(Section("Findings", (Items(items),)))
        if (block := yaml_to_paste(audit.scenario, audit.findings)) and not audit.unexplained:
            blocks.append(Section("To paste into the scenario", (Code(block, "yaml"),)))
    detections = [rates_table(audit)]
    if any(item.unlabelled for item in audit.sensors.values()):
        detections.append(unlabelled_table(audit))
    blocks += [Section("Noise", (noise_table(audit),)), Section("Detections", tuple(detections))]
    hidden = [Item(text, name) for name, item in audit.sensors.items() for text in _hidden_errors(item)]
    if hidden:
        blocks.append(Section("What this log cannot tell", (Items(tuple(hidden)),)))
    return Document("audit", audit.name, tuple(blocks))


def _verdict(audit: LogAudit) -> Iterator[Block]:
    count = len(audit.findings)
    yield Status(counted(count, "finding"), "bad") if count else Status("no finding", "good")
    for name, item in audit.sensors.items():
        if item.square_before is None or item.square_after is None:
            continue
        after = f", {item.square_after:.3g} with the findings put in" if audit.findings else ""
        yield Paragraph(
            f"{name}: mean square of measurement minus truth over the stated sigmas {item.square_before:.3g}{after}; 1 "
            "is right."
        )
    for reason in audit.unexplained:
        advice = "put the log right first. Check frames, the sign of the observer's yaw, and the names of objects."
        yield Paragraph(f"{reason} No scenario.yaml is written: {advice}", strong=True)


def _sensor(item: SensorAudit) -> Iterator[Block]:
    rows = len(item.log.log.time)
    if item.fit is None:
        yield Paragraph(f"{counted(rows, 'measurement')}: too few to estimate anything.")
        return
    outliers = int(item.fit.outlier.sum())
    yield Paragraph(f"{counted(rows, 'measurement')}, {counted(outliers, 'outlier')} beyond four sigma.")
    yield Row(tuple(band_figures(item)))
    yield errors_table(item)


def _hidden_errors(item: SensorAudit) -> Iterator[str]:
    """Yield sentences on the errors of a sensor that the log cannot show."""
    if item.fit is None:
        yield f"{counted(len(item.log.log.time), 'measurement')} are too few to estimate anything."
        return
    for name, others in item.fit.unidentified.items():
        if others:
            rivals = " and ".join(error_words(other) for other in others)
            yield f"{error_words(name)}: cannot be told from {rivals}, so taken as zero."
        else:
            yield f"{error_words(name)}: it changes none of these measurements."


_INTERVAL = "95 % interval"


def noise_table(audit: LogAudit) -> Table:
    """Return the table of standard deviations, estimated and stated, of all components."""
    rows = []
    for name, item in audit.sensors.items():
        if not item.noise:
            rows.append([Cell(name), Cell("all"), *[Cell(NOT_AVAILABLE, reason="too few measurements")] * 2])
        for number, component in enumerate(item.noise):
            stated = Cell(quantity_text(component.stated, component.unit))
            words, sigma = Cell(component.name.replace("_", " ")), _interval(component.sigma, component.unit)
            rows.append([Cell("" if number else name), words, sigma, stated])
    columns = (
        Column("sensor", left=True),
        Column("component", left=True),
        Column("sigma", "of the noise that remains after the errors found", details=_INTERVAL),
        Column("stated"),
    )
    return Table("noise", columns, tuple(map(tuple, rows)))


def rates_table(audit: LogAudit) -> Table:
    """Return the table of each sensor's scan rate and share of detections."""
    detections = [item.detections for item in audit.sensors.values()]
    rates = [
        Cell(NOT_AVAILABLE, reason="no regular rate") if item.rate_hz is None else Cell(f"{item.rate_hz:.4g}")
        for item in detections
    ]
    chances = Column("chances", "scans with an object in the field of view")
    columns = [
        (Column("sensor", left=True), [Cell(name) for name in audit.sensors]),
        (Column("rate, Hz"), rates),
        (chances, [Cell(str(item.chances)) for item in detections]),
        (Column("detected, %", details=_INTERVAL), [_percents(item.share) for item in detections]),
    ]
    return Table.of_columns("rates", columns)


def unlabelled_table(audit: LogAudit) -> Table:
    """Return the table of the sensors whose detections have no labels."""
    rows: list[list[Cell]] = []
    gaps = {clock.name: f"{clock.longest_gap_s:.3g}" for clock in audit.clocks}
    for name, sensor in audit.sensors.items():
        if (item := sensor.unlabelled) is None:
            continue
        shares = [_number(item.per_scan), _percents(item.near), _number(item.others)]
        rows.append([Cell(name), Cell(str(item.scans)), Cell(gaps[name]), *shares, Cell(f"{item.stated_others:.3g}")])
    columns = (
        Column("sensor", left=True),
        Column("scans"),
        Column("gap, s", "the longest between two scans"),
        Column("a scan", "detections", details=_INTERVAL),
        Column("near a box, %", f"the nearest within {GATE_M:g} m", details=_INTERVAL),
        Column("others a scan", "near no box: false alarms, and objects without one", details=_INTERVAL),
        Column("stated"),
    )
    return Table("unlabelled", columns, tuple(map(tuple, rows)))


def _number(interval: BlockInterval) -> Cell:
    low, high = interval.bounds()
    return Cell(f"{interval.value:.3g}", (f"{max(low, 0.0):.3g} to {high:.3g}",))


def errors_table(item: SensorAudit) -> Table:
    """Return the table of the errors of a sensor's joint fit."""
    assert item.fit is not None
    estimates = item.fit.estimates.values()
    effect = Column("effect, sigma", "RMS change of a measurement")
    columns = [
        (Column("error", left=True), [Cell(error_words(estimate.name)) for estimate in estimates]),
        (
            Column("estimate", details=_INTERVAL),
            [_interval(estimate.interval, estimate.unit) for estimate in estimates],
        ),
        (effect, [Cell(f"{estimate.effect:.2g}") for estimate in estimates]),
    ]
    caption = "Errors of time, mount and bias, estimated together"
    return Table.of_columns(f"errors-{item.log.name}", columns, caption)


def clocks_table(audit: LogAudit) -> Table:
    """Return the table of the truth's and the sensors' times."""
    single = Cell(NOT_AVAILABLE, reason="a single time")
    usual = [single if clock.usual_s is None else Cell(f"{clock.usual_s * 1e3:.4g}") for clock in audit.clocks]
    columns = [
        (Column("rows of", left=True), [Cell(clock.name) for clock in audit.clocks]),
        (Column("rows"), [Cell(str(clock.order.rows)) for clock in audit.clocks]),
        (Column("usual interval, ms"), usual),
        (Column("longest gap, s"), [Cell(f"{clock.longest_gap_s:.3g}") for clock in audit.clocks]),
    ]
    return Table.of_columns("clocks", columns, "Times")


def _interval(interval: BlockInterval, unit: str) -> Cell:
    details = bounds_text(interval.bounds(), unit) if np.isfinite(interval.sigma) else "no interval"
    return Cell(quantity_text(interval.value, unit), (details,))


def _percents(interval: BlockInterval) -> Cell:
    low, high = (float(np.clip(bound, 0, 1)) for bound in interval.bounds())
    return Cell(f"{100 * interval.value:.1f}", (f"{100 * low:.1f} to {100 * high:.1f}",))
