"""Figures drawn by matplotlib: as SVG in the fonts and colours of a page, and as SVG, PDF and PNG files.

A figure has the same bytes on every machine: no date, fixed ids, and no settings of the user's matplotlibrc.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import get_named_colors_mapping
from matplotlib.figure import Figure as Canvas
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Annotation
from matplotlib.textpath import text_to_path
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry

#: Named colours of text and bounds, of grid lines, and of bands and surroundings.
INK, GRID, MUTED = "trackbench:ink", "trackbench:grid", "trackbench:muted"
_ON_WHITE = {INK: "#1c2126", GRID: "#e3e6e9", MUTED: "#7a828b"}
#: Placeholders that a page replaces by its light or dark colours. None is pure black, which an SVG leaves out.
_STAND_INS = {INK: "#010203", GRID: "#020304", MUTED: "#030405"}
IN_PAGE = {INK: "currentColor", GRID: "var(--grid)", MUTED: "var(--muted)"}

#: Width of a figure, points (pixels of a page); narrow enough for a phone.
WIDTH = 430.0
DASHED = (0, (4, 2))
#: Matplotlib's marker of each mark of a legend, and its size in points.
MARKERS = {
    "dot": ("o", 4), "ring": ("o", 7), "cross": ("x", 7), "plus": ("+", 7), "triangle": ("^", 7), "upright": ("|", 10),
}  # fmt: skip
#: Height of a legend's line and width of a letter, points.
_LEGEND_LINE, _LEGEND_LETTER = 17.0, 6.0
_STYLE = Path(__file__).parent / "templates" / "figure.mplstyle"
#: Padding around the panels of a figure, inches.
_PAD = 1.0 / 72

_NUMBER = re.compile(r"-?\d+\.\d+")
_REFERENCE = re.compile(r"#([\w.]+)")
_REFERENCE_IN_STYLE = re.compile(r"url\(#([\w.]+)\)")
_FONT_FAMILY = re.compile(r"font-family: [^;]*;? ?")
_GEOMETRY = ("d", "x", "y", "width", "height", "transform", "points", "style")


def svg_in_page(figure: Figure) -> str:
    """Return a figure as ``<svg>`` element for an HTML page; its legend is left out, since the page shows it.

    A matplotlib artist with a tooltip gets its gid as CSS class.
    """
    with _drawn(figure, _STAND_INS, legend=False) as canvas:
        svg = ElementTree.fromstring(_saved(canvas, "svg"))
    _clean(svg, figure.name, figure.tooltips)
    box = svg.attrib["viewBox"]
    svg.attrib = {"viewBox": box, "class": "plot", "role": "img", "aria-label": figure.alternative}
    markup = ElementTree.tostring(svg, encoding="unicode", short_empty_elements=True)
    for name, stand_in in _STAND_INS.items():
        markup = markup.replace(stand_in, IN_PAGE[name])
    return markup


def svg_file(figure: Figure) -> str:
    """Return a figure as the text of an SVG file, on white and with its legend."""
    svg = ElementTree.fromstring(_drawn_file(figure, "svg"))
    _clean(svg, figure.name, {})
    _, _, width, height = svg.attrib["viewBox"].split()
    svg.attrib = {
        "xmlns": "http://www.w3.org/2000/svg",
        "viewBox": svg.attrib["viewBox"],
        "width": width,
        "height": height,
        "font-family": "system-ui, sans-serif",
        "role": "img",
        "aria-label": figure.alternative,
    }
    svg.insert(0, ElementTree.Element("rect", {"width": width, "height": height, "fill": "#ffffff"}))
    return ElementTree.tostring(svg, encoding="unicode") + "\n"


def figure_file(figure: Figure, kind: str) -> bytes:
    """Return a figure as the content of an "svg", "pdf" or "png" file, on white and with its legend."""
    return svg_file(figure).encode() if kind == "svg" else _drawn_file(figure, kind)


def matplotlib_figure(figure: Figure) -> Canvas:
    """Return the matplotlib figure with painted content, on a white ground and with its legend."""
    with _drawn(figure, _ON_WHITE, legend=True) as canvas:
        canvas.set_facecolor("white")
    return canvas


#: Metadata left out of each kind of file, as they change with the day or the version of matplotlib.
_OMITTED_METADATA = {
    "svg": ("Creator", "Date", "Format", "Type"),
    "pdf": ("Creator", "CreationDate", "Producer"),
    "png": ("Software",),
}
#: Pixels of a PNG per point.
_PNG_SCALE = 3


def _drawn_file(figure: Figure, kind: str) -> bytes:
    with _drawn(figure, _ON_WHITE, legend=True) as canvas:
        return _saved(canvas, kind)


def _saved(canvas: Canvas, kind: str) -> bytes:
    buffer = io.BytesIO()
    options: dict[str, Any] = {"dpi": 72 * _PNG_SCALE, "facecolor": "white"} if kind == "png" else {}
    canvas.savefig(buffer, format=kind, metadata=dict.fromkeys(_OMITTED_METADATA[kind]), **options)
    return buffer.getvalue()


@contextmanager
def _drawn(figure: Figure, colours: Mapping[str, str], *, legend: bool) -> Iterator[Canvas]:
    """Yield the painted matplotlib figure; named colours and settings hold until the context ends."""
    width = figure.width or WIDTH
    columns = _legend_columns(figure.legend, width) if legend and figure.legend else 0
    height = figure.height + (_LEGEND_LINE * -(-len(figure.legend) // columns) + 8 if columns else 0)
    with _colours(colours), matplotlib.style.context(_STYLE, after_reset=True):
        canvas = Canvas(
            figsize=(width / 72, height / 72), dpi=72, layout=ConstrainedLayoutEngine(h_pad=_PAD, w_pad=_PAD)
        )
        figure.paint(canvas)
        # Lines and texts inside a panel need no margin; annotations, which stand beside a point, do.
        for artist in (artist for axes in canvas.axes for artist in (*axes.lines, *axes.texts)):
            artist.set_in_layout(isinstance(artist, Annotation))
        is_placed_by_hand = not any(axes.get_subplotspec() for axes in canvas.axes)
        if is_placed_by_hand:
            canvas.set_layout_engine("none")
        if columns:
            handles = [_handle(entry, width) for entry in figure.legend]
            canvas.legend(
                handles=handles,
                loc="lower left" if is_placed_by_hand else "outside lower left",
                borderaxespad=0.3,
                ncols=columns,
                handlelength=1.6,
            )
        yield canvas


@contextmanager
def _colours(colours: Mapping[str, str]) -> Iterator[None]:
    """Set the named colours while a figure is drawn, and afterwards the colours for a white ground."""
    _name_colours(colours)
    try:
        yield
    finally:
        _name_colours(_ON_WHITE)


def _name_colours(colours: Mapping[str, str]) -> None:
    named_colours = get_named_colors_mapping()
    for name, colour in colours.items():
        # Matplotlib's update() would keep its cache of the former colours.
        named_colours[name] = colour


def _legend_columns(entries: tuple[LegendEntry, ...], width: float) -> int:
    longest = max(len(entry.label) for entry in entries)
    return max(1, min(len(entries), int(width / (_LEGEND_LETTER * longest + 40))))


def _handle(entry: LegendEntry, width: float) -> Artist:
    label = shortened_to_width(entry.label, width - 40, 10)
    if entry.mark == "band":
        return Patch(color=entry.colour, alpha=0.35, label=label)
    if entry.mark == "box":
        return Patch(color=entry.colour, label=label)
    if entry.mark in MARKERS:
        marker, size = MARKERS[entry.mark]
        fill = "none" if entry.mark == "ring" else entry.colour
        return Line2D(
            [], [], color=entry.colour, marker=marker, markersize=size, markerfacecolor=fill, linestyle="none",
            label=label,
        )  # fmt: skip
    style: Any = DASHED if entry.mark == "dash" else "solid"
    return Line2D([], [], color=entry.colour, linestyle=style, linewidth=2, label=label)


def _clean(svg: ElementTree.Element, prefix: str, titles: Mapping[str, str]) -> None:
    for parent in list(svg.iter()):
        parent.text = parent.text if parent.text and parent.text.strip() else None
        for child in list(parent):
            child.tail = None
            if child.tag.endswith("}metadata") or child.find("{*}style") is not None:
                parent.remove(child)
    used = set(_REFERENCE.findall(ElementTree.tostring(svg, encoding="unicode")))
    for element in list(svg.iter()):
        element.tag = element.tag.rpartition("}")[2]
        old = {key.rpartition("}")[2]: " ".join(value.split()) for key, value in element.attrib.items()}
        identity = old.pop("id", "")
        new = {key: _attribute(key, value, prefix) for key, value in old.items()}
        if identity in titles:
            new["class"] = identity
            title = ElementTree.Element("title")
            title.text = titles[identity]
            element.insert(0, title)
        elif identity in used:
            new["id"] = f"{prefix}-{identity}"
        element.attrib = new


def _attribute(key: str, value: str, prefix: str) -> str:
    if key == "href" or value.startswith("url("):
        return _REFERENCE.sub(rf"#{prefix}-\1", value)
    if key == "style":
        value = _REFERENCE_IN_STYLE.sub(rf"url(#{prefix}-\1)", _FONT_FAMILY.sub("", value))
    return _NUMBER.sub(_rounded, value) if key in _GEOMETRY else value


def _rounded(match: re.Match[str]) -> str:
    # A hundredth of a pixel makes the file a tenth as long.
    return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")


#: Values that differ by more than this factor are drawn on a logarithmic axis.
LOG_ABOVE = 15.0
TIME_LABEL = "time, s"


def time_axis(axes: Axes, end: float) -> None:
    """Let the x axis show time from 0 to ``end`` s, with round tick labels."""
    axes.set_xlim(0, end)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    axes.grid(axis="x", color=GRID, linewidth=0.6)


def panel_title(axes: Axes, name: str, width: float) -> None:
    """Set the title of a panel, shortened to fit ``width``, the panel's width with tick labels, points."""
    # A fixed height saves matplotlib the search for overlaps.
    axes.set_title(shortened_to_width(name, width - 30, 10), fontsize=10, loc="left", pad=2, y=1.0)


def fit_value_axis(axes: Axes, drawn: Sequence[Array]) -> bool:
    """Fit the y axis to the values ``drawn`` on it; make the axis logarithmic if they span orders of magnitude.

    Returns:
        Whether the axis is logarithmic.
    """
    values = np.concatenate([np.ravel(values) for values in drawn]) if drawn else np.empty(0)
    values = values[np.isfinite(values)]
    positive = values[values > 0]
    if not positive.size:
        return False
    if positive.max() < LOG_ABOVE * np.quantile(positive, 0.1):
        axes.set_ylim(0, 1.06 * float(positive.max()))
        return False
    # Exceptionally small values, such as an error that crosses zero, must not take up the axis.
    logarithmic(axes, "y")
    axes.set_ylim(0.8 * float(np.quantile(positive, 0.005)), 1.25 * float(positive.max()))
    return True


def logarithmic(axes: Axes, name: Literal["x", "y"]) -> None:
    """Make the x or y axis logarithmic, with plain numbers at 1, 2 and 5."""
    axis = axes.xaxis if name == "x" else axes.yaxis
    (axes.set_xscale if name == "x" else axes.set_yscale)("log")
    axis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_tick_params(labelsize=10)


def shortened_to_width(text: str, width: float, size: float = 11.0) -> str:
    """Return a text that is at most ``width`` points wide; a wider one has its middle replaced by "…"."""
    short = text
    for letters in range(len(text) - 1, 1, -1):
        if _line_width(short, size) <= width:
            break
        short = f"{text[: letters // 2]}…{text[-(letters - letters // 2) :]}"
    return short


@lru_cache(maxsize=4096)
def _line_width(line: str, size: float) -> float:
    return float(text_to_path.get_text_width_height_descent(line, FontProperties(size=size), ismath=False)[0])
