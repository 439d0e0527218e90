"""Points in a plane, the tracker's and the right ones, with the ellipses that they are held against."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED
from trackbench.subjects.doctor.exhibits import Points
from trackbench.subjects.doctor.report.exhibits.roles import REFERENCE, TRACKER, fit_equal, outline

_HEIGHT = 330.0


def points_figure(name: str, of: Points) -> Figure:
    """The points, and where they have weights these too, as sizes and in the legend."""

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=of.axes[0], ylabel=of.axes[1])
        right = outline(of.right_ring.mean, of.right_ring.covariance, of.right_ring.size)
        drawn: list[Array] = [right, of.tracker]
        axes.plot(*right, color=REFERENCE, linewidth=1.6, gid="ring-right")
        if of.right is not None:
            size = 7.0
            axes.plot(
                *of.right, color=REFERENCE, marker="o", markersize=size, markerfacecolor="none", markeredgewidth=1.6,
                linestyle="none", gid="shown-right",
            )  # fmt: skip
            drawn.append(of.right)
        if of.tracker_ring is not None:
            ring = outline(of.tracker_ring.mean, of.tracker_ring.covariance, of.tracker_ring.size)
            axes.plot(*ring, color=TRACKER, linestyle=DASHED, linewidth=1.6, gid="ring-tracker")
            drawn.append(ring)
        marker, size = ("x", 6.0) if of.right is not None else ("o", 3.0)
        axes.plot(
            *of.tracker, color=TRACKER, marker=marker, markersize=size, markeredgewidth=1.6, linestyle="none",
            gid="shown-tracker",
        )  # fmt: skip
        if of.tracker_ring is not None:
            for ring_of, colour in ((of.right_ring, REFERENCE), (of.tracker_ring, TRACKER)):
                axes.plot(*ring_of.mean[:, None], color=colour, marker="+", markersize=11, markeredgewidth=1.8)
        fit_equal(axes, drawn)

    own, other = ("", "") if of.weight is None else (f", weights {w:.4g}" for w in of.weight)
    entries = [LegendEntry(f"{of.name}{own}", TRACKER, "dot" if of.right is None else "cross")]
    if of.right is not None:
        entries.append(LegendEntry(f"{of.right_name}{other}", REFERENCE, "ring"))
    entries.append(LegendEntry(of.right_ring.name, REFERENCE))
    tooltips = {"shown-tracker": of.name, "shown-right": of.right_name}
    if of.tracker_ring is not None:
        entries.append(LegendEntry(of.tracker_ring.name, TRACKER, "dash"))
    said = _numbers(of)
    return Figure(name, of.title, said, f"{of.title}. {said}", paint, _HEIGHT, legend=tuple(entries), tooltips=tooltips)


def _numbers(of: Points) -> str:
    ring = of.right_ring
    if of.tracker_ring is None or of.right is None or of.weight is None:
        apart = of.tracker - ring.mean[:, None]
        squared = np.einsum("ik,ij,jk->k", apart, np.linalg.inv(ring.covariance), apart)
        inside, count = int(np.sum(squared <= ring.size**2)), of.tracker.shape[1]
        return f"{inside} of {count} are within {ring.name}; RMS {np.sqrt(squared.mean() / 2):.3g} for each component."
    count = of.tracker.shape[1]
    distances = [np.hypot(*(points - points.mean(axis=1, keepdims=True))).mean() for points in (of.tracker, of.right)]
    means = [", ".join(f"{value:.4g}" for value in one.mean) for one in (of.tracker_ring, ring)]
    sigmas = [np.sqrt(max(0.0, float(np.trace(one.covariance)))) for one in (of.tracker_ring, ring)]
    return (
        f"{count} points whose weights sum to {count * of.weight[0]:.4g} (right: {count * of.weight[1]:.4g}), at "
        f"{distances[0] / distances[1]:.3g} times the right distance from their mean. The mean becomes {means[0]} from "
        f"{means[1]}, the standard deviation {sigmas[0]:.3g} from {sigmas[1]:.3g}. The points are drawn here; the "
        "tracker's own are not known."
    )
