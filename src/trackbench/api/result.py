"""Result, report and figure that a notebook can show."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any, Self

from trackbench import results
from trackbench.base.errors import InputError, nearest_choices
from trackbench.document import Document, Figure
from trackbench.document.files import document_text, files_by_ending, require_ending


class HasFigures:
    """Base of results and comparisons, whose report has named figures."""

    def report(self) -> Report:
        """Return the report, with its text, tables and figures."""
        raise NotImplementedError

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of the report's figures."""
        return tuple(figure.name for figure in self.report().document.figures)

    def figure(self, name: str) -> ReportFigure:
        """Return the figure with this name, one of ``figures``.

        Raises:
            InputError: there is no figure of this name.
        """
        figures = {figure.name: figure for figure in self.report().document.figures}
        if name not in figures:
            raise InputError(f"no figure {name!r} in this report; {nearest_choices(name, figures)}")
        return ReportFigure(figures[name])


class ReportableResult(HasFigures, results.Result):
    """Result of a scenario, which a notebook shows as its ranking.

    ``result["ekf_cv"].position_rmse.value`` is a metric of a tracker; ``result.to_pandas("steps")`` is a table.
    """

    @classmethod
    def of(cls, result: results.Result) -> Self:
        """Return the result with methods for its report, its figures and its display in a notebook."""
        return cls(result.summary, result.tables)

    def report(self) -> Report:
        """Return the report that ``trackbench run`` writes of this result."""
        from trackbench.report.result import result_document

        return Report(result_document(self))

    def _repr_html_(self) -> str:
        import pandas

        from trackbench.report.tables import ranking_table

        table = ranking_table(self)
        rows = [[" ".join([cell.text, *cell.details]) for cell in row] for row in table.rows]
        shown = pandas.DataFrame(rows, columns=[column.heading for column in table.columns]).to_html(index=False)
        missing = (f"<p>{escape(f'{each.name}: {self.why_unscored(each)}')}</p>" for each in self.unscored)
        return "".join([shown, *missing])


#: Height of a report in a notebook, which scrolls, pixels.
HEIGHT = 640
FIGURE_ENDINGS = (".svg", ".pdf", ".png")


class Report:
    """Report of a run or comparison, which a notebook shows as a page and ``print`` as text."""

    def __init__(self, document: Document) -> None:
        self.document = document

    def __repr__(self) -> str:
        return f"<{self.document.kind} {self.document.title}>"

    def __str__(self) -> str:
        return document_text(self.document)

    def _repr_html_(self) -> str:
        from trackbench.document.html import to_html

        # A page has styles of its own, which the notebook's must not meet.
        page = escape(to_html(self.document), quote=True)
        return f'<iframe srcdoc="{page}" width="100%" height="{HEIGHT}" style="border: 0"></iframe>'

    def save(self, path: Path | str) -> None:
        """Write the report in the format of the file's ending.

        Args:
            path: ``.html``, ``.md`` or ``.txt`` for the report; ``.csv`` or ``.tex`` for its tables; ``.svg``, ``.pdf``
                or ``.png`` for its figures. Several tables or figures each get a file, named after this one:
                ``x-ranking.csv``.

        Raises:
            InputError: the ending is none of these.
            TrackbenchError: the file cannot be written.
        """
        file = Path(path)
        require_ending(file)
        for name, content in files_by_ending(self.document, file):
            results.write_bytes(name, content)


class ReportFigure:
    """Figure of a report, which a notebook shows."""

    def __init__(self, figure: Figure) -> None:
        self.figure = figure

    def __repr__(self) -> str:
        return f"<figure {self.figure.name}: {self.figure.title}>"

    def _repr_svg_(self) -> str:
        from trackbench.document.drawing import figure_file

        return figure_file(self.figure, "svg").decode()

    def save(self, path: Path | str) -> None:
        """Write the figure, with its legend, as ``.svg``, ``.pdf`` or ``.png``.

        Raises:
            InputError: the ending is none of these.
            TrackbenchError: the file cannot be written.
        """
        from trackbench.document.drawing import figure_file

        file = Path(path)
        require_ending(file, FIGURE_ENDINGS)
        results.write_bytes(file, figure_file(self.figure, file.suffix.removeprefix(".")))

    def to_matplotlib(self) -> Any:
        """Return the figure, with its legend, as a ``matplotlib.figure.Figure`` to be changed or saved."""
        from trackbench.document.drawing import matplotlib_figure

        return matplotlib_figure(self.figure)
