"""Finds the options of a tracker with which it does best: by trials on identical measurements."""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"tune": Offer(f"{__name__}.command:tune_command", "Find the options with which trackers do best.")},
    api={"tune": f"{__name__}.api:tune"},
)
