"""Suites that can be cited: scenarios that never change, entries that someone else can check, and a page of both."""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"suite": Offer(f"{__name__}.command:suite_command", "Enter a tracker in a suite, and check an entry.")},
)
