"""Reports as data, free of markup, and their renderers for a terminal, HTML, Markdown, LaTeX, CSV and image files.

A report builds a :class:`Document` from the blocks in this file, which is the file to read first;
:func:`trackbench.document.files.files` returns the document's files in a format.

The first screen of a page is a section with a strong :class:`Paragraph` (the answer), a :class:`Status`, a :class:`Row`
of a table and a figure, and folded sections. Its table has bars (``Cell(text, bar=(value, low, high), tracker=name)``)
and verdicts (``Cell("optimistic", tone="bad", chip=True)``); other formats show only the texts.
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
    """Colour, line and marker of a tracker in every figure."""

    key: str
    """CSS class and SVG id of all lines and markers of the tracker."""
    name: str
    colour: str
    line: Any = "solid"
    """Line style of matplotlib; line and marker distinguish trackers that share a colour."""
    marker: str = ""

    @property
    def line_options(self) -> dict[str, Any]:
        """Keyword arguments of matplotlib for the tracker's lines, such as colour and line style."""
        return {"color": self.colour, "linestyle": self.line, "marker": self.marker, "markevery": 0.1, "gid": self.key}

    @property
    def point_options(self) -> dict[str, Any]:
        """Keyword arguments of matplotlib for the tracker's points, such as colour and marker."""
        return {"color": self.colour, "linestyle": "none", "marker": self.marker or "o", "gid": self.key}


@dataclass(frozen=True)
class Cell:
    """Text in a table, with its emphasis, small print, footnote and bar."""

    text: str
    details: tuple[str, ...] = ()
    """Lines of small print under the text."""
    tone: Tone = ""
    reason: str = ""
    """Reason for a missing value, shown as a footnote."""
    tracker: str = ""
    """Name of the tracker, if the cell is its name; else empty."""
    strong: bool = False
    """Whether the cell stands out, such as the best value."""
    link: str = ""
    """Path that the cell links to, relative to the document; empty for no link."""
    chip: bool = False
    """Whether an HTML page shows the text, a verdict, as a coloured label."""
    bar: tuple[float, float, float] | None = None
    """Value, lower and upper end of its interval, which an HTML page draws as a bar; None for no bar."""
    brief: str = ""
    """Short form of the details, for a LaTeX table; empty for the details themselves."""


#: An axis cuts off values more than this many times the lower median.
CUT_OFF_FACTOR = 4.0


def end_of_axis(sizes: Iterable[float]) -> float:
    """Return the end of an axis for bars: the largest positive size that is no outlier; 0 if no size is positive."""
    ordered = sorted(size for size in sizes if size > 0)
    limit = CUT_OFF_FACTOR * ordered[(len(ordered) - 1) // 2] if ordered else 0.0
    return max((size for size in ordered if size <= limit), default=0.0)


@dataclass(frozen=True)
class Column:
    """Column of a table: heading with unit, explanation, and alignment of the cells."""

    heading: str
    """Text of the heading, with the unit of the column's values."""
    explanation: str = ""
    left: bool = False
    """Whether the cells are flush left (names, sentences) instead of flush right (numbers)."""
    details: str = "details"
    """Heading of the cells' small print, for CSV files, in which it is a column of its own."""


@dataclass(frozen=True)
class Table:
    """Rows of cells under headings; reasons for missing values become numbered footnotes."""

    name: str
    """Name of the table's file (CSV, LaTeX), without ending."""
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""

    @classmethod
    def of_columns(cls, name: str, columns: Sequence[tuple[Column, Sequence[Cell]]], caption: str = "") -> Table:
        """Return a table made from columns; each column is a heading with its cells from top to bottom."""
        rows = zip(*(cells for _, cells in columns), strict=True)
        return cls(name, tuple(column for column, _ in columns), tuple(rows), caption)

    @property
    def reasons(self) -> list[str]:
        """Distinct reasons for missing values, the footnotes of the table, in reading order."""
        return list(dict.fromkeys(cell.reason for row in self.rows for cell in row if cell.reason))

    @property
    def key_column(self) -> int:
        """Index of the column that names the row, which stays in sight when the table scrolls."""
        first = self.rows[0] if self.rows else ()
        return next((i for i, cell in enumerate(first) if cell.tracker), 0)

    def axis(self, index: int) -> tuple[float, float]:
        """Return the lower and upper end of the axis for the bars in the column ``index``; the axis includes zero."""
        bars = [row[index].bar for row in self.rows]
        limit = end_of_axis(abs(bar[0]) for bar in bars if bar)
        shown = [end for bar in bars if bar and abs(bar[0]) <= limit for end in bar]
        return min(0.0, *shown), max(0.0, *shown)

    def mark(self, cell: Cell) -> str:
        """Return the number from 1 of a cell's footnote as text; empty for a cell without footnote."""
        return str(self.reasons.index(cell.reason) + 1) if cell.reason else ""


@dataclass(frozen=True)
class LegendEntry:
    """Entry in a figure's legend: label, colour and symbol."""

    label: str
    colour: str
    """``#rrggbb``, or a named colour of :mod:`trackbench.document.drawing`."""
    mark: Literal["line", "dash", "band", "dot", "box", "upright", "cross", "plus", "ring", "triangle"] = "line"
    key: str = ""
    """``TrackerStyle.key`` of the tracker that the entry is about; empty for other entries."""


@dataclass(frozen=True)
class Figure:
    """Figure with title, caption and legend, drawn only when an output format needs it."""

    name: str
    """Name of the figure's file, without ending: letters, digits and dashes."""
    title: str
    caption: str
    alternative: str
    """Text alternative for readers who cannot see the figure."""
    paint: Callable[[figure.Figure], None]
    """Function that paints the content on an empty matplotlib figure."""
    height: float
    """Height of the figure, pixels."""
    width: float | None = None
    """Width of the figure, pixels; None for the width of a column of text."""
    legend: tuple[LegendEntry, ...] = ()
    tooltips: Mapping[str, str] = field(default_factory=dict)
    """Texts of tooltips, by the gid (group id in the SVG) of the matplotlib artist that has the tooltip."""
    replay: ReplayScene | None = None
    """Scene that an HTML page plays in place of the figure; None to show the figure."""


@dataclass(frozen=True)
class Paragraph:
    """Text of one or more sentences, perhaps emphasised."""

    text: str
    strong: bool = False


@dataclass(frozen=True)
class Status:
    """Highlighted outcome, such as "2 of 3 expectations failed"."""

    text: str
    tone: Tone = ""


@dataclass(frozen=True)
class Item:
    """Item of a bulleted list: label, text and small print."""

    text: str
    label: str = ""
    """Subject of the list item, displayed before the text; empty for none."""
    detail: str = ""
    """Small print after the text; empty for none."""
    tone: Tone = ""


@dataclass(frozen=True)
class Items:
    """Bulleted list of items."""

    items: tuple[Item, ...]


@dataclass(frozen=True)
class Code:
    """Text in fixed-width letters, such as a command."""

    text: str
    language: str = ""


@dataclass(frozen=True)
class Row:
    """Blocks shown side by side where the page is wide enough."""

    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Section:
    """Heading with the blocks under it; sections nest."""

    title: str
    blocks: tuple[Block, ...]
    folded: bool = False
    """Whether an HTML page shows the section closed at first."""


Block = Paragraph | Status | Items | Code | Table | Figure | Row | Section


@dataclass(frozen=True)
class Document:
    """Whole report: title, facts and blocks, free of markup."""

    kind: str
    """Type of report, such as "report" or "comparison"."""
    title: str
    blocks: tuple[Block, ...]
    lead: str = ""
    """Introductory sentence under the title; empty for none."""
    facts: tuple[str, ...] = ()
    """Short facts about the run, such as "seed 7"."""
    trackers: tuple[TrackerStyle, ...] = ()
    """Styles of the trackers that the figures show."""

    @property
    def tables(self) -> list[Table]:
        """All tables of the document, also inside rows and sections, in reading order."""
        return [block for block in all_blocks(self.blocks) if isinstance(block, Table)]

    @property
    def figures(self) -> list[Figure]:
        """All figures of the document, also inside rows and sections, in reading order."""
        return [block for block in all_blocks(self.blocks) if isinstance(block, Figure)]


def all_blocks(blocks: Sequence[Block]) -> Iterator[Block]:
    """Yield each block, and after a row or section the blocks inside it."""
    for block in blocks:
        yield block
        if isinstance(block, (Row, Section)):
            yield from all_blocks(block.blocks)


def with_name_prefix(blocks: Sequence[Block], prefix: str) -> tuple[Block, ...]:
    """Return the blocks with a prefix before the name of each table and figure."""
    renamed: list[Block] = []
    for block in blocks:
        if isinstance(block, (Row, Section)):
            renamed.append(replace(block, blocks=with_name_prefix(block.blocks, prefix)))
        elif isinstance(block, (Table, Figure)):
            renamed.append(replace(block, name=f"{prefix.replace('_', '-')}-{block.name}"))
        else:
            renamed.append(block)
    return tuple(renamed)


def without_figures(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """Return the blocks with all figures removed, and the rows and sections that are then empty."""
    remaining: list[Block] = []
    for block in blocks:
        if isinstance(block, (Row, Section)):
            inner = without_figures(block.blocks)
            remaining += [replace(block, blocks=inner)] if inner else []
        elif not isinstance(block, Figure):
            remaining.append(block)
    return tuple(remaining)


_POWER = re.compile(r"\b((?:m|s|rad|deg)(?:/s)?)\^([23])(?!\.?\d)|\b(m/s)([23])\b")
_UNIT = re.compile(r"(?<=\d) (?=(?:%|°|[mckµ]?m[²³]?|[mµn]?s|k?Hz|rad|deg|dB|MB|kB)(?:/(?:s[²³]?|h))?(?![\w-]))")


def with_powers(text: str) -> str:
    """Return a text in which powers of units are superscript: m/s^2 becomes m/s²."""
    return _POWER.sub(lambda match: f"{match[1] or match[3]}{'²³'[int(match[2] or match[4]) - 2]}", text)


def typeset(text: str) -> str:
    """Return a text with superscript powers, and a no-break space between each number and its unit."""
    return _UNIT.sub("\N{NO-BREAK SPACE}", with_powers(text))
