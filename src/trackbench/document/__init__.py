"""A document as data: what a report says, free of any markup. Each renderer writes the same document in its format.

The first screen of a page is a section of these, in this order: a strong :class:`Paragraph` (the answer), a
:class:`Status` (expectations or gate), a :class:`Row` of a table and a figure, and folded sections (``folded=True``).
Its table has bars (``Cell(text, bar=(value, low, high), tracker=name)`` under a ``Column``) and words of verdicts
(``Cell("optimistic", tone="bad", chip=True)``); other formats show the texts alone. A page makes its navigation of the
top sections, sets units and their spaces (:func:`typeset`), and scrolls wide tables under their key column.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib import figure

    from trackbench.document.replay import ReplayScene

Tone = Literal["", "good", "warn", "bad"]


@dataclass(frozen=True)
class TrackerStyle:
    """How a tracker is drawn, the same in every figure."""

    key: str
    """Class and gid of all that is drawn of it."""
    name: str
    colour: str
    line: Any = "solid"
    """A matplotlib line style; where colours repeat, they do with another one and a marker."""
    marker: str = ""

    @property
    def look(self) -> dict[str, Any]:
        """What matplotlib draws its lines with."""
        return {"color": self.colour, "linestyle": self.line, "marker": self.marker, "markevery": 0.1, "gid": self.key}

    @property
    def dot(self) -> dict[str, Any]:
        """What matplotlib draws its points with."""
        return {"color": self.colour, "linestyle": "none", "marker": self.marker or "o", "gid": self.key}


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
    chip: bool = False
    """Whether it is the word of a verdict, which a page shows as a label in its tone."""
    bar: tuple[float, float, float] | None = None
    """A value and the ends of its interval, which a page draws under the text on the axis of the column."""


#: A value more than so many times the lower median of all is far out.
FAR = 4.0


def end_of_axis(sizes: Iterable[float]) -> float:
    """The largest of some sizes but for those far out, which an axis cuts off; 0 of none."""
    ordered = sorted(size for size in sizes if size > 0)
    near = FAR * ordered[(len(ordered) - 1) // 2] if ordered else 0.0
    return max((size for size in ordered if size <= near), default=0.0)


@dataclass(frozen=True)
class Column:
    """The heading of a column."""

    heading: str
    """With the unit of the numbers under it."""
    explanation: str = ""
    left: bool = False
    """Whether its cells are flush left (names, sentences) and not flush right (numbers)."""
    details: str = "details"
    """What the small print in its cells is."""


@dataclass(frozen=True)
class Table:
    """Rows of cells. A renderer numbers the reasons of missing values as footnotes."""

    name: str
    """Of its file, where tables are files of their own (CSV, LaTeX)."""
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""

    @classmethod
    def of_columns(cls, name: str, columns: Sequence[tuple[Column, Sequence[Cell]]], caption: str = "") -> Table:
        """A table from its columns, each with its cells from the top."""
        rows = zip(*(cells for _, cells in columns), strict=True)
        return cls(name, tuple(column for column, _ in columns), tuple(rows), caption)

    @property
    def reasons(self) -> list[str]:
        """Every reason for a missing value, once."""
        return list(dict.fromkeys(cell.reason for row in self.rows for cell in row if cell.reason))

    @property
    def key_column(self) -> int:
        """The number of the column that says what a row is about; it stays in sight where the table scrolls."""
        first = self.rows[0] if self.rows else ()
        return next((i for i, cell in enumerate(first) if cell.tracker), 0)

    def axis(self, index: int) -> tuple[float, float]:
        """The ends of the axis of the bars of a column: from zero to the largest that is not far out."""
        bars = [row[index].bar for row in self.rows]
        near = end_of_axis(abs(bar[0]) for bar in bars if bar)
        shown = [end for bar in bars if bar and abs(bar[0]) <= near for end in bar]
        return min(0.0, *shown), max(0.0, *shown)

    def mark(self, cell: Cell) -> str:
        """The number of the footnote of a cell, or nothing."""
        return str(self.reasons.index(cell.reason) + 1) if cell.reason else ""


@dataclass(frozen=True)
class LegendEntry:
    """A line of a figure's legend."""

    label: str
    colour: str
    """``#rrggbb``, or one of the colours of :mod:`trackbench.document.drawing`."""
    mark: Literal["line", "dash", "band", "dot", "box", "upright", "cross", "plus", "ring", "triangle"] = "line"
    key: str = ""
    """That of the tracker, where the entry is one."""


@dataclass(frozen=True)
class Figure:
    """A figure, drawn only when a renderer needs it."""

    name: str
    """Of its file; letters, digits and dashes."""
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
    replay: ReplayScene | None = None
    """Scene that a page plays in place of the figure."""


@dataclass(frozen=True)
class Paragraph:
    """A sentence or more."""

    text: str
    strong: bool = False


@dataclass(frozen=True)
class Status:
    """A few words that stand out, such as "2 of 3 expectations failed"."""

    text: str
    tone: Tone = ""


@dataclass(frozen=True)
class Item:
    """A line of a list."""

    text: str
    label: str = ""
    """What it is about, before the text."""
    detail: str = ""
    """Small print."""
    tracker: str = ""
    """The tracker that the label names, if it does."""
    tone: Tone = ""


@dataclass(frozen=True)
class Items:
    """A list."""

    items: tuple[Item, ...]
    numbered: bool = False


@dataclass(frozen=True)
class Code:
    """Text as it is."""

    text: str
    language: str = ""


@dataclass(frozen=True)
class Row:
    """Blocks that stand beside each other where there is room."""

    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it; sections nest."""

    title: str
    blocks: tuple[Block, ...]
    folded: bool = False
    """Whether a page that can fold shows it closed."""


Block = Paragraph | Status | Items | Code | Table | Figure | Row | Section


@dataclass(frozen=True)
class Document:
    """A whole report."""

    kind: str
    """Such as "report" or "comparison"."""
    title: str
    blocks: tuple[Block, ...]
    lead: str = ""
    """A sentence under the title."""
    facts: tuple[str, ...] = ()
    """A few words each."""
    trackers: tuple[TrackerStyle, ...] = ()
    """How each tracker that is drawn looks."""

    @property
    def tables(self) -> list[Table]:
        """All tables, in their order."""
        return [block for block in every(self.blocks) if isinstance(block, Table)]

    @property
    def figures(self) -> list[Figure]:
        """All figures, in their order."""
        return [block for block in every(self.blocks) if isinstance(block, Figure)]


def every(blocks: Sequence[Block]) -> Iterator[Block]:
    """All blocks, and after each row or section those that are in it."""
    for block in blocks:
        yield block
        if isinstance(block, (Row, Section)):
            yield from every(block.blocks)


def named_apart(blocks: Sequence[Block], part: str) -> tuple[Block, ...]:
    """The blocks of one part of a document, the names of whose tables and figures begin with that of the part."""
    kept: list[Block] = []
    for block in blocks:
        if isinstance(block, (Row, Section)):
            kept.append(replace(block, blocks=named_apart(block.blocks, part)))
        elif isinstance(block, (Table, Figure)):
            kept.append(replace(block, name=f"{part.replace('_', '-')}-{block.name}"))
        else:
            kept.append(block)
    return tuple(kept)


def without_figures(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """The blocks for a format that shows no figure; a row or section that held nothing else is left out."""
    kept: list[Block] = []
    for block in blocks:
        if isinstance(block, (Row, Section)):
            inner = without_figures(block.blocks)
            kept += [replace(block, blocks=inner)] if inner else []
        elif not isinstance(block, Figure):
            kept.append(block)
    return tuple(kept)


_POWER = re.compile(r"\b((?:m|s|rad|deg)(?:/s)?)\^([23])(?!\.?\d)|\b(m/s)([23])\b")
_UNIT = re.compile(r"(?<=\d) (?=(?:%|°|[mckµ]?m[²³]?|[mµn]?s|k?Hz|rad|deg|dB|MB|kB)(?:/(?:s[²³]?|h))?(?![\w-]))")


def with_powers(text: str) -> str:
    """A text with powers of units as signs: m/s²."""
    return _POWER.sub(lambda match: f"{match[1] or match[3]}{'²³'[int(match[2] or match[4]) - 2]}", text)


def typeset(text: str) -> str:
    """The same without a break between a number and its unit."""
    return _UNIT.sub("\N{NO-BREAK SPACE}", with_powers(text))
