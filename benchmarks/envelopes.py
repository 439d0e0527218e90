"""The envelopes that come with trackbench, as results/envelope: a page, the cells, the claim and a picture of each.

python -m benchmarks.envelopes [NAME...]
"""

from __future__ import annotations

import csv
import io
import re
import sys
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

from trackbench.api.plan import Listener
from trackbench.api.scenario import load
from trackbench.base.execution import executor
from trackbench.document import Document, Paragraph, Section
from trackbench.document.drawing import svg_file
from trackbench.document.markdown import to_markdown
from trackbench.scenario.shipped import shipped
from trackbench.subjects.envelope.api import EnvelopePlan, make_envelope
from trackbench.subjects.envelope.claim import Claim
from trackbench.subjects.envelope.files import claim_text
from trackbench.subjects.envelope.report import envelope_document

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results" / "envelope"
#: The folders of counter-examples are not committed.
LINK = re.compile(r"\[([^\]]*)\]\(counter_examples/[^)]*\)")
#: Sections with a row for each cell or run, which the page leaves to the data beside it.
LONG = ("Cells",)


def page(document: Document, stem: str) -> str:
    """Return the Markdown of an envelope without the long sections, which the cells and the claim hold."""
    blocks = [block for block in document.blocks if not (isinstance(block, Section) and block.title in LONG)]
    beside = Paragraph(f"Every cell is in {stem}.csv, the whole claim in {stem}.json.")
    return LINK.sub(r"\1", to_markdown(replace(document, blocks=(*blocks, beside))))


def cells_csv(claim: Claim) -> str:
    """Return a row for each cell, tracker and limit: where the cell is, its state, the value and its bounds."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    axes = [axis.name for axis in claim.axes]
    rows.writerow([*axes, "tracker", "state", "metric", "value", "low", "high", "scenes", "runs", "cause"])
    for cell in claim.cells:
        place = [axis.shown(cell.point[number]) for number, axis in enumerate(claim.axes)]
        for tracker, state in cell.trackers.items():
            beside = [state.scenes, state.runs, state.cause]
            for limit, value in zip_longest(claim.limits_of(tracker), state.values):
                metric = "" if limit is None else limit.metric
                numbers = [None] * 3 if value is None else [value.value, value.low, value.high]
                shown = ["" if number is None else f"{number:.4g}" for number in numbers]
                rows.writerow([*place, tracker, state.state, metric, *shown, *beside])
    return text.getvalue()


def main() -> None:
    names = sys.argv[1:] or [name for name in shipped() if name.startswith("envelope/")]
    (RESULTS / "figures").mkdir(parents=True, exist_ok=True)
    for name in names:
        with executor(None) as chosen:
            made = make_envelope(load(name), EnvelopePlan(), chosen, Listener())
        document = envelope_document(made)
        stem = made.claim.scenario
        (RESULTS / f"{stem}.json").write_text(claim_text(made.claim), encoding="utf-8")
        (RESULTS / f"{stem}.csv").write_text(cells_csv(made.claim), encoding="utf-8")
        (RESULTS / f"{stem}.md").write_text(page(document, stem), encoding="utf-8")
        picture = svg_file(document.figures[0])
        (RESULTS / "figures" / f"{stem}.svg").write_text(picture, encoding="utf-8")


if __name__ == "__main__":
    main()
