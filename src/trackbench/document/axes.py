"""Axes whose ticks are drawn together.

Matplotlib makes five artists for each tick, which took two thirds of the time of a figure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, Tick, XAxis, YAxis
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from trackbench.document.margins import places_in_view, text_width


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
