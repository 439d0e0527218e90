"""Exports of a scenario's scans, and of its ground truth, as files for other tracking programs.

A scenario comes in; a folder of scans, and another folder of truth, go out. Read ``api.py`` first.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={
        "export": Offer(f"{__name__}.command:export_command", "Write the scans of a scenario for other programs.")
    },
    api={"export": f"{__name__}.api:export"},
)
