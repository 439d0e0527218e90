"""Trackers as live servers: a client sends measurements and gets estimates."""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={
        "serve": Offer(f"{__name__}.command:serve_command", "Let a simulator drive a tracker of a scenario, live.")
    }
)
