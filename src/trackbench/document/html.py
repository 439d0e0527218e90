"""Conversion of a document to one HTML file that loads no other file, for a screen, a phone or paper."""

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
    """Return the text of the HTML file. Equal documents give equal texts."""
    templates = environment(typeset)
    shared = _shared_legend(document)
    assert templates.loader is not None
    names = ["document.js", *(["replay.js"] if any(figure.replay for figure in document.figures) else [])]
    scripts = [templates.loader.get_source(templates, name)[0] for name in names]
    return templates.get_template("document.html.j2").render(
        document=document,
        sections=[block for block in document.blocks if isinstance(block, model.Section)],
        shared=[entry for entry in shared if not entry.key],
        toggled=len(document.trackers) > 1 and any(entry.key for entry in shared),
        own=lambda figure: [entry for entry in figure.legend if entry not in shared],
        styles={style.name: style for style in document.trackers},
        svg=lambda figure: Markup(svg_in_page(figure)),
        bar_on_axis=_bar_on_axis,
        css=lambda colour: IN_PAGE.get(colour, colour),
        identity=lambda text: re.sub(r"\W+", "-", text.lower()).strip("-"),
        packed=_replay_of_page,
        scripts=[
            {"text": Markup(text), "hash": b64encode(sha256(text.encode()).digest()).decode()} for text in scripts
        ],
    )


def _bar_on_axis(table: Table, index: int, cell: Cell) -> dict[str, Any]:
    """Return a cell's bar in % of the axis: start, width and ends of the interval; and the side that is cut off."""
    assert cell.bar is not None
    begin, end = table.axis(index)
    span = end - begin or 1.0
    zero, value, low, high = (100 * min(max((x - begin) / span, 0.0), 1.0) for x in (0.0, *cell.bar))
    ends = {"left": min(zero, value), "width": abs(value - zero), "low": low, "high": high}
    return {key: f"{end:.2f}" for key, end in ends.items()} | {
        "cut": "left" if cell.bar[0] < begin else "right" if cell.bar[0] > end else ""
    }


def _replay_of_page(scene: ReplayScene) -> dict[str, Any]:
    """Return the packed scene for a page, its thinning factor, and its legend of vehicles, sensors and false alarms."""
    text, every = packed_replay(scene)
    body = "vehicle, its front filled" if any(path.size[0] for path in scene.paths) else "truth"
    legend = [LegendEntry(body, TRUTH_COLOUR, "box")]
    legend += [LegendEntry(series.sensor, series.colour, "dot") for series in scene.measurements]
    if any(series.false is not None and series.false.any() for series in scene.measurements):
        legend.append(LegendEntry("false alarm", MUTED, "plus"))
    return {"text": text, "every": every, "legend": legend}


def _shared_legend(document: Document) -> list[LegendEntry]:
    """Return the legend of the whole page: entries of trackers, and other entries that several figures have."""
    entries = Counter(entry for figure in document.figures for entry in figure.legend)
    return [entry for entry, figures in entries.items() if entry.key or figures > 1]
