"""Tracks that other programs wrote, scored against boxes of a file, without a scenario."""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"score": Offer(f"{__name__}.command:score_command", "Score tracks of a file against boxes of another.")},
    api={"score": f"{__name__}.api:score"},
)
