"""Conversion of a table to LaTeX: a ``tabular`` with booktabs rules."""

from __future__ import annotations

from trackbench.document import Cell, Table, typeset

#: A column with a longer cell, in letters, breaks lines.
_LONG = 40
#: LaTeX for characters that pdflatex does not know.
_SIGNS = str.maketrans(
    {
        "\N{NO-BREAK SPACE}": "~",
        "\N{MINUS SIGN}": "$-$",
        "\N{LESS-THAN OR EQUAL TO}": r"$\leq$",
        "\N{GREATER-THAN OR EQUAL TO}": r"$\geq$",
        "\N{RIGHTWARDS ARROW}": r"$\rightarrow$",
        "\N{GREEK SMALL LETTER SIGMA}": r"$\sigma$",
    }
)


def table_to_latex(table: Table) -> str:
    """Return a table as a ``tabular`` with booktabs rules, after comments with its caption and footnotes."""
    # Pandas is slow to import.
    import pandas

    headings = [typeset(column.heading) for column in table.columns]
    texts = pandas.DataFrame([[_text(cell) for cell in row] for row in table.rows], columns=headings, dtype=object)
    bold = [["textbf: --rwrap;" if cell.strong or cell.tracker else "" for cell in row] for row in table.rows]
    columns = zip(table.columns, zip(*table.rows, strict=True), strict=bool(table.rows))
    widths = [
        r"p{0.35\linewidth}" if max(len(cell.text) for cell in cells) > _LONG else "l" if column.left else "r"
        for column, cells in columns
    ]
    styler = texts.style.hide(axis="index").format(escape="latex").format_index(escape="latex", axis="columns")
    styler = styler.apply(lambda shown: pandas.DataFrame(bold, shown.index, shown.columns, dtype=object), axis=None)
    notes = [table.caption] * bool(table.caption) + [f"n/a: {reason}" for reason in table.reasons]
    tabular: str = styler.to_latex(hrules=True, column_format=f"@{{}}{''.join(widths)}@{{}}")
    return "".join(f"% {' '.join(note.split())}\n" for note in notes) + tabular.translate(_SIGNS)


def _text(cell: Cell) -> str:
    details = cell.brief or ", ".join(cell.details)
    return typeset(f"{cell.text} ({details})" if details else cell.text)
