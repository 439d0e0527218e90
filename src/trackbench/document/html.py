"""A document as one HTML file that loads nothing, to be read on a screen, a phone or paper."""

from __future__ import annotations

import re
from collections import Counter
from functools import partial
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from trackbench import document as model
from trackbench.document import Block, Document, Figure, LegendEntry
from trackbench.document.drawing import IN_PAGE, WIDTH, svg_in_page


def to_html(document: Document) -> str:
    """The text of the file, the same for the same document. Each figure is drawn once."""
    environment = Environment(
        loader=PackageLoader("trackbench.document"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    tests: Any = environment.tests
    for kind in (model.Section, model.Row, model.Paragraph, model.Status, model.Items, model.Code, model.Table, Figure):
        tests[kind.__name__.lower()] = partial(_is_a, kind)
    before, drawn, after = _parts(document)
    shared = _shared(drawn)
    made: Any = environment.get_template("document.html.j2").render(
        document=document,
        before=before,
        drawn=drawn,
        after=after,
        shared=[entry for entry in shared if not entry.key],
        own=lambda figure: [entry for entry in figure.legend if entry not in shared],
        styles={style.name: style for style in document.trackers},
        svg=lambda figure: Markup(svg_in_page(figure)),
        css=lambda colour: IN_PAGE.get(colour, colour),
        identity=lambda text: re.sub(r"\W+", "-", text.lower()).strip("-"),
        column_width=WIDTH,
    )
    return str(made)


def _is_a(kind: type, block: object) -> bool:
    return isinstance(block, kind)


def _parts(document: Document) -> tuple[tuple[Block, ...], ...]:
    """The blocks before the first that shows trackers in figures, those up to the last, and the rest."""
    blocks = document.blocks
    showing = [i for i, block in enumerate(blocks) if any(_shows_trackers(inner) for inner in model.every([block]))]
    if not showing or len(document.trackers) < 2:
        return blocks, (), ()
    first, last = showing[0], showing[-1] + 1
    return blocks[:first], blocks[first:last], blocks[last:]


def _shared(blocks: tuple[Block, ...]) -> list[LegendEntry]:
    """What the legend of the page says for all figures: the trackers, and what more than one figure shows."""
    entries = Counter(entry for block in model.every(blocks) if isinstance(block, Figure) for entry in block.legend)
    return [entry for entry, figures in entries.items() if entry.key or figures > 1]


def _shows_trackers(block: Block) -> bool:
    return isinstance(block, Figure) and any(entry.key for entry in block.legend)
