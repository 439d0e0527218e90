"""Templates of plug-ins: a working module, its test and, for trackers, a scenario.

A kind and a name come in (``trackbench new``); the files of a new plug-in go out. Read ``plug_in.py`` first.
"""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"new": Offer(f"{__name__}.plug_in:new_command", "Write a plug-in of your own that works, with its test.")}
)
