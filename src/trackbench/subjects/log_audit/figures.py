"""The figures of an audit of a log: one for each finding, and noise and detections by range."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED, INK, MUTED, TIME_LABEL, time_axis
from trackbench.document.palette import TRACKER_COLOURS
from trackbench.subjects.log_audit.audit import LogAudit
from trackbench.subjects.log_audit.findings import LogFinding, SensorAudit, spelt
from trackbench.subjects.log_audit.joint_fit import JointFit
from trackbench.subjects.log_audit.noise import Band, ResidualNoise

_FOUND = TRACKER_COLOURS[4]
_HEIGHT = 230.0
#: Points of a cloud, and bins of its means.
_POINTS, _BINS = 1500, 20
_UNITS: dict[str, tuple[float, str]] = {"rad": (180 / np.pi, "degree"), "s": (1e3, "ms")}


def finding_figure(audit: LogAudit, finding: LogFinding, number: int) -> Figure | None:
    """The figure that shows a finding."""
    name = f"finding-{number}"
    if finding.kind in ("truth_velocity", "truth_jumps"):
        check = next((check for check in audit.velocities if check.name == finding.component), None)
        if check is None:
            return None
        title = f"{check.name}: speed of the truth"
        caption = (
            "The speed that the truth states, and that of its displacement, over windows of half a second. They should "
            "be the same."
        )
        lines = {"stated": check.stated, "displacement": check.moved}
        return _over_time(name, title, caption, "speed, m/s", check.time, lines)
    if finding.sensor is None or finding.kind in ("clock", "duplicates", "silence", "outside"):
        clock = next((clock for clock in audit.clocks if clock.name == (finding.sensor or "truth")), None)
        if clock is None or len(clock.time) < 2:
            return None
        title = f"{clock.name}: intervals between its times"
        caption = "Time to the next row, after sorting. A gap stands out; times that are repeated are left out."
        lines = {"interval": 1e3 * np.diff(clock.time)}
        return _over_time(name, title, caption, "interval, ms", clock.time[:-1], lines)
    item = audit.sensors[finding.sensor]
    if finding.kind in ("unit", "sign"):
        return _expected(item, finding, name)
    if finding.kind in ("sigma", "sigma_by_range"):
        return next((_sigma(item, noise, name) for noise in item.noise if noise.name == finding.component), None)
    if item.fit is None:
        return None
    if finding.kind == "outliers":
        return _outliers(item, item.fit, name)
    if finding.kind == "clock_drift":
        return _drift(item, item.fit, name)
    return _partial(item, item.fit, finding.kind, name)


def band_figures(item: SensorAudit) -> Iterator[Figure]:
    """Noise and detections by range."""
    for noise in item.noise:
        yield _sigma(item, noise, f"sigma-{item.log.name}-{noise.name}".replace("_", "-"))
    if item.detections.bands:
        texts = (
            f"{item.log.name}: detections",
            "Share of the scans with an object in the field of view that detected it, by range, with 95 % intervals.",
            f"Share of detections of {item.log.name} by range.",
        )
        name = f"detections-{item.log.name}".replace("_", "-")
        yield _by_range(name, texts, "detected, %", item.detections.bands, 100.0, most=100.0)


def _partial(item: SensorAudit, fit: JointFit, kind: str, name: str) -> Figure | None:
    """Added-variable plot: what the other estimates leave of the errors, over what they leave of the effect."""
    if kind not in fit.estimates:
        return None
    names = list(fit.estimates)
    scale = fit.scale
    columns = (fit.derivatives / scale)[:, :, fit.inlier].reshape(len(names), -1)
    rest = (fit.residual / scale)[:, fit.inlier].reshape(-1)
    own, others = columns[names.index(kind)], np.delete(columns, names.index(kind), axis=0)
    if len(others):
        own = own - others.T @ np.linalg.lstsq(others.T, own, rcond=None)[0]
    estimate = fit.estimates[kind]
    factor, unit = _UNITS.get(estimate.unit, (1.0, estimate.unit))
    x, slope = own / factor, estimate.interval.value * factor
    y = x * slope + rest
    chosen = np.unique(np.linspace(0, len(x) - 1, _POINTS).astype(int))
    # Bins with equally many points.
    parts = np.array_split(np.argsort(x), min(_BINS, max(1, len(x) // 5)))
    centres, means = (np.array([values[part].mean() for part in parts]) for values in (x, y))
    spread = np.array([y[part].std() / np.sqrt(len(part)) for part in parts])

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=f"effect, sigma per {unit}", ylabel="error, sigma")
        axes.plot(x[chosen], y[chosen], color=MUTED, marker=".", markersize=2, linestyle="none", alpha=0.5)
        axes.errorbar(centres, means, 1.96 * spread, color=INK, marker="o", markersize=3, linestyle="none", linewidth=1)
        ends = np.array([x.min(), x.max()])
        axes.plot(ends, slope * ends, color=_FOUND)
        low, high = np.quantile(y, [0.001, 0.999])
        axes.set_ylim(low, high)

    return Figure(
        name,
        f"{item.log.name}: {spelt(kind)}",
        f"Each point is a component of a measurement: its error, over what a {spelt(kind)} of one {unit} does to it, "
        "both without what the other estimates explain. The slope of the line is the estimate; were there no such "
        "error, the means would lie on a level line.",
        f"Errors of {item.log.name} over the effect of a {spelt(kind)}, with a line of slope {slope:.3g}.",
        paint,
        _HEIGHT,
        legend=(
            LegendEntry("measurements", MUTED, "dot"),
            LegendEntry("means, 95 %", INK, "dot"),
            LegendEntry("estimate", _FOUND),
        ),
    )


def _sigma(item: SensorAudit, noise: ResidualNoise, name: str) -> Figure:
    factor, unit = (180 / np.pi, "°") if noise.unit == "rad" else (1.0, noise.unit)
    component = noise.name.replace("_", " ")
    texts = (
        f"{item.log.name}: noise of {component}",
        "Standard deviation of measurement minus truth by range, after the errors of time, mount and bias are taken "
        "out, with 95 % intervals. Dashed: what the scenario states.",
        f"Standard deviation of {component} of {item.log.name} by range.",
    )
    return _by_range(name, texts, f"sigma of {component}, {unit}", noise.bands, factor, noise.stated)


def _by_range(
    name: str,
    texts: tuple[str, str, str],
    label: str,
    bands: Sequence[Band],
    factor: float,
    stated: float | None = None,
    most: float = np.inf,
) -> Figure:
    """A value by range with its intervals; ``texts``: title, caption and alternative."""

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel="range, m", ylabel=label)
        for band in bands:
            low, high = (min(max(bound * factor, 0.0), most) for bound in band.interval.bounds())
            value, middle = band.interval.value * factor, 0.5 * (band.from_m + band.to_m)
            axes.plot([band.from_m, band.to_m], [value, value], color=_FOUND)
            axes.plot([middle, middle], [low, high], color=_FOUND, linewidth=1.0)
        if stated is None:
            axes.set_ylim(0, 1.05 * most)
        else:
            axes.axhline(stated * factor, color=MUTED, linestyle=DASHED)
            axes.set_ylim(bottom=0)

    legend = (LegendEntry("found", _FOUND), LegendEntry("stated", MUTED, "dash")) if stated is not None else ()
    return Figure(name, *texts, paint, _HEIGHT, legend=legend)


def _expected(item: SensorAudit, finding: LogFinding, name: str) -> Figure:
    log = item.log
    i = log.components.index(finding.component or "")
    read, expected = log.log.measurement[i], log.expected({})[i]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel="expected from the truth, SI units or rad", ylabel="as read")
        axes.plot(expected, read, color=_FOUND, marker=".", markersize=2, linestyle="none")
        ends = np.array([np.nanmin(expected), np.nanmax(expected)])
        axes.plot(ends, ends, color=MUTED, linestyle=DASHED)

    return Figure(
        name,
        finding.title,
        "What was read over what the truth says. It should lie on the dashed line.",
        f"{finding.component} of {log.name} as read over what is expected.",
        paint,
        _HEIGHT,
        legend=(LegendEntry("measurements", _FOUND, "dot"), LegendEntry("as it should be", MUTED, "dash")),
    )


def _outliers(item: SensorAudit, fit: JointFit, name: str) -> Figure:
    away = np.abs(fit.residual / fit.scale).max(axis=0)
    time = item.log.log.time

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel="largest error, sigma")
        for rows, colour in ((fit.inlier, MUTED), (fit.outlier, _FOUND)):
            axes.plot(time[rows], away[rows], color=colour, marker=".", markersize=2, linestyle="none")
        axes.set_ylim(bottom=0)
        time_axis(axes, float(time.max()))

    return Figure(
        name,
        f"{item.log.name}: outliers",
        "The largest error of each measurement's components.",
        f"Largest error of each measurement of {item.log.name} over time.",
        paint,
        _HEIGHT,
        legend=(LegendEntry("measurements", MUTED, "dot"), LegendEntry("outliers", _FOUND, "dot")),
    )


def _drift(item: SensorAudit, fit: JointFit, name: str) -> Figure:
    scale = fit.scale
    column = (fit.derivatives[list(fit.estimates).index("time_offset")] / scale)[:, fit.inlier]
    rest, time = (fit.residual / scale)[:, fit.inlier], item.log.log.time[fit.inlier]
    parts = np.array_split(np.arange(len(time)), _BINS)
    middle = np.array([time[part].mean() for part in parts])
    square = np.array([(column[:, part] ** 2).sum() for part in parts])
    offset = np.array([(column[:, part] * rest[:, part]).sum() for part in parts]) / square
    offset = 1e3 * (offset + fit.errors["time_offset"])

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel="time offset, ms")
        axes.errorbar(
            middle, offset, 1.96e3 / np.sqrt(square), color=_FOUND, marker="o", markersize=3, linestyle="none"
        )
        time_axis(axes, float(time.max()))

    return Figure(
        name,
        f"{item.log.name}: time offset during the log",
        "What is to be added to the sensor's time stamps, in twentieths of the log. Of a sound clock it is level.",
        f"Time offset of {item.log.name} over time.",
        paint,
        _HEIGHT,
    )


def _over_time(name: str, title: str, caption: str, label: str, time: Array, lines: dict[str, Array]) -> Figure:
    colours = dict(zip(lines, (_FOUND, TRACKER_COLOURS[5]), strict=False))

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel=label)
        for line, values in lines.items():
            axes.plot(time, values, color=colours[line])
        axes.set_ylim(bottom=0)
        time_axis(axes, max(float(time.max()), 1e-3))

    legend = tuple(LegendEntry(line, colour) for line, colour in colours.items()) if len(lines) > 1 else ()
    return Figure(name, title, caption, f"{title} over time.", paint, _HEIGHT, legend=legend)
