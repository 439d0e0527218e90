"""Tuning: the search for a tracker's best options, by trials on identical measurements.

Scenarios and ranges of options come in; tuned values, and their comparison with the start on held-out scenes or
noise, go out. Read ``tune.py`` first.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"tune": Offer(f"{__name__}.command:tune_command", "Find the options with which trackers do best.")},
    api={"tune": f"{__name__}.api:tune"},
)
