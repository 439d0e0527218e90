"""Suites that can be cited: scenarios that never change, and trackers entered in them.

A tracker comes in; its entry goes out, a folder of estimates and scores that anyone can check. Read ``suite.py`` first.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"suite": Offer(f"{__name__}.command:suite_command", "Enter a tracker in a suite, and check an entry.")},
)
