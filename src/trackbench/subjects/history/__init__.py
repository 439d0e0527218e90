"""Results of one scenario in the order in which they were made: what changed, when, and what changed with it."""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"history": Offer(f"{__name__}.command:history_command", "Show how results changed over time.")},
    documents={"history.json": Offer(f"{__name__}.report:saved_history", "")},
    api={"history": f"{__name__}.api:history"},
)
