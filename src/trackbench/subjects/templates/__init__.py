"""A working start for the author of a plug-in: a module, its test and, for trackers, a scenario."""

from trackbench.base.subjects import Offer, Subject

SUBJECT = Subject(
    commands={"new": Offer(f"{__name__}.plug_in:new_command", "Write a plug-in of your own that works, with its test.")}
)
