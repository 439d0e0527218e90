"""Axes whose ticks are drawn together, and margins computed from the labels that stand in them.

Matplotlib makes five artists for each tick, which took two thirds of the time of a figure. A layout solver draws every
label twice before the figure is drawn: half of its time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, Tick, XAxis, YAxis
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.figure import Figure as Canvas
from matplotlib.font_manager import FontProperties
from matplotlib.gridspec import SubplotSpec
from matplotlib.text import Annotation, Text
from matplotlib.textpath import text_to_path
from matplotlib.transforms import Bbox


class QuickFigure(Figure):
    """A figure of :class:`QuickAxes`."""

    def add_subplot(self, *args: Any, **options: Any) -> Any:
        """As of its base."""
        return super().add_subplot(*args, **{"axes_class": QuickAxes, **options})

    def add_axes(self, *args: Any, **options: Any) -> Any:
        """As of its base."""
        return super().add_axes(*args, **{"axes_class": QuickAxes, **options})


class QuickAxes(Axes):
    """Axes without minor ticks, whose major ticks are copies of one."""

    def _init_axis(self) -> None:
        self.xaxis, self.yaxis = _QuickX(self, clear=False), _QuickY(self, clear=False)
        for axis, sides in ((self.xaxis, ("bottom", "top")), (self.yaxis, ("left", "right"))):
            for side in sides:
                self.spines[side].register_axis(axis)


class _QuickAxis(Axis):
    minorTicks: list[Tick] = []  # noqa: RUF012 (matplotlib's is a descriptor)
    if TYPE_CHECKING:
        # Of XAxis and YAxis.
        __name__: str
        axis_name: str
        _update_label_position: Callable[[RendererBase], None]
        _update_offset_text_position: Callable[[list[Bbox], list[Bbox]], None]

    def get_major_ticks(self, numticks: int | None = None) -> list[Tick]:
        """The one that stands for all."""
        return list(self.majorTicks[:1])

    def get_minor_ticks(self, numticks: int | None = None) -> list[Tick]:
        """None."""
        return []

    def draw(self, renderer: RendererBase) -> None:
        """Grid lines as one line, marks as those of one line, each number by the same text."""
        if not self.get_visible():
            return
        renderer.open_group(self.__name__, gid=self.get_gid())
        places, texts = places_in_view(self)
        pattern = self.majorTicks[0]
        self._draw_lines(pattern, places, renderer)
        self._boxes = [self._draw_numbers(text, places, texts, renderer) for text in (pattern.label1, pattern.label2)]
        self._update_label_position(renderer)
        self.label.draw(renderer)
        if offset := self.get_major_formatter().get_offset():
            self._update_offset_text_position(*self._boxes)
            self.offsetText.set_text(offset)
            self.offsetText.draw(renderer)
        renderer.close_group(self.__name__)
        self.stale = False

    def _draw_lines(self, pattern: Tick, places: np.ndarray, renderer: RendererBase) -> None:
        gap = np.full(len(places), np.nan)
        along, across = np.stack([places, places, gap], axis=1).ravel(), np.tile([0.0, 1.0, np.nan], len(places))
        pattern.gridline.set_data(*self._xy(along, across))
        pattern.tick1line.set_data(*self._xy(places, np.zeros(len(places))))
        pattern.tick2line.set_data(*self._xy(places, np.ones(len(places))))
        for line in (pattern.gridline, pattern.tick1line, pattern.tick2line):
            line.draw(renderer)

    def _draw_numbers(
        self, pattern: Text, places: np.ndarray, texts: Sequence[str], renderer: RendererBase
    ) -> list[Bbox]:
        """Draw them, and return a box that reaches as far from the panel as they do; none where none is shown."""
        if not texts or not pattern.get_visible():
            return []
        for place, text in zip(places, texts, strict=True):
            pattern.set_text(text)
            pattern.set(**{self.axis_name: place})
            pattern.draw(renderer)
        pattern.set_text(max(texts, key=lambda text: (text.count("\n"), text_width(text))))
        return [pattern.get_window_extent(renderer)]

    def _xy(self, along: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (along, across) if self.axis_name == "x" else (across, along)

    def _get_tick_boxes_siblings(self, renderer: RendererBase) -> list[list[Bbox]]:
        # From these matplotlib places the label of the axis.
        return self._boxes


class _QuickX(_QuickAxis, XAxis):
    pass


class _QuickY(_QuickAxis, YAxis):
    pass


#: Points: of a letter's height, of a tick with its distance from the number, between a label and the numbers, of the
#: title of a panel, and around everything.
SIZE, TICK, GAP, TITLE, PAD = 11.0, 7.0, 4.0, 15.0, 3.0
#: Lines of text are so many times their size apart.
LINE = 1.2
#: No side takes more of the figure than this.
_MOST = 0.6


class _Room(NamedTuple):
    """What stands beside an axes box, in points."""

    left: float
    right: float
    bottom: float
    top: float


def fit_margins(canvas: Canvas, below: float = 0.0) -> None:
    """Place the panels of a figure so that numbers, labels and titles have room and do not overlap.

    Args:
        canvas: the figure, painted, of one grid of panels or with axes that were placed by hand, which stay.
        below: what else stands below it, points.
    """
    specs = ((axes, axes.get_subplotspec()) for axes in canvas.axes if axes.get_visible())
    panels = [(axes, spec) for axes, spec in specs if spec is not None]
    # The second time numbers and names are known where they stand.
    for _ in range(2 if panels else 0):
        _place(canvas, panels, below)


def text_width(text: str, size: float = SIZE) -> float:
    """The width of a text's longest line, points."""
    return max((_line_width(line, size) for line in text.split("\n")), default=0.0)


def shortened_to_width(text: str, width: float, size: float = SIZE) -> str:
    """The text, without its middle if it is wider than ``width`` points: names of a sweep differ at the end."""
    short = text
    for kept in range(len(text) - 1, 1, -1):
        if text_width(short, size) <= width:
            break
        short = f"{text[: kept // 2]}…{text[-(kept - kept // 2) :]}"
    return short


@lru_cache(maxsize=4096)
def _line_width(line: str, size: float) -> float:
    return float(text_to_path.get_text_width_height_descent(line, FontProperties(size=size), ismath=False)[0])


def _place(canvas: Canvas, panels: Sequence[tuple[Axes, SubplotSpec]], below: float) -> None:
    width, height = canvas.get_size_inches() * 72
    grid = panels[0][1].get_gridspec()
    last_column, last_row = grid.ncols - 1, grid.nrows - 1
    rooms = [(spec.colspan.start, spec.rowspan.start, _room(axes)) for axes, spec in panels]
    left = min(_MOST * width, PAD + max((room.left for column, _, room in rooms if column == 0), default=0.0))
    right = min(
        _MOST * width, PAD + max((room.right for column, _, room in rooms if column == last_column), default=0.0)
    )
    top = PAD + max((room.top for _, row, room in rooms if row == 0), default=0.0)
    bottom = PAD + below + max((room.bottom for _, row, room in rooms if row == last_row), default=0.0)
    across = 2 * PAD
    across += max((room.right for column, _, room in rooms if column < last_column), default=0.0)
    across += max((room.left for column, _, room in rooms if column > 0), default=0.0)
    down = 2 * PAD
    down += max((room.bottom for _, row, room in rooms if row < last_row), default=0.0)
    down += max((room.top for _, row, room in rooms if row > 0), default=0.0)
    panel_width = max(1.0, (width - left - right - last_column * across) / grid.ncols)
    panel_height = max(1.0, (height - top - bottom - last_row * down) / grid.nrows)
    canvas.subplots_adjust(
        left=left / width,
        right=(left + grid.ncols * panel_width + last_column * across) / width,
        bottom=bottom / height,
        top=(bottom + grid.nrows * panel_height + last_row * down) / height,
        wspace=across / panel_width,
        hspace=down / panel_height,
    )


def _room(axes: Axes) -> _Room:
    axes.apply_aspect()
    box = axes.get_window_extent()
    top = TITLE if axes.get_title(loc="left") else 0.0
    right = 0.0
    x_places, x_texts, x_side = _numbers(axes.xaxis)
    tall = max((_height(axes.xaxis, text) for text in x_texts), default=-TICK) + TICK
    if x_texts and not _upright(axes.xaxis):
        ends = axes.get_xaxis_transform().transform(np.stack([x_places, np.zeros(len(x_places))], axis=1))[:, 0]
        right = max(0.0, *(end + text_width(text) / 2 - box.x1 for end, text in zip(ends, x_texts, strict=True)))
    bottom = 0.0 if x_side == "top" else tall
    top += tall if x_side == "top" else 0.0
    bottom += _label(axes.xaxis)
    _, y_texts, _ = _numbers(axes.yaxis)
    left = max((text_width(text) for text in y_texts), default=-TICK) + TICK + _label(axes.yaxis)
    if y_texts:
        # Half of the uppermost number, or the power of ten that stands above all.
        top = max(top, SIZE * (LINE + 0.3 if axes.yaxis.get_major_formatter().get_offset() else LINE / 2))
    for text in axes.texts:
        if isinstance(text, Annotation):
            begin = axes.transData.transform(text.xy)[0] + text.xyann[0]
            wide = text_width(text.get_text(), float(text.get_fontsize()))
            if text.get_horizontalalignment() == "left":
                right = max(right, begin + wide - box.x1)
            else:
                left = max(left, box.x0 - begin + wide)
    return _Room(left, right, bottom, top)


def places_in_view(axis: Axis) -> tuple[np.ndarray, list[str]]:
    """Where the major ticks of an axis are, and their numbers."""
    along = axis.get_transform().transform
    low, high = sorted(along(axis.get_view_interval()))
    slack = 1e-10 * (high - low)
    places = axis.get_majorticklocs()
    texts = axis.get_major_formatter().format_ticks(list(places))
    inside = (along(places) >= low - slack) & (along(places) <= high + slack)
    return places[inside], [text for text, there in zip(texts, inside, strict=True) if there]


def _numbers(axis: Axis) -> tuple[np.ndarray, list[str], str]:
    """Places and texts of the numbers that are shown at an axis, and the side on which they stand."""
    shown = axis.get_tick_params(which="major")
    if not any(shown.get(f"label{side}", False) for side in ("left", "right", "bottom", "top")):
        return np.empty(0), [], ""
    return *places_in_view(axis), "top" if shown.get("labeltop") else ""


def _upright(axis: Axis) -> bool:
    return bool(axis.get_tick_params(which="major").get("rotation", 0.0) == 90.0)


def _height(axis: Axis, text: str) -> float:
    return text_width(text) if _upright(axis) else SIZE * LINE * (1 + text.count("\n"))


def _label(axis: Axis) -> float:
    return SIZE * LINE + GAP if axis.get_label_text() else 0.0
