"""Figures drawn by matplotlib, as SVG that lives inside a page: its fonts, its text colour, light and dark.

Drawn the same on every machine: no date, fixed ids, default settings whatever the user's matplotlibrc says.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping
from typing import Any
from xml.etree import ElementTree

import matplotlib
from matplotlib.figure import Figure

# Stand-ins, replaced by what the page defines; pure black would be left out of the SVG as its default.
INK = "#010203"
GRID = "#020304"
MUTED = "#030405"
_IN_PAGE = {INK: "currentColor", GRID: "var(--grid)", MUTED: "var(--muted)"}
_STANDALONE = {INK: "#1c2126", GRID: "#e3e6e9", MUTED: "#7a828b"}

#: Points of an SVG, shown as pixels of a page; narrow enough to be read on a phone.
WIDTH = 430

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "trackbench",
    "font.size": 11,
    "axes.labelsize": 11,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.facecolor": "none",
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.unicode_minus": True,
    "figure.facecolor": "none",
    "figure.labelsize": 11,
    "savefig.facecolor": "none",
    "grid.color": GRID,
    "grid.linewidth": 1.0,
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "round",
    "patch.linewidth": 0,
    "path.simplify_threshold": 0.3,
    "text.color": INK,
    "text.parse_math": False,
    "xtick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.color": MUTED,
    "ytick.labelcolor": INK,
}

_NUMBER = re.compile(r"-?\d+\.\d+")
_REFERENCE = re.compile(r"#([\w.]+)")
_FONT_FAMILY = re.compile(r"font-family: [^;]*;? ?")
_GEOMETRY = ("d", "x", "y", "width", "height", "transform", "points", "style")


def draw(paint: Callable[[Figure], None], height: float, *, width: float = WIDTH) -> ElementTree.Element:
    """The ``<svg>`` that ``paint`` draws on an empty figure of so many pixels."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=(width / 72, height / 72), dpi=72, layout="constrained")
        paint(figure)
        buffer = io.BytesIO()
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(buffer, format="svg", metadata=nothing)
    return ElementTree.fromstring(buffer.getvalue())


def in_page(svg: ElementTree.Element, name: str, alternative: str, titles: Mapping[str, str]) -> str:
    """Markup for a page; ``name`` keeps its ids apart from those of other figures.

    ``alternative`` is the text for those who cannot see it. An artist whose gid is a key of ``titles`` gets that gid
    as its class and the title as its tooltip.
    """
    _clean(svg, name, titles)
    svg.attrib = {"viewBox": svg.attrib["viewBox"], "class": "plot", "role": "img", "aria-label": alternative}
    return _recoloured(ElementTree.tostring(svg, encoding="unicode", short_empty_elements=True), _IN_PAGE)


def standalone(svg: ElementTree.Element, alternative: str) -> str:
    """A file of its own, on white, for pages that show it as an image."""
    _clean(svg, "figure", {})
    _, _, width, height = svg.attrib["viewBox"].split()
    svg.attrib = {
        "xmlns": "http://www.w3.org/2000/svg",
        "viewBox": svg.attrib["viewBox"],
        "width": width,
        "height": height,
        "font-family": "system-ui, sans-serif",
        "role": "img",
        "aria-label": alternative,
    }
    svg.insert(0, ElementTree.Element("rect", {"width": width, "height": height, "fill": "#ffffff"}))
    return _recoloured(ElementTree.tostring(svg, encoding="unicode"), _STANDALONE) + "\n"


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
        value = _FONT_FAMILY.sub("", value)
    return _NUMBER.sub(_rounded, value) if key in _GEOMETRY else value


def _rounded(match: re.Match[str]) -> str:
    """To a hundredth of a pixel: a tenth of the file is then enough."""
    return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")


def _recoloured(markup: str, colours: Mapping[str, str]) -> str:
    for stand_in, colour in colours.items():
        markup = markup.replace(stand_in, colour)
    return markup
