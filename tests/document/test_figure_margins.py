"""Nothing that stands in the margins of a figure is cut off or lies on something else."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import logarithmic, matplotlib_figure, panel_title, shortened_to_width, text_width

WIDTH, HEIGHT = 430.0, 250.0
LONG = "extended_kalman_filter_with_constant_velocity_and_low_noise_0p8"


def one_panel(canvas):
    axes = canvas.add_subplot(xlabel="time, s", ylabel="position RMSE, m")
    axes.plot([0.0, 20.0], [0.0, 12345.0])
    axes.set_xlim(0, 20)


def logarithms(canvas):
    axes = canvas.add_subplot(xlabel="time, s", ylabel="velocity RMSE, m/s, logarithmic")
    axes.plot([1.0, 1000.0], [0.001, 1000.0])
    logarithmic(axes, "x")
    logarithmic(axes, "y")


def small_numbers(canvas):
    canvas.add_subplot(xlabel="time, s", ylabel="y").plot([0.0, 1.0], [1e-7, 3e-7])


def shared_panels(canvas):
    for i, axes in enumerate(canvas.subplots(3, 2, sharex=True, sharey=True, squeeze=False).flat):
        axes.plot([0.0, 20.0], [-1.0, 1.0])
        panel_title(axes, LONG, WIDTH / 2)
        axes.set_xlabel("time, s" if i > 3 else "")
        axes.set_ylabel("error, m" if i % 2 == 0 else "")


def own_labels(canvas):
    panels = canvas.subplots(2, 1, sharex=True, squeeze=False)[:, 0]
    for axes, scale in zip(panels, (1.0, 1e4), strict=True):
        axes.plot([0.0, 1.0], [-scale, scale])
        axes.set_ylabel("range, m")
    panels[-1].set_xlabel("time, s")


def a_map(canvas):
    axes = canvas.add_subplot(xlabel="x, m", ylabel="y, m")
    axes.plot([0.0, 100.0], [0.0, 40.0])
    axes.set_aspect("equal")
    axes.annotate("a vehicle", (100.0, 40.0), xytext=(3, 3), textcoords="offset points", fontsize=9)


def names_on_top(canvas):
    axes = canvas.add_subplot()
    axes.set_xticks(range(8), [f"{LONG[:20]}_{i}" for i in range(8)])
    axes.set_yticks(range(2), ["highway", "u_turn"])
    axes.set(xlim=(-0.5, 7.5), ylim=(1.5, -0.5))
    axes.xaxis.tick_top()
    axes.tick_params(axis="x", labelrotation=90)


def long_rows(canvas):
    axes = canvas.add_subplot(xlabel="difference, %")
    axes.set_yticks(range(2), [shortened_to_width(LONG, 0.55 * WIDTH)] * 2)


@pytest.mark.parametrize("entries", [0, 4])
@pytest.mark.parametrize(
    "paint",
    [one_panel, logarithms, small_numbers, shared_panels, own_labels, a_map, names_on_top, long_rows],
    ids=lambda paint: paint.__name__,
)
def test_every_text_is_inside_and_alone(paint, entries):
    legend = tuple(LegendEntry(f"{LONG[:30]}_{number}", "#123456") for number in range(entries))
    canvas = matplotlib_figure(Figure("any", "Any", "", "", paint, HEIGHT, legend=legend))
    canvas.set_canvas(FigureCanvasAgg(canvas))
    canvas.draw_without_rendering()
    height = 72 * canvas.get_size_inches()[1]
    assert (height > HEIGHT) == bool(entries)
    boxes = {text: text.get_window_extent() for text in shown(canvas)}
    assert boxes
    for text, box in boxes.items():
        assert -1 < box.x0 < box.x1 < WIDTH + 1, text
        assert -1 < box.y0 < box.y1 < height + 1, text
    for (a, one), (b, other) in combinations(boxes.items(), 2):
        both = Bbox.intersection(one, other)
        # Letters with nothing below the line leave a point of their box free.
        assert both is None or min(both.width, both.height) < 1, (a, b)
    for axes in canvas.axes:
        # The margins leave most of the figure to what is drawn.
        assert axes.get_window_extent().width > 0.3 * WIDTH


def shown(canvas: Canvas) -> list[Text]:
    """Texts that are drawn, but for numbers outside the limits."""
    found = [text for legend in canvas.legends for text in legend.get_texts()]
    for axes in canvas.axes:
        found += [axes.xaxis.label, axes.yaxis.label, *axes.texts, *titles(axes)]
        for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            low, high = sorted((low, high))
            ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            found += [label for tick in ticks for label in (tick.label1, tick.label2)]
            found.append(axis.get_offset_text())
    return [text for text in found if text.get_visible() and text.get_text()]


def titles(axes):
    title = axes.get_title("left")
    return [text for text in axes.get_children() if isinstance(text, Text) and text.get_text() == title]


def test_a_name_keeps_its_ends():
    assert shortened_to_width("ekf_cv", 100.0) == "ekf_cv"
    cut = shortened_to_width(LONG, 120.0, 10)
    assert text_width(cut, 10) <= 120.0
    head, tail = cut.split("…")
    assert LONG.startswith(head)
    assert LONG.endswith(tail)
    assert len(tail) >= len(head) > 5
    widths = [text_width(shortened_to_width(LONG, width)) for width in np.linspace(20, 400, 30)]
    assert widths == sorted(widths)
