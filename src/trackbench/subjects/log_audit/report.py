"""The report of an audit of a log."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.base.errors import counted
from trackbench.document import Block, Code, Document, Item, Items, Paragraph, Row, Section, Status, Table
from trackbench.subjects.log_audit import tables
from trackbench.subjects.log_audit.audit import LogAudit, corrected
from trackbench.subjects.log_audit.figures import band_figures, finding_figure
from trackbench.subjects.log_audit.findings import SensorAudit, spelt

_METHOD = (
    "The errors of time, mount and bias of a sensor are estimated together, by least squares of measurement minus "
    "truth, weighted by the noise, without outliers beyond four sigma. Intervals are 95 % and come from a block "
    "bootstrap over time, and over objects where there are eight. A finding moves a measurement by at least a tenth of "
    "a sigma, and a log without errors has one in at most 5 % of cases."
)
_ALIKE = (
    "What the motion in this log does not show cannot be estimated: drive so that objects cross, turn and brake, and "
    "so that the car that carries the sensors turns."
)


def log_audit_document(audit: LogAudit) -> Document:
    """The whole report."""
    titles = "; ".join(finding.title for finding in audit.findings)
    blocks: list[Block] = [
        Paragraph(f"{titles}." if titles else "Nothing is found wrong with this log.", strong=True),
        *_verdict(audit),
        *_findings(audit),
        *(Section(f"Sensor {name}", tuple(_sensor(item))) for name, item in audit.sensors.items()),
        *(Section("Unlabelled detections", (table,)) for table in _unlabelled(audit)),
        Section("Truth and clocks", (tables.clocks_table(audit), tables.velocities_table(audit))),
        Section("The scenario with the findings put in", (Code(corrected(audit.scenario, audit.findings), "yaml"),)),
    ]
    facts = (
        f"{audit.duration_s:.1f} s",
        counted(len(audit.sensors), "recorded sensor"),
        counted(sum(len(item.log.log.time) for item in audit.sensors.values()), "measurement"),
    )
    return Document("audit", f"Audit of {audit.name}", tuple(blocks), facts=facts)


def log_audit_summary(audit: LogAudit) -> Document:
    """What a terminal shows: the verdict, the findings, and the noise of the sensors."""
    items = tuple(Item(f"{finding.evidence} {finding.fix}", finding.title) for finding in audit.findings)
    blocks: list[Block] = [*_verdict(audit)]
    if items:
        blocks.append(Section("Findings", (Items(items, numbered=True),)))
    detections = (tables.rates_table(audit), *_unlabelled(audit))
    blocks += [Section("Noise", (tables.noise_table(audit),)), Section("Detections", detections)]
    hidden = [Item(text, name) for name, item in audit.sensors.items() for text in _hidden(item)]
    if hidden:
        blocks.append(Section("What this log cannot tell", (Items(tuple(hidden)),)))
    return Document("audit", audit.name, tuple(blocks))


def _unlabelled(audit: LogAudit) -> list[Table]:
    return [tables.unlabelled_table(audit)] if any(item.unlabelled for item in audit.sensors.values()) else []


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


def _findings(audit: LogAudit) -> Iterator[Block]:
    """Each with its figure."""
    for number, finding in enumerate(audit.findings, 1):
        figure = finding_figure(audit, finding, number)
        items = Items((Item(finding.evidence, "Evidence"), Item(finding.fix, "Fix")))
        yield Section(f"{number}. {finding.title}", (Row((figure, items)) if figure else items,))
    if audit.findings:
        yield Section("How it is estimated", (Paragraph(_METHOD),), folded=True)


def _sensor(item: SensorAudit) -> Iterator[Block]:
    rows = len(item.log.log.time)
    if item.fit is None:
        yield Paragraph(f"{counted(rows, 'measurement')}: too few to estimate anything.")
        yield tables.detections_table(item)
        return
    outliers = int(item.fit.outlier.sum())
    yield Paragraph(f"{counted(rows, 'measurement')}, {counted(outliers, 'outlier')} beyond four sigma.")
    yield Row(tuple(band_figures(item)))
    yield tables.errors_table(item)
    hidden = tuple(_hidden(item))
    if hidden:
        yield Items(tuple(Item(text) for text in hidden))
        yield Paragraph(_ALIKE)
    yield tables.components_table(item)
    yield tables.covariance_table(item)
    yield tables.detections_table(item)


def _hidden(item: SensorAudit) -> Iterator[str]:
    """What the log does not show of a sensor."""
    if item.fit is None:
        yield f"{counted(len(item.log.log.time), 'measurement')} are too few to estimate anything."
        return
    for name, others in item.fit.unidentified.items():
        if others:
            named = " and ".join(spelt(other) for other in others)
            yield f"{spelt(name)}: not to be told from {named}, so taken as zero."
        else:
            yield f"{spelt(name)}: it changes none of these measurements."
    for estimate in item.fit.estimates.values():
        if estimate.correlated is not None and abs(estimate.correlated[1]) > tables.STRONG:
            other, correlation = estimate.correlated
            name = spelt(estimate.name)
            yield f"{name}: correlated with {spelt(other)} by {correlation:+.3f}, so its interval is wide."
