"""Draws the figure of docs/traffic-sensing.md: which objects are due, seen from above."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Polygon, Rectangle, Wedge

from trackbench.base.types import DUE
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import GRID, INK, MUTED, svg_file
from trackbench.document.palette import OBSERVER_COLOUR
from trackbench.models.sensors import Radar
from trackbench.sensing.due import find_due
from trackbench.sensing.scans import ideal_sensors
from trackbench.truth.scripted import script
from trackbench.truth.sources import ScriptedTruth

FILE = Path(__file__).parent / "images" / "traffic-due.svg"
RADAR = Radar(
    rate_hz=1, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.1, fov_deg=90, max_range_m=80,
    occlusion=True,
)  # fmt: skip
#: By what is written beside each: x, y, course, and what else is said of it.
CAR, TRUCK, BYSTANDER = {}, {"length_m": 10, "width_m": 2.5}, {"target": False}
OBJECTS = {
    "due": (40, 14, 0, CAR),
    "due, a truck": (30, -4, 0, TRUCK),
    "due, partly hidden": (68, -5.0, 0, CAR),
    "hidden": (52, -7.5, 0, CAR),
    "no target": (46, 24, 180, BYSTANDER),
    "at the rim of the range": (79, 4, 0, CAR),
    "at the side of the view": (26, -24, -45, CAR),
    "beyond the range": (92, -10, 0, CAR),
    "out of view": (16, 27, 90, CAR),
}
COLOURS = {"due": "#009E73", "optional": "#E69F00"}


def main() -> None:
    FILE.write_text(picture(), encoding="utf-8")


def picture() -> str:
    """The text of the SVG file."""
    legend = [
        *(LegendEntry(word, colour, "dot") for word, colour in COLOURS.items()),
        LegendEntry("field of view", MUTED, "band"),
        LegendEntry("behind the truck", INK, "band"),
    ]
    alternative = (
        "From above: cars in the field of view are due; hidden ones and those at its rim or outside are optional"
    )
    return svg_file(Figure("due", "", "", alternative, _paint, 330, 560, tuple(legend)))


def _paint(canvas: Canvas) -> None:
    objects = {
        f"object{i}": {"start": {"x": x, "y": y, "course_deg": course}, **more}
        for i, (x, y, course, more) in enumerate(OBJECTS.values())
    }
    truth = script(ScriptedTruth.model_validate({"duration_s": 1, "rate_hz": 1, "objects": objects}), 0, "figure", 1)
    status = find_due(truth, ideal_sensors(truth, {"radar": RADAR})).status[0, :, 0]
    axes = canvas.add_subplot()
    axes.set_aspect("equal")
    axes.set(xlim=(-6, 112), ylim=(-36, 36), xlabel="x, m", ylabel="y, m")
    axes.grid(color=GRID, linewidth=0.6)
    half = RADAR.fov_deg / 2
    axes.add_patch(Wedge((0, 0), RADAR.max_range_m, -half, half, color=MUTED, alpha=0.18))
    _shadow(axes, *next((x, y) for x, y, _, more in OBJECTS.values() if more is TRUCK))
    axes.plot(0, 0, marker=">", markersize=9, color=OBSERVER_COLOUR)
    axes.text(-4, -5, "sensor", fontsize=9)
    for i, (name, (x, y, course, _)) in enumerate(OBJECTS.items()):
        length, width = truth.length[i], truth.width[i]
        colour = COLOURS["due" if status[i] == DUE else "optional"]
        corner = (x - length / 2, y - width / 2)
        axes.add_patch(Rectangle(corner, length, width, angle=course, rotation_point="center", facecolor=colour))
        axes.text(x, y + 2.2, name, fontsize=9, ha="center", va="bottom")


def _shadow(axes: Axes, x: float, y: float) -> None:
    """What a truck at x, y hides."""
    corners = np.array([(x + a * 5, y + b * 1.25) for a in (-1, 1) for b in (-1, 1)])
    angle = np.arctan2(corners[:, 1], corners[:, 0])
    edges = corners[[np.argmin(angle), np.argmax(angle)]]
    far = edges * (RADAR.max_range_m / np.hypot(*edges.T))[:, None]
    axes.add_patch(Polygon([edges[0], far[0], far[1], edges[1]], color=INK, alpha=0.16))


if __name__ == "__main__":
    main()
