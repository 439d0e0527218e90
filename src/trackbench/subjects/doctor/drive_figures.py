"""Figures of a drive that shows findings: the innovations that the tracker applied, beside the right ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure as Canvas

from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import INK, MUTED, TIME_LABEL, time_axis
from trackbench.document.palette import TRACKER_COLOURS
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.report.numbers import joined_names
from trackbench.subjects.doctor.evidence import EvidenceRun, SensorInnovations

TRACKER, REFERENCE = TRACKER_COLOURS[4], TRACKER_COLOURS[5]
#: Height of a figure with one panel, and of each panel of several.
_HEIGHT, _PANEL = 250.0, 150.0
#: Least difference between applied and expected innovations that counts, in standard deviations of the measurement.
_DIFFERENT = 3.0


def evidence_figures(run: EvidenceRun) -> Iterator[Figure]:
    """Yield a figure of innovations for each sensor that the run's findings name, or for all if they name none."""
    named = {finding.sensor for finding in run.findings}
    relevant = [innovations for innovations in run.innovations if innovations.sensor in named] or run.innovations
    for innovations in relevant:
        yield innovation_figure(run, innovations)


def innovation_figure(run: EvidenceRun, innovations: SensorInnovations) -> Figure:
    """Return the figure of one sensor's applied and expected innovations over time, with the components that differ."""
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
        _html_id(f"{run.drive}-innovation-{innovations.sensor}"),
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


def _html_id(name: str) -> str:
    return "".join(letter if letter.isalnum() else "-" for letter in name)
