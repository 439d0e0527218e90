"""The figures of an examination: one run of a drive, seen through innovations, on a map, and by its errors."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator

from trackbench.doctor.exhibits import Exhibit, Innovations
from trackbench.doctor.measures import Measures, measures
from trackbench.metrics.consistency import mean_bounds
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.palette import TRACKER_COLOURS
from trackbench.report.examination_innovations import departure, innovation_unit, telling
from trackbench.report.figures import Entry, Picture, fit_value_axis
from trackbench.report.numbers import joined
from trackbench.report.svg import GRID, INK, MUTED, WIDTH, draw, in_page
from trackbench.types import COMMON_STATE, Array

TRACKER, REFERENCE = TRACKER_COLOURS[4], TRACKER_COLOURS[5]
_TIME = "time, s"
_HEIGHT = 250.0
_PANEL = 150.0
_TALLEST = 400.0
_MARGIN_M = 6.0
#: An axis that spans more than this factor has room for powers of ten alone.
_MANY = 3e3
#: How far a map goes for a tracker that is elsewhere, beyond what the true path measures, m.
_REACH_M = 40.0
_TRACKER_ENTRY, _REFERENCE_ENTRY = Entry("tracker", TRACKER), Entry("reference", REFERENCE)


def pictures(exhibit: Exhibit) -> Iterator[Picture]:
    """The innovations of each sensor that matters, the map, the errors and the NEES."""
    for innovations in _relevant(exhibit):
        yield innovation_picture(exhibit, innovations)
    of = measures(exhibit)
    yield _map(exhibit)
    yield _errors(exhibit, of)
    yield _nees(exhibit, of)


def innovation_picture(exhibit: Exhibit, innovations: Innovations) -> Picture:
    """Each telling component of one sensor's innovations over time, taken beside sound."""
    chosen, first = telling(innovations), departure(innovations)
    names = joined([innovations.components[i].replace("_", " ") for i in chosen])
    caption = (
        f"What each measurement of {innovations.sensor} was worth to the tracker ({names}): the innovation by which "
        "its estimate moved, and the measurement less what a sound model expects of the tracker's own prediction. The "
        "two should be one line. After a wrong step the prediction is off, and the sound innovation grows with it. The "
        "band is two standard deviations of the sensor's noise."
    )
    said = "The two lines agree."
    if first is not None:
        unit = innovation_unit(first.component)
        said = (
            f"They part first at {first.time:.2f} s (dotted): {first.component.replace('_', ' ')} taken as "
            f"{first.taken:+.3g} {unit}, sound {first.sound:+.3g} {unit}."
        )
    name = f"{exhibit.course}-innovation-{innovations.sensor}"
    alternative = f"Innovations of {innovations.sensor} over time, {names}, as taken and as sound. {said}"
    legend = (
        Entry("as the tracker takes it", TRACKER),
        Entry("sound, from the same prediction", REFERENCE),
        Entry("±2 sigma of the noise", "var(--muted)", "band"),
    )
    svg = in_page(innovation_drawing(exhibit, innovations), _identity(name), alternative, {})
    return Picture(
        _identity(name), f"Innovation of {innovations.sensor}", f"{caption} {said}", alternative, svg, legend
    )


def innovation_drawing(exhibit: Exhibit, innovations: Innovations) -> Element:
    """The drawing of it, a panel for each component."""
    chosen, first = telling(innovations), departure(innovations)

    def paint(figure: Figure) -> None:
        panels = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        for axes, i in zip(panels, chosen, strict=True):
            sigma = float(innovations.sigma[i])
            axes.axhspan(-2 * sigma, 2 * sigma, color=MUTED, alpha=0.35)
            axes.plot(innovations.time, innovations.sound[i], color=REFERENCE, linewidth=2.4)
            axes.plot(innovations.time, innovations.taken[i], color=TRACKER, linewidth=1.3)
            if first is not None:
                axes.axvline(first.time, color=INK, linestyle=(0, (1.5, 1.5)), linewidth=1.0)
            name = innovations.components[i]
            axes.set_ylabel(f"{name.replace('_', ' ')}, {innovation_unit(name)}")
            _time_axis(axes, exhibit)
        panels[-1].set_xlabel(_TIME)

    return draw(paint, max(_HEIGHT, _PANEL * len(chosen)))


def _relevant(exhibit: Exhibit) -> list[Innovations]:
    """Of the sensors that findings name, or else of all."""
    named = {finding.sensor for finding in exhibit.findings}
    return [one for one in exhibit.innovations if one.sensor in named] or exhibit.innovations


def _map(exhibit: Exhibit) -> Picture:
    x, y = exhibit.target[:2]
    poses = np.array([scan.sensor_pose[:2] for scan in exhibit.scans]).T
    (left, right), (bottom, top) = _limits(exhibit, x, poses[0], 0), _limits(exhibit, y, poses[1], 1)

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="x, m", ylabel="y, m")
        axes.plot(*_measurements(exhibit), color=MUTED, marker=".", markersize=2.5, linestyle="none", alpha=0.6)
        axes.plot(poses[0], poses[1], color=MUTED, linewidth=1.2, linestyle=(0, (1.5, 1.5)))
        axes.plot(poses[0][:1], poses[1][:1], color=MUTED, marker="s", markersize=5)
        axes.plot(*exhibit.reference_mean[:2], color=REFERENCE, linewidth=2.0)
        axes.plot(*exhibit.mean[:2], color=TRACKER, linewidth=1.4)
        axes.plot(x, y, color=INK, linewidth=0.9, linestyle=(0, (4, 2)))
        axes.plot(x[:1], y[:1], color=INK, marker="o", markersize=3.5)
        axes.set(xlim=(left, right), ylim=(bottom, top))
        axes.set_aspect("equal")

    caption = (
        f"From above, {exhibit.purpose}: dashed is the truth from the dot on, the square is the sensors' place at the "
        "start, small dots are measurements. A tracker that is lost may leave the map."
    )
    alternative = f"Map of {exhibit.purpose}: the true path, the tracker's and the reference's."
    legend = (
        Entry("truth", "currentColor", "dash"),
        _TRACKER_ENTRY,
        _REFERENCE_ENTRY,
        Entry("measurements", "var(--muted)", "dot"),
    )
    height = float(np.clip(60 + (WIDTH - 50) * (top - bottom) / (right - left), 160, _TALLEST))
    name = _identity(f"{exhibit.course}-map")
    return Picture(
        name, "From above", caption, alternative, in_page(draw(paint, height), name, alternative, {}), legend
    )


def _limits(exhibit: Exhibit, target: Array, sensor: Array, axis: int) -> tuple[float, float]:
    """What holds the target, the sensors and most of the tracker's track, unless that is lost, m."""
    shown = np.concatenate([target, sensor])
    own = exhibit.mean[axis][np.isfinite(exhibit.mean[axis])]
    if len(own):
        reach = np.ptp(exhibit.target[:2], axis=1).max() + _REACH_M
        middle = np.clip(np.quantile(own, [0.25, 0.75]), shown.min() - reach, shown.max() + reach)
        shown = np.concatenate([shown, middle])
    return float(shown.min()) - _MARGIN_M, float(shown.max()) + _MARGIN_M


def _measurements(exhibit: Exhibit) -> Array:
    """``(2, measurements)`` m in the fixed frame."""
    seen = [SENSOR_MODELS[scan.kind].position(scan).mean for scan in exhibit.scans if scan.valid]
    return np.array(seen).reshape(-1, 2).T


def _errors(exhibit: Exhibit, of: dict[str, Measures]) -> Picture:
    mine, theirs = of["tracker"], of["reference"]

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel=_TIME, ylabel="position error, m")
        axes.plot(exhibit.time, theirs.error, color=REFERENCE)
        axes.plot(exhibit.time, mine.error, color=TRACKER)
        axes.plot(exhibit.time, mine.claimed, color=TRACKER, linestyle=(0, (4, 2)), linewidth=1.2)
        _time_axis(axes, exhibit)
        _fit(axes, [mine.error, theirs.error, mine.claimed])

    caption = (
        "Distance of the estimate from the truth. Dashed is twice the standard deviation that the tracker's own "
        "covariance states: its error should be below it nearly always."
    )
    alternative = (
        f"Position error over time. Largest: tracker {_largest(mine.error)} m, reference {_largest(theirs.error)} m."
    )
    legend = (_TRACKER_ENTRY, _REFERENCE_ENTRY, Entry("tracker's own 2 sigma", TRACKER, "dash"))
    name = _identity(f"{exhibit.course}-error")
    svg = in_page(draw(paint, _HEIGHT), name, alternative, {})
    return Picture(name, "Position error", caption, alternative, svg, legend)


def _nees(exhibit: Exhibit, of: dict[str, Measures]) -> Picture:
    mine, theirs = of["tracker"].nees, of["reference"].nees
    low, high = (float(bound) for bound in mean_bounds(len(COMMON_STATE), 1))

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel=_TIME, ylabel="NEES")
        axes.axhspan(low, high, color=MUTED, alpha=0.35)
        axes.plot(exhibit.time, theirs, color=REFERENCE)
        axes.plot(exhibit.time, mine, color=TRACKER)
        _time_axis(axes, exhibit)
        _fit(axes, [mine, theirs, np.array([low, high])])

    caption = (
        "Squared error of position and velocity in units of the covariance that is stated for it. Of a tracker that "
        "knows its own accuracy it lies in the grey band 95 % of the time, and is 4 on average."
    )
    alternative = f"NEES over time. Largest: tracker {_largest(mine)}, reference {_largest(theirs)}."
    legend = (_TRACKER_ENTRY, _REFERENCE_ENTRY, Entry("95 % of a consistent tracker", "var(--muted)", "band"))
    name = _identity(f"{exhibit.course}-nees")
    svg = in_page(draw(paint, _HEIGHT), name, alternative, {})
    return Picture(name, "Does it know its own error?", caption, alternative, svg, legend)


def _largest(values: Array) -> str:
    return f"{np.nanmax(values):.3g}" if np.isfinite(values).any() else "unknown"


def _time_axis(axes: Axes, exhibit: Exhibit) -> None:
    axes.set_xlim(0, float(exhibit.time.max()))
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    axes.grid(axis="x", color=GRID, linewidth=0.6)


def _fit(axes: Axes, drawn: list[Array]) -> None:
    if not fit_value_axis(axes, drawn):
        return
    axes.set_ylabel(f"{axes.get_ylabel()}, logarithmic")
    low, high = axes.get_ylim()
    if high > _MANY * low:
        axes.yaxis.set_major_locator(LogLocator(numticks=7))


def _identity(name: str) -> str:
    """Without what a reference inside a page must not hold."""
    return "".join(letter if letter.isalnum() else "-" for letter in name)
