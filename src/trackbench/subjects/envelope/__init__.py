"""Operating envelopes: for which sensors, traffic and manoeuvres a tracker meets its requirement.

A scenario with an ``envelope:`` block comes in; a map of cells that hold, fail or are undecided goes out, with the
nearest failing cells as counter-examples. Read ``mapping.py`` first.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"envelope": Offer(f"{__name__}.command:envelope_command", "Map where trackers meet their requirement.")},
    api={"envelope": f"{__name__}.api:envelope"},
    terms={"envelopes": f"{__name__}.terms:map_terms"},
    documents={"claim.json": Offer(f"{__name__}.report:document_of_claim", "")},
    blocks={"envelope": f"{__name__}.config:EnvelopeConfig"},
)
