"""The figures of a drive that shows findings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import COMMON_STATE, Array, Mask
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED, INK, MUTED, TIME_LABEL, WIDTH, time_axis
from trackbench.metrics.consistency import mean_bounds
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.report.numbers import joined, percent
from trackbench.subjects.doctor.evidence import EvidenceRun, RunErrors, SensorInnovations, run_errors
from trackbench.subjects.doctor.exhibits import UNITS, OverTime
from trackbench.subjects.doctor.report.exhibits.values import REFERENCE, TRACKER, fit_values

#: Difference from which on applied and expected innovation are not the same, in standard deviations of the measurement.
DIFFERENT = 3.0


class Mismatch(NamedTuple):
    """The first measurement whose applied innovation is not the expected one."""

    component: str
    time: float
    """s"""
    applied: float
    expected: float


def mismatched_components(innovations: SensorInnovations) -> list[int]:
    """The components with a mismatch; all components if there is none."""
    found = np.flatnonzero((_gap(innovations) > DIFFERENT).any(axis=1))
    return [int(i) for i in found] or list(range(len(innovations.components)))


def first_mismatch(innovations: SensorInnovations) -> Mismatch | None:
    """The first mismatch; None if there is none."""
    gap = _gap(innovations)
    columns = np.flatnonzero((gap > DIFFERENT).any(axis=0))
    if not len(columns):
        return None
    k = int(columns[0])
    i = int(np.argmax(gap[:, k]))
    return Mismatch(
        innovations.components[i],
        float(innovations.time[k]),
        float(innovations.applied[i, k]),
        float(innovations.expected[i, k]),
    )


def innovation_unit(component: str) -> str:
    """The unit of a component of a measurement."""
    return UNITS.get(component, "m")


def _gap(innovations: SensorInnovations) -> np.ndarray:
    gap = np.abs(innovations.applied - innovations.expected) / innovations.sigma[:, None]
    return np.nan_to_num(gap, nan=0.0)


_HEIGHT = 250.0
_PANEL = 150.0
_TALLEST = 400.0
_MARGIN_M = 6.0
#: How far a map follows a tracker that has lost its target, beyond the extent of the true path, m.
_REACH_M = 40.0
_TRACKER_ENTRY, _REFERENCE_ENTRY = LegendEntry("tracker", TRACKER), LegendEntry("reference", REFERENCE)


def figures(run: EvidenceRun) -> Iterator[Figure]:
    """The innovations of the sensors that findings name, the map, and unless a finding shows them error and NEES."""
    for innovations in _relevant(run):
        yield innovation_figure(run, innovations)
    of = run_errors(run)
    yield _map(run, of)
    if not any(isinstance(one.exhibit, OverTime) and one.shown_by == run.drive for one in run.findings):
        yield _errors(run, of)
        yield _nees(run, of)


def innovation_figure(run: EvidenceRun, innovations: SensorInnovations) -> Figure:
    """The applied and the expected innovations of one sensor over time, of each component with a mismatch."""
    chosen, first = mismatched_components(innovations), first_mismatch(innovations)
    names = joined([innovations.components[i].replace("_", " ") for i in chosen])

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        for axes, i in zip(panels, chosen, strict=True):
            sigma = float(innovations.sigma[i])
            axes.axhspan(-2 * sigma, 2 * sigma, color=MUTED, alpha=0.35)
            axes.plot(innovations.time, innovations.expected[i], color=REFERENCE, linewidth=2.4)
            axes.plot(innovations.time, innovations.applied[i], color=TRACKER, linewidth=1.3)
            if first is not None:
                axes.axvline(first.time, color=INK, linestyle=(0, (1.5, 1.5)), linewidth=1.0)
            name = innovations.components[i]
            axes.set_ylabel(f"{name.replace('_', ' ')}, {innovation_unit(name)}")
            time_axis(axes, _end(run))
        panels[-1].set_xlabel(TIME_LABEL)

    said = "The two lines are the same."
    if first is not None:
        unit = innovation_unit(first.component)
        said = (
            f"They first differ at {first.time:.2f} s (dotted): {first.component.replace('_', ' ')} applied "
            f"{first.applied:+.3g} {unit}, expected {first.expected:+.3g} {unit}."
        )
    return Figure(
        _identity(f"{run.drive}-innovation-{innovations.sensor}"),
        f"Innovation of {innovations.sensor}",
        f"{said} Expected is the measurement minus that of the tracker's own prediction.",
        f"Innovations of {innovations.sensor} over time, {names}, applied and expected. {said}",
        paint,
        max(_HEIGHT, _PANEL * len(chosen)),
        legend=(
            LegendEntry("applied by the tracker", TRACKER),
            LegendEntry("expected from the same prediction", REFERENCE),
            LegendEntry("±2 sigma of the noise", MUTED, "band"),
        ),
    )


def _relevant(run: EvidenceRun) -> list[SensorInnovations]:
    """Those of the sensors that findings name, or else all."""
    named = {finding.sensor for finding in run.findings}
    return [one for one in run.innovations if one.sensor in named] or run.innovations


def _map(run: EvidenceRun, of: dict[str, RunErrors]) -> Figure:
    x, y = run.target[:2]
    poses = np.array([scan.sensor_pose[:2] for scan in run.scans]).T
    (left, right), (bottom, top) = _limits(run, x, poses[0], 0), _limits(run, y, poses[1], 1)

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel="x, m", ylabel="y, m")
        axes.plot(*_measurements(run), color=MUTED, marker=".", markersize=2.5, linestyle="none", alpha=0.6)
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
        f"Farthest from the truth: tracker {_largest(of['tracker'].position, run)}, reference "
        f"{_largest(of['reference'].position, run)}. The truth starts at its dot, the sensors at the square.",
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


def _measurements(run: EvidenceRun) -> Array:
    """``(2, measurements)`` m in the fixed frame."""
    seen = [SENSOR_MODELS[scan.kind].position(scan).mean for scan in run.scans if scan.valid]
    return np.array(seen).reshape(-1, 2).T


def _errors(run: EvidenceRun, of: dict[str, RunErrors]) -> Figure:
    mine, theirs = of["tracker"], of["reference"]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel="position error, m")
        axes.plot(run.time, theirs.position, color=REFERENCE)
        axes.plot(run.time, mine.position, color=TRACKER)
        axes.plot(run.time, mine.two_sigma, color=TRACKER, linestyle=DASHED, linewidth=1.2)
        time_axis(axes, _end(run))
        _fit(axes, [mine.position, theirs.position, mine.two_sigma])

    return Figure(
        _identity(f"{run.drive}-error"),
        "Position error",
        f"Largest: tracker {_largest(mine.position, run)}, reference {_largest(theirs.position, run)}. Below its own 2 "
        f"sigma: tracker {_share(mine.position <= mine.two_sigma, mine.position)} of the time, reference "
        f"{_share(theirs.position <= theirs.two_sigma, theirs.position)}.",
        f"Position error over time. Largest: tracker {_largest(mine.position, run)}, reference "
        f"{_largest(theirs.position, run)}.",
        paint,
        _HEIGHT,
        legend=(_TRACKER_ENTRY, _REFERENCE_ENTRY, LegendEntry("tracker's own 2 sigma", TRACKER, "dash")),
    )


def _nees(run: EvidenceRun, of: dict[str, RunErrors]) -> Figure:
    mine, theirs = of["tracker"].nees, of["reference"].nees
    low, high = (float(bound) for bound in mean_bounds(len(COMMON_STATE), 1))
    shares = [_share((nees > low) & (nees < high), nees) for nees in (mine, theirs)]
    said = (
        f"Mean: tracker {_mean(mine)}, reference {_mean(theirs)} ({len(COMMON_STATE)} expected). In the band: tracker "
        f"{shares[0]} of the time, reference {shares[1]} (95 % expected)."
    )

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel="NEES")
        axes.axhspan(low, high, color=MUTED, alpha=0.35)
        axes.plot(run.time, theirs, color=REFERENCE)
        axes.plot(run.time, mine, color=TRACKER)
        time_axis(axes, _end(run))
        _fit(axes, [mine, theirs, np.array([low, high])])

    return Figure(
        _identity(f"{run.drive}-nees"),
        "NEES",
        said,
        f"NEES over time. {said}",
        paint,
        _HEIGHT,
        legend=(_TRACKER_ENTRY, _REFERENCE_ENTRY, LegendEntry("95 % of a consistent tracker", MUTED, "band")),
    )


def _largest(distance: Array, run: EvidenceRun) -> str:
    if not np.isfinite(distance).any():
        return "unknown"
    k = int(np.nanargmax(distance))
    return f"{distance[k]:.3g} m at {run.time[k]:.3g} s"


def _mean(values: Array) -> str:
    return f"{np.nanmean(values):.3g}" if np.isfinite(values).any() else "unknown"


def _share(within: Mask, of: Array) -> str:
    known = np.isfinite(of)
    return percent(float(np.mean(within[known]))) if known.any() else "unknown"


def _end(run: EvidenceRun) -> float:
    return float(run.time.max())


def _fit(axes: Axes, drawn: list[Array]) -> None:
    if fit_values(axes, drawn):
        axes.set_ylabel(f"{axes.get_ylabel()}, logarithmic")


def _identity(name: str) -> str:
    """With letters, digits and dashes only, for an id in a page."""
    return "".join(letter if letter.isalnum() else "-" for letter in name)
