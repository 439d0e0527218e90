"""The tables of an audit of a log."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trackbench.document import Cell, Column, Table
from trackbench.report.numbers import NOT_AVAILABLE
from trackbench.subjects.log_audit.audit import LogAudit, SensorAudit
from trackbench.subjects.log_audit.blocks import BlockInterval
from trackbench.subjects.log_audit.findings import bounds_shown, shown, spelt
from trackbench.subjects.log_audit.noise import Band, ResidualNoise
from trackbench.subjects.log_audit.sensor_log import Clock

#: Two estimates are called correlated from here on.
STRONG = 0.95


def noise(audit: LogAudit) -> Table:
    """Mean error and standard deviation of all components."""
    columns = (
        Column("sensor", left=True),
        Column("component", left=True),
        Column("mean error", "measurement minus truth, as logged", details="95 % interval"),
        Column("sigma", "of what the errors that were found leave", details="95 % interval"),
        Column("stated"),
    )
    rows: list[tuple[Cell, ...]] = []
    for name, item in audit.sensors.items():
        rows += [(Cell(name if number == 0 else ""), *_component(one)) for number, one in enumerate(item.noise)]
        if not item.noise:
            few = [Cell(NOT_AVAILABLE, reason="too few measurements") for _ in range(3)]
            rows.append((Cell(name), Cell("all"), *few))
    return Table("noise", columns, tuple(rows))


def rates(audit: LogAudit) -> Table:
    """How often each sensor looks and detects."""
    columns = (
        Column("sensor", left=True),
        Column("rate, Hz"),
        Column("chances", "scans with an object in the field of view"),
        Column("detected, %", details="95 % interval"),
    )
    rows = [
        (
            Cell(name),
            _rate(item),
            Cell(str(item.detections.chances)),
            _share(item),
        )
        for name, item in audit.sensors.items()
    ]
    return Table("rates", columns, tuple(rows))


def _rate(item: SensorAudit) -> Cell:
    rate = item.detections.rate_hz
    return Cell(NOT_AVAILABLE, reason="no regular rate") if rate is None else Cell(f"{rate:.4g}")


def components(item: SensorAudit) -> Table:
    """The noise of each component, and how it changes with the range."""
    columns = (
        Column("component", left=True),
        Column("mean error", "measurement minus truth, as logged", details="95 % interval"),
        Column("sigma", "of what the errors that were found leave", details="95 % interval"),
        Column("stated"),
        Column("proportional to range to the power", "0: the same at all ranges", details="95 % interval"),
    )
    return Table(
        f"components-{item.log.name}", columns, tuple((*_component(one), _exponent(one)) for one in item.noise), "Noise"
    )


def errors(item: SensorAudit) -> Table:
    """The errors that were estimated together."""
    columns = (
        Column("error", left=True),
        Column("estimate", details="95 % interval"),
        Column("effect, sigma", "RMS of what it does to a measurement"),
        Column("most correlated with", left=True),
        Column("holds if there is no", left=True),
    )
    assert item.fit is not None
    rows = []
    for estimate in item.fit.estimates.values():
        alike = estimate.correlated
        rows.append(
            (
                Cell(spelt(estimate.name)),
                _interval(estimate.interval, estimate.unit),
                Cell(f"{estimate.effect:.2g}"),
                Cell(f"{spelt(alike[0])} ({alike[1]:+.2f})" if alike else ""),
                Cell(", ".join(spelt(name) for name in (*estimate.or_else, *estimate.same_as))),
            )
        )
    caption = f"Errors of time, mount and bias, estimated together (condition number {item.fit.condition:.3g})"
    return Table(f"errors-{item.log.name}", columns, tuple(rows), caption)


def covariance(item: SensorAudit) -> Table:
    """The suggested covariance of a measurement."""
    names = [name.replace("_", " ") for name in item.log.components]
    units = item.log.config.units
    columns = (Column("R", left=True), *(Column(f"{name}, {unit}") for name, unit in zip(names, units, strict=True)))
    rows = [
        (Cell(name), *(Cell(f"{value:.3g}") for value in row))
        for name, row in zip(names, item.covariance.tolist(), strict=True)
    ]
    return Table(
        "covariance", columns, tuple(rows), "Suggested covariance of a measurement, SI units and radians", True
    )


def detections(item: SensorAudit) -> Table:
    """How often the sensor detects, by range."""
    found = item.detections
    columns = (Column("range, m", left=True), Column("chances"), Column("detected, %", details="95 % interval"))
    rows = [(Cell("all"), Cell(str(found.chances)), _share(item)), *_bands(found.bands)]
    rate = "no regular rate" if found.rate_hz is None else f"{found.rate_hz:.4g} Hz"
    seen = f"{np.rad2deg(found.seen_half_angle):.1f}° to either side of the boresight and {found.seen_range_m:.4g} m"
    stated = f"; none beyond {seen}, which is what is counted: state fov_deg and max_range_m" if found.narrower else ""
    return Table("detections", columns, tuple(rows), f"Detections of objects in the field of view, {rate}{stated}")


def clocks(audit: LogAudit) -> Table:
    """The times of the truth and of the sensors."""
    columns = (
        Column("rows of", left=True),
        Column("rows"),
        Column("usual interval, ms"),
        Column("longest gap, s"),
        Column("out of order"),
        Column("repeated"),
        Column("outside the truth"),
    )
    rows = [
        (
            Cell(clock.name),
            Cell(str(clock.order.rows)),
            Cell(NOT_AVAILABLE, reason="a single time")
            if clock.usual_s is None
            else Cell(f"{clock.usual_s * 1e3:.4g}"),
            Cell(f"{clock.longest_gap_s:.3g}"),
            Cell(str(clock.order.backwards)),
            Cell(str(clock.order.duplicates)),
            Cell(str(clock.outside)),
        )
        for clock in audit.clocks
    ]
    return Table("clocks", columns, tuple(rows), "Times")


def _usual(clock: Clock) -> Cell:
    if clock.usual_s is None:
        return Cell(NOT_AVAILABLE, reason="a single time")
    return Cell(f"{clock.usual_s * 1e3:.4g}")


def velocities(audit: LogAudit) -> Table:
    """The velocity of the truth beside its displacement."""
    columns = (
        Column("object", left=True),
        Column("difference, m/s", "median over windows of half a second"),
        Column("displacement over velocity"),
        Column("jumps"),
    )
    rows = [
        (
            Cell(check.name),
            Cell(f"{check.difference:.2g}", tone="bad" if check.contradicts else ""),
            Cell(f"{check.scale:.3f}"),
            Cell(str(check.jumps)),
        )
        for check in audit.velocities
    ]
    return Table("velocities", columns, tuple(rows), "The truth's velocity against its displacement")


def _component(one: ResidualNoise) -> tuple[Cell, Cell, Cell, Cell]:
    return (
        Cell(one.name.replace("_", " ")),
        _interval(one.mean, one.unit),
        _interval(one.sigma, one.unit),
        Cell(shown(one.stated, one.unit)),
    )


def _exponent(one: ResidualNoise) -> Cell:
    if one.exponent is None:
        return Cell(NOT_AVAILABLE, reason="the range hardly changes in this log")
    low, high = one.exponent.bounds()
    return Cell(f"{one.exponent.value:.2f}", (f"{low:.2f} to {high:.2f}",))


def _interval(interval: BlockInterval, unit: str) -> Cell:
    if not np.isfinite(interval.sigma):
        return Cell(shown(interval.value, unit), ("no interval",))
    return Cell(shown(interval.value, unit), (bounds_shown(interval.bounds(), unit),))


def _share(item: SensorAudit) -> Cell:
    return _percents(item.detections.share)


def _percents(interval: BlockInterval) -> Cell:
    low, high = (float(np.clip(bound, 0, 1)) for bound in interval.bounds())
    return Cell(f"{100 * interval.value:.1f}", (f"{100 * low:.1f} to {100 * high:.1f}",))


def _bands(bands: tuple[Band, ...]) -> Iterator[tuple[Cell, ...]]:
    for band in bands:
        yield Cell(f"{band.from_m:.0f} to {band.to_m:.0f}"), Cell(str(band.count)), _percents(band.interval)
