"""A document as LaTeX for pdflatex: tables with booktabs rules and figures are files beside it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from trackbench.document import (
    Block,
    Cell,
    Code,
    Column,
    Document,
    Figure,
    Items,
    Paragraph,
    Row,
    Section,
    Status,
    Table,
    typeset,
)

_PREAMBLE = r"""\documentclass[a4paper]{article}
\usepackage[T1]{fontenc}
\usepackage[utf8]{inputenc}
\usepackage{textcomp,amsmath,amssymb}
\usepackage[margin=20mm]{geometry}
\usepackage{booktabs,float,graphicx}
\floatplacement{table}{H}
\usepackage[export]{adjustbox}
\setlength{\parindent}{0pt}
\setlength{\parskip}{0.5em}
"""
_HEADINGS = ("section", "subsection", "subsubsection", "paragraph")
#: Letters of a cell above which its column breaks lines.
_LONG = 40
_BROKEN = r"p{0.35\linewidth}"

_ESCAPES = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    # Two would become a dash.
    "-": "-{}",
    "\N{NO-BREAK SPACE}": "~",
    "\N{MINUS SIGN}": "$-$",
    "\N{LESS-THAN OR EQUAL TO}": r"$\leq$",
    "\N{GREATER-THAN OR EQUAL TO}": r"$\geq$",
    "\N{RIGHTWARDS ARROW}": r"$\rightarrow$",
    "\N{SUPERSCRIPT TWO}": r"\textsuperscript{2}",
    "\N{SUPERSCRIPT THREE}": r"\textsuperscript{3}",
    "\N{GREEK SMALL LETTER MU}": r"\textmu{}",
    "\N{GREEK SMALL LETTER SIGMA}": r"$\sigma$",
}
_SPECIAL = re.compile("|".join("-(?=-)" if letter == "-" else re.escape(letter) for letter in _ESCAPES))


def to_latex(document: Document, *, tables: str, figures: str) -> str:
    """The text of the main file.

    Args:
        document: what it says.
        tables: the folder of the tables' files (:func:`table_to_latex`), relative to the main file.
        figures: the folder of the figures' PDF files, likewise.
    """
    lines = [_PREAMBLE + r"\begin{document}", rf"\section*{{{escape_latex(document.title)}}}"]
    lines += [escape_latex(document.lead), ""] if document.lead else []
    lines += [escape_latex(", ".join(document.facts)), ""] if document.facts else []
    for block in document.blocks:
        lines += _lines(block, 0, tables, figures)
    return "\n".join([*lines, r"\end{document}"]) + "\n"


def table_to_latex(table: Table) -> str:
    """The text of a table's own file: a ``table`` with caption, label and footnotes, to be put into any document.

    Details stand in a smaller line under the row. It needs the packages booktabs and adjustbox. The label is ``tab:``
    and the table's name.
    """
    layout = "".join(_layout(table, i, column) for i, column in enumerate(table.columns))
    caption = table.caption or re.sub("[-_]", " ", table.name).capitalize()
    lines = [r"\begin{table}", r"\centering", rf"\caption{{{escape_latex(caption)}}}", rf"\label{{tab:{table.name}}}"]
    lines += [r"\begin{adjustbox}{max width=\linewidth}", rf"\begin{{tabular}}{{@{{}}{layout}@{{}}}}", r"\toprule"]
    lines += [_row(escape_latex(column.heading) for column in table.columns), r"\midrule"]
    for row in table.rows:
        lines.append(_row(_cell(table, cell) for cell in row))
        for i in range(max((len(cell.details) for cell in row), default=0)):
            lines.append(_row(_small(cell.details[i]) if i < len(cell.details) else "" for cell in row))
    lines += [r"\bottomrule", r"\end{tabular}", r"\end{adjustbox}"]
    lines += [
        rf"\par\footnotesize\textsuperscript{{{i}}} {escape_latex(reason)}" for i, reason in enumerate(table.reasons, 1)
    ]
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def escape_latex(text: str) -> str:
    """``text`` as it is, whatever LaTeX it looks like, but for its units."""
    return _verbatim(typeset(text))


def _verbatim(text: str) -> str:
    return _SPECIAL.sub(lambda match: _ESCAPES[match[0]], text)


def _lines(block: Block, level: int, tables: str, figures: str) -> Iterator[str]:
    match block:
        case Section():
            yield rf"\{_HEADINGS[min(level, len(_HEADINGS) - 1)]}{{{escape_latex(block.title)}}}"
            for inner in block.blocks:
                yield from _lines(inner, level + 1, tables, figures)
        case Row():
            for inner in block.blocks:
                yield from _lines(inner, level, tables, figures)
        case Paragraph():
            yield from (rf"\textbf{{{escape_latex(block.text)}}}" if block.strong else escape_latex(block.text), "")
        case Status():
            yield from (f"{escape_latex(block.text)}.", "")
        case Items():
            yield from _items(block)
        case Code():
            yield from _code(block)
        case Table():
            yield rf"\input{{{tables}/{block.name}.tex}}"
        case Figure():
            yield from (r"\begin{figure}[H]", r"\centering")
            yield rf"\includegraphics[max width=\linewidth]{{{figures}/{block.name}.pdf}}"
            yield rf"\caption{{{escape_latex(f'{block.title}. {block.caption}')}}}"
            yield from (rf"\label{{fig:{block.name}}}", r"\end{figure}")


def _items(block: Items) -> Iterator[str]:
    if not block.items:
        return
    environment = "enumerate" if block.numbered else "itemize"
    yield rf"\begin{{{environment}}}"
    for item in block.items:
        label = rf"\textbf{{{escape_latex(item.label)}}}: " if item.label else ""
        detail = rf"\\{{\small {escape_latex(item.detail)}}}" if item.detail else ""
        # A bracket after \item would be its option.
        yield rf"\item {{}}{label}{escape_latex(item.text)}{detail}"
    yield rf"\end{{{environment}}}"


def _code(block: Code) -> Iterator[str]:
    """Line by line: a text could end any environment for verbatim text."""
    yield r"\begin{flushleft}\ttfamily\footnotesize"
    for line in block.text.rstrip("\n").splitlines():
        indent = len(line) - len(line.lstrip())
        yield rf"\mbox{{}}\hspace*{{{indent / 2:g}em}}{_verbatim(line.strip())}\\"
    yield r"\end{flushleft}"


def _layout(table: Table, index: int, column: Column) -> str:
    longest = max((len(row[index].text) for row in table.rows), default=0)
    return _BROKEN if longest > _LONG else "l" if column.left else "r"


def _row(cells: Iterable[str]) -> str:
    return " & ".join(cells) + r" \\"


def _small(text: str) -> str:
    return rf"{{\scriptsize {escape_latex(text)}}}"


def _cell(table: Table, cell: Cell) -> str:
    text = rf"\textbf{{{escape_latex(cell.text)}}}" if cell.strong or cell.tracker else escape_latex(cell.text)
    return text + (rf"\textsuperscript{{{table.mark(cell)}}}" if cell.reason else "")
