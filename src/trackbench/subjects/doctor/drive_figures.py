"""The figures of a drive that shows findings, and of a finding that is shown over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import LogLocator, MaxNLocator

from trackbench.base.types import COMMON_STATE, Array, Mask
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED, INK, MUTED, TIME_LABEL, WIDTH, fit_value_axis, time_axis
from trackbench.document.palette import TRACKER_COLOURS
from trackbench.metrics.consistency import mean_bounds
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.report.numbers import joined_names, percent
from trackbench.subjects.doctor.evidence import EvidenceRun, RunErrors, SensorInnovations, run_errors
from trackbench.subjects.doctor.exhibits import Course, OverTime

TRACKER, REFERENCE = TRACKER_COLOURS[4], TRACKER_COLOURS[5]
_TRACKER_ENTRY, _REFERENCE_ENTRY = LegendEntry("tracker", TRACKER), LegendEntry("reference", REFERENCE)
#: Heights: of a figure with one panel, of each of several, of a map at most, and of a finding over time at least.
_HEIGHT, _PANEL, _TALLEST, _LEAST = 250.0, 150.0, 400.0, 230.0
#: Of each of several panels of a finding over time.
_COURSE = 170.0
#: Difference from which on applied and expected innovation are not the same, in standard deviations of the measurement.
_DIFFERENT = 3.0
_MARGIN_M = 6.0
#: How far a map follows a tracker that has lost its target, beyond the extent of the true path, m.
_REACH_M = 40.0
#: An axis that spans more than this factor has room for powers of ten alone.
_MANY = 3e3
#: So few values are drawn as points too.
_FEW = 2
#: Of more time than this only so much is drawn, s.
_LONG = 20.0
#: Share of what is right below which a value is next to nothing.
_NOTHING = 1e-3


def evidence_figures(run: EvidenceRun) -> Iterator[Figure]:
    """The innovations of the sensors that findings name, the map, and unless a finding shows them error and NEES."""
    named = {finding.sensor for finding in run.findings}
    relevant = [innovations for innovations in run.innovations if innovations.sensor in named] or run.innovations
    for innovations in relevant:
        yield innovation_figure(run, innovations)
    errors = run_errors(run)
    yield _map(run, errors)
    if not any(isinstance(finding.exhibit, OverTime) and finding.shown_by == run.drive for finding in run.findings):
        yield from _error_figures(run, errors)


def innovation_figure(run: EvidenceRun, innovations: SensorInnovations) -> Figure:
    """The applied and the expected innovations of one sensor over time, of each component with a mismatch."""
    gap = np.abs(innovations.applied - innovations.expected) / innovations.sigma[:, None]
    different = np.nan_to_num(gap, nan=0.0) > _DIFFERENT
    components = [name.replace("_", " ") for name in innovations.components]
    units = SENSOR_MODELS[innovations.kind].units
    chosen = [int(i) for i in np.flatnonzero(different.any(axis=1))] or list(range(len(components)))
    instants = np.flatnonzero(different.any(axis=0))

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        for axes, i in zip(panels, chosen, strict=True):
            sigma = float(innovations.sigma[i])
            axes.axhspan(-2 * sigma, 2 * sigma, color=MUTED, alpha=0.35)
            axes.plot(innovations.time, innovations.expected[i], color=REFERENCE, linewidth=2.4)
            axes.plot(innovations.time, innovations.applied[i], color=TRACKER, linewidth=1.3)
            if len(instants):
                first = float(innovations.time[instants[0]])
                axes.axvline(first, color=INK, linestyle=(0, (1.5, 1.5)), linewidth=1.0)
            axes.set_ylabel(f"{components[i]}, {units[i]}")
            time_axis(axes, float(run.time.max()))
        panels[-1].set_xlabel(TIME_LABEL)

    caption = "The two lines are the same."
    if len(instants):
        k = int(instants[0])
        i = int(np.argmax(np.nan_to_num(gap[:, k], nan=0.0)))
        caption = (
            f"They first differ at {innovations.time[k]:.2f} s (dotted): {components[i]} applied "
            f"{innovations.applied[i, k]:+.3g} {units[i]}, expected {innovations.expected[i, k]:+.3g} {units[i]}."
        )
    return Figure(
        _identity(f"{run.drive}-innovation-{innovations.sensor}"),
        f"Innovation of {innovations.sensor}",
        f"{caption} Expected is the measurement minus that of the tracker's own prediction.",
        f"Innovations of {innovations.sensor} over time, {joined_names([components[i] for i in chosen])}, applied and "
        f"expected. {caption}",
        paint,
        max(_HEIGHT, _PANEL * len(chosen)),
        legend=(
            LegendEntry("applied by the tracker", TRACKER),
            LegendEntry("expected from the same prediction", REFERENCE),
            LegendEntry("±2 sigma of the noise", MUTED, "band"),
        ),
    )


def _map(run: EvidenceRun, errors: dict[str, RunErrors]) -> Figure:
    x, y = run.target[:2]
    positions = [SENSOR_MODELS[scan.kind].position(scan).mean for scan in run.scans if scan.valid]
    measurements = np.array(positions).reshape(-1, 2).T
    poses = np.array([scan.sensor_pose[:2] for scan in run.scans]).T
    (left, right), (bottom, top) = _limits(run, x, poses[0], 0), _limits(run, y, poses[1], 1)

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel="x, m", ylabel="y, m")
        axes.plot(*measurements, color=MUTED, marker=".", markersize=2.5, linestyle="none", alpha=0.6)
        axes.plot(poses[0], poses[1], color=MUTED, linewidth=1.2, linestyle=(0, (1.5, 1.5)))
        axes.plot(poses[0][:1], poses[1][:1], color=MUTED, marker="s", markersize=5)
        axes.plot(*run.reference_mean[:2], color=REFERENCE, linewidth=2.0)
        axes.plot(*run.mean[:2], color=TRACKER, linewidth=1.4)
        axes.plot(x, y, color=INK, linewidth=0.9, linestyle=DASHED)
        axes.plot(x[:1], y[:1], color=INK, marker="o", markersize=3.5)
        axes.set(xlim=(left, right), ylim=(bottom, top))
        axes.set_aspect("equal")

    return Figure(
        _identity(f"{run.drive}-map"),
        "From above",
        f"Farthest from the truth: tracker {_largest(errors['tracker'].position, run)}, reference "
        f"{_largest(errors['reference'].position, run)}. The truth starts at its dot, the sensors at the square.",
        f"Map of {run.description}: the true path, the tracker's and the reference's.",
        paint,
        float(np.clip(60 + (WIDTH - 50) * (top - bottom) / (right - left), 160, _TALLEST)),
        legend=(
            LegendEntry("truth", INK, "dash"),
            _TRACKER_ENTRY,
            _REFERENCE_ENTRY,
            LegendEntry("measurements", MUTED, "dot"),
        ),
    )


def _limits(run: EvidenceRun, target: Array, sensor: Array, axis: int) -> tuple[float, float]:
    """Limits around the target, the sensors and, within reach, the middle half of the estimates, m."""
    shown = np.concatenate([target, sensor])
    own = run.mean[axis][np.isfinite(run.mean[axis])]
    if len(own):
        reach = np.ptp(run.target[:2], axis=1).max() + _REACH_M
        middle = np.clip(np.quantile(own, [0.25, 0.75]), shown.min() - reach, shown.max() + reach)
        shown = np.concatenate([shown, middle])
    return float(shown.min()) - _MARGIN_M, float(shown.max()) + _MARGIN_M


def _error_figures(run: EvidenceRun, errors: dict[str, RunErrors]) -> Iterator[Figure]:
    """The position error with twice its own standard deviation, and the NEES with its bounds, over time."""
    mine, theirs = errors["tracker"], errors["reference"]

    def figure(
        kind: str, label: str, caption: str, alternative: str, drawn: Sequence[Array], limits: LegendEntry
    ) -> Figure:
        def paint(canvas: Canvas) -> None:
            axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel=label)
            axes.plot(run.time, drawn[1], color=REFERENCE)
            axes.plot(run.time, drawn[0], color=TRACKER)
            if limits.mark == "band":
                axes.axhspan(*drawn[2], color=MUTED, alpha=0.35)
            else:
                axes.plot(run.time, drawn[2], color=TRACKER, linestyle=DASHED, linewidth=1.2)
            time_axis(axes, float(run.time.max()))
            if _fit_values(axes, drawn):
                axes.set_ylabel(f"{label}, logarithmic")

        name, title = _identity(f"{run.drive}-{kind}"), label.partition(",")[0]
        title = title[0].upper() + title[1:]
        legend = (_TRACKER_ENTRY, _REFERENCE_ENTRY, limits)
        return Figure(name, title, caption, f"{title} over time. {alternative}", paint, _HEIGHT, legend=legend)

    shares = [_share(error.position <= error.two_sigma, error.position) for error in (mine, theirs)]
    largest = f"Largest: tracker {_largest(mine.position, run)}, reference {_largest(theirs.position, run)}."
    caption = f"{largest} Below its own 2 sigma: tracker {shares[0]} of the time, reference {shares[1]}."
    own_sigma = LegendEntry("tracker's own 2 sigma", TRACKER, "dash")
    drawn = (mine.position, theirs.position, mine.two_sigma)
    yield figure("error", "position error, m", caption, largest, drawn, own_sigma)
    low, high = (float(bound) for bound in mean_bounds(len(COMMON_STATE), 1))
    both = (mine.nees, theirs.nees)
    shares = [_share((nees > low) & (nees < high), nees) for nees in both]
    means = [f"{np.nanmean(nees):.3g}" if np.isfinite(nees).any() else "unknown" for nees in both]
    caption = (
        f"Mean: tracker {means[0]}, reference {means[1]} ({len(COMMON_STATE)} expected). "
        f"In the band: tracker {shares[0]} of the time, reference {shares[1]} (95 % expected)."
    )
    band = LegendEntry("95 % of a consistent tracker", MUTED, "band")
    yield figure("nees", "NEES", caption, caption, (*both, np.array([low, high])), band)


def _largest(distance: Array, run: EvidenceRun) -> str:
    if not np.isfinite(distance).any():
        return "unknown"
    k = int(np.nanargmax(distance))
    return f"{distance[k]:.3g} m at {run.time[k]:.3g} s"


def _share(within: Mask, values: Array) -> str:
    finite = np.isfinite(values)
    return percent(float(np.mean(within[finite]))) if finite.any() else "unknown"


def _identity(name: str) -> str:
    """With letters, digits and dashes only, for an id in a page."""
    return "".join(letter if letter.isalnum() else "-" for letter in name)


def _fit_values(axes: Axes, drawn: Sequence[Array]) -> bool:
    """As :func:`fit_value_axis`, with room between the numbers also of many powers of ten."""
    logarithmic = fit_value_axis(axes, drawn)
    low, high = axes.get_ylim()
    if logarithmic and high > _MANY * low:
        axes.yaxis.set_major_locator(LogLocator(numticks=7))
    return logarithmic


def over_time_figure(name: str, exhibit: OverTime) -> Figure:
    """A panel for each quantity, with the same time: all of it, or where that is long what is around the mark."""
    begin, end = min(0.0, float(exhibit.at.min())), float(exhibit.at.max())
    if exhibit.marked is not None and end - begin >= _LONG:
        middle = float(np.clip(sum(exhibit.marked) / 2, begin + _LONG / 2, end - _LONG / 2))
        begin, end = middle - _LONG / 2, max(middle + _LONG / 2, exhibit.marked[1])

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(exhibit.courses), 1, sharex=True, squeeze=False)[:, 0]
        for axes, course in zip(panels, exhibit.courses, strict=True):
            if exhibit.marked is not None:
                axes.axvspan(*exhibit.marked, color=TRACKER, alpha=0.25, gid="marked")
            if course.band is not None:
                axes.fill_between(exhibit.at, *course.band, color=MUTED, alpha=0.35, linewidth=0, gid="band")
            marker = "o" if len(exhibit.at) <= _FEW else None
            if course.right is not None:
                axes.plot(exhibit.at, course.right, color=REFERENCE, marker=marker, gid="shown-right")
            axes.plot(exhibit.at, course.tracker, color=TRACKER, marker=marker, gid="shown-tracker")
            axes.set_ylabel(course.label)
            others = [] if course.right is None else [course.right]
            others += [] if course.band is None else [course.band[1]]
            largest = max((float(np.nanmax(values)) for values in others), default=0.0)
            if largest > 0.0 and not (course.tracker > _NOTHING * largest).any():
                # Values that are next to nothing: zero is on the axis.
                axes.set_ylim(-0.05 * largest, 1.06 * largest)
            else:
                _fit_values(axes, [course.tracker, *others])
            axes.set_xlim(begin, end)
            axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
        panels[-1].set_xlabel(exhibit.axis)

    caption = " ".join(_course_text(exhibit, course) for course in exhibit.courses)
    bands = {course.band_name for course in exhibit.courses if course.band is not None}
    entries = [LegendEntry("tracker", TRACKER)]
    if any(course.right is not None for course in exhibit.courses):
        entries.append(LegendEntry(exhibit.right_name, REFERENCE))
    entries += [LegendEntry(band, MUTED, "band") for band in sorted(bands)]
    tooltips = {"shown-tracker": "tracker", "shown-right": exhibit.right_name}
    if exhibit.marked is not None:
        tooltips["marked"] = f"{exhibit.marked[0]:g} to {exhibit.marked[1]:g} s"
        entries.append(LegendEntry(tooltips["marked"], TRACKER, "band"))
    height = max(_LEAST, _COURSE * len(exhibit.courses))
    return captioned_figure(name, exhibit.title, caption, paint, height, tuple(entries), tooltips)


def captioned_figure(
    name: str,
    title: str,
    caption: str,
    paint: Callable[[Canvas], None],
    height: float,
    legend: tuple[LegendEntry, ...] = (),
    tooltips: Mapping[str, str] | None = None,
    note: str = "",
) -> Figure:
    """The figure of an exhibit; ``note`` is the end of its caption that its alternative text does not have."""
    alternative = f"{title}. {caption}"
    return Figure(name, title, caption + note, alternative, paint, height, legend=legend, tooltips=tooltips or {})


def _course_text(exhibit: OverTime, course: Course) -> str:
    """The means of the marked interval, or the values at both ends."""

    def means(chosen: Mask) -> str:
        texts = [f"tracker {_mean(course.tracker[chosen])}"]
        if course.right is not None:
            texts.append(f"{exhibit.right_name} {_mean(course.right[chosen])}")
        if course.band is not None:
            texts.append(f"band {_mean(course.band[0][chosen])} to {_mean(course.band[1][chosen])}")
        return ", ".join(texts)

    at, unit = exhibit.at, exhibit.axis.rpartition(", ")[2]
    if exhibit.marked is None:
        text = "; ".join(f"at {at[k]:.3g} {unit} {means(np.arange(len(at)) == k)}" for k in (0, len(at) - 1))
    else:
        begin, end = exhibit.marked
        text = f"mean from {begin:g} to {end:g} {unit} {means((at >= begin) & (at < end))}"
    return f"{course.label[0].upper()}{course.label[1:]}: {text}."


def _mean(values: Array) -> str:
    finite = values[np.isfinite(values)]
    return f"{finite.mean():.3g}" if finite.size else "nan"
