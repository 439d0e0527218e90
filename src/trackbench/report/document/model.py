"""The parts of a document."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from matplotlib import figure

Tone = Literal["", "good", "warn", "bad"]


@dataclass(frozen=True)
class Cell:
    """A cell of a table."""

    text: str
    details: tuple[str, ...] = ()
    """Lines of small print under the text."""
    tone: Tone = ""
    reason: str = ""
    """Why there is no value; a footnote."""
    tracker: str = ""
    """The tracker that the cell names, if it does."""
    strong: bool = False
    """Whether it stands out, as the best do."""
    link: str = ""
    """Where it leads: a path relative to the document."""


@dataclass(frozen=True)
class Column:
    """The heading of a column."""

    heading: str
    explanation: str = ""
    left: bool = False
    """Whether its cells are flush left (names, sentences) and not flush right (numbers)."""


@dataclass(frozen=True)
class Table:
    """Rows of cells. A renderer numbers the reasons of missing values as footnotes."""

    name: str
    """Of its file, where tables are files of their own (CSV, LaTeX)."""
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""

    @property
    def reasons(self) -> list[str]:
        """Every reason for a missing value, once."""
        return list(dict.fromkeys(cell.reason for row in self.rows for cell in row if cell.reason))


@dataclass(frozen=True)
class LegendEntry:
    """A line of a figure's legend."""

    label: str
    colour: str
    """A CSS colour."""
    mark: Literal["line", "dash", "band", "dot", "ring"] = "line"
    key: str = ""
    """Class of what is drawn of the tracker, where the entry is one."""


@dataclass(frozen=True)
class Figure:
    """A figure, drawn when a renderer needs it."""

    name: str
    """Of its file."""
    title: str
    caption: str
    alternative: str
    """What it shows, for those who cannot see it."""
    paint: Callable[[figure.Figure], None]
    """Draws it on an empty matplotlib figure."""
    height: float
    """Pixels."""
    width: float | None = None
    """Pixels; the width of a column of text unless given."""
    legend: tuple[LegendEntry, ...] = ()
    tooltips: Mapping[str, str] = field(default_factory=dict)
    """By the gid of an artist."""


@dataclass(frozen=True)
class Paragraph:
    """A sentence or more."""

    text: str
    strong: bool = False
    tone: Tone = ""


@dataclass(frozen=True)
class Items:
    """A list."""

    texts: tuple[str, ...]
    numbered: bool = False


@dataclass(frozen=True)
class Code:
    """Text as it is."""

    text: str
    language: str = ""


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it; sections nest."""

    title: str
    blocks: tuple[Block, ...]
    folded: bool = False
    """Whether a page that can fold shows it closed."""


Block = Paragraph | Items | Code | Table | Figure | Section


@dataclass(frozen=True)
class Document:
    """A whole report."""

    title: str
    blocks: tuple[Block, ...]
    trackers: tuple[str, ...] = ()
    """Every tracker in its order, which gives each its colour."""
