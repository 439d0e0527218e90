"""Servers of trackers: a simulator sends measurements over the network and gets estimates.

A tracker of a scenario and a client's frames (messages) come in; frames with estimates go out. Read ``session.py``
first.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={
        "serve": Offer(f"{__name__}.command:serve_command", "Let a simulator drive a tracker of a scenario, live.")
    }
)
