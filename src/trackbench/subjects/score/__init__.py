"""Scores of tracks that other programs wrote, against the boxes of a file, without a scenario.

Files of tracks and of true boxes come in; a ``Result`` with gates goes out. Read ``scenario.py`` first.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"score": Offer(f"{__name__}.command:score_command", "Score tracks of a file against boxes of another.")},
    api={"score": f"{__name__}.api:score"},
)
