"""A document as LaTeX for pdflatex: tables with booktabs rules and figures are files beside it."""

from __future__ import annotations

import re
from functools import cache

from jinja2 import Environment
from markupsafe import Markup

from trackbench.document import Code, Document, Table, typeset
from trackbench.document.template import LATEX_SYNTAX, environment

#: Letters of a cell above which its column breaks lines.
_LONG = 40
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
    return (
        _environment()
        .get_template("document.tex.j2")
        .render(document=document, facts=", ".join(document.facts), tables=Markup(tables), figures=Markup(figures))
    )


def table_to_latex(table: Table) -> str:
    """The text of a table's own file: a ``table`` with caption, label and footnotes, to be put into any document.

    Details stand in a smaller line under the row. It needs the packages booktabs and adjustbox. The label is ``tab:``
    and the table's name.
    """
    caption = table.caption or re.sub("[-_]", " ", table.name).capitalize()
    return _environment().get_template("table.tex.j2").render(table=table, caption=caption, long=_LONG)


def escape_latex(text: str) -> str:
    """``text`` as it is, whatever LaTeX it looks like, but for its units."""
    return _verbatim(typeset(text))


def _verbatim(text: str) -> Markup:
    return Markup(_SPECIAL.sub(lambda match: _ESCAPES[match[0]], text))


@cache
def _environment() -> Environment:
    made = environment(escape_latex, LATEX_SYNTAX)
    made.globals["code_lines"] = _code_lines
    return made


def _code_lines(block: Code) -> list[tuple[float, Markup]]:
    """The indent and the text of each line: a whole text could end any environment for verbatim text."""
    lines = block.text.rstrip("\n").splitlines()
    return [((len(line) - len(line.lstrip())) / 2, _verbatim(line.strip())) for line in lines]
