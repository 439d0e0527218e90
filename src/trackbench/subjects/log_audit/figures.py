"""The figures of a log's audit: noise and detections by range."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure as Canvas

from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED, MUTED
from trackbench.document.palette import TRACKER_COLOURS
from trackbench.subjects.log_audit.findings import SensorAudit
from trackbench.subjects.log_audit.noise import Band, ResidualNoise

_FOUND = TRACKER_COLOURS[4]
_HEIGHT = 230.0


def band_figures(item: SensorAudit) -> Iterator[Figure]:
    """Yield a sensor's figures of noise by component and of detections, both by range."""
    for noise in item.noise:
        yield _sigma_figure(item, noise, f"sigma-{item.log.name}-{noise.name}".replace("_", "-"))
    if item.detections.bands:
        texts = (
            f"{item.log.name}: detections",
            "Share of the scans with an object in the field of view that detected it, by range, with 95 % intervals.",
            f"Share of detections of {item.log.name} by range.",
        )
        name = f"detections-{item.log.name}".replace("_", "-")
        yield _range_figure(name, texts, "detected, %", item.detections.bands, 100.0, most=100.0)


def _sigma_figure(item: SensorAudit, noise: ResidualNoise, name: str) -> Figure:
    factor, unit = (180 / np.pi, "°") if noise.unit == "rad" else (1.0, noise.unit)
    component = noise.name.replace("_", " ")
    texts = (
        f"{item.log.name}: noise of {component}",
        "Standard deviation of measurement minus truth by range, after the errors of time, mount and bias are taken "
        "out, with 95 % intervals. Dashed: what the scenario states.",
        f"Standard deviation of {component} of {item.log.name} by range.",
    )
    return _range_figure(name, texts, f"sigma of {component}, {unit}", noise.bands, factor, noise.stated)


def _range_figure(
    name: str,
    texts: tuple[str, str, str],
    label: str,
    bands: Sequence[Band],
    factor: float,
    stated: float | None = None,
    most: float = np.inf,
) -> Figure:
    """Return a figure of a value against range, with intervals; ``texts`` are title, caption and alternative text."""

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
