"""A document as one HTML file that loads nothing, to be read on a screen, a phone or paper."""

from __future__ import annotations

import re
from base64 import b64encode
from collections import Counter
from hashlib import sha256
from typing import Any

from markupsafe import Markup

from trackbench import document as model
from trackbench.document import Cell, Document, LegendEntry, Table, typeset
from trackbench.document.drawing import IN_PAGE, MUTED, svg_in_page
from trackbench.document.packed_replay import packed_replay
from trackbench.document.palette import TRUTH_COLOUR
from trackbench.document.replay import ReplayScene
from trackbench.document.template import environment


def to_html(document: Document) -> str:
    """The text of the file, the same for the same document. Each figure is drawn once."""
    made = environment(typeset)
    shared = _shared(document)
    assert made.loader is not None
    names = ["document.js", *(["replay.js"] if any(figure.replay for figure in document.figures) else [])]
    scripts = [made.loader.get_source(made, name)[0] for name in names]
    return made.get_template("document.html.j2").render(
        document=document,
        sections=[block for block in document.blocks if isinstance(block, model.Section)],
        shared=[entry for entry in shared if not entry.key],
        toggled=len(document.trackers) > 1 and any(entry.key for entry in shared),
        own=lambda figure: [entry for entry in figure.legend if entry not in shared],
        styles={style.name: style for style in document.trackers},
        svg=lambda figure: Markup(svg_in_page(figure)),
        bar_on_axis=_bar,
        css=lambda colour: IN_PAGE.get(colour, colour),
        identity=lambda text: re.sub(r"\W+", "-", text.lower()).strip("-"),
        packed=_packed,
        scripts=[
            {"text": Markup(text), "hash": b64encode(sha256(text.encode()).digest()).decode()} for text in scripts
        ],
    )


def _bar(table: Table, index: int, cell: Cell) -> dict[str, Any]:
    """Where the bar of a cell and its interval are on the axis of its column, in percent, and whether it ends there."""
    assert cell.bar is not None
    begin, end = table.axis(index)
    span = end - begin or 1.0
    zero, value, low, high = (100 * min(max((x - begin) / span, 0.0), 1.0) for x in (0.0, *cell.bar))
    ends = {"left": min(zero, value), "width": abs(value - zero), "low": low, "high": high}
    return {key: f"{end:.2f}" for key, end in ends.items()} | {
        "cut": "left" if cell.bar[0] < begin else "right" if cell.bar[0] > end else ""
    }


def _packed(scene: ReplayScene) -> dict[str, Any]:
    """What a page has of a replay: its scene as text, and the legend of what is no tracker."""
    text, every = packed_replay(scene)
    body = "vehicle, its front filled" if any(path.size[0] for path in scene.paths) else "truth"
    legend = [LegendEntry(body, TRUTH_COLOUR, "box")]
    legend += [LegendEntry(of.sensor, of.colour, "dot") for of in scene.measurements]
    if any(of.false is not None and of.false.any() for of in scene.measurements):
        legend.append(LegendEntry("false alarm", MUTED, "plus"))
    return {"text": text, "every": every, "legend": legend}


def _shared(document: Document) -> list[LegendEntry]:
    """What the legend of the page says for all figures: the trackers, and what more than one figure shows."""
    entries = Counter(entry for figure in document.figures for entry in figure.legend)
    return [entry for entry, figures in entries.items() if entry.key or figures > 1]
