"""The scans of a scenario, and its truth apart, as files for programs that track elsewhere."""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={
        "export": Offer(f"{__name__}.command:export_command", "Write the scans of a scenario for other programs.")
    },
    api={"export": f"{__name__}.api:export"},
)
