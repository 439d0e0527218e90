"""The envelopes that come with trackbench, as results/envelope: a page, the claim and a picture of each.

python -m benchmarks.envelopes [NAME...]
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from trackbench.api.plan import Listener
from trackbench.api.scenario import load
from trackbench.base.execution import executor
from trackbench.document.drawing import svg_file
from trackbench.document.markdown import to_markdown
from trackbench.scenario.shipped import shipped
from trackbench.subjects.envelope.api import EnvelopePlan, make_envelope
from trackbench.subjects.envelope.files import claim_text
from trackbench.subjects.envelope.report import envelope_document

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results" / "envelope"
#: The folders of counter-examples are not committed.
LINK = re.compile(r"\[([^\]]*)\]\(counter_examples/[^)]*\)")


def main() -> None:
    names = sys.argv[1:] or [name for name in shipped() if name.startswith("envelope/")]
    (RESULTS / "figures").mkdir(parents=True, exist_ok=True)
    for name in names:
        with executor(None) as chosen:
            made = make_envelope(load(name), EnvelopePlan(), chosen, Listener())
        document = envelope_document(made)
        stem = made.claim.scenario
        (RESULTS / f"{stem}.json").write_text(claim_text(made.claim), encoding="utf-8")
        page = LINK.sub(r"\1", to_markdown(document))
        (RESULTS / f"{stem}.md").write_text(page, encoding="utf-8")
        picture = svg_file(document.figures[0])
        (RESULTS / "figures" / f"{stem}.svg").write_text(picture, encoding="utf-8")


if __name__ == "__main__":
    main()
